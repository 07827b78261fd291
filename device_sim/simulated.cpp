#include "device_sim/simulated.h"

#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"

namespace sulcus {

void SimulatedDevice::open() {
  advance(DeviceState::closed, DeviceState::open, "open()");
  command_ = DeviceCommand();
  sequence_ = 0;
  last_time_s_ = 0;
  restart();
}

void SimulatedDevice::calibrate() {
  advance(DeviceState::open, DeviceState::calibrated, "calibrate()");
}

void SimulatedDevice::arm() {
  advance(DeviceState::calibrated, DeviceState::armed, "arm()");
}

void SimulatedDevice::advance(DeviceState from, DeviceState to, const char* call) {
  if (state_ != from) {
    throw EnvironmentError("device '" + capabilities().model + "': " + call + " called in state '" +
                           state_name(state_) + "'; expected '" + state_name(from) +
                           "': call open(), calibrate(), arm() once each, in this order");
  }
  state_ = to;
}

DeviceError SimulatedDevice::read(double time_s, DeviceSample& sample) {
  if (state_ != DeviceState::armed && state_ != DeviceState::running) return DeviceError::fatal;
  state_ = DeviceState::running;
  const DeviceError error = std::isfinite(time_s) ? sample_at(time_s, sample) : DeviceError::fatal;
  if (error == DeviceError::fatal) state_ = DeviceState::faulted;
  return error;
}

void SimulatedDevice::write(const DeviceCommand& command) {
  command_ = command;
  if (!command.force.allFinite()) command_.force.setZero();
  if (!command.torque.allFinite()) command_.torque.setZero();
}

DeviceCommand SimulatedDevice::command_at(double time_s) const {
  return time_s <= command_.expiry_s ? command_ : DeviceCommand();
}

void SimulatedDevice::stamp(double time_s, DeviceSample& sample) {
  sample.sequence = sequence_;
  sample.time_s = time_s;
  sample.interval_s = sequence_ == 0 ? 0 : std::max(0.0, time_s - last_time_s_);
  sample.force_sent = command_at(time_s).force;
  ++sequence_;
  last_time_s_ = time_s;
}

}  // namespace sulcus
