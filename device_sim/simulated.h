// What the simulated devices share: the order of life, the command they were told, and the checks of read().
#pragma once

#include "engine/device/device.h"

namespace sulcus {

// A device whose sample is a function of time (and, for some, of the commands written so far).
class SimulatedDevice : public Device {
 public:
  DeviceState state() const override { return state_; }
  void open() override;
  void calibrate() override;
  void arm() override;
  void close() noexcept override { state_ = DeviceState::closed; }

  // fatal: not armed, or time_s is not finite; the device is faulted then (unless it was closed or not yet
  // armed).
  DeviceError read(double time_s, DeviceSample& sample) final;
  // A force that is not finite is taken as zero.
  void write(const DeviceCommand& command) override;

 protected:
  virtual void restart() {}  // called by open(): forget the session before
  virtual DeviceError sample_at(double time_s, DeviceSample& sample) = 0;

  // The command in force at that time: zero after its expiry.
  DeviceCommand command_at(double time_s) const;
  // Sequence number, time, measured interval and force_sent of a sample taken now.
  void stamp(double time_s, DeviceSample& sample);

 private:
  void advance(DeviceState from, DeviceState to, const char* call);

  DeviceState state_ = DeviceState::closed;
  DeviceCommand command_;
  std::uint64_t sequence_ = 0;
  double last_time_s_ = 0;
};

}  // namespace sulcus
