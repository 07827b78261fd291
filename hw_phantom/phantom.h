// The Phantom Omni / Touch and its relatives as a Device: 6 inputs, 3 outputs (6 where the device has them).
//
// Each servo tick runs in the driver's own thread: read, convert, guard (safety.h), send, publish through
// mailboxes. Nothing has been checked against a real device yet: docs/devices.md says what that leaves open.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "engine/device/device.h"
#include "hw_phantom/convert.h"
#include "hw_phantom/safety.h"

namespace sulcus {

// Time as the device sees it; tests put a stand-in here.
struct PhantomClock {
  double (*now_s)();          // s, monotonic; called in the servo thread
  void (*sleep_s)(double s);  // waits, in the controlling thread
};
PhantomClock steady_clock();

struct PhantomSettings {
  std::string library;      // file of libHD; empty: search (hdapi.h)
  std::string device_name;  // empty: the driver's default device
  double rate_Hz = 1000;    // asked for; a driver that refuses goes on at its own
  DeviceMount mount;
  SafetyLimits safety;                // workspace and force are narrowed to what the device tells
  int hold_button = -1;               // button that must be held for any force; -1: none
  double calibration_timeout_s = 30;  // s, for the user to dock the stylus
  bool skip_disable = false;          // at close(): for systems where disabling a device crashes the driver
  PhantomClock clock = steady_clock();
};

// Counters and last events of the servo; a copy, made by status().
struct PhantomStatus {
  std::uint64_t ticks = 0;            // since open()
  std::uint64_t late_ticks = 0;       // interval above 1.5 of the nominal one
  double max_interval_s = 0;          // s
  std::uint64_t invalid_samples = 0;  // not published: not finite, not a pose
  std::uint64_t stalls = 0;           // intervals above the safety limit
  std::uint64_t commands_not_finite = 0;
  std::uint64_t torques_ignored = 0;  // commands with a torque, on a device with 3 outputs
  std::uint64_t force_errors = 0;     // 0x0200..0x0204
  unsigned int last_error = 0;        // code of the driver, 0 = none
  int last_error_internal = 0;
  unsigned int calibration = 0;  // code of the driver, 0 = not asked yet
  std::uint32_t reasons = 0;     // SafetyReason of the newest tick
  bool docked = false;           // stylus in the inkwell
  double max_command_age_s = 0;  // s, while armed
  // Until calibrate() is called: the arm as its joints tell it, and how far an Omni's gimbal would then be
  // from where the driver says it is.
  bool joints_known = false;
  ArmAngles joints;
  double joints_off_m = 0, joints_off_rad = 0;
};

struct PhantomIdentity {
  std::string library, api_version, driver_version, model, vendor, serial;
  double firmware = 0;
  int inputs = 0, outputs = 0;
  int calibration_style = 0;  // mask of the driver
  double max_force_N = 0, continuous_force_N = 0;
  bool rate_refused = false;
};

class PhantomDevice : public Device {
 public:
  // Sends nothing while paused; a soft start follows.
  virtual void pause(bool paused) = 0;
  virtual PhantomStatus status() = 0;
  virtual const PhantomIdentity& identity() const = 0;  // from open() on
};

// open(): loads the driver, starts the servo, waits until data are sound. Forces are off until arm().
// calibrate(): waits for the user where the device needs it (inkwell), then until the pose has settled.
// read(): the newest sample; recoverable if it is older than 20 ms, fatal after a fault or 0.5 s without one.
// All throw OpenError (an EnvironmentError) with the remedy.
std::unique_ptr<PhantomDevice> make_phantom_device(PhantomSettings settings);

// What `sulcus device --check phantom` tells. Never turns the motors on.
struct Finding {
  bool good = false;
  std::string text;
};
std::vector<Finding> diagnose_phantom(const PhantomSettings& settings, double watch_s = 5);

}  // namespace sulcus
