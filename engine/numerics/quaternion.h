// Unit quaternions for rotations, order (s, x, y, z), body -> world, Hamilton product.
#pragma once

#include "engine/numerics/types.h"

namespace sulcus {

struct Quaternion {
  double s = 1, x = 0, y = 0, z = 0;

  Vec3 vector() const { return {x, y, z}; }
};

Quaternion operator*(const Quaternion& a, const Quaternion& b);  // Hamilton product: first b, then a
Quaternion conjugate(const Quaternion& q);
Quaternion normalised(const Quaternion& q);  // the identity if |q| is zero or not finite

// Rotation matrix; valid for any |q| > 0 (homogeneous form divided by |q|^2, equations.md 2.5).
Mat3 rotation_matrix(const Quaternion& q);

// exp of a rotation vector [rad, world axes], and the rotation vector of q in [0, pi] (atan2 form,
// equations.md 2.5), whatever the sign of q. Uses the engine's own elementary functions.
Quaternion quaternion_from_rotation_vector(const Vec3& rotation);
Vec3 rotation_vector(const Quaternion& q);

}  // namespace sulcus
