#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/numerics/test_random.h"
#include "engine/tool/rigid_body.h"
#include "engine/tool/virtual_coupling.h"

namespace sulcus {
namespace {

Vec3 random_vector(std::mt19937_64& random, double size) {
  return {uniform(random, -size, size), uniform(random, -size, size), uniform(random, -size, size)};
}

TEST(VirtualCouplingTest, StiffnessIsTheSymmetricPartOfTheMisalignmentsDerivative) {
  const std::uint64_t seed = 3;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (int trial = 0; trial < 300; ++trial) {
    const Quaternion tool = quaternion_from_rotation_vector(random_vector(random, 1.5));
    Vec3 turn = random_vector(random, 1);
    turn *= uniform(random, 0.001, 3.0) / turn.norm();
    const Quaternion device = quaternion_from_rotation_vector(turn) * tool;
    const Vec3 u = misalignment(device, tool);
    EXPECT_LT((u - turn).norm(), 1e-12);
    Mat3 derivative;
    const double eps = 1e-6;
    for (int a = 0; a < 3; ++a) {
      const Vec3 small = eps * Vec3::Unit(a);
      derivative.col(a) = (misalignment(device, quaternion_from_rotation_vector(small) * tool) -
                           misalignment(device, quaternion_from_rotation_vector(-small) * tool)) /
                          (2 * eps);
    }
    const Mat3 symmetric = -0.5 * (derivative + derivative.transpose());
    const Mat3 h = misalignment_stiffness(u);
    EXPECT_LT((symmetric - h).norm(), 1e-6 * (1 + h.norm())) << u.transpose();
  }
}

TEST(VirtualCouplingTest, LowPassIsExactForAHeldInput) {
  // y' = 2 pi f (x - y), y(0) = 0, x = 1: y(h) = 1 - exp(-2 pi f h)
  EXPECT_NEAR(low_pass_alpha(10, 0.001), 0.0609, 1e-4);
  EXPECT_NEAR(low_pass_alpha(1, 0.001), 0.00626, 1e-5);
  EXPECT_EQ(low_pass_alpha(0, 0.033), 1);
  const double once = low_pass_alpha(3, 0.02);
  const double half = low_pass_alpha(3, 0.01);
  EXPECT_NEAR(1 - once, (1 - half) * (1 - half), 1e-15);  // two half steps make a whole one
}

TEST(RigidBodyTest, VelocitiesAreMomentaOverInertia) {
  RigidBody body;
  body.mass_kg = 0.2;
  body.inertia_kg_m2 = Vec3(1e-4, 2e-4, 5e-4).asDiagonal();
  RigidBodyState state;
  state.orientation = quaternion_from_rotation_vector({0.4, 1.0, -0.3});
  const Vec3 omega(1, -2, 0.5);
  state.angular_momentum = world_inertia(body, state.orientation) * omega;
  state.linear_momentum = 0.2 * Vec3(3, 2, 1);
  EXPECT_LT((angular_velocity(body, state) - omega).norm(), 1e-12);
  EXPECT_LT((linear_velocity(body, state) - Vec3(3, 2, 1)).norm(), 1e-12);
}

}  // namespace
}  // namespace sulcus
