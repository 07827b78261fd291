#include "device_sim/hand.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

std::unique_ptr<Device> armed(std::unique_ptr<Device> device) {
  device->open();
  device->calibrate();
  device->arm();
  return device;
}

DeviceSample read(Device& device, double time_s) {
  DeviceSample sample;
  EXPECT_EQ(device.read(time_s, sample), DeviceError::none) << time_s;
  return sample;
}

ScriptedTrajectory still(double end_s) {
  return {{{0, {0, 0, 0}, {}, Path::hold}, {end_s, {0, 0, 0}, {}, Path::hold}}};
}

ScriptedTrajectory straight(double speed_m_s) {
  return {{{0, {0, 0, 0}, {}, Path::hold}, {10, {10 * speed_m_s, 0, 0}, {}, Path::linear}}};
}

// The hand's equation by Runge-Kutta with small steps: x and v after `time_s` under a force that stays.
struct MassPoint {
  double x = 0, v = 0;
};
MassPoint runge_kutta(const VirtualHand& hand, MassPoint p, double force_N, double script_speed_m_s,
                      double time_s) {
  const auto acceleration = [&](const MassPoint& q, double t) {
    return (-hand.damping_N_s_m * (q.v - script_speed_m_s) -
            hand.stiffness_N_m * (q.x - script_speed_m_s * t) + force_N) /
           hand.mass_kg;
  };
  const int steps = static_cast<int>(time_s / 2e-5);
  const double h = time_s / steps;
  for (int n = 0; n < steps; ++n) {
    const double t = n * h;
    const double v1 = p.v, a1 = acceleration(p, t);
    const double v2 = p.v + h / 2 * a1, a2 = acceleration({p.x + h / 2 * v1, v2}, t + h / 2);
    const double v3 = p.v + h / 2 * a2, a3 = acceleration({p.x + h / 2 * v2, v3}, t + h / 2);
    const double v4 = p.v + h * a3, a4 = acceleration({p.x + h * v3, v4}, t + h);
    p.x += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    p.v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }
  return p;
}

TEST(Hand, MovesAsItsEquationSays) {
  const VirtualHand creeping{0.01, 10, 1};
  for (const VirtualHand& hand : {device_alone, light_hand, firm_hand, creeping}) {
    SCOPED_TRACE(hand.stiffness_N_m);
    const auto device = armed(make_hand_device(straight(0.05), hand));
    device->write({{0.3, 0, 0}, Vec3::Zero(), 100});
    EXPECT_NEAR(read(*device, 0).linear_velocity.x(), 0, 1e-15);  // at rest at the first way-point
    for (const double t : {0.01, 0.033, 0.2, 1.0}) {
      const DeviceSample sample = read(*device, t);
      const MassPoint expected = runge_kutta(hand, {}, 0.3, 0.05, t);
      EXPECT_NEAR(sample.position.x(), expected.x, 1e-9);
      EXPECT_NEAR(sample.linear_velocity.x(), expected.v, 1e-8);
    }
  }
}

TEST(Hand, YieldsToAForceByItsSpring) {
  const auto device = armed(make_hand_device(still(20), light_hand));
  device->write({{0, -1, 0}, Vec3::Zero(), 100});
  read(*device, 0);
  EXPECT_NEAR(read(*device, 20).position.y(), -1.0 / 100, 1e-12);
}

TEST(Hand, IsFreeOfTheForceOnceItExpires) {
  const auto device = armed(make_hand_device(still(20), light_hand));
  device->write({{0, -1, 0}, Vec3::Zero(), 0.1});
  read(*device, 0);
  EXPECT_LT(read(*device, 0.1).position.y(), -1e-3);
  EXPECT_NEAR(read(*device, 10).position.y(), 0, 1e-12);
}

TEST(Hand, MotionDoesNotDependOnHowOftenItIsRead) {
  const auto rarely = armed(make_hand_device(straight(0.1), firm_hand));
  const auto often = armed(make_hand_device(straight(0.1), firm_hand));
  for (Device* device : {rarely.get(), often.get()}) {
    device->write({{0, 0, 2}, Vec3::Zero(), 100});
    read(*device, 0);
  }
  for (int n = 1; n <= 330; ++n) {
    const DeviceSample fine = read(*often, n * 0.001);
    if (n % 33 != 0) continue;
    const DeviceSample coarse = read(*rarely, n * 0.001);
    EXPECT_LT((fine.position - coarse.position).norm(), 1e-13);
    EXPECT_LT((fine.linear_velocity - coarse.linear_velocity).norm(), 1e-12);
  }
}

TEST(Hand, FollowsItsScriptWithoutAForce) {
  const auto device = armed(make_hand_device(straight(0.05), firm_hand));
  read(*device, 0);
  EXPECT_NEAR(read(*device, 5).position.x(), 0.25, 1e-9);
}

TEST(Hand, EarlierTimesMoveNothing) {
  const auto device = armed(make_hand_device(straight(0.05), firm_hand));
  read(*device, 0);
  const Vec3 position = read(*device, 1).position;
  EXPECT_EQ(read(*device, 0.5).position, position);
}

TEST(Hand, RefusesWhatCannotBeSimulated) {
  EXPECT_THROW(make_hand_device(still(1), {.mass_kg = 0}), InputError);
  EXPECT_THROW(make_hand_device(still(1), {.damping_N_s_m = -1}), InputError);
  EXPECT_THROW(make_hand_device(still(1), {.stiffness_N_m = NAN}), InputError);
}

// Explicit spring of 1000 N/m against the hand, as stiff as the coupling: stays bounded at a servo step of 1
// ms, and a device alone is shaken by a held force of 33 ms (equations.md section 6: the light grip is the
// hard case).
double swing_after_contact(const VirtualHand& hand, int hold_ticks) {
  const auto device = armed(make_hand_device(still(10), hand));
  double largest_m = 0;
  DeviceSample sample = read(*device, 0);
  for (int n = 1; n < 9000; ++n) {
    if (n % hold_ticks == 0) {
      // A wall 1 mm above the start that pushes the hand down.
      device->write({{0, 0, 1000 * (-0.001 - sample.position.z())}, Vec3::Zero(), 100});
    }
    sample = read(*device, n * 0.001);
    if (n > 8000) largest_m = std::max(largest_m, std::abs(sample.position.z()));
    if (largest_m > 1) break;
  }
  return largest_m;
}

TEST(Hand, ForceActsBackAndAHeldForceMakesALightGripSwing) {
  EXPECT_LT(swing_after_contact(firm_hand, 1), 0.0011);
  EXPECT_GT(swing_after_contact(device_alone, 33), 0.1);
}

TEST(Push, StopsAtTheThresholdHoldsAndComesBack) {
  // A wall of 100 N/m at 10 mm along -z: 0.5 N is reached 5 mm behind it.
  const auto device = armed(make_push_device({.start_m = {0.1, 0, 0},
                                              .direction = {0, 0, -2},
                                              .speed_m_s = 0.01,
                                              .threshold_N = 0.5,
                                              .hold_s = 0.5}));
  DeviceSample sample;
  double deepest_m = 0, holding_s = 0, time_s = 0;
  for (int n = 0;; ++n) {
    time_s = n * 0.001;
    if (device->read(time_s, sample) != DeviceError::none) break;
    ASSERT_LT(time_s, 10);
    EXPECT_EQ(sample.position.x(), 0.1);
    const double depth_m = -sample.position.z() - 0.010;
    deepest_m = std::max(deepest_m, depth_m);
    if (sample.linear_velocity.norm() == 0) holding_s += 0.001;
    device->write({{0, 0, 100 * std::max(0.0, depth_m)}, Vec3::Zero(), time_s + 0.05});
  }
  EXPECT_NEAR(deepest_m, 0.005, 1.1e-5);  // one read late at most
  EXPECT_NEAR(holding_s, 0.5, 0.0021);
  EXPECT_NEAR(time_s, 2 * 1.5 + 0.5, 0.005);
  EXPECT_NEAR(sample.position.z(), 0, 1.1e-5);
}

TEST(Push, EndsItsWayWithoutAnyForce) {
  const auto device =
      armed(make_push_device({.direction = {1, 0, 0}, .speed_m_s = 0.1, .max_way_m = 0.02, .hold_s = 1}));
  for (int n = 0; n < 1000; ++n) EXPECT_LE(read(*device, n * 0.001).position.x(), 0.02);
  EXPECT_EQ(read(*device, 1.0).position.x(), 0.02);
}

TEST(Push, RefusesNumbersThatMakeNoSense) {
  EXPECT_THROW(make_push_device({.direction = {0, 0, 0}}), InputError);
  EXPECT_THROW(make_push_device({.speed_m_s = 0}), InputError);
  EXPECT_THROW(make_push_device({.threshold_N = -1}), InputError);
  EXPECT_THROW(make_push_device({.orientation = {2, 0, 0, 0}}), InputError);
}

}  // namespace
}  // namespace sulcus
