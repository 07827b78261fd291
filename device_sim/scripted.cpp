#include "device_sim/scripted.h"

#include <cmath>
#include <string>
#include <utility>

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
      break;
  }
  return {};
}

class ScriptedDevice final : public SimulatedDevice {
 public:
  explicit ScriptedDevice(ScriptedTrajectory trajectory) : trajectory_(checked(std::move(trajectory))) {}

  DeviceCapabilities capabilities() const override { return {.model = "scripted"}; }

 private:
  DeviceError sample_at(double time_s, DeviceSample& sample) override;

  ScriptedTrajectory trajectory_;
};

DeviceError ScriptedDevice::sample_at(double time_s, DeviceSample& sample) {
  const std::vector<Waypoint>& points = trajectory_.waypoints;
  if (time_s > points.back().time_s + end_tolerance_s) return DeviceError::ended;
  sample = DeviceSample();
  stamp(time_s, sample);
  sample.linear_velocity_valid = sample.angular_velocity_valid = true;

  // The segment that ends at the first way-point not before time_s.
  std::size_t end = 0;
  while (end + 1 < points.size() && points[end].time_s < time_s) ++end;
  const Waypoint& b = points[end];
  if (end == 0 || time_s > b.time_s) {
    sample.position = b.position_m;
    sample.orientation = b.orientation;
    return DeviceError::none;
  }
  const Waypoint& a = points[end - 1];
  const double duration_s = b.time_s - a.time_s;
  const Progress done = progress(b.path, (time_s - a.time_s) / duration_s, duration_s);
  const Vec3 way = b.position_m - a.position_m;
  const Vec3 turn = rotation_vector(b.orientation * conjugate(a.orientation));
  // At the way-point itself its very numbers, free of rounding.
  const bool arrived = time_s == b.time_s;
  sample.position = arrived ? b.position_m : Vec3(a.position_m + done.share * way);
  sample.orientation = arrived
                           ? b.orientation
                           : normalised(quaternion_from_rotation_vector(done.share * turn) * a.orientation);
  sample.linear_velocity = done.rate_Hz * way;
  sample.angular_velocity = done.rate_Hz * turn;
  return DeviceError::none;
}

}  // namespace

std::unique_ptr<Device> make_scripted_device(ScriptedTrajectory trajectory) {
  return std::make_unique<ScriptedDevice>(std::move(trajectory));
}

}  // namespace sulcus
