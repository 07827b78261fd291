// How a test drives the stand-in of the Phantom's driver: exported beside the driver's own functions, found
// by dlsym.
#pragma once

#include <cstdint>

namespace sulcus::standin {

// Faults to come; all zero: a healthy Omni. Ticks count from the start of the scheduler, the first is 1.
struct Faults {
  // hdInitDevice
  unsigned int init_error;  // code pushed, if not 0
  int init_error_internal;
  int init_errors;           // how many times; 0 with a code: always
  bool garbage_handle;       // "success" with a handle out of range
  bool needs_decimal_point;  // reads a number in the present locale; with a comma the joints are dead
  // Calibration
  std::uint64_t manual_input_ticks;  // needs manual input up to this tick ...
  bool needs_update;                 // ... and then an update
  double jump_mm[3];                 // by which the position jumps at the update
  // Data
  std::uint64_t garbage_ticks;  // all zero up to this tick
  std::uint64_t nan_from, nan_ticks;
  std::uint64_t docked_ticks;               // in the inkwell up to this tick
  std::uint64_t glitch_from, glitch_ticks;  // of the buttons
  int buttons;                              // held
  double temperature;                       // of the motors at tick 0 ...
  double temperature_fall;                  // ... and by how much it falls each tick
  bool no_temperature, no_joints;           // the parameter is unknown
  // Scheduler
  double period_s;           // 0: 1 ms
  double jitter_s;           // of the period, up and down, pseudo-random
  std::uint64_t stall_from;  // this tick comes late ...
  double stall_s;            // ... by this
  bool refuse_rate;
  bool never_ticks;
  // Errors pushed at a frame's begin
  unsigned int error;  // code
  int error_internal;
  std::uint64_t error_from;   // first tick
  std::uint64_t error_every;  // 0: once
  std::uint64_t error_count;  // 0: no end
  // Others
  bool abort_on_disable;
  bool motors_stay_off;  // hdEnable of the force output has no effect
  bool old_version;      // HD_VERSION "2.0"
  int output_dof;        // 0: 3
};

// What a device has seen.
struct Observation {
  std::uint64_t frames;  // frames ended
  double force_N[3];     // in the motors now; zero unless enabled and set in the newest frame
  double torque_mN_m[3];
  double largest_force_N;                   // since reset
  double largest_step_N;                    // between two frames
  std::uint64_t forces_while_uncalibrated;  // frames with a force ...
  std::uint64_t forces_while_docked;
  std::uint64_t sets_outside_frames;
  std::uint64_t stops_with_force;  // of the scheduler, while the motors had a force
  bool initialised, motors_on, frame_open;
  int inits, disables;
};

// Joint and gimbal angles [rad] of the arm: base + amplitude sin(2 pi frequency t).
struct Motion {
  double joints[3], gimbals[3];
  double joint_amplitude[3], gimbal_amplitude[3];
  double frequency_Hz;
};

struct Control {
  void (*reset)(bool manual);  // all as at the start; manual: time moves by step() only
  void (*set_faults)(const Faults*);
  void (*set_motion)(int device, const Motion*);
  void (*observe)(int device, Observation*);
  void (*step)(int ticks);  // manual: the scheduler's ticks, in this thread
  void (*sleep)(double s);  // manual: as many ticks as fit, and the rest of the time
  double (*now_s)();        // the stand-in's clock
  int (*errors_on_stack)();
  void (*kinematics)(const double* joints, const double* gimbals, double* transform);
  std::uint64_t (*ticks)();
  bool (*scheduler_runs)();
  int (*inits_failed)();  // by init_error, since reset
};

// Exported as "standin_control". A program that cannot reach it sets SULCUS_STANDIN (world.cpp). With
// SULCUS_STANDIN_LOG set to a file, its 64 bytes are kept up to date, also when the process dies: struct Log
// of the first device.
struct Log {
  std::uint64_t frames;
  double force_N;  // norm, in the motors now
  double largest_force_N;
  std::uint64_t scheduler_runs, disabled;
};

}  // namespace sulcus::standin
