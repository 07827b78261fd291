#include "tools/sulcus/hand.h"

#include <algorithm>
#include <vector>

#include "tools/sulcus/realtime.h"
#include "tools/sulcus/servo_replay.h"

namespace sulcus {

namespace {
constexpr double stale_sample_s = 0.02;  // as the Phantom has it
}

double SessionClock::now_s() const {
  return steady_now_s() - zero_s;
}

DeviceSample placed(const Placement& placement, DeviceSample sample) {
  sample.position += placement.shift_m;
  sample.orientation = sample.orientation * placement.turn;
  return sample;
}

Placement placement_for(const DeviceSample& stylus, const Vec3& position_m, const Quaternion& orientation) {
  return {position_m - stylus.position, normalised(conjugate(stylus.orientation) * orientation)};
}

Hand::Hand(std::unique_ptr<Device> device, std::size_t tool, const ServoSettings& settings, bool leads)
    : device_(std::move(device)), tool_(tool), settings_(settings), leads_(leads) {}

void Hand::arm() {
  device_->open();
  device_->calibrate();
  has_servo_ = device_->set_servo(&Hand::driver_tick, this);
  device_->arm();
}

void Hand::start(const Placement& placement, const SessionClock& clock, SessionLog& log, bool realtime) {
  placement_ = placement;
  clock_ = clock;
  log_ = &log;
  ask_realtime_ = realtime;
  started_.store(true, std::memory_order_release);
}

void Hand::close() {
  device_->close();
}

DeviceError Hand::newest(double time_s, DeviceSample& sample) {
  if (has_servo_) {
    DeviceSample stylus;
    const DeviceError error = device_->read(time_s, stylus);
    if (error == DeviceError::none || error == DeviceError::recoverable) sample = placed(placement_, stylus);
    return error;
  }
  readings_.read(newest_);
  sample = newest_.sample;
  const bool stale = newest_.error == DeviceError::none && time_s - newest_.time_s > stale_sample_s;
  return stale ? DeviceError::recoverable : newest_.error;
}

DeviceCommand Hand::tick(double time_s, DeviceError error, const DeviceSample& sample) {
  const double begin_s = steady_now_s();
  couplings_.read(coupling_);
  tick_.number = ticks_++;
  tick_.time_s = time_s;
  tick_.coupling_step = coupling_.steps;
  tick_.error = static_cast<std::uint32_t>(error);
  tick_.sample = placed(placement_, sample);
  const DeviceCommand command = servo_command(coupling_.snapshot, tick_, settings_, state_);
  tick_.force = command.force;
  tick_.torque = command.torque;
  tick_.work_s = steady_now_s() - begin_s;
  log_->push_tick(tool_, tick_);
  return command;
}

DeviceCommand Hand::driver_tick(void* user, const DeviceSample& sample) {
  Hand& hand = *static_cast<Hand*>(user);
  if (!hand.started_.load(std::memory_order_acquire)) return {};
  if (hand.ask_realtime_) {
    hand.ask_realtime_ = false;
    hand.realtime_.store(schedule_realtime(servo_priority));
  }
  return hand.tick(hand.clock_.now_s(), DeviceError::none, sample);
}

void Hand::serve(double time_s) {
  if (done_) return;
  const DeviceError error = device_->read(time_s, last_);
  const DeviceCommand command = tick(time_s, error, last_);
  done_ = error == DeviceError::fatal || error == DeviceError::ended;
  if (!done_) device_->write(command);
  readings_.write({tick_.sample, time_s, error});
}

ServoThread::ServoThread(std::span<const std::unique_ptr<Hand>> hands, const SessionClock& clock,
                         bool realtime) {
  std::vector<Hand*> served;
  for (const auto& hand : hands) {
    if (!hand->has_servo()) served.push_back(hand.get());
  }
  if (served.empty()) return;
  thread_ = std::thread([this, served, clock, realtime] {
    realtime_.store(realtime && schedule_realtime(servo_priority));
    double next_s = clock.now_s();
    while (!stop_.load(std::memory_order_acquire)) {
      const double time_s = clock.now_s();
      for (Hand* hand : served) hand->serve(time_s);
      if (!begun_.exchange(true)) begun_.notify_one();
      next_s = std::max(next_s + period_s, clock.now_s());  // ticks that were missed are not made up for
      sleep_until_s(clock.zero_s + next_s);
    }
  });
  begun_.wait(false);
}

ServoThread::~ServoThread() {
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

}  // namespace sulcus
