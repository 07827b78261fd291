// Tremor of a hand: a small band-limited motion that looks random and is a function of seed and time alone.
#pragma once

#include <array>
#include <cstdint>

#include "engine/numerics/quaternion.h"
#include "engine/numerics/types.h"

namespace sulcus {

// Physiological tremor of the hand lies at 8 to 12 Hz.
struct Tremor {
  double position_rms_m = 0;    // m, root mean square of each axis over a long time; 0 = none
  double rotation_rms_rad = 0;  // rad, of each component of the rotation vector
  double low_Hz = 8;
  double high_Hz = 12;  // band: 0 < low < high
  std::uint64_t seed = 1;
};

// The project's own generator (splitmix64): a full-period counter, scrambled.
struct SplitMix64 {
  std::uint64_t state = 0;

  std::uint64_t next();
  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }  // [0, 1)
};

// Eight tones an axis with random frequencies, one from each eighth of the band, and random phases.
struct TremorTones {
  static constexpr int tones = 8;
  struct Tone {
    double angular_frequency = 0;  // rad/s
    double phase = 0;              // rad
  };
  std::array<std::array<Tone, tones>, 6> axes{};  // three of the position, three of the rotation
  double position_amplitude_m = 0, rotation_amplitude_rad = 0;  // of each tone
};

TremorTones make_tones(
    const Tremor& tremor);  // throws InputError for a band or an amplitude that makes no sense

struct TremorMotion {
  Vec3 position = Vec3::Zero(), velocity = Vec3::Zero();  // m, m/s
  Vec3 rotation = Vec3::Zero(),
       rotation_rate = Vec3::Zero();  // rad, rad/s: rotation vector and its time derivative
};
TremorMotion tremor_at(const TremorTones& tones,
                       double time_s);  // |time_s| up to 1000 s or more (det_sin's range)

}  // namespace sulcus
