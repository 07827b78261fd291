// The 13-state form of the thesis (chapter 4) with its equations corrected (equations.md 2.5, 2.6): a tool
// y = (x_com, q, P, L), the tissue's velocities, all Jacobians in full, one dense unsymmetric system a step.
// Slow and simple: what the step of the engine is compared with.
#pragma once

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "engine/fem/rotation.h"
#include "engine/fem/stress.h"
#include "engine/scene/step.h"

namespace sulcus::oracle {

using Vec13 = Eigen::Matrix<double, 13, 1>;
using Mat13 = Eigen::Matrix<double, 13, 13>;
using Mat34 = Eigen::Matrix<double, 3, 4>;
using Mat43 = Eigen::Matrix<double, 4, 3>;
using Vec4 = Eigen::Matrix<double, 4, 1>;  // quaternion (s, x, y, z), of any length > 0
using Mat4 = Eigen::Matrix<double, 4, 4>;
using Dense = Eigen::MatrixXd;
using Column = Eigen::VectorXd;

inline Mat3 star(const Vec3& u) {
  Mat3 m;
  m << 0, -u[2], u[1], u[2], 0, -u[0], -u[1], u[0], 0;
  return m;
}

inline Mat3 homogeneous(const Vec4& q) {
  const Vec3 v = q.tail<3>();
  return (q[0] * q[0] - v.squaredNorm()) * Mat3::Identity() + 2 * v * v.transpose() + 2 * q[0] * star(v);
}

inline Mat3 rotation(const Vec4& q) {
  return homogeneous(q) / q.squaredNorm();
}

inline Mat3 rotation_derivative(const Vec4& q, int j) {
  const Vec3 v = q.tail<3>();
  Mat3 d;
  if (j == 0) {
    d = 2 * q[0] * Mat3::Identity() + 2 * star(v);
  } else {
    const Vec3 e = Vec3::Unit(j - 1);
    d = -2 * v[j - 1] * Mat3::Identity() + 2 * (e * v.transpose() + v * e.transpose()) + 2 * q[0] * star(e);
  }
  const double n2 = q.squaredNorm();
  return d / n2 - 2 * q[j] * homogeneous(q) / (n2 * n2);
}

// A contact as the step freezes it: r in body axes, N and the weights held.
struct Spring {
  std::array<std::int32_t, 4> nodes{};
  std::array<double, 4> weights{};
  Vec3 arm = Vec3::Zero();  // body axes
  Mat3 n = Mat3::Zero();
};

struct Model {
  RigidBody body;
  VirtualCoupling coupling;
  double stiffness = 0, damping = 0;
  DeviceSample device;  // at the end of the step
  std::vector<Spring> springs;

  Mat3 inverse_inertia(const Vec4& q) const {
    const Mat3 r = rotation(q);
    return r * body.inertia_kg_m2.inverse() * r.transpose();
  }
  Vec3 omega(const Vec13& y) const { return inverse_inertia(y.segment<4>(3)) * y.tail<3>(); }

  Mat34 omega_by_q(const Vec13& y) const {
    const Vec4 q = y.segment<4>(3);
    const Vec3 l = y.tail<3>();
    const Mat3 r = rotation(q), inverse = body.inertia_kg_m2.inverse();
    Mat34 d;
    for (int j = 0; j < 4; ++j) {
      const Mat3 rj = rotation_derivative(q, j);
      d.col(j) = rj * (inverse * (r.transpose() * l)) + r * (inverse * (rj.transpose() * l));
    }
    return d;
  }

  static Mat43 rate_matrix(const Vec4& q) {
    Mat43 m;
    m.row(0) = -q.tail<3>().transpose();
    m.bottomRows<3>() = q[0] * Mat3::Identity() - star(q.tail<3>());
    return m;
  }

  // d = C q, the quaternion of q_device q^-1 of the shorter turn.
  Mat4 turn_matrix(const Vec4& q) const {
    const Quaternion& h = device.orientation;
    Mat4 c;
    c << h.s, h.x, h.y, h.z, h.x, -h.s, h.z, -h.y, h.y, -h.z, -h.s, h.x, h.z, h.y, -h.x, -h.s;
    return (c * q)[0] < 0 ? Mat4(-c) : c;
  }

  Vec3 turn(const Vec4& q) const {
    const Vec4 d = turn_matrix(q) * q;
    const double length = d.tail<3>().norm();
    const double f = length > 1e-12 ? 2 * std::atan2(length, d[0]) / length : 2 / d[0];
    return f * d.tail<3>();
  }

  Mat34 turn_by_q(const Vec4& q) const {
    const Mat4 c = turn_matrix(q);
    const Vec4 d = c * q;
    const Vec3 v = d.tail<3>();
    const double t = v.norm() / d[0];
    double f = 0, g = 0;
    if (t < 1e-3) {  // also at no turn at all
      f = 2 / d[0] * (1 - t * t / 3 + t * t * t * t / 5);
      g = 2 / (d[0] * d[0] * d[0]) * (-2.0 / 3 + 4 * t * t / 5 - 6 * t * t * t * t / 7);
    } else {
      f = 2 * std::atan2(v.norm(), d[0]) / v.norm();
      g = (2 * d[0] / d.squaredNorm() - f) / v.squaredNorm();
    }
    const auto cv = c.bottomRows<3>();
    return f * cv + v * (g * (v.transpose() * cv) - 2 / d.squaredNorm() * c.row(0));
  }

  Vec3 gap(const Spring& s, const Column& x, const Vec13& y) const {
    Vec3 g = y.head<3>() + rotation(y.segment<4>(3)) * s.arm;
    for (std::size_t k = 0; k < 4; ++k) g -= s.weights[k] * x.segment<3>(3 * s.nodes[k]);
    return g;
  }
  Vec3 gap_rate(const Spring& s, const Column& v, const Vec13& y) const {
    const Vec3 arm = rotation(y.segment<4>(3)) * s.arm;
    Vec3 g = y.segment<3>(7) / body.mass_kg + omega(y).cross(arm);
    for (std::size_t k = 0; k < 4; ++k) g -= s.weights[k] * v.segment<3>(3 * s.nodes[k]);
    return g;
  }
  Vec3 force(const Spring& s, const Column& x, const Column& v, const Vec13& y) const {
    return s.n * (stiffness * gap(s, x, y) + damping * gap_rate(s, v, y));
  }

  // Contact forces on the tissue.
  Column tissue_forces(const Column& x, const Column& v, const Vec13& y) const {
    Column f = Column::Zero(x.size());
    for (const Spring& s : springs) {
      const Vec3 force_s = force(s, x, v, y);
      for (std::size_t k = 0; k < 4; ++k) f.segment<3>(3 * s.nodes[k]) += s.weights[k] * force_s;
    }
    return f;
  }

  // y' = g(x, v, y).
  Vec13 rate(const Column& x, const Column& v, const Vec13& y) const {
    Vec13 g;
    const Vec4 q = y.segment<4>(3);
    const Vec3 w = omega(y);
    g.head<3>() = y.segment<3>(7) / body.mass_kg;
    g.segment<4>(3) = 0.5 * rate_matrix(q) * w;
    Vec3 f = coupling.stiffness_N_m * (device.position - y.head<3>()) +
             coupling.damping_N_s_m * (device.linear_velocity - y.segment<3>(7) / body.mass_kg);
    Vec3 t = coupling.rotational_stiffness_N_m_rad * turn(q) +
             coupling.rotational_damping_N_m_s_rad * (device.angular_velocity - w);
    for (const Spring& s : springs) {
      const Vec3 force_s = force(s, x, v, y);
      f -= force_s;
      t -= (rotation(q) * s.arm).cross(force_s);
    }
    g.segment<3>(7) = f;
    g.tail<3>() = t;
    return g;
  }

  struct Jacobians {
    Dense f_x, f_v, f_y, g_x, g_v;  // contact forces on the tissue; rate of the tool
    Mat13 g_y;
  };

  Jacobians jacobians(const Column& x, const Column& v, const Vec13& y) const {
    const auto n = x.size();
    Jacobians j{Dense::Zero(n, n),  Dense::Zero(n, n),  Dense::Zero(n, 13),
                Dense::Zero(13, n), Dense::Zero(13, n), Mat13::Zero()};
    const Vec4 q = y.segment<4>(3);
    const Vec3 w = omega(y);
    const Mat3 inverse = inverse_inertia(q), r = rotation(q);
    const Mat34 wq = omega_by_q(y);
    const double m = body.mass_kg, k = stiffness, b = damping;
    j.g_y.block<3, 3>(0, 7) = Mat3::Identity() / m;
    Mat4 left = Mat4::Zero();  // of (0, omega)
    left.topRightCorner<1, 3>() = -w.transpose();
    left.bottomLeftCorner<3, 1>() = w;
    left.bottomRightCorner<3, 3>() = star(w);
    j.g_y.block<4, 4>(3, 3) = 0.5 * left + 0.5 * rate_matrix(q) * wq;
    j.g_y.block<4, 3>(3, 10) = 0.5 * rate_matrix(q) * inverse;
    j.g_y.block<3, 3>(7, 0) = -coupling.stiffness_N_m * Mat3::Identity();
    j.g_y.block<3, 3>(7, 7) = -coupling.damping_N_s_m / m * Mat3::Identity();
    j.g_y.block<3, 4>(10, 3) =
        coupling.rotational_stiffness_N_m_rad * turn_by_q(q) - coupling.rotational_damping_N_m_s_rad * wq;
    j.g_y.block<3, 3>(10, 10) = -coupling.rotational_damping_N_m_s_rad * inverse;
    for (const Spring& s : springs) {
      const Vec3 arm = r * s.arm, pull = -force(s, x, v, y);
      Eigen::Matrix<double, 3, 13> by_y = Eigen::Matrix<double, 3, 13>::Zero(), torque;
      by_y.leftCols<3>() = k * s.n;
      for (int c = 0; c < 4; ++c) {
        const Vec3 turned = rotation_derivative(q, c) * s.arm;
        by_y.col(3 + c) = s.n * (k * turned + b * w.cross(turned) - b * arm.cross(Vec3(wq.col(c))));
      }
      by_y.middleCols<3>(7) = b / m * s.n;
      by_y.rightCols<3>() = -b * s.n * star(arm) * inverse;
      torque = -star(arm) * by_y;
      for (int c = 0; c < 4; ++c) torque.col(3 + c) -= star(pull) * (rotation_derivative(q, c) * s.arm);
      j.g_y.middleRows<3>(7) -= by_y;
      j.g_y.bottomRows<3>() += torque;
      for (std::size_t a = 0; a < 4; ++a) {
        const auto row = 3 * s.nodes[a];
        j.f_y.middleRows<3>(row) += s.weights[a] * by_y;
        j.g_x.block<3, 3>(7, row) += k * s.weights[a] * s.n;
        j.g_v.block<3, 3>(7, row) += b * s.weights[a] * s.n;
        j.g_x.block<3, 3>(10, row) += star(arm) * (k * s.weights[a] * s.n);
        j.g_v.block<3, 3>(10, row) += star(arm) * (b * s.weights[a] * s.n);
        for (std::size_t c = 0; c < 4; ++c) {
          const double product = s.weights[a] * s.weights[c];
          j.f_x.block<3, 3>(row, 3 * s.nodes[c]) -= k * product * s.n;
          j.f_v.block<3, 3>(row, 3 * s.nodes[c]) -= b * product * s.n;
        }
      }
    }
    return j;
  }
};

// Warped stiffness K and f0 of the tissue at positions x, from the rest shape and the materials alone.
inline void stiffness(const Scene& scene, const Column& x, Dense& k, Column& f0) {
  k = Dense::Zero(x.size(), x.size());
  f0 = Column::Zero(x.size());
  const double e = scene.settings.material.youngs_modulus_Pa, nu = scene.settings.material.poisson_ratio;
  const double lambda = e * nu / ((1 + nu) * (1 - 2 * nu)), mu = e / (2 * (1 + nu));
  for (const auto& tet : scene.mesh.tets) {
    const auto rest = [&](std::size_t a) {
      return scene.mesh.rest_positions[static_cast<std::size_t>(tet[a])];
    };
    Mat3 dm, ds;
    for (std::size_t a = 1; a < 4; ++a) {
      dm.col(static_cast<Eigen::Index>(a) - 1) = rest(a) - rest(0);
      ds.col(static_cast<Eigen::Index>(a) - 1) = x.segment<3>(3 * tet[a]) - x.segment<3>(3 * tet[0]);
    }
    const Mat3 inverse = dm.inverse();
    const double volume = dm.determinant() / 6;
    const SignedSvd svd = signed_svd(ds * inverse);
    const Mat3 r = svd.u * svd.v.transpose();
    Vec3 g[4];
    g[0].setZero();
    for (int a = 1; a < 4; ++a) {
      g[a] = inverse.row(a - 1);
      g[0] -= g[a];
    }
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = 0; b < 4; ++b) {
        const Mat3 k0 = volume * (lambda * g[a] * g[b].transpose() + mu * g[b] * g[a].transpose() +
                                  mu * g[a].dot(g[b]) * Mat3::Identity());
        k.block<3, 3>(3 * tet[a], 3 * tet[b]) += r * k0 * r.transpose();
        f0.segment<3>(3 * tet[a]) += r * k0 * rest(b);
      }
    }
  }
}

}  // namespace sulcus::oracle
