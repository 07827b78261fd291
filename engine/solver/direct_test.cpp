// The direct solver against a dense solve and against conjugate gradients; what is not positive definite is
// named.
#include "engine/solver/direct.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "engine/fem/test_meshes.h"
#include "engine/solver/test_pressed_body.h"

namespace sulcus {
namespace {

PressedBody pressed_block(int cells, double contact_N_m) {
  PressedBody body = make_body("block", box_mesh(cells, cells, cells + 1, 0.01));
  const Vec3 top(0.005 * cells, 0.005 * cells, 0.01 * (cells + 1));
  if (contact_N_m > 0) press(body, top, -Vec3::UnitZ(), 9, contact_N_m);
  return body;
}

// The matrix of the free unknowns (unit rows elsewhere) without the tools, and the right-hand side.
struct DenseSystem {
  Eigen::MatrixXd a;
  Eigen::VectorXd b;
};
DenseSystem dense(const BodySystem<double>& s) {
  const Sparsity& sparsity = s.body.sparsity;
  const auto size = static_cast<Eigen::Index>(s.body.positions.size());
  DenseSystem out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd(size)};
  for (std::int64_t slot = 0; slot < sparsity.chunks * 16; ++slot) {
    const std::int32_t row = sparsity.node_of_slot[static_cast<std::size_t>(slot)];
    if (row < 0) continue;
    const std::int64_t chunk = slot / 16, lane = slot % 16;
    const auto add = [&](std::int32_t column, const double* planes) {
      for (int k = 0; k < 9; ++k) out.a(3 * row + k / 3, 3 * column + k % 3) += planes[16 * k];
    };
    add(row, &s.system.diagonal[static_cast<std::size_t>(chunk * 144 + lane)]);
    for (std::int64_t e = sparsity.chunk_start[static_cast<std::size_t>(chunk)];
         e < sparsity.chunk_start[static_cast<std::size_t>(chunk) + 1]; ++e) {
      if (sparsity.block[static_cast<std::size_t>(e * 16 + lane)] < 0) continue;
      add(sparsity.node_of_slot[static_cast<std::size_t>(
              sparsity.column[static_cast<std::size_t>(e * 16 + lane)])],
          &s.system.values[static_cast<std::size_t>(e * 144 + lane)]);
    }
    for (std::size_t d = 0; d < 3; ++d)
      out.b[3 * row + static_cast<Eigen::Index>(d)] = s.solver.b[s.entry(static_cast<std::size_t>(row), d)];
  }
  for (const ToolBorder<double>& border : s.borders) {
    Eigen::MatrixXd b = Eigen::MatrixXd::Zero(size, 6), inverse(6, 6);
    for (const auto& row : border.rows) {
      const std::int32_t node =
          sparsity.node_of_slot[static_cast<std::size_t>(row.chunk * 16 + row.offset % 16)];
      for (int k = 0; k < 18; ++k) b(3 * node + k / 6, k % 6) = row.b[static_cast<std::size_t>(k)];
    }
    for (int k = 0; k < 36; ++k) inverse(k / 6, k % 6) = border.inverse[static_cast<std::size_t>(k)];
    out.a -= b * inverse * b.transpose();
  }
  return out;
}

// Solution of the free unknowns with the others given.
Eigen::VectorXd dense_solution(const BodySystem<double>& s, const Eigen::VectorXd& given) {
  DenseSystem system = dense(s);
  Eigen::VectorXd b = system.b - system.a * given;
  for (Eigen::Index i = 0; i < given.size(); ++i) {
    if (s.body.free_node[static_cast<std::size_t>(i / 3)]) continue;
    system.a.row(i).setZero();
    system.a.col(i).setZero();
    system.a(i, i) = 1;
    b[i] = given[i];
  }
  return system.a.llt().solve(b);
}

double difference(const BodySystem<double>& s, const Eigen::VectorXd& expected) {
  Eigen::VectorXd found(expected.size());
  for (Eigen::Index i = 0; i < found.size(); ++i)
    found[i] = s.solver.x[s.entry(static_cast<std::size_t>(i / 3), static_cast<std::size_t>(i % 3))];
  return (found - expected).norm() / expected.norm();
}

TEST(DirectSolver, AgreesWithADenseSolve) {
  for (double contact : {0.0, 1e3}) {
    const PressedBody body = pressed_block(4, contact);
    BodySystem<double> s(body);
    DirectSolver solver(body.sparsity);
    ASSERT_EQ(solver.factor(s.matrix()), -1);
    const SolveResult result = solver.solve(s.matrix(), s.borders, s.solver);
    EXPECT_TRUE(result.converged);
    EXPECT_LT(result.residual, 1e-12);
    const auto size = static_cast<Eigen::Index>(body.positions.size());
    EXPECT_LT(difference(s, dense_solution(s, Eigen::VectorXd::Zero(size))), 1e-11) << contact;
  }
}

TEST(DirectSolver, TakesPrescribedValuesAndLeavesTheReactionInTheResidual) {
  const PressedBody body = pressed_block(3, 1e3);
  BodySystem<double> s(body);
  s.solver.prescribed.assign(s.solver.b.size(), 0.0);
  Eigen::VectorXd given = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size()));
  for (std::size_t n = 0; n < body.free_node.size(); ++n) {
    if (body.free_node[n]) continue;
    given[static_cast<Eigen::Index>(3 * n + 1)] = s.solver.prescribed[s.entry(n, 1)] = 0.01;
  }
  DirectSolver solver(body.sparsity);
  ASSERT_EQ(solver.factor(s.matrix()), -1);
  solver.solve(s.matrix(), s.borders, s.solver);
  const Eigen::VectorXd expected = dense_solution(s, given);
  EXPECT_LT(difference(s, expected), 1e-11);
  const DenseSystem system = dense(s);
  const Eigen::VectorXd residual = system.b - system.a * expected;
  for (std::size_t n = 0; n < body.free_node.size(); ++n) {
    for (std::size_t d = 0; d < 3; ++d) {
      EXPECT_NEAR(s.solver.r[s.entry(n, d)], residual[static_cast<Eigen::Index>(3 * n + d)], 1e-12);
    }
  }
}

TEST(DirectSolver, AgreesWithConjugateGradients) {
  BodySettings settings;
  settings.stiff_factor = 100;
  PressedBody body = make_body("cubes", box_mesh(9, 8, 10, 0.005), settings);
  press(body, Vec3(0.02, 0.02, 0.05), -Vec3::UnitZ(), 40, 1e3);
  BodySystem<double> direct(body), iterative(body);
  DirectSolver solver(body.sparsity);
  ASSERT_EQ(solver.factor(direct.matrix()), -1);
  solver.solve(direct.matrix(), direct.borders, direct.solver);
  const SolveResult result =
      conjugate_gradients(iterative.matrix(), iterative.borders, 1e-13, 0.0, 5000, iterative.solver);
  EXPECT_TRUE(result.converged);
  EXPECT_LT(relative_difference(iterative.solver.x, direct.solver.x), 1e-10);
}

TEST(DirectSolver, NamesANodeOfABodyThatNothingHolds) {
  // without mass and with all nodes free the matrix has the six rigid motions in its null space
  PressedBody body = pressed_block(3, 0);
  std::fill(body.free_node.begin(), body.free_node.end(), std::uint8_t{1});
  BodySystem<double> s(body);
  std::fill(s.system.node_terms.begin(), s.system.node_terms.end(), 0.0);
  close_rows<double>(body.sparsity, body.free_node, s.system);
  DirectSolver solver(body.sparsity);
  const std::int32_t node = solver.factor(s.matrix());
  EXPECT_GE(node, 0);
  EXPECT_LT(node, static_cast<std::int32_t>(body.free_node.size()));
}

TEST(DirectSolver, NamesTheNodeOfANegativeDiagonal) {
  PressedBody body = pressed_block(3, 0);
  BodySystem<double> s(body);
  const std::size_t bad = body.free_node.size() - 1;
  s.system.node_terms[16 * bad] = -10;
  close_rows<double>(body.sparsity, body.free_node, s.system);
  DirectSolver solver(body.sparsity);
  EXPECT_GE(solver.factor(s.matrix()), 0);
  // and the same solver goes on with a sound matrix
  BodySystem<double> sound(body);
  EXPECT_EQ(solver.factor(sound.matrix()), -1);
  EXPECT_LT(solver.solve(sound.matrix(), {}, sound.solver).residual, 1e-12);
}

}  // namespace
}  // namespace sulcus
