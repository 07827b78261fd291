#include "device_sim/perturbed.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "device_sim/hand.h"
#include "device_sim/scripted.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

ScriptedTrajectory straight() {
  return {{{0, {0, 0, 0}, {}, Path::hold},
           {10, {1, 0.5, 0}, quaternion_from_rotation_vector({0, 0, 2}), Path::linear}}};
}

std::unique_ptr<Device> armed(const Perturbation& perturbation) {
  auto device = make_perturbed_device(make_scripted_device(straight()), perturbation);
  device->open();
  device->calibrate();
  device->arm();
  return device;
}

struct Read {
  DeviceError error;
  DeviceSample sample;
};

std::vector<Read> reads(const Perturbation& perturbation, int count = 1000) {
  const auto device = armed(perturbation);
  std::vector<Read> all(static_cast<std::size_t>(count));
  DeviceSample sample;
  for (std::size_t n = 0; n < all.size(); ++n) {
    all[n].error = device->read(0.001 * static_cast<double>(n), sample);
    all[n].sample = sample;
  }
  return all;
}

bool same_bits(const DeviceSample& a, const DeviceSample& b) {
  const auto same = [](const auto& x, const auto& y) { return std::memcmp(&x, &y, sizeof(x)) == 0; };
  return a.sequence == b.sequence && same(a.time_s, b.time_s) && same(a.interval_s, b.interval_s) &&
         same(a.position, b.position) && same(a.orientation, b.orientation) &&
         same(a.linear_velocity, b.linear_velocity) && same(a.angular_velocity, b.angular_velocity) &&
         same(a.force_sent, b.force_sent) && a.buttons == b.buttons && a.docked == b.docked;
}

TEST(Perturbed, OffIsTheDeviceBelowBitByBit) {
  const auto below = make_scripted_device(straight());
  below->open();
  below->calibrate();
  below->arm();
  for (const Read& read : reads({})) {
    DeviceSample sample;
    ASSERT_EQ(below->read(0.001 * static_cast<double>(read.sample.sequence), sample), DeviceError::none);
    EXPECT_TRUE(same_bits(read.sample, sample));
  }
}

TEST(Perturbed, SameSeedGivesTheSameFaults) {
  const Perturbation all{.seed = 9, .jitter_s = 0.003, .lost_share = 0.1, .late_share = 0.2, .late_s = 0.01};
  Perturbation other = all;
  other.seed = 10;
  const auto a = reads(all), b = reads(all), c = reads(other);
  int different = 0;
  for (std::size_t n = 0; n < a.size(); ++n) {
    EXPECT_TRUE(same_bits(a[n].sample, b[n].sample));
    EXPECT_EQ(a[n].error, b[n].error);
    different += !same_bits(a[n].sample, c[n].sample);
  }
  EXPECT_GT(different, 500);
}

TEST(Perturbed, LostSamplesAreRecoverableAndRepeatTheOneBefore) {
  const auto all = reads({.lost_share = 0.25});
  int lost = 0;
  for (std::size_t n = 1; n < all.size(); ++n) {
    if (all[n].error == DeviceError::none) continue;
    ++lost;
    EXPECT_EQ(all[n].error, DeviceError::recoverable);
    EXPECT_EQ(all[n].sample.sequence, all[n - 1].sample.sequence);
  }
  EXPECT_NEAR(lost, 250, 60);
}

TEST(Perturbed, LateSamplesAreAsOldAsToldAndNoOlder) {
  const auto all = reads({.late_share = 0.3, .late_s = 0.010});
  int late = 0;
  for (std::size_t n = 20; n < all.size(); ++n) {
    const double age_s = 0.001 * static_cast<double>(n) - all[n].sample.time_s;
    if (age_s == 0) continue;
    ++late;
    EXPECT_GE(age_s, 0.010 - 1e-12);
    EXPECT_LE(age_s, 0.011 + 1e-12);
  }
  EXPECT_NEAR(late, 294, 70);
}

TEST(Perturbed, JitterMovesTheTimeOfReadingAndNeverBackwards) {
  const auto all = reads({.jitter_s = 0.004});
  double largest_s = 0;
  for (std::size_t n = 1; n < all.size(); ++n) {
    EXPECT_GE(all[n].sample.time_s, all[n - 1].sample.time_s);
    const double off_s = all[n].sample.time_s - 0.001 * static_cast<double>(n);
    EXPECT_LE(std::abs(off_s), 0.004 + 1e-12);
    largest_s = std::max(largest_s, std::abs(off_s));
  }
  EXPECT_GT(largest_s, 0.003);
}

TEST(Perturbed, StuckSampleStaysForItsTime) {
  const auto all = reads({.stuck_from_s = 0.2, .stuck_for_s = 0.05});
  EXPECT_EQ(all[199].sample.sequence, 199u);
  for (std::size_t n = 201; n < 250; ++n) EXPECT_TRUE(same_bits(all[n].sample, all[200].sample));
  EXPECT_GE(all[251].sample.sequence, 250u);
}

TEST(Perturbed, EncodersRoundToTheirSteps) {
  const auto all = reads({.encoder_step_m = 0.000055, .encoder_step_rad = 0.001});
  for (std::size_t n = 0; n < all.size(); ++n) {
    const double x = all[n].sample.position.x();
    const double steps = x / 0.000055;
    EXPECT_NEAR(steps, std::round(steps), 1e-9);
    EXPECT_NEAR(x, 1e-4 * static_cast<double>(n), 0.0000275 + 1e-15);
    const double turns = rotation_vector(all[n].sample.orientation).z() / 0.001;
    EXPECT_NEAR(turns, std::round(turns), 1e-9);
  }
}

TEST(Perturbed, TimeRateScalesTimeAndVelocity) {
  const auto all = reads({.time_rate = 2});
  EXPECT_NEAR(all[500].sample.position.x(), 0.1, 1e-12);
  EXPECT_NEAR(all[500].sample.linear_velocity.x(), 0.2, 1e-12);
  EXPECT_NEAR(all[500].sample.time_s, 0.5, 1e-12);
  EXPECT_NEAR(all[500].sample.interval_s, 0.001, 1e-12);
}

TEST(Perturbed, CommandsExpireOnTheSessionsClock) {
  const auto device = armed({.time_rate = 2});
  device->write({{1, 0, 0}, Vec3::Zero(), 0.4});
  DeviceSample sample;
  ASSERT_EQ(device->read(0.39, sample), DeviceError::none);
  EXPECT_EQ(sample.force_sent.x(), 1);
  ASSERT_EQ(device->read(0.41, sample), DeviceError::none);
  EXPECT_EQ(sample.force_sent.x(), 0);
}

TEST(Perturbed, NanComesAndGoes) {
  const auto all = reads({.nan_from_s = 0.3, .nan_for_s = 0.01});
  EXPECT_TRUE(all[299].sample.position.allFinite());
  EXPECT_TRUE(std::isnan(all[301].sample.position.x()));
  EXPECT_EQ(all[301].error, DeviceError::none);
  EXPECT_TRUE(all[311].sample.position.allFinite());
}

TEST(Perturbed, DisconnectionIsFatalUntilClosed) {
  const auto device = armed({.disconnect_at_s = 0.5});
  DeviceSample sample;
  EXPECT_EQ(device->read(0.49, sample), DeviceError::none);
  EXPECT_EQ(device->read(0.5, sample), DeviceError::fatal);
  EXPECT_EQ(device->state(), DeviceState::faulted);
  EXPECT_EQ(device->read(0.1, sample), DeviceError::fatal);
  device->close();
  EXPECT_EQ(device->state(), DeviceState::closed);
  device->open();
  device->calibrate();
  device->arm();
  EXPECT_EQ(device->read(0.1, sample), DeviceError::none);
}

TEST(Perturbed, LeavesTheHandBelowInItsOwnTime) {
  // Late and stuck samples do not turn back a device that moves with the reads.
  const auto make = [](const Perturbation& p) {
    auto device = make_perturbed_device(make_hand_device(straight(), firm_hand), p);
    device->open();
    device->calibrate();
    device->arm();
    return device;
  };
  const auto plain = make({}),
             late = make({.late_share = 0.5, .late_s = 0.01, .stuck_from_s = 0.1, .stuck_for_s = 0.1});
  DeviceSample a, b;
  for (int n = 0; n < 400; ++n) {
    plain->read(0.001 * n, a);
    late->read(0.001 * n, b);
    if (b.sequence == a.sequence) {
      EXPECT_TRUE(same_bits(a, b));
    }
  }
}

TEST(Perturbed, RefusesNumbersThatMakeNoSense) {
  const auto make = [](const Perturbation& p) { make_perturbed_device(make_scripted_device(straight()), p); };
  EXPECT_NO_THROW(make({}));
  EXPECT_THROW(make({.time_rate = 0}), InputError);
  EXPECT_THROW(make({.lost_share = 1.1}), InputError);
  EXPECT_THROW(make({.late_share = -0.1}), InputError);
  EXPECT_THROW(make({.jitter_s = NAN}), InputError);
  EXPECT_THROW(make({.encoder_step_m = -1}), InputError);
}

}  // namespace
}  // namespace sulcus
