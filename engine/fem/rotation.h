// The rotation of an element: polar decomposition of the deformation gradient, for one element at a time and
// for any F, also inverted, flat or collapsed (equations.md 2.2). The kernels call it where their own few
// Newton steps do not suffice.
#pragma once

#include <array>

#include "engine/numerics/quaternion.h"
#include "engine/numerics/types.h"

namespace sulcus {

// Rotation R (det +1) that maximises tr(R^T F): Newton on the quaternion from `start`, and where that does
// not reach a maximum, a Jacobi SVD. Where R is not unique (rank below 2) it stays as close to `start` as the
// remaining direction allows. A matrix that is not finite gives `start`.
Quaternion polar_rotation(const Mat3& f, const Quaternion& start);

// F = U diag(s) V^T with U, V rotations and s sorted, s[2] < 0 for inverted F (equations.md 2.2).
struct SignedSvd {
  Mat3 u, v;
  Vec3 s;
};
SignedSvd signed_svd(const Mat3& f);

}  // namespace sulcus
