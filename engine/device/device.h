// What a haptic device is. No implementation here: see device_sim/ and hw_phantom/.
//
// Frame: right-handed world frame of the scene, metres; orientation is body -> world, quaternion order (s, x,
// y, z). A back-end converts from its own units and frame before it hands a sample over.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "engine/numerics/quaternion.h"
#include "engine/numerics/types.h"

namespace sulcus {

// One atomic snapshot of the device at a servo tick. Plain data; all that the engine ever sees of a device.
struct DeviceSample {
  std::uint64_t sequence = 0;            // tick number, from 0
  double time_s = 0;                     // s, monotonic, from the start of the session
  double interval_s = 0;                 // s, measured since the tick before
  Vec3 position = Vec3::Zero();          // m, of the stylus' reference point
  Quaternion orientation;                // unit, body -> world
  Vec3 linear_velocity = Vec3::Zero();   // m/s
  Vec3 angular_velocity = Vec3::Zero();  // rad/s, world axes
  bool linear_velocity_valid = false;
  bool angular_velocity_valid = false;
  bool docked = false;             // stylus in its inkwell
  std::uint32_t buttons = 0;       // bit b: button b is down
  Vec3 force_sent = Vec3::Zero();  // N, what the device was last told to render
  double motor_temperature = 0;    // share of the allowed range, 0..1; 0 where unknown
};

// What the device is asked to render until the expiry time; afterwards it renders nothing.
struct DeviceCommand {
  Vec3 force = Vec3::Zero();   // N, on the hand
  Vec3 torque = Vec3::Zero();  // N m, on the hand; ignored without 6 outputs
  double expiry_s = 0;         // s, on the sample's clock
};

struct DeviceCapabilities {
  std::string model;  // "scripted", "Phantom Omni", ...
  bool renders_force = false;
  bool renders_torque = false;
  double servo_rate_Hz = 0;   // ticks a second
  double max_force_N = 0;     // N, 0 = no limit known
  double max_torque_N_m = 0;  // N m
};

enum class DeviceState { closed, open, calibrated, armed, running, faulted };
enum class DeviceError { none, recoverable, fatal, ended };

constexpr const char* state_name(DeviceState state) {
  constexpr const char* names[] = {"closed", "open", "calibrated", "armed", "running", "faulted"};
  return names[static_cast<int>(state)];
}

// Work at the servo's own rate: the command that answers a sample (servo.h). Runs in the device's servo
// thread: must not throw, allocate, lock or wait.
using ServoFunction = DeviceCommand (*)(void* user, const DeviceSample& sample);

// Life: closed -open()-> open -calibrate()-> calibrated -arm()-> armed -read()-> running -close()-> closed.
// open(), calibrate() and arm() out of this order throw EnvironmentError; read() before arm() gives fatal.
// Any fatal error leads to faulted, where force is zero; only close() leads out of it.
class Device {
 public:
  virtual ~Device() = default;
  virtual DeviceCapabilities capabilities() const = 0;
  virtual DeviceState state() const = 0;

  virtual void open() = 0;       // throws EnvironmentError with the remedy if there is no device
  virtual void calibrate() = 0;  // may wait for the user
  virtual void arm() = 0;
  virtual void close() noexcept = 0;

  // The sample at simulated time time_s (scripted and recorded devices) or the newest one (hardware).
  // DeviceError::ended: the trajectory has no sample for that time. Does not throw, allocate or wait.
  virtual DeviceError read(double time_s, DeviceSample& sample) = 0;
  virtual void write(const DeviceCommand& command) = 0;

  // Before arm(). True: the device has a servo thread of its own and from arm() to close() calls `function`
  // there at each tick instead of waiting for write(). False: it has none; the caller reads, renders and
  // writes at 1 kHz. `user` must live until close().
  virtual bool set_servo(ServoFunction /*function*/, void* /*user*/) { return false; }

  // From arm() on: zero of the samples' clock as seconds of std::chrono::steady_clock, for a device with a
  // clock of its own. The others' samples carry the time that was given to read().
  virtual std::optional<double> clock_zero_s() const { return std::nullopt; }
};

}  // namespace sulcus
