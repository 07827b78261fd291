#include "engine/numerics/quaternion.h"

#include <cmath>

#include "engine/numerics/elementary.h"

namespace sulcus {

Quaternion operator*(const Quaternion& a, const Quaternion& b) {
  return {a.s * b.s - a.x * b.x - a.y * b.y - a.z * b.z, a.s * b.x + a.x * b.s + a.y * b.z - a.z * b.y,
          a.s * b.y - a.x * b.z + a.y * b.s + a.z * b.x, a.s * b.z + a.x * b.y - a.y * b.x + a.z * b.s};
}

Quaternion conjugate(const Quaternion& q) {
  return {q.s, -q.x, -q.y, -q.z};
}

Quaternion normalised(const Quaternion& q) {
  const double length = std::sqrt(q.s * q.s + q.x * q.x + q.y * q.y + q.z * q.z);
  if (!(length > 0) || !std::isfinite(length)) return {};
  return {q.s / length, q.x / length, q.y / length, q.z / length};
}

Mat3 rotation_matrix(const Quaternion& q) {
  const double n = 1.0 / (q.s * q.s + q.x * q.x + q.y * q.y + q.z * q.z);
  Mat3 r;
  r(0, 0) = (q.s * q.s + q.x * q.x - q.y * q.y - q.z * q.z) * n;
  r(1, 1) = (q.s * q.s - q.x * q.x + q.y * q.y - q.z * q.z) * n;
  r(2, 2) = (q.s * q.s - q.x * q.x - q.y * q.y + q.z * q.z) * n;
  r(0, 1) = 2 * (q.x * q.y - q.s * q.z) * n;
  r(1, 0) = 2 * (q.x * q.y + q.s * q.z) * n;
  r(0, 2) = 2 * (q.x * q.z + q.s * q.y) * n;
  r(2, 0) = 2 * (q.x * q.z - q.s * q.y) * n;
  r(1, 2) = 2 * (q.y * q.z - q.s * q.x) * n;
  r(2, 1) = 2 * (q.y * q.z + q.s * q.x) * n;
  return r;
}

Quaternion quaternion_from_rotation_vector(const Vec3& rotation) {
  const double angle2 = rotation.squaredNorm();
  const double angle = std::sqrt(angle2);
  // sin(angle/2)/angle by its series near zero
  const double scale = angle < 1e-4 ? 0.5 - angle2 / 48.0 : det_sin(0.5 * angle) / angle;
  const double s = angle < 1e-4 ? 1.0 - angle2 / 8.0 : det_cos(0.5 * angle);
  return normalised({s, scale * rotation[0], scale * rotation[1], scale * rotation[2]});
}

Vec3 rotation_vector(const Quaternion& q) {
  const double sign = q.s < 0 ? -1.0 : 1.0;
  const double s = sign * q.s;
  const Vec3 v = sign * q.vector();
  const double length = std::sqrt(v.squaredNorm());
  if (length < 1e-3 * s) {
    const double t2 = (length / s) * (length / s);
    return v * ((2.0 / s) * (1.0 - t2 / 3.0 + t2 * t2 / 5.0));
  }
  return v * (2.0 * det_atan2(length, s) / length);
}

}  // namespace sulcus
