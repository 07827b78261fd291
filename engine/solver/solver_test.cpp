// Conjugate gradients against a dense solve, with and without an eliminated tool.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <limits>
#include <random>

#include "engine/fem/assembly.h"
#include "engine/fem/test_meshes.h"
#include "engine/numerics/test_random.h"
#include "engine/solver/conjugate_gradients.h"
#include "engine/solver/refinement.h"

namespace sulcus {
namespace {

// A small step system with held bottom nodes and, as a choice, one tool touching some nodes.
template <class Real>
struct Problem {
  EmbeddingMesh mesh = box_mesh(6, 5, 7, 0.01);
  ElementData elements;
  Sparsity sparsity;
  SystemMatrix<Real> system;
  RowMatrix<Real> matrix;
  std::vector<std::uint8_t> free_node;
  std::vector<ToolBorder<Real>> borders;
  Eigen::MatrixXd border_dense, border_block;
  SolverWorkspace<Real> workspace;

  explicit Problem(bool with_tool, Isa isa = widest_isa(), int threads = 1) {
    const Material material{1000, 0.45, 1000};
    const std::vector<std::int32_t> numbers(mesh.tets.size(), 0);
    elements = build_elements(mesh, std::span(&material, 1), numbers);
    sparsity = build_sparsity(mesh);
    system = make_system_matrix<Real>(elements, sparsity, isa, threads);
    std::vector<double> positions = flat_positions(mesh), velocities(positions.size(), 0.0);
    std::vector<double> rotations(4 * mesh.tets.size(), 0.0);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) rotations[4 * t] = 1;
    for (const Vec3& x : mesh.rest_positions) free_node.push_back(x[2] > 1e-6);
    assemble_elements<Real>(elements, sparsity, {0.02, {0, 0.1}}, mesh.rest_positions, positions, velocities,
                            {}, free_node, rotations, system);
    matrix = {sparsity.chunks,      sparsity.chunk_start.data(), sparsity.column.data(),
              system.values.data(), system.diagonal.data(),      system.inverse.data()};
    workspace = make_solver_workspace<Real>(sparsity, isa, threads);
    std::mt19937_64 random(5);
    for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
      for (std::size_t d = 0; d < 3; ++d)
        workspace.b[slot(n, d)] = static_cast<Real>(uniform(random, -1e-4, 1e-4));
    }
    const auto size = static_cast<Eigen::Index>(3 * mesh.rest_positions.size());
    border_dense = Eigen::MatrixXd::Zero(size, 6);
    border_block = 1e-2 * Eigen::MatrixXd::Identity(6, 6);
    if (with_tool) add_tool(random);
  }

  std::size_t slot(std::size_t node, std::size_t d) const {
    const auto s = static_cast<std::size_t>(sparsity.slot_of_node[node]);
    return (s / 16 * 3 + d) * 16 + s % 16;
  }

  void add_tool(std::mt19937_64& random) {
    ToolBorder<Real> border;
    std::vector<std::size_t> nodes;
    for (std::size_t n = 0; n < mesh.rest_positions.size(); n += 11) {
      if (free_node[n]) nodes.push_back(n);
    }
    std::sort(nodes.begin(), nodes.end(),
              [&](std::size_t a, std::size_t b) { return slot(a, 0) < slot(b, 0); });
    for (std::size_t n : nodes) {
      typename ToolBorder<Real>::Row row;
      row.offset = static_cast<std::int64_t>(slot(n, 0));
      row.chunk = row.offset / 48;
      for (std::size_t k = 0; k < 18; ++k) {
        row.b[k] = static_cast<Real>(uniform(random, -3e-4, 3e-4));
        border_dense(static_cast<Eigen::Index>(3 * n + k / 6), static_cast<Eigen::Index>(k % 6)) =
            static_cast<double>(row.b[k]);
      }
      border.rows.push_back(row);
    }
    const Eigen::MatrixXd inverse = border_block.inverse();
    for (int i = 0; i < 36; ++i) border.inverse[static_cast<std::size_t>(i)] = inverse(i / 6, i % 6);
    borders.push_back(border);
  }

  // Solution of the free rows by a dense factorisation, in node order.
  Eigen::VectorXd reference() const {
    const auto size = static_cast<Eigen::Index>(3 * mesh.rest_positions.size());
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd b(size);
    for (std::int64_t s = 0; s < sparsity.chunks * 16; ++s) {
      const std::int32_t row = sparsity.node_of_slot[static_cast<std::size_t>(s)];
      if (row < 0) continue;
      const std::int64_t chunk = s / 16, l = s % 16;
      const auto add = [&](std::int32_t column, const Real* planes) {
        for (int k = 0; k < 9; ++k)
          a(3 * row + k / 3, 3 * column + k % 3) += static_cast<double>(planes[16 * k]);
      };
      add(row, &system.diagonal[static_cast<std::size_t>(chunk * 144 + l)]);
      for (std::int64_t e = sparsity.chunk_start[static_cast<std::size_t>(chunk)];
           e < sparsity.chunk_start[static_cast<std::size_t>(chunk) + 1]; ++e) {
        const std::int32_t at = sparsity.column[static_cast<std::size_t>(e * 16 + l)];
        add(sparsity.node_of_slot[static_cast<std::size_t>(at)],
            &system.values[static_cast<std::size_t>(e * 144 + l)]);
      }
    }
    a -= border_dense * border_block.inverse() * border_dense.transpose();
    for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
      for (std::size_t d = 0; d < 3; ++d) {
        const auto i = static_cast<Eigen::Index>(3 * n + d);
        b[i] = static_cast<double>(workspace.b[slot(n, d)]);
        if (free_node[n]) continue;
        a.row(i).setZero();
        a.col(i).setZero();
        a(i, i) = 1;
        b[i] = 0;
      }
    }
    return a.llt().solve(b);
  }

  double error(const Eigen::VectorXd& expected) const {
    double difference = 0;
    for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
      for (std::size_t d = 0; d < 3; ++d) {
        const double e =
            static_cast<double>(workspace.x[slot(n, d)]) - expected[static_cast<Eigen::Index>(3 * n + d)];
        difference += e * e;
      }
    }
    return std::sqrt(difference) / expected.norm();
  }
};

TEST(ConjugateGradients, AgreeWithADenseSolve) {
  for (bool with_tool : {false, true}) {
    Problem<double> problem(with_tool);
    const SolveResult result =
        conjugate_gradients(problem.matrix, problem.borders, 1e-12, 0.0, 1000, problem.workspace);
    EXPECT_TRUE(result.converged);
    EXPECT_LT(problem.error(problem.reference()), 1e-10) << with_tool;
  }
}

TEST(ConjugateGradients, SinglePrecisionReachesItsRounding) {
  for (bool with_tool : {false, true}) {
    Problem<float> problem(with_tool);
    conjugate_gradients(problem.matrix, problem.borders, 1e-6, 0.0, 1000, problem.workspace);
    EXPECT_LT(problem.error(problem.reference()), 2e-4) << with_tool;
  }
}

TEST(ConjugateGradients, ErrorShrinksWithTheTolerance) {
  Problem<double> problem(true);
  const Eigen::VectorXd expected = problem.reference();
  double last = 1;
  for (double tolerance : {1e-1, 1e-3, 1e-5, 1e-7}) {
    const SolveResult result =
        conjugate_gradients(problem.matrix, problem.borders, tolerance, 0.0, 1000, problem.workspace);
    EXPECT_LE(result.residual, tolerance);
    EXPECT_LT(problem.error(expected), last);
    last = problem.error(expected);
  }
}

TEST(ConjugateGradients, HeldNodesStayWhereTheyAre) {
  Problem<double> problem(true);
  conjugate_gradients(problem.matrix, problem.borders, 1e-8, 0.0, 1000, problem.workspace);
  for (std::size_t n = 0; n < problem.mesh.rest_positions.size(); ++n) {
    if (problem.free_node[n]) continue;
    for (std::size_t d = 0; d < 3; ++d) EXPECT_EQ(problem.workspace.x[problem.slot(n, d)], 0.0);
  }
}

TEST(ConjugateGradients, TheCapIsReported) {
  Problem<double> problem(false);
  const SolveResult result =
      conjugate_gradients(problem.matrix, problem.borders, 1e-12, 0.0, 3, problem.workspace);
  EXPECT_EQ(result.iterations, 3);
  EXPECT_FALSE(result.converged);
}

TEST(ConjugateGradients, GoOnAfterAPauseAsIfThereHadBeenNone) {
  for (int threads : {1, 2}) {
    Problem<float> straight(true, widest_isa(), threads), paused(true, widest_isa(), threads);
    const SolveResult whole =
        conjugate_gradients(straight.matrix, straight.borders, 1e-5, 0.0, 500, straight.workspace);
    const SolveResult first =
        conjugate_gradients(paused.matrix, paused.borders, 1e-1, 0.0, 500, paused.workspace);
    paused.workspace.start = Start::pause;
    const SolveResult rest =
        conjugate_gradients(paused.matrix, paused.borders, 1e-5, 0.0, 500, paused.workspace);
    EXPECT_GT(first.iterations, 0);
    EXPECT_GT(rest.iterations, 0);
    EXPECT_EQ(first.iterations + rest.iterations, whole.iterations);
    EXPECT_EQ(rest.residual, whole.residual);
    EXPECT_EQ(paused.workspace.x, straight.workspace.x);
  }
}

TEST(ConjugateGradients, BeginAlongAGuessWhereTheEnergyErrorIsLeast) {
  for (int threads : {1, 2}) {
    Problem<double> problem(true, widest_isa(), threads);
    auto& workspace = problem.workspace;
    std::mt19937_64 random(7);
    workspace.guess.assign(workspace.b.size(), 0.0);
    for (std::size_t node = 0; node < problem.free_node.size(); ++node) {
      for (std::size_t d = 0; problem.free_node[node] && d < 3; ++d)
        workspace.guess[problem.slot(node, d)] = uniform(random, -500, 500);
    }
    workspace.x = workspace.guess;
    find_residual(problem.matrix, problem.borders, workspace);
    double along = 0, curvature = 0;  // g . b, g . A g
    for (std::size_t i = 0; i < workspace.b.size(); ++i) {
      along += workspace.guess[i] * workspace.b[i];
      curvature += workspace.guess[i] * (workspace.b[i] - workspace.r[i]);
    }
    const double share = along / curvature;
    workspace.start = Start::guess;
    const SolveResult begun = conjugate_gradients(problem.matrix, problem.borders, 1e-9, 0.0, 0, workspace);
    EXPECT_EQ(begun.iterations, 0);
    for (std::size_t i = 0; i < workspace.x.size(); ++i)
      EXPECT_NEAR(workspace.x[i], share * workspace.guess[i], 1e-6 * std::fabs(share)) << i;
    const SolveResult end = conjugate_gradients(problem.matrix, problem.borders, 1e-9, 0.0, 5000, workspace);
    EXPECT_TRUE(end.converged);
  }
}

// A node that is led far along a slanting direction and slides across it: the force that leads it is larger
// than all residuals, and must not leak into the other two directions however long the search goes on.
template <class Real>
void expect_no_leak(double tolerance) {
  Problem<Real> problem(false);
  const std::size_t node = problem.mesh.rest_positions.size() / 2;
  ASSERT_TRUE(problem.free_node[node]);
  const Vec3 normal = Vec3(0.3, -0.5, 0.8).normalized();
  const std::size_t entry = problem.slot(node, 0), first = entry / 48 * 144 + entry % 16;
  Mat3 block;
  for (int k = 0; k < 9; ++k)
    block(k / 3, k % 3) =
        static_cast<double>(problem.system.diagonal[first + 16 * static_cast<std::size_t>(k)]);
  const Mat3 along = normal * normal.transpose(), plane = Mat3::Identity() - along;
  const Mat3 inverse = plane * (plane * block * plane + along * block.trace()).inverse() * plane;
  for (int k = 0; k < 9; ++k)
    problem.system.inverse[first + 16 * static_cast<std::size_t>(k)] =
        static_cast<Real>(inverse(k / 3, k % 3));
  problem.workspace.sliding = {
      {static_cast<std::int64_t>(entry / 48), static_cast<std::int64_t>(entry), normal}};
  problem.workspace.prescribed.assign(problem.workspace.b.size(), Real(0));
  for (std::size_t d = 0; d < 3; ++d)
    problem.workspace.prescribed[problem.slot(node, d)] =
        static_cast<Real>(50 * normal[static_cast<Eigen::Index>(d)]);
  const SolveResult result =
      conjugate_gradients(problem.matrix, problem.borders, tolerance, 0.0, 1000, problem.workspace);
  EXPECT_TRUE(result.converged) << result.residual;
  Vec3 x, r;
  for (std::size_t d = 0; d < 3; ++d) {
    x[static_cast<Eigen::Index>(d)] = static_cast<double>(problem.workspace.x[problem.slot(node, d)]);
    r[static_cast<Eigen::Index>(d)] = static_cast<double>(problem.workspace.r[problem.slot(node, d)]);
  }
  EXPECT_NEAR(x.dot(normal), 50, 50 * 10 * std::numeric_limits<Real>::epsilon());
  EXPECT_GT(r.norm(), 1e-2);  // the force that leads it is in the residual, along the normal alone
  EXPECT_NEAR((r - r.dot(normal) * normal).norm() / r.norm(), 0, 10 * tolerance);
}

TEST(ConjugateGradients, ForcesOfConstraintDoNotLeak) {
  expect_no_leak<double>(1e-11);
  expect_no_leak<float>(1e-6);
}

TEST(ConjugateGradients, NothingToDoIsConvergedAtOnce) {
  Problem<double> problem(false);
  std::fill(problem.workspace.b.begin(), problem.workspace.b.end(), 0.0);
  const SolveResult result =
      conjugate_gradients(problem.matrix, problem.borders, 1e-3, 0.0, 100, problem.workspace);
  EXPECT_EQ(result.iterations, 0);
  EXPECT_TRUE(result.converged);
}

TEST(ConjugateGradients, NotANumberIsSaidNotSpread) {
  Problem<double> problem(false);
  problem.workspace.b[problem.slot(problem.mesh.rest_positions.size() - 1, 0)] = NAN;
  const SolveResult result =
      conjugate_gradients(problem.matrix, problem.borders, 1e-3, 0.0, 100, problem.workspace);
  EXPECT_TRUE(result.broken);
  EXPECT_FALSE(result.converged);
}

// The system in double precision, solved by corrections in single precision.
SolveResult refine(Problem<double>& problem, double tolerance, int max_iterations, Isa isa = widest_isa(),
                   int threads = 1) {
  const auto refinement = make_refinement(problem.sparsity, isa, threads);
  round_matrix(problem.matrix, *refinement);
  return refined_conjugate_gradients(problem.matrix, problem.borders, tolerance, 0.0, max_iterations,
                                     problem.workspace, *refinement);
}

TEST(Refinement, ReachesWhatSinglePrecisionCannot) {
  for (bool with_tool : {false, true}) {
    Problem<double> problem(with_tool);
    const Eigen::VectorXd expected = problem.reference();
    const SolveResult result = refine(problem, 1e-11, 1000);
    EXPECT_TRUE(result.converged);
    EXPECT_LE(result.residual, 1e-11);
    EXPECT_LT(problem.error(expected), 1e-9) << with_tool;
  }
}

TEST(Refinement, TakesPrescribedValuesAndAGuess) {
  Problem<double> problem(true);
  problem.workspace.prescribed.assign(problem.workspace.b.size(), 0.0);
  for (std::size_t n = 0; n < problem.mesh.rest_positions.size(); ++n) {
    if (!problem.free_node[n]) problem.workspace.prescribed[problem.slot(n, 0)] = 0.01;
  }
  conjugate_gradients(problem.matrix, problem.borders, 1e-12, 0.0, 1000, problem.workspace);
  const auto expected = problem.workspace.x;
  const auto held = problem.workspace.r;
  refine(problem, 1e-11, 1000);
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(problem.workspace.x[i], expected[i], 1e-10);
    EXPECT_NEAR(problem.workspace.r[i], held[i], 1e-12);
  }
  problem.workspace.guess = expected;
  for (std::size_t i = 0; i < expected.size(); ++i)
    problem.workspace.guess[i] -= problem.workspace.prescribed[i];
  problem.workspace.start = Start::guess;
  EXPECT_EQ(refine(problem, 1e-9, 1000).iterations, 0);
}

TEST(Refinement, TheCapIsReported) {
  Problem<double> problem(false);
  const SolveResult result = refine(problem, 1e-11, 5);
  EXPECT_EQ(result.iterations, 5);
  EXPECT_FALSE(result.converged);
  EXPECT_GT(result.residual, 1e-11);
}

TEST(Refinement, GivesTheSameBitsOnEveryInstructionSetAndThreadCount) {
  Problem<double> reference(true, Isa::sse2, 1);
  refine(reference, 1e-10, 500, Isa::sse2, 1);
  for (Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
    if (isa > widest_isa()) continue;
    for (int threads : {1, 2, 3}) {
      Problem<double> other(true, isa, threads);
      refine(other, 1e-10, 500, isa, threads);
      EXPECT_EQ(other.workspace.x, reference.workspace.x) << isa_name(isa) << ' ' << threads;
    }
  }
}

template <class Real>
void expect_same_bits_everywhere() {
  Problem<Real> reference(true, Isa::sse2, 1);
  conjugate_gradients(reference.matrix, reference.borders, 1e-5, 0.0, 500, reference.workspace);
  for (Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
    if (isa > widest_isa()) continue;
    for (int threads : {1, 2, 3, 4, 8}) {
      Problem<Real> other(true, isa, threads);
      conjugate_gradients(other.matrix, other.borders, 1e-5, 0.0, 500, other.workspace);
      EXPECT_EQ(other.workspace.x, reference.workspace.x) << isa_name(isa) << ' ' << threads;
    }
  }
}

TEST(ConjugateGradients, GiveTheSameBitsOnEveryInstructionSetAndThreadCount) {
  expect_same_bits_everywhere<float>();
  expect_same_bits_everywhere<double>();
}

}  // namespace
}  // namespace sulcus
