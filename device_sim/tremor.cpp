#include "device_sim/tremor.h"

#include <cmath>

#include "engine/numerics/elementary.h"
#include "engine/numerics/error.h"

namespace sulcus {

std::uint64_t SplitMix64::next() {
  std::uint64_t z = state += 0x9E3779B97F4A7C15u;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  return z ^ (z >> 31);
}

TremorTones make_tones(const Tremor& tremor) {
  if (!(tremor.position_rms_m >= 0) || !(tremor.rotation_rms_rad >= 0) ||
      !std::isfinite(tremor.position_rms_m) || !std::isfinite(tremor.rotation_rms_rad)) {
    throw InputError("trajectory: tremor: amplitudes must be finite and not negative (m, rad)");
  }
  if (!(tremor.low_Hz > 0) || !(tremor.high_Hz > tremor.low_Hz) || !std::isfinite(tremor.high_Hz)) {
    throw InputError("trajectory: tremor: band " + std::to_string(tremor.low_Hz) + " to " +
                     std::to_string(tremor.high_Hz) + " Hz; expected 0 < low < high");
  }
  constexpr double two_pi = 6.283185307179586;
  TremorTones tones;
  // The mean square of n tones of amplitude a is n a^2 / 2.
  const double amplitude_of_rms = std::sqrt(2.0 / TremorTones::tones);
  tones.position_amplitude_m = amplitude_of_rms * tremor.position_rms_m;
  tones.rotation_amplitude_rad = amplitude_of_rms * tremor.rotation_rms_rad;
  SplitMix64 random{tremor.seed};
  const double band_Hz = (tremor.high_Hz - tremor.low_Hz) / TremorTones::tones;
  for (auto& axis : tones.axes) {
    double low_Hz = tremor.low_Hz;
    for (TremorTones::Tone& tone : axis) {
      tone.angular_frequency = two_pi * (low_Hz + band_Hz * random.uniform());
      tone.phase = two_pi * random.uniform();
      low_Hz += band_Hz;
    }
  }
  return tones;
}

TremorMotion tremor_at(const TremorTones& tones, double time_s) {
  TremorMotion motion;
  if (tones.position_amplitude_m == 0 && tones.rotation_amplitude_rad == 0) return motion;
  for (std::size_t axis = 0; axis < 6; ++axis) {
    double sum = 0, rate = 0;
    for (const TremorTones::Tone& tone : tones.axes[axis]) {
      const double phase = tone.angular_frequency * time_s + tone.phase;
      sum += det_sin(phase);
      rate += tone.angular_frequency * det_cos(phase);
    }
    const auto i = static_cast<Eigen::Index>(axis % 3);
    if (axis < 3) {
      motion.position[i] = tones.position_amplitude_m * sum;
      motion.velocity[i] = tones.position_amplitude_m * rate;
    } else {
      motion.rotation[i] = tones.rotation_amplitude_rad * sum;
      motion.rotation_rate[i] = tones.rotation_amplitude_rad * rate;
    }
  }
  return motion;
}

}  // namespace sulcus
