// The bits of simulated hands do not depend on compiler or optimisation: one number for all of them.
#include <gtest/gtest.h>

#include <cstring>

#include "device_sim/hand.h"
#include "device_sim/perturbed.h"

namespace sulcus {
namespace {

// FNV-1a over the bytes of what a sample says about the motion.
void mix(std::uint64_t& hash, const DeviceSample& sample) {
  double values[13];
  std::memcpy(values, sample.position.data(), 24);
  std::memcpy(values + 3, sample.linear_velocity.data(), 24);
  std::memcpy(values + 6, sample.angular_velocity.data(), 24);
  std::memcpy(values + 9, &sample.orientation.s, 8);
  std::memcpy(values + 10, &sample.orientation.x, 8);
  std::memcpy(values + 11, &sample.orientation.y, 8);
  std::memcpy(values + 12, &sample.orientation.z, 8);
  unsigned char bytes[sizeof(values)];
  std::memcpy(bytes, values, sizeof(values));
  for (const unsigned char byte : bytes) hash = (hash ^ byte) * 1099511628211u;
}

TEST(SimulatedHands, GiveTheSameBitsEverywhere) {
  const Quaternion a = quaternion_from_rotation_vector({0.9, -0.5, 0.8}),
                   b = quaternion_from_rotation_vector({-1, 2, 0});
  ScriptedTrajectory script{{{0, {0, 0, 0.05}, {}, Path::hold},
                             {0.5, {0.01, 0.02, 0}, a, Path::minimum_jerk},
                             {0.7, {0.01, 0.02, 0}, a, Path::hold},
                             {1.2, {-0.02, 0, 0.01}, b, Path::spline},
                             {1.5, {0.01, 0.01, 0.02}, {}, Path::spline},
                             {2, {0, 0, 0}, b, Path::linear}}};
  script.tremor = {.position_rms_m = 1e-4, .rotation_rms_rad = 0.01, .seed = 42};
  const auto device = make_perturbed_device(make_hand_device(script, light_hand), {.seed = 5,
                                                                                   .jitter_s = 0.0005,
                                                                                   .lost_share = 0.02,
                                                                                   .late_share = 0.1,
                                                                                   .late_s = 0.005,
                                                                                   .encoder_step_m = 1e-5});
  device->open();
  device->calibrate();
  device->arm();
  std::uint64_t hash = 14695981039346656037u;
  DeviceSample sample;
  for (int n = 0; n < 1990; ++n) {
    const double time_s = n * 0.001;
    device->read(time_s, sample);
    mix(hash, sample);
    device->write({{0, 0, -100 * sample.position.z()}, Vec3::Zero(), time_s + 0.02});
  }
  EXPECT_EQ(hash, 18073161498938941768u);
}

}  // namespace
}  // namespace sulcus
