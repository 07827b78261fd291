// Kinematics of an Omni as published after Harders et al. 2009; lengths in mm, angles in rad, in the driver's
// frame.
#pragma once

#include <cmath>

namespace sulcus::standin {

inline constexpr double arm_mm = 133.35;  // upper arm and forearm alike

inline void multiply(const double (&a)[9], const double (&b)[9], double (&c)[9]) {  // row-major
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j)
      c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
  }
}

inline void turn(int axis, double angle, double (&r)[9]) {
  const double c = std::cos(angle), s = std::sin(angle);
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  double m[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
  m[4 * axis] = 1;
  m[4 * u] = m[4 * v] = c;
  m[3 * u + v] = -s;
  m[3 * v + u] = s;
  double product[9];
  multiply(r, m, product);
  for (int i = 0; i < 9; ++i) r[i] = product[i];
}

// Joints: turret, thigh, shin (the shin absolute, not relative to the thigh). Transform: column-major 4x4.
inline void omni_transform(const double* joints, const double* gimbals, double* transform) {
  const double reach = arm_mm * (std::cos(joints[1]) + std::sin(joints[2]));
  const double position[3] = {-std::sin(joints[0]) * reach,
                              -110 + arm_mm * (std::sin(joints[1]) - std::cos(joints[2]) + 1),
                              -35 - arm_mm + std::cos(joints[0]) * reach};
  double r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  turn(1, -joints[0], r);
  turn(0, -joints[2], r);
  turn(1, gimbals[0], r);
  turn(0, -gimbals[1], r);
  turn(2, -gimbals[2], r);
  for (int axis = 0; axis < 3; ++axis) {
    for (int row = 0; row < 3; ++row) transform[4 * axis + row] = r[3 * row + axis];
    transform[4 * axis + 3] = 0;
    transform[12 + axis] = position[axis];
  }
  transform[15] = 1;
}

}  // namespace sulcus::standin
