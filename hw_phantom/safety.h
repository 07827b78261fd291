// What stands between a command and the motors, at every servo tick. Pure functions: tested without a device.
#pragma once

#include <cstdint>

#include "engine/numerics/types.h"

namespace sulcus {

struct SafetyLimits {
  double max_force_N =
      0.88;  // N, norm of the force; the device's own continuous force if it tells a smaller one
  double max_torque_N_m = 0.1;    // N m, norm of the torque
  double slew_N_s = 400;          // N/s, fastest change of the force, in a tick at most that of 2 ms
  double torque_slew_N_m_s = 40;  // N m/s
  double soft_start_s = 0.5;      // s, from nothing to full force after a start, a dock, a pause or an error
  double watchdog_s = 0.03;       // s, a command older than this fades ...
  double decay_s = 0.02;          // s, ... to nothing within this
  double max_interval_s = 0.02;   // s, a longer servo tick (stall, breakpoint) sends nothing and starts anew
  Vec3 workspace_min = Vec3::Constant(-1e3);  // m, driver's frame
  Vec3 workspace_max = Vec3::Constant(1e3);   // m
  double workspace_fade_m = 0.01;             // m, outside of the box over which the force fades to nothing
  double fade_speed_m_s = 0.8;                // m/s, above it the force fades ...
  double max_speed_m_s = 1.2;                 // m/s, ... to nothing here, and starts anew
  double fade_temperature = 0.7;              // share of the allowed range, above it the force fades ...
  double max_temperature = 0.95;              // ... to nothing here
};

struct SafetyInput {
  bool permitted = false;  // armed, calibrated, not docked, not paused, no error, hold-to-run button down
  bool pose_valid = false;
  Vec3 force = Vec3::Zero();     // N, wanted; driver's frame
  Vec3 torque = Vec3::Zero();    // N m, wanted
  double command_age_s = 0;      // s
  double interval_s = 0;         // s, measured since the tick before
  Vec3 position = Vec3::Zero();  // m, driver's frame
  double speed_m_s = 0;          // m/s
  double temperature = 0;        // hottest motor, 0..1
};

// Why the command was not sent as it was.
enum SafetyReason : std::uint32_t {
  reason_not_permitted = 1,
  reason_pose = 2,
  reason_not_finite = 4,
  reason_stall = 8,
  reason_command_age = 16,
  reason_workspace = 32,
  reason_speed = 64,
  reason_temperature = 128,
  reason_soft_start = 256,
  reason_norm = 512,
  reason_slew = 1024,
};

// Carried from tick to tick.
struct SafetyState {
  double soft_start = 0;       // 0..1
  Vec3 force = Vec3::Zero();   // N, what was sent
  Vec3 torque = Vec3::Zero();  // N m
};

// Updates `state`; state.force and state.torque are to be sent. Zero at once, and a soft start to come, when
// not permitted, without a valid pose, with anything that is not finite, after a stall, at or above the
// largest speed; otherwise faded, clamped and slew-limited. Returns the reasons, a mask of SafetyReason.
std::uint32_t limit_force(const SafetyLimits& limits, const SafetyInput& input, SafetyState& state);

}  // namespace sulcus
