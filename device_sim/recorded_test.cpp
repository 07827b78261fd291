#include "device_sim/recorded.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "device_sim/scripted.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

std::unique_ptr<Device> armed(std::unique_ptr<Device> device) {
  device->open();
  device->calibrate();
  device->arm();
  return device;
}

std::vector<DeviceSample> scripted_samples(int steps, double step_s) {
  const auto device = armed(make_scripted_device(
      {{{0, {0, 0, 0.05}, {}, Path::hold},
        {2, {0.01, 0.02, 0}, quaternion_from_rotation_vector({1, 0.5, 0}), Path::minimum_jerk}}}));
  std::vector<DeviceSample> samples(static_cast<std::size_t>(steps));
  for (int n = 0; n < steps; ++n) {
    device->write({.force = {0.1 * n, 0, 0}, .torque = Vec3::Zero(), .expiry_s = 10});
    EXPECT_EQ(device->read(n * step_s, samples[static_cast<std::size_t>(n)]), DeviceError::none);
  }
  return samples;
}

void expect_same_bits(const DeviceSample& a, const DeviceSample& b) {
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.docked, b.docked);
  EXPECT_EQ(a.buttons, b.buttons);
  auto same = [](const auto& x, const auto& y) { return std::memcmp(&x, &y, sizeof(x)) == 0; };
  EXPECT_TRUE(same(a.time_s, b.time_s) && same(a.interval_s, b.interval_s) && same(a.position, b.position) &&
              same(a.orientation, b.orientation) && same(a.linear_velocity, b.linear_velocity) &&
              same(a.angular_velocity, b.angular_velocity) && same(a.force_sent, b.force_sent));
}

TEST(Recorded, GivesBackTheSampleOfEachStepBitByBit) {
  const double step_s = 0.033;
  const auto samples = scripted_samples(60, step_s);
  const auto device = armed(make_recorded_device(samples));
  for (int n = 0; n < 60; ++n) {
    DeviceSample sample;
    ASSERT_EQ(device->read(n * step_s, sample), DeviceError::none);
    expect_same_bits(sample, samples[static_cast<std::size_t>(n)]);
  }
  DeviceSample sample;
  EXPECT_EQ(device->read(60 * step_s, sample), DeviceError::ended);
}

TEST(Recorded, FindsTheStepAlsoWhenTimesWereAddedUp) {
  const double step_s = 0.033;
  const auto samples = scripted_samples(60, step_s);
  const auto device = armed(make_recorded_device(samples));
  double time_s = 0;
  for (std::uint64_t n = 0; n < 60; ++n, time_s += step_s) {
    DeviceSample sample;
    ASSERT_EQ(device->read(time_s, sample), DeviceError::none);
    EXPECT_EQ(sample.sequence, n);
  }
}

TEST(Recorded, ReadTimesAllowSamplesThatWereStuckOrOfALaterTime) {
  auto samples = scripted_samples(4, 0.1);
  samples[2] = samples[1];  // stuck
  samples[3].time_s = 0.4;  // the step was late and saw a sample from its future
  samples[3].position.x() = std::numeric_limits<double>::quiet_NaN();
  const auto device = armed(make_recorded_device(RecordedTrajectory{samples, {0, 0.1, 0.2, 0.3}}));
  for (std::size_t n = 0; n < 4; ++n) {
    DeviceSample sample;
    ASSERT_EQ(device->read(static_cast<double>(n) * 0.1, sample), DeviceError::none);
    expect_same_bits(sample, samples[n]);
  }
}

TEST(Recorded, HoldsTheNewestSampleBetweenTimes) {
  const auto device = armed(make_recorded_device(scripted_samples(10, 0.1)));
  DeviceSample sample;
  ASSERT_EQ(device->read(0.25, sample), DeviceError::none);
  EXPECT_EQ(sample.sequence, 2u);
  ASSERT_EQ(device->read(-1, sample), DeviceError::none);
  EXPECT_EQ(sample.sequence, 0u);
}

TEST(Recorded, RefusesTimesThatDoNotIncrease) {
  auto samples = scripted_samples(3, 0.1);
  EXPECT_THROW(make_recorded_device(std::vector<DeviceSample>()), InputError);
  EXPECT_THROW(make_recorded_device(RecordedTrajectory{samples, {0, 1}}), InputError);
  samples[2].time_s = samples[1].time_s;
  EXPECT_THROW(make_recorded_device(samples), InputError);
  samples[2].time_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(make_recorded_device(samples), InputError);
}

}  // namespace
}  // namespace sulcus
