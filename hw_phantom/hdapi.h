// The driver interface of the Phantom family (OpenHaptics libHD 3.x), as far as Sulcus uses it. The library
// is found and bound at run time, so Sulcus builds and ships without the vendor's kit. Declared from
// published facts, not from the vendor's headers; not checked against a real device (docs/devices.md).
//
// Units of the driver: mm, mm/s, N, mN m, rad. Its frame: right-handed, +x right, +y up, +z towards the user.
#pragma once

#include <string>
#include <vector>

#include "engine/numerics/error.h"

namespace sulcus::hd {

static_assert(sizeof(void*) == 8 && sizeof(long) == 8,
              "libHD is called with the calling convention of Linux x86-64");

using Handle = unsigned int;
using Boolean = unsigned char;  // one byte, both as result and as output
inline constexpr Handle invalid_handle = 0xFFFFFFFF;
inline constexpr Handle largest_handle =
    1024;  // some versions return garbage and no error after a failed init

// Popped from a stack, newest first, possibly of an earlier call. Without an error only `code` has a meaning.
struct ErrorRecord {
  unsigned int code;
  int internal;
  Handle device;
};
static_assert(sizeof(ErrorRecord) == 12);

enum Parameter : unsigned int {
  current_buttons = 0x2000,               // int, bit mask
  current_inkwell_switch = 0x2002,        // Boolean, 0 = docked
  current_velocity = 0x2051,              // 3 double, mm/s, smoothed by the driver
  current_transform = 0x2052,             // 16 double, column-major, mm; gimbal centre
  current_joint_angles = 0x2100,          // 3 double, rad: turret, thigh, shin (convert.h)
  current_gimbal_angles = 0x2150,         // 3 double, rad
  api_version = 0x2500,                   // string
  device_model = 0x2501,                  // string
  driver_version = 0x2502,                // string
  device_vendor = 0x2503,                 // string
  serial_number = 0x2504,                 // string
  firmware_version = 0x2505,              // double
  usable_workspace = 0x2551,              // 6 double, mm: min x y z, max x y z
  input_dof = 0x2553,                     // int
  output_dof = 0x2554,                    // int
  calibration_style = 0x2555,             // int, bits below
  nominal_max_force = 0x2603,             // double, N, cold motors
  nominal_max_continuous_force = 0x2604,  // double, N
  motor_temperature = 0x2605,             // up to 6 double, predicted, 0 cold .. 1 hot
  current_force = 0x2700,                 // 3 double, N
  current_torque = 0x2701,  // 3 double, mN m (the 3.0 manual also says N m: see docs/devices.md)
};

enum Capability : unsigned int {
  software_velocity_limit = 0x2606,
  software_force_impulse_limit = 0x2607,
  force_output = 0x4000,
  max_force_clamping = 0x4001,
  force_ramping = 0x4002,
  software_force_limit = 0x4003,
};

enum Calibration : unsigned int {
  calibration_ok = 0x5000,
  needs_update = 0x5001,
  needs_manual_input = 0x5002
};
enum CalibrationStyle : unsigned int { encoder_reset = 1, automatic = 2, inkwell = 4 };
enum CallbackResult : unsigned int { callback_done = 0, callback_continue = 1 };

enum Error : unsigned int {
  success = 0x0000,
  warm_motors = 0x0200,
  exceeded_force = 0x0201,
  exceeded_impulse = 0x0202,
  exceeded_velocity = 0x0203,
  force_error = 0x0204,
  device_fault = 0x0300,
  already_initiated = 0x0301,
  comm_error = 0x0302,
  comm_config_error = 0x0303,
  timer_error = 0x0304,
  invalid_license = 0x0600,
};

using Callback = unsigned int (*)(void* user);

// The bound functions; every pointer is set.
struct Api {
  Handle (*init_device)(const char* name);  // null: the default device
  void (*disable_device)(Handle);
  void (*make_current_device)(Handle);
  Handle (*get_current_device)();
  void (*begin_frame)(Handle);
  void (*end_frame)(Handle);
  ErrorRecord (*get_error)();
  const char* (*get_error_string)(unsigned int code);
  void (*enable)(unsigned int capability);
  void (*disable)(unsigned int capability);
  Boolean (*is_enabled)(unsigned int capability);
  void (*get_boolean)(unsigned int parameter, Boolean* out);
  void (*get_integer)(unsigned int parameter, int* out);
  void (*get_double)(unsigned int parameter, double* out);
  const char* (*get_string)(unsigned int parameter);
  void (*set_double)(unsigned int parameter, const double* in);
  unsigned int (*check_calibration)();
  void (*update_calibration)(unsigned int style);
  void (*start_scheduler)();
  void (*stop_scheduler)();
  void (*set_scheduler_rate)(unsigned long hz);
  unsigned long (*schedule_asynchronous)(Callback, void* user, unsigned short priority);
  void (*unschedule)(unsigned long operation);

  std::string path;         // what was loaded
  void* library = nullptr;  // never closed: the driver does not survive a second load
};

// Why a Phantom cannot be used, each with a remedy of its own in the message.
enum class Failure {
  library_absent,
  dependency_absent,
  symbol_absent,
  version,
  device,
  configuration,
  licence,
  calibration
};

struct OpenError : EnvironmentError {
  OpenError(Failure failure_, const std::string& message) : EnvironmentError(message), failure(failure_) {}
  Failure failure;
};

// The names tried, in this order: `library` alone if it is not empty; else the environment variable
// SULCUS_LIBHD alone if it is set; else libHD.so.3.4, libHD.so, libHD.so.3.0 and libHD.so.3 as the loader
// finds them, then the same in /usr/lib, /usr/lib64, /usr/lib/x86_64-linux-gnu, /opt/OpenHaptics and its lib
// and lib64.
std::vector<std::string> search_order(const std::string& library);

// Loads and binds the first that works. Throws OpenError: library_absent (all of them), else the most telling
// failure: dependency_absent with the loader's own words and a hint, or symbol_absent with the symbol's name.
Api load(const std::string& library);

// Empties the error stack (at most 64 records, should it never end) and returns it, newest first.
struct Errors {
  ErrorRecord records[64];
  int count = 0;
};
Errors drain(const Api& api);

// Only the force errors 0x0200..0x0204 are survived by a running servo; every other code ends it.
constexpr bool is_recoverable(unsigned int code) {
  return code >= warm_motors && code <= force_error;
}

// "0x0302 (communication lost), internal -28"
std::string describe(unsigned int code, int internal);

// The failure and the remedy for an error of hdInitDevice.
OpenError open_error(const ErrorRecord& error, const std::string& device_name);

}  // namespace sulcus::hd
