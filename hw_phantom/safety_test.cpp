#include "hw_phantom/safety.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace sulcus {
namespace {

const double nan_value = std::numeric_limits<double>::quiet_NaN();

SafetyInput good_input() {
  SafetyInput input;
  input.permitted = input.pose_valid = true;
  input.force = {0.3, 0, 0.4};
  input.torque = {0, 0.01, 0};
  input.command_age_s = input.interval_s = 0.001;
  return input;
}

SafetyLimits boxed() {
  SafetyLimits limits;
  limits.workspace_min = Vec3::Constant(-0.1);
  limits.workspace_max = Vec3::Constant(0.1);
  return limits;
}

// After enough ticks of the same input.
SafetyState settled(const SafetyInput& input, const SafetyLimits& limits = boxed()) {
  SafetyState state;
  for (int tick = 0; tick < 2000; ++tick) limit_force(limits, input, state);
  return state;
}

TEST(Safety, LetsASmallCommandThrough) {
  const SafetyState state = settled(good_input());
  EXPECT_EQ(state.force, Vec3(0.3, 0, 0.4));
  EXPECT_EQ(state.torque, Vec3(0, 0.01, 0));
}

TEST(Safety, ClampsTheNormAndKeepsTheDirection) {
  SafetyInput input = good_input();
  input.force = {3, 0, 4};
  const SafetyState state = settled(input);
  EXPECT_NEAR(state.force.norm(), 0.88, 1e-12);
  EXPECT_NEAR(state.force.x() / state.force.z(), 0.75, 1e-12);
  input.force = {1e300, 0, 0};  // its square overflows
  EXPECT_LE(settled(input).force.norm(), 0.88);
}

TEST(Safety, StartsSoftly) {
  SafetyState state;
  const SafetyInput input = good_input();
  for (int tick = 1; tick <= 250; ++tick) {
    const std::uint32_t reasons = limit_force(boxed(), input, state);
    EXPECT_TRUE(reasons & reason_soft_start);
    EXPECT_NEAR(state.force.norm(), 0.5 * tick / 500, 1e-12);
  }
}

TEST(Safety, ChangesNoFasterThanTheSlewLimit) {
  SafetyInput input = good_input();
  SafetyState state = settled(input);
  input.force = -input.force;
  EXPECT_TRUE(limit_force(boxed(), input, state) & reason_slew);
  EXPECT_NEAR((state.force - Vec3(0.3, 0, 0.4)).norm(), 0.4, 1e-12);
}

TEST(Safety, ALateTickDoesNotLetTheForceJump) {
  SafetyLimits limits = boxed();
  limits.slew_N_s = 100;
  SafetyInput input = good_input();
  SafetyState state = settled(input, limits);
  input.force = -input.force;
  input.interval_s = 0.015;
  limit_force(limits, input, state);
  EXPECT_NEAR((state.force - Vec3(0.3, 0, 0.4)).norm(), 0.2, 1e-12);  // as after 2 ms
}

TEST(Safety, FadesAnOldCommandToNothing) {
  SafetyInput input = good_input();
  input.command_age_s = 0.04;
  EXPECT_NEAR(settled(input).force.norm(), 0.25, 1e-12);
  input.command_age_s = 0.05;
  EXPECT_EQ(settled(input).force, Vec3(0, 0, 0));
}

TEST(Safety, FadesOutsideTheWorkspace) {
  SafetyInput input = good_input();
  input.position = {0.103, 0, -0.104};
  EXPECT_NEAR(settled(input).force.norm(), 0.25, 1e-12);
  input.position = {0.2, 0, 0};
  EXPECT_EQ(settled(input).force, Vec3(0, 0, 0));
  // A command far above the clamp fades as well.
  input.position = {0, 0.105, 0};
  input.force = {100, 0, 0};
  EXPECT_NEAR(settled(input).force.norm(), 0.44, 1e-12);
}

TEST(Safety, FadesWithSpeedAndStartsAnewAboveTheLimit) {
  SafetyInput input = good_input();
  input.speed_m_s = 1.0;
  SafetyState state = settled(input);
  EXPECT_NEAR(state.force.norm(), 0.25, 1e-12);
  input.speed_m_s = 1.2;
  EXPECT_TRUE(limit_force(boxed(), input, state) & reason_speed);
  EXPECT_EQ(state.force, Vec3(0, 0, 0));
  EXPECT_EQ(state.soft_start, 0);
}

TEST(Safety, FadesWithTheTemperatureOfTheMotors) {
  SafetyInput input = good_input();
  input.temperature = 0.825;
  EXPECT_NEAR(settled(input).force.norm(), 0.25, 1e-12);
  input.temperature = 1;
  EXPECT_EQ(settled(input).force, Vec3(0, 0, 0));
}

TEST(Safety, GivesNothingAtOnceAndStartsAnewWhenItMustNot) {
  const auto stops = [](auto change, std::uint32_t reason) {
    SafetyInput input = good_input();
    SafetyState state = settled(input);
    change(input);
    EXPECT_EQ(limit_force(boxed(), input, state), reason);
    EXPECT_EQ(state.force, Vec3(0, 0, 0));
    EXPECT_EQ(state.torque, Vec3(0, 0, 0));
    limit_force(boxed(), good_input(), state);
    EXPECT_NEAR(state.force.norm(), 0.001, 1e-12);  // soft start: a five hundredth
  };
  stops([](SafetyInput& in) { in.permitted = false; }, reason_not_permitted);
  stops([](SafetyInput& in) { in.pose_valid = false; }, reason_pose);
  stops([](SafetyInput& in) { in.interval_s = 0.05; }, reason_stall);
  stops([](SafetyInput& in) { in.force.y() = nan_value; }, reason_not_finite);
  stops([](SafetyInput& in) { in.torque.x() = INFINITY; }, reason_not_finite);
  stops([](SafetyInput& in) { in.position.x() = nan_value; }, reason_not_finite);
  stops([](SafetyInput& in) { in.interval_s = nan_value; }, reason_not_finite);
  stops([](SafetyInput& in) { in.speed_m_s = nan_value; }, reason_not_finite);
  stops([](SafetyInput& in) { in.temperature = nan_value; }, reason_not_finite);
  stops([](SafetyInput& in) { in.command_age_s = nan_value; }, reason_not_finite);
}

// Whatever comes in: never above the clamp, never faster than the slew limit but down to nothing.
TEST(Safety, HoldsItsBoundsForAnyInput) {
  constexpr std::uint64_t seed = 4711;
  SCOPED_TRACE(seed);
  std::mt19937_64 raw(seed);
  const auto draw = [&] { return static_cast<double>(raw() >> 11) * 0x1p-52 - 1; };
  const SafetyLimits limits = boxed();
  SafetyState state;
  for (int tick = 0; tick < 200000; ++tick) {
    SafetyInput input;
    input.permitted = raw() % 50 != 0;
    input.pose_valid = raw() % 50 != 0;
    input.force = Vec3(draw(), draw(), draw()) * (raw() % 3 == 0 ? 1000 : 1);
    input.torque = Vec3(draw(), draw(), draw());
    if (raw() % 100 == 0) input.force.x() = nan_value;
    if (raw() % 100 == 0) input.torque.z() = -INFINITY;
    input.command_age_s = 0.05 * std::abs(draw());
    input.interval_s = 0.001 * (1 + draw());
    input.position = 0.12 * Vec3(draw(), draw(), draw());
    input.speed_m_s = 1.3 * std::abs(draw());
    input.temperature = std::abs(draw());
    const Vec3 before = state.force;
    limit_force(limits, input, state);
    ASSERT_TRUE(state.force.allFinite() && state.torque.allFinite());
    ASSERT_LE(state.force.norm(), 0.88 * (1 + 1e-12));
    ASSERT_LE(state.torque.norm(), 0.1 * (1 + 1e-12));
    if (state.force != Vec3::Zero()) {
      ASSERT_LE((state.force - before).norm(), 400 * input.interval_s * (1 + 1e-9) + 1e-15);
    }
  }
}

}  // namespace
}  // namespace sulcus
