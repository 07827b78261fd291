#include "device_sim/tremor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double two_pi = 6.283185307179586;

TEST(Tremor, HasTheRootMeanSquareAskedFor) {
  const TremorTones tones = make_tones({.position_rms_m = 1e-4, .rotation_rms_rad = 0.02, .seed = 7});
  Vec3 position = Vec3::Zero(), rotation = Vec3::Zero();
  constexpr int samples = 200000;
  for (int n = 0; n < samples; ++n) {
    const TremorMotion motion = tremor_at(tones, 0.001 * n);
    position += motion.position.cwiseAbs2() / samples;
    rotation += motion.rotation.cwiseAbs2() / samples;
  }
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(std::sqrt(position[i]), 1e-4, 2e-6);
    EXPECT_NEAR(std::sqrt(rotation[i]), 0.02, 4e-4);
  }
}

TEST(Tremor, StaysInItsBand) {
  const TremorTones tones = make_tones({.position_rms_m = 1, .low_Hz = 6, .high_Hz = 9, .seed = 3});
  // Share of the power at each frequency, by a Hann-windowed Fourier sum over 20 s.
  constexpr int samples = 4000;
  constexpr double step_s = 0.005;
  std::vector<double> x(samples);
  for (std::size_t n = 0; n < samples; ++n) {
    const double t = static_cast<double>(n);
    x[n] = (0.5 - 0.5 * std::cos(two_pi * t / samples)) * tremor_at(tones, t * step_s).position.x();
  }
  double inside = 0, outside = 0;
  for (double frequency_Hz = 0.5; frequency_Hz < 40; frequency_Hz += 0.05) {
    double re = 0, im = 0;
    for (int n = 0; n < samples; ++n) {
      re += x[static_cast<std::size_t>(n)] * std::cos(two_pi * frequency_Hz * n * step_s);
      im += x[static_cast<std::size_t>(n)] * std::sin(two_pi * frequency_Hz * n * step_s);
    }
    (frequency_Hz > 5.9 && frequency_Hz < 9.1 ? inside : outside) += re * re + im * im;
  }
  EXPECT_LT(outside, 1e-3 * inside);
}

TEST(Tremor, RatesAreDerivatives) {
  const TremorTones tones = make_tones({.position_rms_m = 1e-3, .rotation_rms_rad = 0.02});
  constexpr double h = 1e-6;
  for (double t = 0.1; t < 3; t += 0.137) {
    const TremorMotion before = tremor_at(tones, t - h), now = tremor_at(tones, t),
                       after = tremor_at(tones, t + h);
    EXPECT_LT((now.velocity - (after.position - before.position) / (2 * h)).norm(), 1e-7);
    EXPECT_LT((now.rotation_rate - (after.rotation - before.rotation) / (2 * h)).norm(), 1e-6);
  }
}

TEST(Tremor, DependsOnItsSeedAlone) {
  const Tremor a{.position_rms_m = 1e-3, .seed = 5}, b{.position_rms_m = 1e-3, .seed = 6};
  EXPECT_EQ(tremor_at(make_tones(a), 1.5).position, tremor_at(make_tones(a), 1.5).position);
  EXPECT_GT((tremor_at(make_tones(a), 1.5).position - tremor_at(make_tones(b), 1.5).position).norm(), 1e-5);
}

// First outputs for seed 1234567, as published with the generator.
TEST(Tremor, GeneratorIsSplitMix64) {
  SplitMix64 random{1234567};
  EXPECT_EQ(random.next(), 6457827717110365317u);
  EXPECT_EQ(random.next(), 3203168211198807973u);
}

TEST(Tremor, RefusesABandThatIsNone) {
  EXPECT_THROW(make_tones({.low_Hz = 12, .high_Hz = 8}), InputError);
  EXPECT_THROW(make_tones({.low_Hz = 0}), InputError);
  EXPECT_THROW(make_tones({.position_rms_m = -1}), InputError);
  EXPECT_THROW(make_tones({.rotation_rms_rad = NAN}), InputError);
}

}  // namespace
}  // namespace sulcus
