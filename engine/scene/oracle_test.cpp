// The 13-state form of the thesis as an oracle: its derivatives against finite differences, and the step of
// the engine against its trajectories (equations.md 4).
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/contact/test_tools.h"
#include "engine/numerics/test_random.h"
#include "engine/scene/test_oracle.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

using oracle::Column;
using oracle::Dense;
using oracle::Mat13;
using oracle::Vec13;
using oracle::Vec4;

Vec3 random_vector(std::mt19937_64& random, double size) {
  return {uniform(random, -size, size), uniform(random, -size, size), uniform(random, -size, size)};
}

// |found - expected| relative to the size of both, of the difference quotient of `function` at `at`.
template <class Function>
double error_of(const Dense& derivative, const Column& at, double eps, Function&& function) {
  Dense quotient(derivative.rows(), derivative.cols());
  for (Eigen::Index c = 0; c < at.size(); ++c) {
    Column ahead = at, behind = at;
    ahead[c] += eps;
    behind[c] -= eps;
    quotient.col(c) = (function(ahead) - function(behind)) / (2 * eps);
  }
  const double size = derivative.norm();
  return size > 0 ? (quotient - derivative).norm() / size : quotient.norm();
}

// Random states, quaternions of any length, misalignments of up to 3 rad, anisotropic inertia.
TEST(ThirteenStates, AllDerivativesAreThoseOfFiniteDifferences) {
  const std::uint64_t seed = 91;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  double worst = 0;
  for (int trial = 0; trial < 60; ++trial) {
    oracle::Model model;
    const Mat3 turn = rotation_matrix(quaternion_from_rotation_vector(random_vector(random, 1.5)));
    model.body.inertia_kg_m2 =
        turn * Vec3(uniform(random, 1, 5), uniform(random, 1, 5), uniform(random, 1, 5)).asDiagonal() * 1e-4 *
        turn.transpose();
    model.body.mass_kg = uniform(random, 0.05, 0.5);
    model.stiffness = uniform(random, 1, 1000);
    model.damping = trial % 3 == 0 ? 0 : uniform(random, 0, 1);
    Column x(18), v(18);
    for (Eigen::Index i = 0; i < 18; ++i) {
      x[i] = uniform(random, -0.05, 0.05);
      v[i] = uniform(random, -0.2, 0.2);
    }
    Vec13 y;
    y.head<3>() = random_vector(random, 0.05);
    const Vec4 q(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1),
                 uniform(random, -1, 1));
    y.segment<4>(3) = q.normalized() * uniform(random, 0.5, 2);
    y.segment<3>(7) = random_vector(random, 0.05);
    y.tail<3>() = random_vector(random, 1e-3);
    Vec3 away = random_vector(random, 1);
    away *= uniform(random, trial % 4 == 0 ? 1e-5 : 0.1, trial % 4 == 0 ? 1e-3 : 3.0) / away.norm();
    const Quaternion tool = normalised({q[0], q[1], q[2], q[3]});
    model.device.orientation = quaternion_from_rotation_vector(away) * tool;
    model.device.position = random_vector(random, 0.05);
    model.device.linear_velocity = random_vector(random, 0.2);
    model.device.angular_velocity = random_vector(random, 2);
    for (int s = 0; s < 3; ++s) {
      oracle::Spring spring;
      double sum = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        spring.nodes[k] = static_cast<std::int32_t>((s + static_cast<int>(k)) % 6);
        sum += spring.weights[k] = uniform(random, 0, 1);
      }
      for (double& w : spring.weights) w /= sum;
      spring.arm = random_vector(random, 0.06);
      const Vec3 n = random_vector(random, 1).normalized();
      const double a = s == 0 ? 0 : s == 1 ? 1 : uniform(random, 0, 1);
      spring.n = a * Mat3::Identity() + (1 - a) * n * n.transpose();
      model.springs.push_back(spring);
    }
    const auto j = model.jacobians(x, v, y);
    const auto check = [&](const char* name, const Dense& derivative, const Column& at, double eps, auto f) {
      const double error = error_of(derivative, at, eps, f);
      EXPECT_LT(error, 1e-6) << name << ", trial " << trial;
      worst = std::fmax(worst, error);
    };
    check("f by x", j.f_x, x, 1e-5, [&](const Column& c) { return model.tissue_forces(c, v, y); });
    check("f by v", j.f_v, v, 1e-5, [&](const Column& c) { return model.tissue_forces(x, c, y); });
    check("g by x", j.g_x, x, 1e-5, [&](const Column& c) { return Column(model.rate(c, v, y)); });
    check("g by v", j.g_v, v, 1e-5, [&](const Column& c) { return Column(model.rate(x, c, y)); });
    // y in parts, whose sizes differ by orders: position, quaternion, momentum, angular momentum
    const int first[4] = {0, 3, 7, 10}, count[4] = {3, 4, 3, 3};
    const double eps[4] = {1e-5, 1e-5, 1e-5, 1e-7};
    for (int part = 0; part < 4; ++part) {
      const auto with = [&](const Column& c) {
        Vec13 moved = y;
        moved.segment(first[part], count[part]) = c;
        return moved;
      };
      const Column at = y.segment(first[part], count[part]);
      check("f by y", j.f_y.middleCols(first[part], count[part]), at, eps[part],
            [&](const Column& c) { return model.tissue_forces(x, v, with(c)); });
      for (int row = 0; row < 4; ++row) {
        check("g by y", j.g_y.block(first[row], first[part], count[row], count[part]), at, eps[part],
              [&](const Column& c) {
                return Column(model.rate(x, v, with(c)).segment(first[row], count[row]));
              });
      }
    }
  }
  RecordProperty("worst_relative_error", std::to_string(worst));
}

}  // namespace
}  // namespace sulcus
