// A device that gives again the samples of a recording, bit by bit.
#pragma once

#include <memory>
#include <vector>

#include "engine/device/device.h"

namespace sulcus {

struct RecordedTrajectory {
  std::vector<DeviceSample> samples;  // at least one
  // [samples] s, strictly increasing: the time for which each sample was read (a session: the start of the
  // engine's step that consumed it). Empty: the samples' own times, which then must be strictly increasing.
  std::vector<double> read_times_s;
};

// Open loop: read(t) gives the newest sample whose read time is not later than t (within a nanosecond), with
// every field as recorded, also values that are not finite; before the first read time, the first sample.
// More than a nanosecond past the last read time: DeviceError::ended. Commands are ignored.
// Throws InputError for no samples, times that do not increase or are not finite, counts that differ.
std::unique_ptr<Device> make_recorded_device(RecordedTrajectory trajectory);
std::unique_ptr<Device> make_recorded_device(std::vector<DeviceSample> samples);

}  // namespace sulcus
