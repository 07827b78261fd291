#include "device_sim/rotation_rate.h"

#include <Eigen/Geometry>
#include <cmath>

#include "engine/numerics/elementary.h"

namespace sulcus {

// J = I + (1 - cos t)/t^2 [r] + (t - sin t)/t^3 [r]^2 with t = |r|.
Vec3 angular_velocity_of(const Vec3& r, const Vec3& rate) {
  const double t2 = r.squaredNorm();
  const double t = std::sqrt(t2);
  double a = 0.5 - t2 / 24, b = 1.0 / 6 - t2 / 120;  // series; next terms below 1e-13 where it is used
  if (t > 1e-3) {
    const double s = det_sin(0.5 * t);
    a = 2 * s * s / t2;
    b = (t - det_sin(t)) / (t2 * t);
  }
  const Vec3 cross = r.cross(rate);
  return rate + a * cross + b * r.cross(cross);
}

// J^-1 = I - [r]/2 + (1 - (t/2) cot(t/2))/t^2 [r]^2.
Vec3 rotation_rate_of(const Vec3& r, const Vec3& omega) {
  const double t2 = r.squaredNorm();
  const double t = std::sqrt(t2);
  double c = 1.0 / 12 + t2 / 720;
  if (t > 1e-3) c = (1 - 0.5 * t * det_cos(0.5 * t) / det_sin(0.5 * t)) / t2;
  const Vec3 cross = r.cross(omega);
  return omega - 0.5 * cross + c * r.cross(cross);
}

}  // namespace sulcus
