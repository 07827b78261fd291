#include "engine/solver/multigrid.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "engine/fem/test_meshes.h"
#include "engine/solver/conjugate_gradients.h"
#include "engine/solver/test_pressed_body.h"
#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

// A pressed, twisted body with its multigrid, ready to solve.
template <class Real>
struct Problem {
  PressedBody body;
  BodySystem<Real> system;
  Multigrid multigrid;

  explicit Problem(PressedBody pressed, int threads = 1, Isa isa = widest_isa())
      : body(std::move(pressed)),
        system(body, threads, isa),
        multigrid(build_multigrid(body.mesh, body.elements, body.sparsity, body.step, body.elements.node_mass,
                                  body.free_node, true)) {
    use_multigrid(multigrid, body.sparsity.chunks, system.solver);
    set_up();
  }
  Problem(const Problem&) = delete;
  Problem& operator=(const Problem&) = delete;

  void set_up() {
    clear_contacts(system.solver.levels);
    for (const Contact& contact : body.contacts) {
      add_contact<Real>(multigrid, body.mesh, contact.tet, contact.weights,
                        body.contact_weight() * contact.normal * contact.normal.transpose(),
                        system.solver.levels);
    }
    set_up_multigrid<Real>(multigrid, system.matrix(), system.rotations, {}, system.solver.kernels,
                           system.solver.threads, system.solver.levels);
  }
  SolveResult solve(double tolerance, int most = 2000) {
    return conjugate_gradients(system.matrix(), system.borders, tolerance, 0.0, most, system.solver);
  }
};

PressedBody cube(int cells, double contact_stiffness_N_m = 1e3) {
  PressedBody body = make_body("cube", box_mesh(cells, cells, cells, 0.005));
  const double edge = 0.005 * cells;
  if (contact_stiffness_N_m > 0)
    press(body, Vec3(edge / 2, edge / 2, edge), -Vec3::UnitZ(), 20, contact_stiffness_N_m);
  return body;
}

// Two blocks that touch along a closed fissure and hang together below it: superimposed cells and nodes.
PressedBody cloven_block(std::uint64_t seed) {
  LabelMap map = box_map(9, 7, 9, 0.005);
  Random random(seed);
  for (int k = 0; k < 9; ++k) {
    for (int j = 0; j < 7; ++j) {
      for (int i = 0; i < 9; ++i) {
        std::int32_t& label = map.labels[map.index(i, j, k)];
        if (k > 2) label = i < 4 ? 2 : 3;
        if (k > 0 && random_below(random, 12) == 0) label = 0;
      }
    }
  }
  EmbeddingOptions options;
  options.size_m = 0.005;
  return make_body("cloven", build_embedding(map, make_separation_pairs({{2, 3}}), options));
}

// z = M r for a residual given in node order, as the solver's first search direction (one iteration's p).
template <class Real>
Eigen::VectorXd preconditioned(Problem<Real>& problem, const Eigen::VectorXd& r) {
  auto& solver = problem.system.solver;
  std::fill(solver.b.begin(), solver.b.end(), Real(0));
  for (std::size_t n = 0; n < problem.body.free_node.size(); ++n) {
    for (std::size_t d = 0; d < 3; ++d)
      solver.b[problem.system.entry(n, d)] = static_cast<Real>(r[static_cast<Eigen::Index>(3 * n + d)]);
  }
  problem.solve(0.0, 0);
  Eigen::VectorXd z(r.size());
  for (std::size_t n = 0; n < problem.body.free_node.size(); ++n) {
    for (std::size_t d = 0; d < 3; ++d) {
      z[static_cast<Eigen::Index>(3 * n + d)] = static_cast<double>(solver.p[problem.system.entry(n, d)]);
    }
  }
  return z;
}

Eigen::MatrixXd dense_preconditioner(Problem<double>& problem) {
  const auto size = static_cast<Eigen::Index>(problem.body.positions.size());
  Eigen::MatrixXd m(size, size);
  for (Eigen::Index k = 0; k < size; ++k) m.col(k) = preconditioned(problem, Eigen::VectorXd::Unit(size, k));
  return m;
}

TEST(Multigrid, IsSymmetricAndPositiveOnFreeNodesAndZeroOnHeldOnes) {
  for (bool cloven : {false, true}) {
    Problem<double> problem(cloven ? cloven_block(3) : cube(5));
    ASSERT_GT(problem.multigrid.levels, 1);
    const Eigen::MatrixXd m = dense_preconditioner(problem);
    EXPECT_LT((m - m.transpose()).norm(), 1e-13 * m.norm());
    std::vector<Eigen::Index> rows;
    for (std::size_t i = 0; i < problem.body.positions.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      if (problem.body.free_node[i / 3]) {
        rows.push_back(row);
      } else {
        EXPECT_EQ(m.row(row).norm(), 0.0);
      }
    }
    const Eigen::MatrixXd inner = m(rows, rows);
    EXPECT_EQ(inner.llt().info(), Eigen::Success);
  }
}

// Level by level against P_l (diagonal blocks of P_l^T A P_l)^-1 P_l^T made of the assembled matrix itself,
// on a body at rest, where the mean rotations are exact.
TEST(Multigrid, LevelsHoldTheDiagonalBlocksOfTheInterpolatedMatrix) {
  PressedBody body = cloven_block(8);
  for (std::size_t n = 0; n < body.mesh.rest_positions.size(); ++n) {
    for (std::size_t d = 0; d < 3; ++d)
      body.positions[3 * n + d] = body.mesh.rest_positions[n][static_cast<Eigen::Index>(d)];
  }
  Problem<double> problem(std::move(body));
  const auto nodes = static_cast<Eigen::Index>(problem.body.free_node.size());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(3 * nodes, 3 * nodes);
  const Sparsity& sparsity = problem.body.sparsity;
  const auto& system = problem.system.system;
  for (std::int64_t s = 0; s < sparsity.chunks * 16; ++s) {
    const std::int32_t row = sparsity.node_of_slot[static_cast<std::size_t>(s)];
    if (row < 0) continue;
    const std::int64_t chunk = s / 16, lane = s % 16;
    const auto add = [&](std::int32_t column, const double* planes) {
      for (int k = 0; k < 9; ++k) a(3 * row + k / 3, 3 * column + k % 3) += planes[16 * k];
    };
    add(row, &system.diagonal[static_cast<std::size_t>(chunk * 144 + lane)]);
    for (std::int64_t e = sparsity.chunk_start[static_cast<std::size_t>(chunk)];
         e < sparsity.chunk_start[static_cast<std::size_t>(chunk) + 1]; ++e) {
      const std::int32_t at = sparsity.column[static_cast<std::size_t>(e * 16 + lane)];
      add(sparsity.node_of_slot[static_cast<std::size_t>(at)],
          &system.values[static_cast<std::size_t>(e * 144 + lane)]);
    }
  }
  const std::vector<CoarseLevel> levels = build_coarse_levels(problem.body.mesh, 40);
  ASSERT_EQ(static_cast<std::int64_t>(levels.size()), problem.multigrid.levels);
  Eigen::MatrixXd p = Eigen::MatrixXd::Identity(nodes, nodes);
  for (Eigen::Index n = 0; n < nodes; ++n) p(n, n) = problem.body.free_node[static_cast<std::size_t>(n)];
  std::int64_t global = 0;
  for (const CoarseLevel& level : levels) {
    Eigen::MatrixXd up = Eigen::MatrixXd::Zero(p.cols(), level.node_count);
    for (Eigen::Index n = 0; n < p.cols(); ++n) {
      const auto first = level.start[static_cast<std::size_t>(n)],
                 last = level.start[static_cast<std::size_t>(n) + 1];
      for (std::int32_t k = first; k < last; ++k)
        up(n, level.among[static_cast<std::size_t>(k)]) = 1.0 / (last - first);
    }
    p = p * up;
    for (std::int64_t c = 0; c < level.node_count; ++c, ++global) {
      Mat3 expected = Mat3::Zero();
      for (Eigen::Index i = 0; i < nodes; ++i) {
        if (p(i, c) == 0) continue;
        for (Eigen::Index j = 0; j < nodes; ++j) {
          if (p(j, c) != 0) expected += p(i, c) * p(j, c) * a.block<3, 3>(3 * i, 3 * j);
        }
      }
      Mat3 found = problem.multigrid.mass[static_cast<std::size_t>(global)] * Mat3::Identity();
      for (std::int32_t k = problem.multigrid.corner_start[static_cast<std::size_t>(global)];
           k < problem.multigrid.corner_start[static_cast<std::size_t>(global) + 1]; ++k) {
        const auto corner = static_cast<std::size_t>(problem.multigrid.corners[static_cast<std::size_t>(k)]);
        const float* b = &problem.multigrid.stiffness[48 * (corner / 8) + corner % 8];
        Mat3 block;
        block << b[0], b[8], b[16], b[8], b[24], b[32], b[16], b[32], b[40];
        found += block;
      }
      EXPECT_LT((found - expected).norm(), 1e-5 * expected.norm() + 1e-12) << "coarse node " << global;
    }
  }
}

TEST(Multigrid, FindsTheSolutionOfBlockJacobi) {
  for (bool cloven : {false, true}) {
    Problem<double> problem(cloven ? cloven_block(5) : cube(8));
    const SolveResult with = problem.solve(1e-11);
    EXPECT_TRUE(with.converged);
    const auto own = problem.system.solver.x;
    problem.system.solver.multigrid = nullptr;
    problem.system.solver.levels = {};
    const SolveResult without = problem.solve(1e-12);
    EXPECT_LT(relative_difference(own, problem.system.solver.x), 1e-8);
    EXPECT_LT(with.iterations, without.iterations);
  }
}

TEST(Multigrid, NeedsNoMoreIterationsOnFinerMeshes) {
  int least = 1000, most = 0;
  for (int cells : {8, 12, 16}) {
    Problem<double> problem(cube(cells));
    const SolveResult result = problem.solve(1e-4);
    EXPECT_TRUE(result.converged);
    least = std::min(least, result.iterations);
    most = std::max(most, result.iterations);
  }
  EXPECT_LT(most, 1.6 * least);
}

// A slab with a sponge on it, a third of whose cells are missing: coarse cells hold thin strips, as they hold
// the folds of a brain.
PressedBody sponge() {
  LabelMap map = box_map(13, 13, 13, 0.005);
  Random random(5);
  for (int k = 2; k < 13; ++k) {
    for (int j = 0; j < 13; ++j) {
      for (int i = 0; i < 13; ++i) {
        if (random_below(random, 3) == 0) map.labels[map.index(i, j, k)] = 0;
      }
    }
  }
  EmbeddingOptions options;
  options.size_m = 0.005;
  return make_body("sponge", build_embedding(map, {}, options));
}

TEST(Multigrid, WeighsTheLevelsLessWherePartsAreThin) {
  Problem<double> problem(sponge());
  std::vector<float>& weight = problem.multigrid.weight;
  const auto first_level = static_cast<std::size_t>(problem.multigrid.first_node[1]);
  const auto [least, most] = std::minmax_element(weight.begin(), weight.begin() + first_level);
  EXPECT_GT(*most, 0.75F);
  EXPECT_LT(*least, 0.5F);
  const SolveResult weighted = problem.solve(1e-3);
  for (std::size_t n = 0; n < weight.size(); ++n) weight[n] = n < first_level ? 0.7F : 0.5F;
  problem.set_up();
  const SolveResult alike = problem.solve(1e-3);
  EXPECT_TRUE(weighted.converged && alike.converged);
  EXPECT_LT(weighted.iterations, 0.93 * alike.iterations);
}

TEST(Multigrid, BearsAnyContactStiffness) {
  for (double stiffness : {0.0, 1.0, 1e4, 1e8}) {
    Problem<double> problem(cube(6, stiffness));
    EXPECT_TRUE(problem.solve(1e-8).converged) << stiffness;
  }
}

// The error that is left is what the tolerance says, within a small factor: its norm is nearly that of
// energy.
TEST(Multigrid, ToleranceIsCloseToTheErrorThatIsLeft) {
  for (double tolerance : {1e-2, 1e-3, 1e-4}) {
    Problem<double> problem(cube(10));
    problem.solve(1e-12);
    const auto expected = problem.system.solver.x;
    problem.solve(tolerance);
    EXPECT_LT(relative_difference(problem.system.solver.x, expected), 20 * tolerance);
  }
}

template <class Real>
void expect_same_bits_everywhere() {
  Problem<Real> reference(cube(7), 1, Isa::sse2);
  reference.solve(1e-4);
  for (Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
    if (isa > widest_isa()) continue;
    for (int threads : {1, 2, 3, 8}) {
      Problem<Real> other(cube(7), threads, isa);
      other.solve(1e-4);
      EXPECT_EQ(other.system.solver.x, reference.system.solver.x) << isa_name(isa) << ' ' << threads;
    }
  }
}

TEST(Multigrid, GivesTheSameBitsOnEveryInstructionSetAndThreadCount) {
  expect_same_bits_everywhere<float>();
  expect_same_bits_everywhere<double>();
}

TEST(Multigrid, CellsAreAsStiffAsWhatIsLeftOfThem) {
  const std::uint64_t seed = 41;
  SCOPED_TRACE(seed);
  Random random(seed);
  Problem<double> problem(cloven_block(seed));
  const Multigrid& m = problem.multigrid;
  const auto& mesh = problem.body.mesh;
  std::vector<std::uint8_t> alive;
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) alive.push_back(random_below(random, 3) > 0);
  const auto set_up = [&](std::span<const std::uint8_t> which) {
    set_up_multigrid<double>(m, problem.system.matrix(), problem.system.rotations, which,
                             problem.system.solver.kernels, 1, problem.system.solver.levels);
    return problem.system.solver.levels.turns;
  };
  const auto whole = set_up({}), torn = set_up(alive);
  const auto cells = static_cast<std::size_t>(m.first_cell.back());
  std::vector<double> left(cells, 0.0), all(cells, 0.0);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    for (std::int32_t c = m.parent[e / 5]; c >= 0;
         c = m.parent[mesh.cell_nodes.size() + static_cast<std::size_t>(c)]) {
      all[static_cast<std::size_t>(c)] += 1;  // one material, tetrahedra of one size but for the middle ones
      left[static_cast<std::size_t>(c)] += alive[e];
    }
  }
  for (std::size_t c = 0; c < cells; ++c) {
    double before = 0, after = 0;
    for (std::size_t k = 0; k < 12; ++k) {
      before += whole[12 * c + k] * whole[12 * c + k];
      after += torn[12 * c + k] * torn[12 * c + k];
    }
    EXPECT_NEAR(before, 3, 1e-12);
    EXPECT_NEAR(after / before, left[c] / all[c], 0.25) << c;  // the middle one has twice the volume
    EXPECT_EQ(after < 3 - 1e-9, left[c] < all[c]);
  }
  EXPECT_EQ(set_up(std::vector<std::uint8_t>(mesh.tets.size(), 1)), whole);
}

TEST(Multigrid, CornersAreTurnedWithTheirCell) {
  Problem<double> problem(cloven_block(43));
  const Multigrid& m = problem.multigrid;
  std::mt19937_64 random(43);
  std::vector<double> rotations = problem.system.rotations;
  for (double& number : rotations) number += uniform(random, -0.3, 0.3);  // of any length, as a mean is
  auto& levels = problem.system.solver.levels;
  set_up_multigrid<double>(m, problem.system.matrix(), rotations, {}, problem.system.solver.kernels, 1,
                           levels);
  double most = 0;  // by which a turn changes a block
  for (std::size_t c = 0; c < static_cast<std::size_t>(m.first_cell.back()); ++c) {
    Mat3 q;
    for (int i = 0; i < 9; ++i)
      q(i % 3, i / 3) = levels.turns[12 * c + static_cast<std::size_t>(4 * (i / 3) + i % 3)];
    for (std::size_t corner = 0; corner < 8; ++corner) {
      const float* k = &m.stiffness[48 * c + corner];
      const double* found = &levels.turned[64 * c + 8 * corner];
      Mat3 rest, turned;
      rest << k[0], k[8], k[16], k[8], k[24], k[32], k[16], k[32], k[40];
      turned << found[0], found[1], found[2], found[1], found[3], found[4], found[2], found[4], found[5];
      EXPECT_LT((turned - q * rest * q.transpose()).norm(), 1e-12 * rest.norm()) << c << ' ' << corner;
      if (rest.norm() > 0) most = std::fmax(most, (turned - rest).norm() / rest.norm());
    }
  }
  EXPECT_GT(most, 0.05);
}

// The path that only bodies with a large second level take.
TEST(Multigrid, LevelsThatThreadsShareGiveTheBitsOfThoseThatEachClimbsAlone) {
  const PressedBody body = cube(26);
  Problem<double> reference(body);
  ASSERT_EQ(reference.multigrid.shared_levels, 3);
  reference.multigrid.shared_levels = 1;
  use_multigrid(reference.multigrid, body.sparsity.chunks, reference.system.solver);
  reference.set_up();
  const SolveResult alone = reference.solve(1e-4);
  EXPECT_GT(alone.iterations, 10);
  for (int threads : {1, 2, 3}) {
    Problem<double> problem(body, threads);
    EXPECT_EQ(problem.solve(1e-4).iterations, alone.iterations) << threads;
    EXPECT_EQ(problem.system.solver.x, reference.system.solver.x) << threads;
  }
}

TEST(Multigrid, HasNoLevelWhoseCellsAreLargerThanADisturbanceTravels) {
  PressedBody body = cube(16, 0);
  std::int64_t before = 0;
  for (const double step_s : {1e-4, 0.003, 0.033}) {
    body.step = {step_s, {0, 0.1}};
    const double modulus = 1000 * 0.55 / (1.45 * 0.1);  // lambda + 2 mu at E = 1 kPa, nu = 0.45
    const double cells = std::sqrt(step_s * (0.1 + step_s) * modulus / 1000) / 0.005;
    EXPECT_NEAR(reach_of_step(body.mesh, body.elements, body.step).pressure, cells, 1e-9 * cells);
    const std::int64_t levels = build_multigrid(body.mesh, body.elements, body.sparsity, body.step,
                                                body.elements.node_mass, body.free_node)
                                    .levels;
    EXPECT_TRUE(levels == 1 || std::exp2(levels) <= cells) << step_s;
    EXPECT_GT(levels, before) << step_s;
    before = levels;
  }
}

// Iterations from zero to an error of 1e-3 of the solution.
template <class Solve>
int iterations_to_a_thousandth(const std::vector<double>& exact, const BodySystem<double>& system,
                               const Solve& solve) {
  return fewest_iterations(2000, [&](int iterations) {
    solve(iterations);
    return relative_difference(system.solver.x, exact) <= 1e-3;
  });
}

// Iterations of block-Jacobi that a step's solution costs. Of multigrid, an iteration takes as long as 1.7 of
// block-Jacobi and the set-up as 3 (docs/solver-tables.md).
struct Work {
  double block_jacobi = 0, multigrid = 0;
};

Work work_of(const PressedBody& body) {
  BodySystem<double> plain(body);
  conjugate_gradients(plain.matrix(), plain.borders, 1e-10, 0.0, 5000, plain.solver);
  const std::vector<double> exact{plain.solver.x.begin(), plain.solver.x.end()};
  Problem<double> problem(body);
  Work work;
  work.block_jacobi = iterations_to_a_thousandth(exact, plain, [&](int most) {
    conjugate_gradients(plain.matrix(), plain.borders, 0, 0.0, most, plain.solver);
  });
  work.multigrid =
      3 + 1.7 * iterations_to_a_thousandth(exact, problem.system, [&](int most) { problem.solve(0, most); });
  return work;
}

TEST(Multigrid, IsChosenWhereItNeedsLessWorkForTheSameError) {
  double sum = 0;
  int count = 0, multigrids = 0;
  const auto ask = [&](const EmbeddingMesh& mesh, const BodySettings& settings, double stiffness_N_m) {
    PressedBody body = make_body("body", mesh, settings);
    const Vec3 top(0.5 * mesh.grid_size[0] * 0.005, 0.5 * mesh.grid_size[1] * 0.005,
                   mesh.grid_size[2] * 0.005);
    if (stiffness_N_m > 0) press(body, top, -Vec3::UnitZ(), 40, stiffness_N_m);
    const Work work = work_of(body);
    const bool multigrid = takes_multigrid(body);
    const double best = std::min(work.block_jacobi, work.multigrid);
    const double over = (multigrid ? work.multigrid : work.block_jacobi) / best;
    EXPECT_LE(over, 1.35) << mesh.grid_size[0] << " x " << mesh.grid_size[1] << " x " << mesh.grid_size[2]
                          << " cells, steps of " << settings.step_s << " s, E " << settings.youngs_modulus_Pa
                          << " Pa, nu " << settings.poisson_ratio << ", contacts of " << stiffness_N_m
                          << " N/m: block-Jacobi " << work.block_jacobi << ", multigrid " << work.multigrid;
    sum += over;
    ++count;
    multigrids += multigrid;
  };
  const EmbeddingMesh meshes[] = {box_mesh(8, 8, 8, 0.005), box_mesh(10, 10, 11, 0.005),
                                  box_mesh(4, 4, 24, 0.005), cloven_block(1).mesh};
  for (const EmbeddingMesh& mesh : meshes) {
    for (const double step_s : {0.033, 0.01, 0.005, 0.002, 0.001}) {
      for (const double ratio : {0.3, 0.45, 0.49}) ask(mesh, {1000, 1, ratio, step_s, 0.1}, 0);
      ask(mesh, {1000, 1, 0.45, step_s, 0.1}, 1e4);
      ask(mesh, {1000, 1, 0.45, step_s, 0.01}, 100);
    }
    ask(mesh, {10000, 1, 0.45, 0.033, 0.1}, 1e3);
  }
  EXPECT_LE(sum / count, 1.03);
  EXPECT_GT(multigrids, count / 4);  // neither is always the better one
  EXPECT_LT(multigrids, 3 * count / 4);
}

TEST(Multigrid, HasNoLevelsWhereTheMeshIsSmall) {
  const PressedBody body = cube(1, 0);
  const Multigrid multigrid = build_multigrid(body.mesh, body.elements, body.sparsity, body.step,
                                              body.elements.node_mass, body.free_node);
  EXPECT_EQ(multigrid.levels, 0);
}

}  // namespace
}  // namespace sulcus
