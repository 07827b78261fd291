// A whole back-end, as docs/devices.md shows it: house_test holds the two to each other.
#pragma once

#include <cmath>

#include "device_sim/simulated.h"

class Metronome final : public sulcus::SimulatedDevice {
 public:
  sulcus::DeviceCapabilities capabilities() const override { return {.model = "metronome"}; }

 private:
  sulcus::DeviceError sample_at(double time_s, sulcus::DeviceSample& sample) override {
    if (time_s > 60) return sulcus::DeviceError::ended;
    sample = sulcus::DeviceSample();
    stamp(time_s, sample);  // sequence, time, interval, force_sent

    const double tooth = time_s - 2 * std::floor(0.5 * time_s);  // 0..2 s
    const bool forth = tooth < 1;
    sample.position = {0.01 * (forth ? tooth : 2 - tooth), 0, 0};
    sample.linear_velocity = {forth ? 0.01 : -0.01, 0, 0};
    sample.linear_velocity_valid = true;
    return sulcus::DeviceError::none;
  }
};
