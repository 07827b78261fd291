#include "engine/tool/virtual_coupling.h"

#include <cmath>

#include "engine/numerics/elementary.h"

namespace sulcus {

Vec3 misalignment(const Quaternion& device, const Quaternion& tool) {
  return rotation_vector(device * conjugate(tool));
}

Mat3 misalignment_stiffness(const Vec3& u) {
  const double angle2 = u.squaredNorm();
  if (angle2 < 1e-8) return Mat3::Identity();
  const double half = 0.5 * std::sqrt(angle2);
  const double c = half * det_cos(half) / det_sin(half);
  return c * Mat3::Identity() + ((1 - c) / angle2) * (u * u.transpose());
}

double low_pass_alpha(double cutoff_Hz, double step_s) {
  if (!(cutoff_Hz > 0)) return 1;
  return 1 - det_exp(-2 * 3.14159265358979323846 * cutoff_Hz * step_s);
}

}  // namespace sulcus
