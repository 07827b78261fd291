#include "engine/device/servo.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace sulcus {
namespace {

CouplingSnapshot still_tool() {
  CouplingSnapshot coupling;
  coupling.valid = true;
  coupling.stiffness_N_m = 1000;
  coupling.damping_N_s_m = 10;
  coupling.rotational_stiffness_N_m_rad = 0.3;
  coupling.rotational_damping_N_m_s_rad = 0.03;
  return coupling;
}

DeviceSample hand_at(double time_s, const Vec3& position) {
  DeviceSample sample;
  sample.time_s = time_s;
  sample.interval_s = 0.001;
  sample.position = position;
  return sample;
}

TEST(Servo, SpringPullsTheHandToTheTool) {
  ServoState state;
  const DeviceCommand command = render(still_tool(), hand_at(0.01, {0.001, 0, 0}), {}, state);
  EXPECT_LT((command.force - Vec3(-1, 0, 0)).norm(), 1e-15);
  EXPECT_DOUBLE_EQ(command.expiry_s, 0.015);
}

TEST(Servo, TorqueTurnsTheHandToTheTool) {
  DeviceSample sample = hand_at(0, Vec3::Zero());
  sample.orientation = quaternion_from_rotation_vector({0, 0.2, 0});
  ServoState state;
  EXPECT_LT((render(still_tool(), sample, {}, state).torque - Vec3(0, -0.06, 0)).norm(), 1e-15);
}

TEST(Servo, DampingCountsOnlyValidVelocities) {
  DeviceSample sample = hand_at(0, Vec3::Zero());
  sample.linear_velocity = {0, 0.1, 0};
  sample.angular_velocity = {0, 0, 2};
  ServoState state;
  EXPECT_EQ(render(still_tool(), sample, {}, state).force.norm(), 0);
  sample.linear_velocity_valid = sample.angular_velocity_valid = true;
  const DeviceCommand command = render(still_tool(), sample, {}, state);
  EXPECT_LT((command.force - Vec3(0, -1, 0)).norm(), 1e-15);
  EXPECT_LT((command.torque - Vec3(0, 0, -0.06)).norm(), 1e-15);
}

TEST(Servo, HandThatMovesWithTheToolFeelsNoStaircase) {
  // Tool and hand move together at 0.05 m/s; the engine publishes every 17 ms, the servo runs every 1 ms.
  CouplingSnapshot coupling = still_tool();
  coupling.tool_linear_velocity = {0.05, 0, 0};
  ServoSettings settings;
  ServoState state;
  double largest_N = 0;
  for (int tick = 0; tick < 170; ++tick) {
    const double t = tick * 0.001;
    if (tick % 17 == 0) {
      coupling.time_s = t;
      coupling.tool_position = {0.05 * t, 0, 0};
    }
    largest_N =
        std::max(largest_N, render(coupling, hand_at(t, {0.05 * t, 0, 0}), settings, state).force.norm());
  }
  EXPECT_LT(largest_N, 1e-12);
  // Without the extrapolation it is a staircase of up to k v h = 0.8 N.
  settings.max_extrapolation_s = 0;
  EXPECT_NEAR(render(coupling, hand_at(0.169, {0.05 * 0.169, 0, 0}), settings, state).force.x(),
              -1000 * 0.05 * 0.016, 1e-9);
}

TEST(Servo, ExtrapolationStaysWithinItsBounds) {
  CouplingSnapshot coupling = still_tool();
  coupling.tool_linear_velocity = {1, 0, 0};
  coupling.tool_angular_velocity = {0, 0, 10};
  ServoSettings settings;
  settings.max_extrapolation_s = 0.05;
  settings.max_extrapolation_m = 0.002;
  settings.max_extrapolation_rad = 0.05;
  ServoState state;
  const DeviceCommand far = render(coupling, hand_at(0.04, Vec3::Zero()), settings, state);
  EXPECT_NEAR(far.force.x(), 1000 * 0.002, 1e-12);
  EXPECT_NEAR(far.torque.z(), 0.3 * 0.05, 1e-12);
  coupling.tool_linear_velocity = {0.01, 0, 0};
  const DeviceCommand late = render(coupling, hand_at(0.15, Vec3::Zero()), settings, state);
  EXPECT_NEAR(late.force.x(), 1000 * 0.01 * 0.05, 1e-12);
  // A sample from before the snapshot does not carry the tool backwards.
  coupling.time_s = 1;
  EXPECT_EQ(render(coupling, hand_at(0.9, Vec3::Zero()), settings, state).force.norm(), 0);
}

TEST(Servo, FilterReachesAStepAsTheExponentialDoes) {
  ServoSettings settings;
  settings.filter_Hz = 10;
  ServoState state;
  double force_N = 0;
  CouplingSnapshot coupling = still_tool();
  for (int tick = 0; tick < 20; ++tick) {
    DeviceSample sample = hand_at(0.001 * tick, {0.001, 0, 0});
    sample.interval_s = tick % 2 == 0 ? 0.0005 : 0.0015;  // uneven, 20 ms altogether
    force_N = render(coupling, sample, settings, state).force.x();
  }
  EXPECT_NEAR(force_N, -(1 - std::exp(-6.283185307179586 * 10 * 0.02)), 1e-12);
}

TEST(Servo, RendersNothingFromWhatIsOldInvalidOrNotFinite) {
  ServoState state;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const DeviceSample sample = hand_at(0.3, {0.001, 0, 0});
  CouplingSnapshot coupling = still_tool();
  EXPECT_EQ(render(coupling, sample, {}, state).force, Vec3(0, 0, 0));  // 0.3 s old
  coupling.time_s = 0.29;
  EXPECT_NE(render(coupling, sample, {}, state).force, Vec3(0, 0, 0));
  DeviceSample broken = sample;
  broken.position.y() = nan;
  EXPECT_EQ(render(coupling, broken, {}, state).force, Vec3(0, 0, 0));
  EXPECT_EQ(state.force, Vec3(0, 0, 0));
  broken = sample;
  broken.time_s = nan;
  EXPECT_EQ(render(coupling, broken, {}, state).force, Vec3(0, 0, 0));
  broken = sample;
  broken.interval_s = nan;
  EXPECT_EQ(render(coupling, broken, {}, state).force, Vec3(0, 0, 0));
  coupling.tool_orientation.x = nan;
  EXPECT_EQ(render(coupling, sample, {}, state).torque, Vec3(0, 0, 0));
  coupling = still_tool();
  coupling.valid = false;
  coupling.time_s = 0.3;
  EXPECT_EQ(render(coupling, sample, {}, state).force, Vec3(0, 0, 0));
}

}  // namespace
}  // namespace sulcus
