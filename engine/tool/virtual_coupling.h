// Virtual coupling (thesis 4.5.1 as corrected in equations.md 2.5 and 4): a 6-DoF spring and damper between
// the device's pose and the tool, and the low-pass filter of the displayed force.
#pragma once

#include "engine/device/device.h"
#include "engine/tool/rigid_body.h"

namespace sulcus {

struct VirtualCoupling {
  double stiffness_N_m = 1000;                 // k_c
  double damping_N_s_m = 10;                   // b_c
  double rotational_stiffness_N_m_rad = 0.3;   // k_theta
  double rotational_damping_N_m_s_rad = 0.03;  // b_theta
};

// Misalignment u [rad, world axes] that turns the tool's orientation into the device's: rotation vector of
// q_device * conjugate(q_tool), |u| <= pi.
Vec3 misalignment(const Quaternion& device, const Quaternion& tool);

// H = c I + (1-c) e e^T with c = (theta/2) cot(theta/2), theta = |u|, e = u/theta: symmetric part of
// -du/dphi, positive semidefinite for theta <= pi.
Mat3 misalignment_stiffness(const Vec3& u);

// First-order low-pass filter, exact for an input held constant over the step: y += alpha (x - y).
// alpha = 1 - exp(-2 pi f h); 1 (filter off) for f <= 0.
double low_pass_alpha(double cutoff_Hz, double step_s);

}  // namespace sulcus
