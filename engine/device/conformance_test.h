// What every device must do, whatever is behind it: included by the tests of each back-end, which instantiate
// DeviceConformance with a way to make one.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "engine/device/device.h"
#include "engine/numerics/error.h"

namespace sulcus {

struct DeviceUnderTest {
  std::string name;
  std::function<std::unique_ptr<Device>()> make;                 // gives samples for at least 2 s
  std::function<void(double)> pass = [](double /*seconds*/) {};  // lets time pass for devices with a clock
};
inline void PrintTo(const DeviceUnderTest& device, std::ostream* out) {
  *out << device.name;  // GoogleTest would print the bytes, addresses among them
}

class DeviceConformance : public testing::TestWithParam<DeviceUnderTest> {
 protected:
  static constexpr double tick_s = 0.001;

  std::unique_ptr<Device> armed() {
    auto device = GetParam().make();
    device->open();
    device->calibrate();
    device->arm();
    time_s_ = 0;
    return device;
  }

  // The next sample, a tick later.
  DeviceSample next(Device& device) {
    GetParam().pass(tick_s);
    time_s_ += tick_s;
    DeviceSample sample;
    EXPECT_EQ(device.read(time_s_, sample), DeviceError::none) << "at " << time_s_ << " s";
    return sample;
  }

  double time_s_ = 0;
};

TEST_P(DeviceConformance, LifeHasOneOrder) {
  const auto device = GetParam().make();
  EXPECT_EQ(device->state(), DeviceState::closed);
  EXPECT_THROW(device->calibrate(), EnvironmentError);
  EXPECT_THROW(device->arm(), EnvironmentError);
  device->open();
  EXPECT_EQ(device->state(), DeviceState::open);
  EXPECT_THROW(device->open(), EnvironmentError);
  EXPECT_THROW(device->arm(), EnvironmentError);
  device->calibrate();
  EXPECT_EQ(device->state(), DeviceState::calibrated);
  EXPECT_THROW(device->calibrate(), EnvironmentError);
  device->arm();
  EXPECT_EQ(device->state(), DeviceState::armed);
  next(*device);
  EXPECT_EQ(device->state(), DeviceState::running);
  device->close();
  EXPECT_EQ(device->state(), DeviceState::closed);
}

TEST_P(DeviceConformance, GivesSamplesOnlyWhenArmed) {
  const auto device = GetParam().make();
  DeviceSample sample;
  EXPECT_EQ(device->read(0, sample), DeviceError::fatal);
  device->open();
  EXPECT_EQ(device->read(0, sample), DeviceError::fatal);
  device->calibrate();
  EXPECT_EQ(device->read(0, sample), DeviceError::fatal);
  EXPECT_EQ(device->state(), DeviceState::calibrated);  // asking too early is no fault
  device->arm();
  next(*device);
  device->close();
  EXPECT_EQ(device->read(0, sample), DeviceError::fatal);
}

TEST_P(DeviceConformance, SamplesAreSoundAndInOrder) {
  const auto device = armed();
  DeviceSample before = next(*device);
  for (int i = 0; i < 500; ++i) {
    const DeviceSample sample = next(*device);
    const Quaternion& q = sample.orientation;
    ASSERT_TRUE(sample.position.allFinite() && sample.linear_velocity.allFinite() &&
                sample.angular_velocity.allFinite() && sample.force_sent.allFinite());
    ASSERT_NEAR(q.s * q.s + q.x * q.x + q.y * q.y + q.z * q.z, 1, 1e-12);
    ASSERT_GE(sample.sequence, before.sequence);
    ASSERT_GE(sample.time_s, before.time_s);
    ASSERT_GE(sample.interval_s, 0);
    ASSERT_LE(sample.time_s, time_s_ + 0.05);
    before = sample;
  }
}

TEST_P(DeviceConformance, VelocityAddsUpToTheWay) {
  const auto device = armed();
  DeviceSample before = next(*device);
  const DeviceSample first = before;
  Vec3 way = Vec3::Zero();
  double length_m = 0;
  for (int i = 0; i < 500; ++i) {
    const DeviceSample sample = next(*device);
    ASSERT_TRUE(sample.linear_velocity_valid);
    way += sample.linear_velocity * (sample.time_s - before.time_s);
    length_m += sample.linear_velocity.norm() * (sample.time_s - before.time_s);
    before = sample;
  }
  EXPECT_GT(length_m, 1e-3) << "the device under test must move";
  EXPECT_LT((way - (before.position - first.position)).norm(), 0.05 * length_m);
}

TEST_P(DeviceConformance, SendsNothingUntoldAndNothingExpired) {
  const auto device = armed();
  for (int i = 0; i < 50; ++i) ASSERT_EQ(next(*device).force_sent, Vec3(0, 0, 0));
  for (int i = 0; i < 100; ++i) {
    device->write({.force = {0.1, 0, 0.2}, .torque = Vec3::Zero(), .expiry_s = time_s_ + 0.01});
    ASSERT_LE(next(*device).force_sent.norm(), std::sqrt(0.05) + 1e-12);
  }
  for (int i = 0; i < 50; ++i) next(*device);
  EXPECT_EQ(next(*device).force_sent, Vec3(0, 0, 0));
}

TEST_P(DeviceConformance, CommandThatIsNotFiniteSendsNothing) {
  const auto device = armed();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 20; ++i) {
    device->write({.force = {nan, 0, 0}, .torque = {0, nan, 0}, .expiry_s = time_s_ + 1});
    ASSERT_EQ(next(*device).force_sent, Vec3(0, 0, 0));
  }
  EXPECT_EQ(device->state(), DeviceState::running);
}

TEST_P(DeviceConformance, TimeThatIsNotFiniteIsAFaultThatOnlyCloseLeaves) {
  const auto device = armed();
  next(*device);
  DeviceSample sample;
  EXPECT_EQ(device->read(std::numeric_limits<double>::quiet_NaN(), sample), DeviceError::fatal);
  EXPECT_EQ(device->state(), DeviceState::faulted);
  EXPECT_EQ(device->read(time_s_, sample), DeviceError::fatal);
  EXPECT_THROW(device->arm(), EnvironmentError);
  device->close();
  EXPECT_EQ(device->state(), DeviceState::closed);
}

TEST_P(DeviceConformance, CanBeClosedTwiceAndOpenedAgain) {
  const auto device = armed();
  for (int i = 0; i < 10; ++i) next(*device);
  device->close();
  device->close();
  device->open();
  device->calibrate();
  device->arm();
  time_s_ = 0;
  EXPECT_LE(next(*device).sequence, 5u);  // the session begins anew
}

TEST_P(DeviceConformance, MayBeDestroyedInAnyState) {
  for (int calls = 0; calls < 4; ++calls) {
    auto device = GetParam().make();
    if (calls > 0) device->open();
    if (calls > 1) device->calibrate();
    if (calls > 2) device->arm();
  }
}

inline std::string conformance_name(const testing::TestParamInfo<DeviceUnderTest>& info) {
  return info.param.name;
}

}  // namespace sulcus
