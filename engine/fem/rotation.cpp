#include "engine/fem/rotation.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <utility>

namespace sulcus {
namespace {

Quaternion quaternion_of(const Mat3& r) {
  // the largest of the four candidates, so that no division by a small number happens
  const double trace = r(0, 0) + r(1, 1) + r(2, 2);
  Quaternion q;
  if (trace >= r(0, 0) && trace >= r(1, 1) && trace >= r(2, 2)) {
    q = {1 + trace, r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)};
  } else if (r(0, 0) >= r(1, 1) && r(0, 0) >= r(2, 2)) {
    q = {r(2, 1) - r(1, 2), 1 + r(0, 0) - r(1, 1) - r(2, 2), r(0, 1) + r(1, 0), r(0, 2) + r(2, 0)};
  } else if (r(1, 1) >= r(2, 2)) {
    q = {r(0, 2) - r(2, 0), r(0, 1) + r(1, 0), 1 - r(0, 0) + r(1, 1) - r(2, 2), r(1, 2) + r(2, 1)};
  } else {
    q = {r(1, 0) - r(0, 1), r(0, 2) + r(2, 0), r(1, 2) + r(2, 1), 1 - r(0, 0) - r(1, 1) + r(2, 2)};
  }
  return normalised(q);
}

// Unit vector next to `wanted` among those at right angles to the unit vector a.
Vec3 perpendicular(const Vec3& a, const Vec3& wanted) {
  Vec3 v = wanted - a * a.dot(wanted);
  if (v.squaredNorm() < 1e-12) {
    int axis = 0;
    for (int i = 1; i < 3; ++i) {
      if (std::fabs(a[i]) < std::fabs(a[axis])) axis = i;
    }
    v = Vec3::Unit(axis) - a * a[axis];
  }
  return v / std::sqrt(v.squaredNorm());
}

// Right singular vectors: eigenvectors of F^T F by one-sided Jacobi on the columns of F; sorted, det V = +1.
void right_singular_vectors(const Mat3& f, Mat3& v, Mat3& fv) {
  v = Mat3::Identity();
  fv = f;
  for (int sweep = 0; sweep < 12; ++sweep) {
    bool rotated = false;
    for (const auto& [p, q] : {std::pair{0, 1}, std::pair{0, 2}, std::pair{1, 2}}) {
      const double app = fv.col(p).squaredNorm();
      const double aqq = fv.col(q).squaredNorm();
      const double apq = fv.col(p).dot(fv.col(q));
      if (apq * apq <= 1e-30 * app * aqq) continue;
      rotated = true;
      const double tau = (aqq - app) / (2 * apq);
      const double t = (tau >= 0 ? 1.0 : -1.0) / (std::fabs(tau) + std::sqrt(1 + tau * tau));
      const double c = 1 / std::sqrt(1 + t * t);
      const double s = c * t;
      for (Mat3* m : {&v, &fv}) {
        const Vec3 column_p = m->col(p);
        const Vec3 column_q = m->col(q);
        m->col(p) = c * column_p - s * column_q;
        m->col(q) = s * column_p + c * column_q;
      }
    }
    if (!rotated) break;
  }
  for (const auto& [p, q] : {std::pair{0, 1}, std::pair{1, 2}, std::pair{0, 1}}) {
    if (fv.col(p).squaredNorm() < fv.col(q).squaredNorm()) {
      v.col(p).swap(v.col(q));
      fv.col(p).swap(fv.col(q));
    }
  }
  if (v.determinant() < 0) {
    v.col(2) = -v.col(2);
    fv.col(2) = -fv.col(2);
  }
}

// SVD with the free directions of a rank-deficient F chosen next to start * V.
SignedSvd signed_svd_near(const Mat3& f, const Mat3& start) {
  SignedSvd svd;
  Mat3 fv;
  right_singular_vectors(f, svd.v, fv);
  const double s1 = std::sqrt(fv.col(0).squaredNorm());
  if (!(s1 > 1e-150)) {
    svd.u = start * svd.v;
    svd.s = Vec3::Zero();
    return svd;
  }
  svd.u.col(0) = fv.col(0) / s1;
  const Vec3 second = fv.col(1) - svd.u.col(0) * svd.u.col(0).dot(fv.col(1));
  const double s2 = std::sqrt(second.squaredNorm());
  svd.u.col(1) = s2 > 1e-9 * s1 ? Vec3(second / s2) : perpendicular(svd.u.col(0), start * svd.v.col(1));
  svd.u.col(2) = svd.u.col(0).cross(svd.u.col(1));
  svd.s = {s1, svd.u.col(1).dot(fv.col(1)), svd.u.col(2).dot(fv.col(2))};
  return svd;
}

}  // namespace

SignedSvd signed_svd(const Mat3& f) {
  return signed_svd_near(f, Mat3::Identity());
}

Quaternion polar_rotation(const Mat3& f, const Quaternion& start) {
  if (!f.allFinite()) return start;
  Quaternion q = start;
  const double size = std::sqrt(f.squaredNorm());
  for (int iteration = 0; iteration < 8; ++iteration) {
    // Newton step of tr(R^T F) in the body frame: (tr M I - sym M) delta = 2 axial(M), M = R^T F
    const Mat3 m = rotation_matrix(q).transpose() * f;
    const Vec3 g(m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1));
    const Mat3 h = (m(0, 0) + m(1, 1) + m(2, 2)) * Mat3::Identity() - 0.5 * (m + m.transpose());
    const double minor = h(0, 0) * h(1, 1) - h(0, 1) * h(0, 1);
    const double det = h.determinant();
    const bool maximum =
        h(0, 0) > 1e-6 * size && minor > 1e-9 * size * size && det > 1e-10 * size * size * size;
    if (!maximum) break;
    Mat3 adjugate;
    adjugate.row(0) = h.col(1).cross(h.col(2)).transpose();
    adjugate.row(1) = h.col(2).cross(h.col(0)).transpose();
    adjugate.row(2) = h.col(0).cross(h.col(1)).transpose();
    const Vec3 delta = adjugate * g / det;
    const double step = delta.squaredNorm();
    if (step > 0.25) break;
    q = normalised(q * Quaternion{1, 0.5 * delta[0], 0.5 * delta[1], 0.5 * delta[2]});
    if (step < 1e-18) return q;
  }
  const SignedSvd svd = signed_svd_near(f, rotation_matrix(start));
  const Quaternion r = quaternion_of(svd.u * svd.v.transpose());
  // of the two signs the one next to the start
  const double side = r.s * start.s + r.x * start.x + r.y * start.y + r.z * start.z;
  return side < 0 ? Quaternion{-r.s, -r.x, -r.y, -r.z} : r;
}

}  // namespace sulcus
