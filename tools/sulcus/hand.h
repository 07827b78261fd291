// One device in a session: its servo at 1 kHz, and the mailboxes between servo and engine.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <thread>

#include "engine/device/device.h"
#include "engine/device/mailbox.h"
#include "engine/device/servo.h"
#include "verify/session_log.h"

namespace sulcus {

// Zero of the session's time.
struct SessionClock {
  double zero_s = 0;  // s of std::chrono::steady_clock
  double now_s() const;
};

// Moves a stylus to where the tool starts: a shift in the world, and a turn of the tool in the stylus. Way,
// velocity and force stay what they are.
struct Placement {
  Vec3 shift_m = Vec3::Zero();
  Quaternion turn = {};
};
DeviceSample placed(const Placement& placement, DeviceSample sample);
Placement placement_for(const DeviceSample& stylus, const Vec3& position_m, const Quaternion& orientation);

class Hand {
 public:
  // leads: the session ends with this device's trajectory; the others' tools stay where they end.
  Hand(std::unique_ptr<Device> device, std::size_t tool, const ServoSettings& settings, bool leads);

  // Opens, calibrates and arms; from then on the driver's servo runs, if it has one, and renders nothing.
  void arm();
  // From here on ticks are rendered and recorded. The log lives until close(). realtime: whether to ask for
  // it in the driver's thread.
  void start(const Placement& placement, const SessionClock& clock, SessionLog& log, bool realtime);
  void close();

  // Engine's thread: the newest sample, as Device::read() gives it. It stands still if the servo does.
  DeviceError newest(double time_s, DeviceSample& sample);
  // Engine's thread: what to render from now on. `steps` done when the state was left; -1 with an invalid
  // one.
  void publish(const CouplingSnapshot& coupling, std::int64_t steps) { couplings_.write({coupling, steps}); }

  // Servo's thread, for a device without one of its own: read, render, write.
  void serve(double time_s);

  Device& device() { return *device_; }
  std::size_t tool() const { return tool_; }
  bool leads() const { return leads_; }
  bool has_servo() const { return has_servo_; }  // a thread of its driver's
  const ServoSettings& settings() const { return settings_; }
  bool realtime() const { return realtime_.load(); }  // granted to the driver's thread

 private:
  struct Coupling {
    CouplingSnapshot snapshot;
    std::int64_t steps = -1;
  };
  struct Reading {
    DeviceSample sample;
    double time_s = 0;
    DeviceError error = DeviceError::recoverable;
  };

  static DeviceCommand driver_tick(void* hand, const DeviceSample& sample);
  DeviceCommand tick(double time_s, DeviceError error, const DeviceSample& sample);

  const std::unique_ptr<Device> device_;
  const std::size_t tool_;
  const ServoSettings settings_;
  const bool leads_;
  bool has_servo_ = false;
  Placement placement_;
  SessionClock clock_;
  SessionLog* log_ = nullptr;

  std::atomic<bool> started_{false}, realtime_{false};
  Mailbox<Coupling> couplings_;  // engine -> servo
  Mailbox<Reading> readings_;    // servo -> engine
  Reading newest_;               // engine's

  // Servo's thread only.
  Coupling coupling_;
  ServoState state_;
  ServoTick tick_;
  DeviceSample last_;
  bool ask_realtime_ = false, done_ = false;
  std::uint64_t ticks_ = 0;
};

// The servo of all hands whose devices have none: one thread, a thousand times a second.
class ServoThread {
 public:
  static constexpr double period_s = 0.001;

  // Returns after the first tick.
  ServoThread(std::span<const std::unique_ptr<Hand>> hands, const SessionClock& clock, bool realtime);
  ~ServoThread();
  bool runs() const { return thread_.joinable(); }
  bool realtime() const { return realtime_.load(); }

 private:
  std::atomic<bool> stop_{false}, begun_{false}, realtime_{false};
  std::thread thread_;
};

}  // namespace sulcus
