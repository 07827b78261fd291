#include "device_sim/scripted.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

Quaternion turned(double x, double y, double z) {
  return quaternion_from_rotation_vector({x, y, z});
}

// Random numbers in [-1, 1) from raw output.
struct Draw {
  std::mt19937_64 raw;
  double operator()() { return static_cast<double>(raw() >> 11) * 0x1p-52 - 1; }
};

ScriptedTrajectory example() {
  const Quaternion turn = turned(0.3, -0.5, 0.8);
  return {{{0.0, {0, 0, 0.05}, {}, Path::hold},
           {0.5, {0.01, 0.02, 0.0}, turn, Path::minimum_jerk},
           {0.7, {0.01, 0.02, 0.0}, turn, Path::hold},
           {1.5, {-0.02, 0.0, 0.01}, turned(-1, 0, 0), Path::linear}}};
}

std::unique_ptr<Device> armed(ScriptedTrajectory trajectory) {
  auto device = make_scripted_device(std::move(trajectory));
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

double angle_between(const Quaternion& a, const Quaternion& b) {
  return rotation_vector(a * conjugate(b)).norm();
}

TEST(Scripted, PassesThroughItsWaypointsExactly) {
  const ScriptedTrajectory trajectory = example();
  const auto device = armed(trajectory);
  for (const Waypoint& p : trajectory.waypoints) {
    const DeviceSample sample = read(*device, p.time_s);
    EXPECT_EQ(sample.position, p.position_m);
    EXPECT_LT(angle_between(sample.orientation, p.orientation), 1e-15);
  }
}

TEST(Scripted, LinearPathIsProportionalToTime) {
  const auto device = armed(example());
  const DeviceSample sample = read(*device, 0.7 + 0.25 * 0.8);
  EXPECT_LT((sample.position - Vec3(0.0025, 0.015, 0.0025)).norm(), 1e-16);
  EXPECT_LT((sample.linear_velocity - Vec3(-0.03, -0.02, 0.01) / 0.8).norm(), 1e-15);
  // A quarter of the angle has been turned.
  const Quaternion from = turned(0.3, -0.5, 0.8), to = turned(-1, 0, 0);
  EXPECT_NEAR(angle_between(sample.orientation, from), 0.25 * angle_between(to, from), 1e-14);
}

TEST(Scripted, MinimumJerkIsHalfWayAtHalfTimeAndAtRestAtBothEnds) {
  const auto device = armed(example());
  const DeviceSample middle = read(*device, 0.25);
  EXPECT_LT((middle.position - Vec3(0.005, 0.01, 0.025)).norm(), 1e-16);
  // Peak speed of a minimum-jerk path is 15/8 of the mean.
  EXPECT_NEAR(middle.linear_velocity.norm(), 1.875 * Vec3(0.01, 0.02, -0.05).norm() / 0.5, 1e-14);
  EXPECT_EQ(read(*device, 0.5).linear_velocity.norm(), 0);
  EXPECT_LT(read(*device, 1e-6).linear_velocity.norm(), 1e-10);
}

TEST(Scripted, HoldStaysAtRest) {
  const auto device = armed(example());
  const DeviceSample sample = read(*device, 0.61);
  EXPECT_EQ(sample.position, Vec3(0.01, 0.02, 0.0));
  EXPECT_EQ(sample.linear_velocity.norm(), 0);
  EXPECT_EQ(sample.angular_velocity.norm(), 0);
}

TEST(Scripted, VelocitiesAreTheDerivativesOfThePose) {
  constexpr std::uint64_t seed = 20231;
  SCOPED_TRACE(seed);
  Draw draw{std::mt19937_64(seed)};
  const auto device = armed(example());
  constexpr double h = 1e-5;
  for (int i = 0; i < 300; ++i) {
    const double t = 0.75 + 0.74 * draw();
    if (std::abs(t - 0.5) < 2 * h || std::abs(t - 0.7) < 2 * h) continue;  // velocity jumps at way-points
    const DeviceSample before = read(*device, t - h), now = read(*device, t), after = read(*device, t + h);
    ASSERT_TRUE(now.linear_velocity_valid && now.angular_velocity_valid);
    const Vec3 v = (after.position - before.position) / (2 * h);
    const Vec3 w = rotation_vector(after.orientation * conjugate(before.orientation)) / (2 * h);
    EXPECT_LT((now.linear_velocity - v).norm(), 1e-8) << t;
    EXPECT_LT((now.angular_velocity - w).norm(), 1e-7) << t;
  }
}

TEST(Scripted, RotatesAlongTheShorterArcWhateverTheSignOfTheQuaternion) {
  const Quaternion q = turned(0, 0, 0.4);
  const auto device =
      armed({{{0, Vec3::Zero(), {}, Path::hold}, {1, Vec3::Zero(), {-q.s, -q.x, -q.y, -q.z}, Path::linear}}});
  EXPECT_LT((read(*device, 0.5).angular_velocity - Vec3(0, 0, 0.4)).norm(), 1e-15);
}

TEST(Scripted, RestsAtTheFirstWaypointBeforeItsTime) {
  const auto device = armed({{{1, {1, 2, 3}, {}, Path::hold}, {2, {2, 2, 3}, {}, Path::linear}}});
  const DeviceSample sample = read(*device, 0);
  EXPECT_EQ(sample.position, Vec3(1, 2, 3));
  EXPECT_EQ(sample.linear_velocity.norm(), 0);
}

TEST(Scripted, EndsAfterTheLastWaypoint) {
  const auto device = armed(example());
  DeviceSample sample;
  EXPECT_EQ(device->read(1.5 + 0.5e-9, sample), DeviceError::none);
  EXPECT_EQ(sample.position, Vec3(-0.02, 0.0, 0.01));
  EXPECT_EQ(device->read(1.500001, sample), DeviceError::ended);
  EXPECT_EQ(device->state(), DeviceState::running);
}

TEST(Scripted, TimeThatIsNotFiniteIsFatal) {
  const auto device = armed(example());
  DeviceSample sample;
  EXPECT_EQ(device->read(std::numeric_limits<double>::quiet_NaN(), sample), DeviceError::fatal);
  EXPECT_EQ(device->state(), DeviceState::faulted);
  EXPECT_EQ(device->read(0.1, sample), DeviceError::fatal);
}

ScriptedTrajectory winding() {
  return {{{0.0, {0, 0, 0}, {}, Path::spline},
           {0.5, {0.01, 0.02, 0.0}, turned(0.9, -0.5, 0.8), Path::spline},
           {0.7, {0.03, 0.02, 0.01}, turned(0.2, 1.5, 0.0), Path::spline},
           {1.5, {-0.02, 0.0, 0.01}, turned(-1, 0.3, 2), Path::spline}}};
}

TEST(Scripted, SplinePassesThroughItsWaypointsWithContinuousVelocity) {
  const ScriptedTrajectory trajectory = winding();
  const auto device = armed(trajectory);
  constexpr double h = 1e-9;
  for (std::size_t i = 1; i < 3; ++i) {
    const Waypoint& p = trajectory.waypoints[i];
    const DeviceSample before = read(*device, p.time_s - h), at = read(*device, p.time_s),
                       after = read(*device, p.time_s + h);
    EXPECT_EQ(at.position, p.position_m);
    EXPECT_LT(angle_between(before.orientation, p.orientation), 1e-7);
    EXPECT_GT(at.linear_velocity.norm(), 0.01);
    EXPECT_LT((after.linear_velocity - before.linear_velocity).norm(), 1e-8);
    EXPECT_LT((after.angular_velocity - before.angular_velocity).norm(), 1e-6);
  }
  EXPECT_EQ(read(*device, 0).linear_velocity.norm(), 0);
  EXPECT_LT(read(*device, 1.5).linear_velocity.norm(), 1e-15);
  EXPECT_LT(read(*device, 1.5).angular_velocity.norm(), 1e-14);
}

TEST(Scripted, SplineVelocitiesAreTheDerivativesOfThePoseAlsoWithTremor) {
  ScriptedTrajectory trajectory = winding();
  for (const bool shaking : {false, true}) {
    if (shaking) trajectory.tremor = {.position_rms_m = 1e-4, .rotation_rms_rad = 0.02};
    const auto device = armed(trajectory);
    constexpr double h = 1e-5;
    for (double t = 0.0113; t < 1.49; t += 0.0171) {
      const DeviceSample before = read(*device, t - h), now = read(*device, t), after = read(*device, t + h);
      const Vec3 v = (after.position - before.position) / (2 * h);
      const Vec3 w = rotation_vector(after.orientation * conjugate(before.orientation)) / (2 * h);
      EXPECT_LT((now.linear_velocity - v).norm(), 1e-7) << t;
      EXPECT_LT((now.angular_velocity - w).norm(), 1e-6) << t;
    }
  }
}

TEST(Scripted, SplineThroughAParabolaIsTheParabolaBetweenInnerWaypoints) {
  ScriptedTrajectory trajectory;
  for (const double t : {0.0, 0.4, 0.9, 1.0, 1.7}) {
    trajectory.waypoints.push_back(
        {t, {t * t, 0, 0}, quaternion_from_rotation_vector({0, t * t, 0}), Path::spline});
  }
  const auto device = armed(trajectory);
  for (double t = 0.4; t <= 1.0; t += 0.05) {
    const DeviceSample sample = read(*device, t);
    EXPECT_NEAR(sample.position.x(), t * t, 1e-14);
    EXPECT_NEAR(sample.angular_velocity.y(), 2 * t, 1e-12);
  }
}

TEST(Scripted, ButtonsAreDownFromTheirWaypointToTheNext) {
  ScriptedTrajectory trajectory = example();
  trajectory.waypoints[1].buttons = 5;
  const auto device = armed(trajectory);
  EXPECT_EQ(read(*device, 0.49).buttons, 0u);
  EXPECT_EQ(read(*device, 0.5).buttons, 5u);
  EXPECT_EQ(read(*device, 0.69).buttons, 5u);
  EXPECT_EQ(read(*device, 0.7).buttons, 0u);
}

TEST(Scripted, RefusesWhatItCannotFollow) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  auto make = [](auto change) {
    ScriptedTrajectory trajectory = example();
    change(trajectory.waypoints);
    make_scripted_device(std::move(trajectory));
  };
  using Points = std::vector<Waypoint>;
  EXPECT_NO_THROW(make([](Points&) {}));
  EXPECT_THROW(make([](Points& p) { p.clear(); }), InputError);
  EXPECT_THROW(make([](Points& p) { p[1].time_s = 0; }), InputError);
  EXPECT_THROW(make([&](Points& p) { p[1].time_s = nan; }), InputError);
  EXPECT_THROW(make([&](Points& p) { p[0].position_m.y() = nan; }), InputError);
  EXPECT_THROW(make([&](Points& p) { p[0].orientation.z = nan; }), InputError);
  EXPECT_THROW(make([](Points& p) { p[3].orientation = {0, 0, 0, 0}; }), InputError);
  EXPECT_THROW(make([](Points& p) { p[3].orientation = {1, 1, 0, 0}; }), InputError);
  EXPECT_THROW(make([](Points& p) { p[2].position_m.x() += 0.001; }), InputError);
}

TEST(Scripted, ReportsTheForceItWasToldUntilItExpires) {
  const auto device = armed(example());
  device->write({.force = {0, 0, 1}, .torque = Vec3::Zero(), .expiry_s = 0.2});
  EXPECT_EQ(read(*device, 0.2).force_sent, Vec3(0, 0, 1));
  EXPECT_EQ(read(*device, 0.21).force_sent, Vec3(0, 0, 0));
}

}  // namespace
}  // namespace sulcus
