#include "device_sim/hand.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "device_sim/simulated.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double substep_s = 1e-3;
constexpr double end_tolerance_s = 1e-9;

void check(bool good, const std::string& what) {
  if (!good) throw InputError(what);
}

// exp(A) by scaling, Taylor and squaring: + and * alone, exact to rounding whether the hand swings or creeps.
Mat3 exponential(Mat3 a) {
  int squarings = 0;
  while (a.cwiseAbs().maxCoeff() > 0.125 && squarings < 60) {
    a *= 0.5;
    ++squarings;
  }
  Mat3 sum = Mat3::Identity(), term = Mat3::Identity();
  for (int n = 1; n <= 14; ++n) {
    term = Mat3(term * a) / n;
    sum += term;
  }
  for (int i = 0; i < squarings; ++i) sum = Mat3(sum * sum);
  return sum;
}

// Of (x - s, x' - s', F/m), the last one constant, over `duration_s`.
Mat3 propagator(const VirtualHand& hand, double duration_s) {
  Mat3 a = Mat3::Zero();
  a(0, 1) = 1;
  a(1, 0) = -hand.stiffness_N_m / hand.mass_kg;
  a(1, 1) = -hand.damping_N_s_m / hand.mass_kg;
  a(1, 2) = 1;
  return exponential(a * duration_s);
}

class HandDevice final : public SimulatedDevice {
 public:
  HandDevice(ScriptedTrajectory script, const VirtualHand& hand) : path_(std::move(script)), hand_(hand) {
    check(hand.mass_kg > 0 && std::isfinite(hand.mass_kg),
          "hand: mass is " + std::to_string(hand.mass_kg) + " kg; give a positive number");
    check(
        hand.damping_N_s_m >= 0 && std::isfinite(hand.damping_N_s_m),
        "hand: damping is " + std::to_string(hand.damping_N_s_m) + " N s/m; give zero or a positive number");
    check(
        hand.stiffness_N_m >= 0 && std::isfinite(hand.stiffness_N_m),
        "hand: stiffness is " + std::to_string(hand.stiffness_N_m) + " N/m; give zero or a positive number");
  }

  DeviceCapabilities capabilities() const override { return {.model = "hand", .renders_force = true}; }

 private:
  void restart() override { started_ = false; }

  DeviceError sample_at(double time_s, DeviceSample& sample) override {
    if (time_s > path_.end_s() + end_tolerance_s) return DeviceError::ended;
    HandMotion motion = path_.at(time_s);
    if (!started_) {
      position_ = motion.position;
      velocity_ = motion.linear_velocity;
      time_s_ = time_s;
      started_ = true;
    }
    if (time_s > time_s_) advance(time_s);
    motion.position = position_;
    motion.linear_velocity = velocity_;
    sample = DeviceSample();
    stamp(time_s, sample);
    put(motion, sample);
    return DeviceError::none;
  }

  void advance(double time_s) {
    const double whole_s = time_s - time_s_;
    const double substeps = std::ceil(whole_s / substep_s * (1 - 1e-9));
    const double h = whole_s / substeps;
    const Mat3 phi = propagator(hand_, h);
    const double from_s = time_s_;
    Vec3 script = path_.at(from_s).position;
    for (double n = 1; n <= substeps; ++n) {
      const Vec3 script_end = path_.at(n == substeps ? time_s : from_s + n * h).position;
      const Vec3 script_velocity = (script_end - script) / h;
      const Vec3 push = command_at(from_s + (n - 1) * h).force / hand_.mass_kg;
      const Vec3 e = position_ - script, rate = velocity_ - script_velocity;
      position_ = script_end + phi(0, 0) * e + phi(0, 1) * rate + phi(0, 2) * push;
      velocity_ = script_velocity + phi(1, 0) * e + phi(1, 1) * rate + phi(1, 2) * push;
      script = script_end;
    }
    time_s_ = time_s;
  }

  ScriptedPath path_;
  VirtualHand hand_;
  bool started_ = false;
  double time_s_ = 0;             // s, of position and velocity
  Vec3 position_ = Vec3::Zero();  // m
  Vec3 velocity_ = Vec3::Zero();  // m/s
};

class PushDevice final : public SimulatedDevice {
 public:
  explicit PushDevice(const PushScript& script) : script_(script) {
    const double length = std::sqrt(script.direction.squaredNorm());
    const Quaternion& q = script.orientation;
    check(script.start_m.allFinite(), "push: start is not finite; give metres");
    check(std::isfinite(length) && length > 0, "push: direction has no length; give a vector");
    check(std::abs(std::sqrt(q.s * q.s + q.x * q.x + q.y * q.y + q.z * q.z) - 1) <= 0.01,
          "push: orientation is no unit quaternion (s, x, y, z)");
    check(script.speed_m_s > 0 && std::isfinite(script.speed_m_s), "push: speed must be positive (m/s)");
    check(script.threshold_N > 0, "push: threshold must be positive (N)");
    check(script.max_way_m > 0 && std::isfinite(script.max_way_m), "push: max way must be positive (m)");
    check(script.hold_s >= 0 && std::isfinite(script.hold_s), "push: hold must be zero or positive (s)");
    script_.direction /= length;
    script_.orientation = normalised(q);
  }

  DeviceCapabilities capabilities() const override { return {.model = "push", .renders_force = true}; }

 private:
  enum class Phase { push, hold, back, over };

  void restart() override {
    phase_ = Phase::push;
    started_ = false;
    way_m_ = 0;
  }

  DeviceError sample_at(double time_s, DeviceSample& sample) override {
    const double since_s = started_ ? std::max(0.0, time_s - time_s_) : 0;
    time_s_ = started_ ? std::max(time_s, time_s_) : time_s;
    started_ = true;
    const double resistance_N = -command_at(time_s).force.dot(script_.direction);
    double speed_m_s = 0;
    switch (phase_) {
      case Phase::push:
        if (resistance_N >= script_.threshold_N || way_m_ >= script_.max_way_m) {
          phase_ = Phase::hold;
          hold_from_s_ = time_s;
          break;
        }
        way_m_ = std::min(script_.max_way_m, way_m_ + script_.speed_m_s * since_s);
        speed_m_s = script_.speed_m_s;
        break;
      case Phase::hold:
        if (time_s - hold_from_s_ > script_.hold_s) phase_ = Phase::back;
        break;
      case Phase::back:
        if (way_m_ == 0) phase_ = Phase::over;
        way_m_ = std::max(0.0, way_m_ - script_.speed_m_s * since_s);
        speed_m_s = -script_.speed_m_s;
        break;
      case Phase::over:
        break;
    }
    if (phase_ == Phase::over) return DeviceError::ended;
    sample = DeviceSample();
    stamp(time_s, sample);
    put({script_.start_m + way_m_ * script_.direction, script_.orientation, speed_m_s * script_.direction,
         Vec3::Zero(), 0},
        sample);
    return DeviceError::none;
  }

  PushScript script_;
  Phase phase_ = Phase::push;
  bool started_ = false;
  double time_s_ = 0, hold_from_s_ = 0;  // s
  double way_m_ = 0;                     // m, along the direction
};

}  // namespace

std::unique_ptr<Device> make_hand_device(ScriptedTrajectory script, const VirtualHand& hand) {
  return std::make_unique<HandDevice>(std::move(script), hand);
}

std::unique_ptr<Device> make_push_device(const PushScript& script) {
  return std::make_unique<PushDevice>(script);
}

}  // namespace sulcus
