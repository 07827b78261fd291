// Warped stiffness and geometric stiffness together are the derivative of the forces.
#include "engine/fem/tangent.h"

#include <gtest/gtest.h>

#include <random>

#include "engine/fem/test_body.h"

namespace sulcus {
namespace {

// Stiffness at the present positions, [3*nodes, 3*nodes].
Eigen::MatrixXd tangent(Body& body, bool with_geometric) {
  auto system = body.assemble<double>({1, {}});
  if (with_geometric) {
    add_geometric_stiffness(body.elements, body.sparsity, body.mesh.rest_positions, body.positions, {},
                            body.rotations, 1, system);
  }
  std::fill(system.node_terms.begin(), system.node_terms.end(), 0.0);  // no mass
  const std::vector<std::uint8_t> free_node(body.mesh.rest_positions.size(), 1);
  close_rows<double>(body.sparsity, free_node, system);
  return dense(body, system);
}

Eigen::MatrixXd by_differences(Body& body) {
  constexpr double h = 1e-7;  // m
  const auto size = static_cast<Eigen::Index>(body.positions.size());
  Eigen::MatrixXd k(size, size);
  for (Eigen::Index j = 0; j < size; ++j) {
    double& x = body.positions[static_cast<std::size_t>(j)];
    const double at = x;
    x = at + h;
    const std::vector<double> after = body.force();
    x = at - h;
    const std::vector<double> before = body.force();
    x = at;
    for (Eigen::Index i = 0; i < size; ++i)
      k(i, j) = (after[static_cast<std::size_t>(i)] - before[static_cast<std::size_t>(i)]) / (2 * h);
  }
  return k;
}

Body deformed_body(std::uint64_t seed, double strain) {
  std::mt19937_64 random(seed);
  Body body(box_mesh(2, 2, 2, 0.01));
  body.deform(random_rotation(random) * (Mat3::Identity() + random_matrix(random, 0.5 * strain)));
  for (double& x : body.positions) x += uniform(random, -0.01 * strain, 0.01 * strain);
  return body;
}

TEST(Tangent, IsTheDerivativeOfTheForces) {
  for (std::uint64_t seed : {1, 2, 3, 4}) {
    SCOPED_TRACE(seed);
    Body body = deformed_body(seed, 0.2);
    const Eigen::MatrixXd expected = by_differences(body);
    body.force();  // rotations at the positions themselves
    const double error = (tangent(body, true) - expected).norm() / expected.norm();
    EXPECT_LT(error, 1e-6);
    EXPECT_GT((tangent(body, false) - expected).norm() / expected.norm(), 0.02);
  }
}

TEST(Tangent, AtRestIsTheWarpedStiffness) {
  Body body(box_mesh(2, 1, 2, 0.01));
  const Eigen::MatrixXd warped = tangent(body, false);
  EXPECT_LT((tangent(body, true) - warped).norm(), 1e-13 * warped.norm());
}

TEST(Tangent, OfPlainLinearElementsHasNoGeometricPart) {
  Material material{2000, 0.45, 1000};
  material.law = Law::linear;
  Body body(box_mesh(2, 2, 1, 0.01), material);
  Mat3 f = Mat3::Identity();
  f(0, 0) = 1.2;
  body.deform(f);
  EXPECT_EQ(tangent(body, true), tangent(body, false));
}

TEST(Tangent, OfACompressedBarIsIndefiniteWhereTheWarpedStiffnessIsNot) {
  Body body(box_mesh(1, 1, 6, 0.01));
  Mat3 f = Mat3::Identity();
  f(2, 2) = 0.7;
  body.deform(f);
  body.force();
  const auto least = [&](bool geometric) {
    const Eigen::MatrixXd k = tangent(body, geometric);
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(0.5 * (k + k.transpose()), Eigen::EigenvaluesOnly)
        .eigenvalues()[0];
  };
  EXPECT_LT(least(true), -1);       // N/m
  EXPECT_GT(least(false), -1e-12);  // N/m
}

}  // namespace
}  // namespace sulcus
