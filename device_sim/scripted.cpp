#include "device_sim/scripted.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "device_sim/rotation_rate.h"
#include "device_sim/simulated.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double end_tolerance_s = 1e-9;  // a step time n*h may exceed the last way-point by rounding

bool finite(const Quaternion& q) {
  return std::isfinite(q.s) && std::isfinite(q.x) && std::isfinite(q.y) && std::isfinite(q.z);
}

bool same(const Quaternion& a, const Quaternion& b) {
  return a.s == b.s && a.x == b.x && a.y == b.y && a.z == b.z;
}

// Refuses what cannot be followed; normalises the orientations.
ScriptedTrajectory checked(ScriptedTrajectory trajectory) {
  std::vector<Waypoint>& points = trajectory.waypoints;
  if (points.empty()) throw InputError("trajectory: no way-points; give at least one");
  for (std::size_t i = 0; i < points.size(); ++i) {
    Waypoint& p = points[i];
    const std::string place = "trajectory: way-point " + std::to_string(i) + ": ";
    if (!std::isfinite(p.time_s)) throw InputError(place + "time is not finite; give seconds");
    if (!p.position_m.allFinite()) throw InputError(place + "position is not finite; give metres");
    if (!finite(p.orientation)) throw InputError(place + "orientation is not finite; give a unit quaternion");
    const Quaternion& q = p.orientation;
    const double norm = std::sqrt(q.s * q.s + q.x * q.x + q.y * q.y + q.z * q.z);
    if (!(std::abs(norm - 1) <= 0.01)) {
      throw InputError(place + "orientation has length " + std::to_string(norm) +
                       "; expected a unit quaternion (s, x, y, z)");
    }
    p.orientation = normalised(p.orientation);
    if (i == 0) continue;
    const Waypoint& before = points[i - 1];
    if (!(p.time_s > before.time_s)) {
      throw InputError(place + "time " + std::to_string(p.time_s) + " s is not after " +
                       std::to_string(before.time_s) + " s; times must increase");
    }
    const bool moves = p.position_m != before.position_m || !same(p.orientation, before.orientation);
    if (p.path == Path::hold && moves) {
      throw InputError(place +
                       "path is 'hold' but the pose differs from the way-point before; repeat that pose");
    }
  }
  return trajectory;
}

struct Progress {
  double share = 0;    // of the segment's path, 0..1
  double rate_Hz = 0;  // its time derivative, 1/s
};

Progress progress(Path path, double tau, double duration_s) {
  switch (path) {
    case Path::linear:
      return {tau, 1 / duration_s};
    case Path::minimum_jerk:
      return {tau * tau * tau * (10 + tau * (-15 + 6 * tau)),
              30 * tau * tau * (1 - tau) * (1 - tau) / duration_s};
    case Path::hold:
    case Path::spline:
      break;
  }
  return {};
}

// Cubic Hermite curve from 0 to `way` in `duration_s` with the end velocities given; value and time
// derivative.
struct Curve {
  Vec3 value, rate;
};

Curve hermite(const Vec3& way, const Vec3& rate_0, const Vec3& rate_1, double tau, double duration_s) {
  const double tau2 = tau * tau, tau3 = tau2 * tau;
  return {
      (3 * tau2 - 2 * tau3) * way + duration_s * ((tau - 2 * tau2 + tau3) * rate_0 + (tau3 - tau2) * rate_1),
      (6 * tau - 6 * tau2) / duration_s * way + (1 - 4 * tau + 3 * tau2) * rate_0 +
          (3 * tau2 - 2 * tau) * rate_1};
}

Vec3 turn_between(const Quaternion& a, const Quaternion& b) {
  return rotation_vector(b * conjugate(a));
}

// Velocity at the middle of three points of a parabola: the means of the two segments, each weighted with the
// duration of the other.
Vec3 middle_rate(const Vec3& way_0, double duration_0_s, const Vec3& way_1, double duration_1_s) {
  return (way_0 / duration_0_s * duration_1_s + way_1 / duration_1_s * duration_0_s) /
         (duration_0_s + duration_1_s);
}

}  // namespace

ScriptedPath::ScriptedPath(ScriptedTrajectory trajectory)
    : trajectory_(checked(std::move(trajectory))), tones_(make_tones(trajectory_.tremor)) {
  set_tangents();
}

void ScriptedPath::set_tangents() {
  const std::vector<Waypoint>& points = trajectory_.waypoints;
  tangents_.resize(points.size());
  for (std::size_t i = 1; i + 1 < points.size(); ++i) {
    const Waypoint &a = points[i - 1], &b = points[i], &c = points[i + 1];
    if (b.path != Path::spline || c.path != Path::spline) continue;
    const double before_s = b.time_s - a.time_s, after_s = c.time_s - b.time_s;
    tangents_[i].linear =
        middle_rate(b.position_m - a.position_m, before_s, c.position_m - b.position_m, after_s);
    tangents_[i].angular = middle_rate(turn_between(a.orientation, b.orientation), before_s,
                                       turn_between(b.orientation, c.orientation), after_s);
  }
}

HandMotion ScriptedPath::along_segment(std::size_t end, double time_s) const {
  const Waypoint &a = trajectory_.waypoints[end - 1], &b = trajectory_.waypoints[end];
  const double duration_s = b.time_s - a.time_s;
  const double tau = (time_s - a.time_s) / duration_s;
  const Vec3 way = b.position_m - a.position_m;
  const Vec3 turn = turn_between(a.orientation, b.orientation);
  HandMotion motion;
  Vec3 done, turned;
  if (b.path == Path::spline) {
    const Tangent &from = tangents_[end - 1], &to = tangents_[end];
    const Curve position = hermite(way, from.linear, to.linear, tau, duration_s);
    const Curve rotation = hermite(turn, from.angular, rotation_rate_of(turn, to.angular), tau, duration_s);
    done = position.value;
    turned = rotation.value;
    motion.linear_velocity = position.rate;
    motion.angular_velocity = angular_velocity_of(rotation.value, rotation.rate);
  } else {
    const Progress progressed = progress(b.path, tau, duration_s);
    done = progressed.share * way;
    turned = progressed.share * turn;
    motion.linear_velocity = progressed.rate_Hz * way;
    motion.angular_velocity = progressed.rate_Hz * turn;
  }
  // At the way-point itself its very numbers, free of rounding.
  const bool arrived = time_s == b.time_s;
  motion.position = arrived ? b.position_m : Vec3(a.position_m + done);
  motion.orientation =
      arrived ? b.orientation : normalised(quaternion_from_rotation_vector(turned) * a.orientation);
  motion.buttons = arrived ? b.buttons : a.buttons;
  return motion;
}

HandMotion ScriptedPath::at(double time_s) const {
  const std::vector<Waypoint>& points = trajectory_.waypoints;
  // The segment that ends at the first way-point not before time_s.
  const auto not_before = std::lower_bound(points.begin(), points.end(), time_s,
                                           [](const Waypoint& p, double t) { return p.time_s < t; });
  const std::size_t end = std::min(static_cast<std::size_t>(not_before - points.begin()), points.size() - 1);
  HandMotion motion;
  if (end == 0 || time_s > points[end].time_s) {
    const bool reached = time_s >= points[end].time_s;
    motion = {points[end].position_m, points[end].orientation, Vec3::Zero(), Vec3::Zero(),
              reached ? points[end].buttons : 0};
  } else {
    motion = along_segment(end, time_s);
  }

  const Tremor& tremor = trajectory_.tremor;
  if (tremor.position_rms_m > 0 || tremor.rotation_rms_rad > 0) {
    const TremorMotion shake = tremor_at(tones_, time_s);
    const Quaternion turn = quaternion_from_rotation_vector(shake.rotation);
    motion.position += shake.position;
    motion.linear_velocity += shake.velocity;
    motion.orientation = normalised(turn * motion.orientation);
    motion.angular_velocity = angular_velocity_of(shake.rotation, shake.rotation_rate) +
                              rotation_matrix(turn) * motion.angular_velocity;
  }
  return motion;
}

namespace {

class ScriptedDevice final : public SimulatedDevice {
 public:
  explicit ScriptedDevice(ScriptedTrajectory trajectory) : path_(std::move(trajectory)) {}

  DeviceCapabilities capabilities() const override { return {.model = "scripted"}; }

 private:
  DeviceError sample_at(double time_s, DeviceSample& sample) override {
    if (time_s > path_.end_s() + end_tolerance_s) return DeviceError::ended;
    sample = DeviceSample();
    stamp(time_s, sample);
    put(path_.at(time_s), sample);
    return DeviceError::none;
  }

  ScriptedPath path_;
};

}  // namespace

void put(const HandMotion& motion, DeviceSample& sample) {
  sample.position = motion.position;
  sample.orientation = motion.orientation;
  sample.linear_velocity = motion.linear_velocity;
  sample.angular_velocity = motion.angular_velocity;
  sample.linear_velocity_valid = sample.angular_velocity_valid = true;
  sample.buttons = motion.buttons;
}

std::unique_ptr<Device> make_scripted_device(ScriptedTrajectory trajectory) {
  return std::make_unique<ScriptedDevice>(std::move(trajectory));
}

}  // namespace sulcus
