// Hands that feel: devices whose motion depends on the force that was written to them.
#pragma once

#include <memory>

#include "device_sim/scripted.h"

namespace sulcus {

// Mass, damper and spring between a script and the device's stylus, of hand and device together:
// m x'' = -b (x' - s') - k (x - s(t)) + F. The values are assumptions of equations.md section 6.
struct VirtualHand {
  double mass_kg = 0.1;        // kg, > 0
  double damping_N_s_m = 1.5;  // N s/m, >= 0
  double stiffness_N_m = 100;  // N/m, >= 0
};
inline constexpr VirtualHand device_alone = {0.045, 0.5, 0};
inline constexpr VirtualHand light_hand = {0.1, 1.5, 100};
inline constexpr VirtualHand firm_hand = {0.2, 5, 500};

// The hand moves from one read() to the next under the command of that time, in equal substeps of at most 1
// ms; in each the equation is solved exactly for a script that moves straight and a force that stays. Starts
// on the script at the first read(). A read() of an earlier time moves nothing. The orientation follows the
// script; torques are ignored. Ends as the script does. Throws InputError for the script, or for a hand that
// cannot be simulated.
std::unique_ptr<Device> make_hand_device(ScriptedTrajectory script, const VirtualHand& hand);

// Push until the device's force against the push reaches a threshold, hold, and come back the same way.
struct PushScript {
  Vec3 start_m = Vec3::Zero();  // m
  Quaternion orientation = {};  // unit within 1 %, throughout
  Vec3 direction = {0, 0, -1};  // of the push; normalised
  double speed_m_s = 0.01;      // m/s, > 0, both ways
  double threshold_N = 0.5;     // N, > 0
  double max_way_m = 0.05;      // m, > 0: the push ends here at the latest
  double hold_s = 1;            // s, >= 0
};

// Decides at each read() with the command of that time: a function of the reads and writes so far. After the
// way back read() gives DeviceError::ended. Throws InputError for numbers that make no sense.
std::unique_ptr<Device> make_push_device(const PushScript& script);

}  // namespace sulcus
