// Faults on top of any other device: what a real one does on a bad day, for scenarios and tests.
#pragma once

#include <cstdint>
#include <memory>

#include "engine/device/device.h"

namespace sulcus {

// All zero (and time_rate 1): the device below, bit by bit. Times are those given to read(). Random choices
// come from the project's own generator and depend on seed and number of the read alone.
struct Perturbation {
  std::uint64_t seed = 1;
  double time_rate = 1;       // > 0: the device below is read at time_rate * time; velocities are scaled
  double jitter_s = 0;        // s: it is read up to this much earlier or later, never before an earlier read
  double lost_share = 0;      // 0..1 of the reads give DeviceError::recoverable and the sample before
  double late_share = 0;      // 0..1 of the reads give an old sample: the newest that is ...
  double late_s = 0;          // s, ... at least this old (up to 64 reads back)
  double stuck_from_s = 0;    // s: from here ...
  double stuck_for_s = 0;     // s, ... for so long every read gives the same sample
  double encoder_step_m = 0;  // m: positions are rounded to multiples
  double encoder_step_rad = 0;  // rad: components of the rotation vector likewise
  double nan_from_s = 0;        // s: from here ...
  double nan_for_s = 0;         // s, ... for so long the position is not a number
  double disconnect_at_s = -1;  // s: from here on read() is fatal; negative: never
};

// Throws InputError for shares outside 0..1, negative times and steps, a rate that is not positive.
std::unique_ptr<Device> make_perturbed_device(std::unique_ptr<Device> device,
                                              const Perturbation& perturbation);

}  // namespace sulcus
