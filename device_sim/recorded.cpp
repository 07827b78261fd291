#include "device_sim/recorded.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "device_sim/simulated.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double time_tolerance_s = 1e-9;  // step times n*h carry rounding

RecordedTrajectory checked(RecordedTrajectory trajectory) {
  std::vector<double>& times = trajectory.read_times_s;
  if (trajectory.samples.empty()) throw InputError("recorded trajectory: no samples; give at least one");
  if (times.empty()) {
    for (const DeviceSample& sample : trajectory.samples) times.push_back(sample.time_s);
  }
  if (times.size() != trajectory.samples.size()) {
    throw InputError("recorded trajectory: " + std::to_string(times.size()) + " read times for " +
                     std::to_string(trajectory.samples.size()) + " samples; give one a sample");
  }
  for (std::size_t i = 0; i < times.size(); ++i) {
    const std::string place = "recorded trajectory: sample " + std::to_string(i) + ": ";
    if (!std::isfinite(times[i])) throw InputError(place + "time is not finite; give seconds");
    if (i > 0 && !(times[i] > times[i - 1])) {
      throw InputError(place + "time " + std::to_string(times[i]) + " s is not after " +
                       std::to_string(times[i - 1]) + " s; times must increase");
    }
  }
  return trajectory;
}

class RecordedDevice final : public SimulatedDevice {
 public:
  explicit RecordedDevice(RecordedTrajectory trajectory) : trajectory_(checked(std::move(trajectory))) {}

  DeviceCapabilities capabilities() const override { return {.model = "recorded"}; }

 private:
  DeviceError sample_at(double time_s, DeviceSample& sample) override {
    const std::vector<double>& times = trajectory_.read_times_s;
    if (time_s > times.back() + time_tolerance_s) return DeviceError::ended;
    const auto later = std::upper_bound(times.begin(), times.end(), time_s + time_tolerance_s);
    const std::size_t i = later == times.begin() ? 0 : static_cast<std::size_t>(later - times.begin()) - 1;
    sample = trajectory_.samples[i];
    return DeviceError::none;
  }

  RecordedTrajectory trajectory_;
};

}  // namespace

std::unique_ptr<Device> make_recorded_device(RecordedTrajectory trajectory) {
  return std::make_unique<RecordedDevice>(std::move(trajectory));
}

std::unique_ptr<Device> make_recorded_device(std::vector<DeviceSample> samples) {
  return make_recorded_device(RecordedTrajectory{std::move(samples), {}});
}

}  // namespace sulcus
