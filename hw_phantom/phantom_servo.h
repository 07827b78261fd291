// The Phantom's share of a servo tick: what runs in the driver's thread, and the mailboxes to the controlling
// thread.
#pragma once

#include <atomic>
#include <thread>

#include "engine/device/mailbox.h"
#include "hw_phantom/driver.h"
#include "hw_phantom/phantom.h"

namespace sulcus {

// What the controlling thread wants; the servo reaches it within a tick or more.
enum class ServoMode : int {
  watch,      // read and publish, motors off
  calibrate,  // and bring the calibration to "ok"
  run,        // motors on, forces as commanded
  stop,       // zero force, motors off
};

struct StampedCommand {
  DeviceCommand command;
  double written_s = 0;  // s, servo's clock
};

// Everything is set before the servo starts, but for the atomics and mailboxes.
struct PhantomServo final : hd::Servo {
  bool tick(const hd::Api& api, hd::Handle device) override;
  void rest(bool resting) noexcept override { resting_.store(resting, std::memory_order_relaxed); }

  // Set before attaching.
  std::thread::id controller;  // the thread that controls the device
  double (*now_s)() = nullptr;
  DeviceMount mount;
  SafetyLimits limits;
  double nominal_interval_s = 0.001;
  int hold_button = -1;
  bool has_inkwell = false;
  bool has_temperature = false;
  bool renders_torque = false;
  unsigned int calibration_style = 0;  // the one bit to update with
  ServoFunction function = nullptr;    // set before arming
  void* user = nullptr;

  // Between the threads.
  std::atomic<ServoMode> mode{ServoMode::watch};     // controlling thread writes
  std::atomic<bool> paused{false};                   // controlling thread writes
  std::atomic<double> start_s{0};                    // zero of the samples' clock; controlling thread writes
  std::atomic<ServoMode> reached{ServoMode::watch};  // servo writes, when `mode` has been carried out
  std::atomic<bool> faulted{false};                  // servo writes
  std::atomic<std::uint64_t> ticks{0};               // servo writes
  std::atomic<unsigned int> calibration{0};          // servo writes; code of the driver
  Mailbox<DeviceSample> samples;                     // servo -> control
  Mailbox<PhantomStatus> statuses;                   // servo -> control
  Mailbox<StampedCommand> commands;                  // control -> servo

 private:
  struct Reading {
    StylusPose pose;               // driver's frame, m
    Vec3 velocity = Vec3::Zero();  // m/s, driver's frame
    bool valid = false;
    bool velocity_valid = false;
    int buttons = 0;
    bool docked = false;
    double temperature = 0;  // hottest motor
  };

  Reading read(const hd::Api& api) const;
  void read_joints(const hd::Api& api, const StylusPose& pose);
  bool survives(const hd::Api& api);  // drains the errors
  void note(const hd::Errors& errors);
  void debounce(int raw);
  DeviceSample make_sample(const Reading& reading);
  StampedCommand command_for(const DeviceSample& sample);
  void decide(const Reading& reading, const DeviceSample& sample);  // what to send: safety_
  void send(const hd::Api& api) const;
  bool change_mode(const hd::Api& api, hd::Handle device);  // false: the motors could not be switched on
  bool calibrate(const hd::Api& api);                       // true: done and settled
  bool switch_motors_on(const hd::Api& api);
  void fail(const hd::Api& api, hd::Handle device);

  std::atomic<bool> resting_{false};

  // Servo thread only.
  PhantomStatus status_;
  SafetyState safety_;
  StampedCommand command_;
  double last_time_s_ = 0, interval_s_ = 0;
  std::uint64_t sequence_ = 0;
  double sequence_start_s_ = 0;
  bool asks_joints_ = true;  // until the driver does not know them
  Reading last_;             // the newest valid one
  double last_valid_s_ = 0;  // s, when
  double speed_m_s_ = 0;     // the larger of the driver's and the measured one
  Vec3 angular_velocity_ = Vec3::Zero();
  bool angular_velocity_valid_ = false;
  int raw_buttons_ = 0, raw_button_ticks_ = 0;
  std::uint32_t buttons_ = 0;
  int invalid_run_ = 0;         // ticks without a valid sample, in a row
  int settled_ticks_ = 0;       // since the calibration was ok
  double warm_error_s_ = -1e9;  // s, when the motors were too warm last
  bool too_warm_ = false;
  double force_error_s_[4] = {-1e9, -1e9, -1e9, -1e9};  // s, when the last ones came
  bool error_this_tick_ = false;
  int last_ticks_ = 5;  // frames with a zero force after a fault, then the servo is done
};

}  // namespace sulcus
