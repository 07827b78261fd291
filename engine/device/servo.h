// The servo's share of the virtual coupling: what the hand feels between two steps of the engine. Not a
// staircase: the coupling spring is evaluated at every servo tick against the tool's last pose, carried on by
// its velocity within bounds, and then filtered.
#pragma once

#include "engine/device/device.h"

namespace sulcus {

// The coupling as the engine left it at the end of a step (thesis 4.5.1); plain data, passed through a
// Mailbox.
struct CouplingSnapshot {
  bool valid = false;                         // false: no tool is coupled, nothing is rendered
  double time_s = 0;                          // s, the moment that the pose is for: when the engine read the
                                              // samples of that step, on the sample's clock
  Vec3 tool_position = Vec3::Zero();          // m
  Quaternion tool_orientation;                // unit, body -> world
  Vec3 tool_linear_velocity = Vec3::Zero();   // m/s
  Vec3 tool_angular_velocity = Vec3::Zero();  // rad/s, world axes
  double stiffness_N_m = 0;                   // k_c
  double damping_N_s_m = 0;                   // b_c
  double rotational_stiffness_N_m_rad = 0;    // k_theta
  double rotational_damping_N_m_s_rad = 0;    // b_theta
};

struct ServoSettings {
  double filter_Hz = 0;                // cut-off of the output filter; 0 = none
  double max_extrapolation_s = 0.1;    // s, how long the tool is carried on; then it stands still
  double max_extrapolation_m = 0.02;   // m, and how far: 0.3 m/s over two steps of 33 ms
  double max_extrapolation_rad = 0.5;  // rad, and how far it turns
  double max_age_s = 0.2;              // s, an older snapshot renders nothing
  double command_life_s = 0.005;       // s, expiry of the command after the sample it answers
};

struct ServoState {
  Vec3 force = Vec3::Zero();   // N, output of the filter
  Vec3 torque = Vec3::Zero();  // N m
};

// Force and torque on the hand at this sample (F = k_c (x_tool - x_hand) + b_c (v_tool - v_hand); torque
// likewise with the rotation vector from hand to tool; a velocity that is not valid leaves its damping out),
// low-passed with the sample's measured interval: y += (1 - exp(-2 pi f T)) (x - y). A snapshot that is not
// valid, too old or not finite, or a sample that is not finite, gives zero and clears the filter. A function
// of its arguments alone; does not allocate or throw; below a microsecond.
DeviceCommand render(const CouplingSnapshot& coupling, const DeviceSample& sample,
                     const ServoSettings& settings, ServoState& state);

}  // namespace sulcus
