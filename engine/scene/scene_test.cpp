// Whole steps against theory, and the laws of the house: same bits, no allocation, only what a scene needs.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/numerics/error.h"
#include "engine/numerics/float_environment.h"
#include "engine/scene/allocation_count.h"
#include "engine/scene/precision_error.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// A ball of points as a tool; only its vertices matter to the contact.
Tool ball(double radius_m) {
  Tool tool;
  tool.name = "ball";
  for (int i = 0; i < 300; ++i) {  // spiral of equal areas
    const double z = 1 - (2 * i + 1) / 300.0;
    const double r = std::sqrt(1 - z * z);
    tool.surface.vertices.emplace_back(radius_m * r * std::cos(2.4 * i), radius_m * r * std::sin(2.4 * i),
                                       radius_m * z);
  }
  return tool;
}

void hold_bottom(SceneDescription& d) {
  const EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
  for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
    if (mesh.rest_positions[n][2] < 1e-9) d.fixed_nodes.push_back(static_cast<std::int32_t>(n));
  }
}

// The hand presses a ball 12 mm into the top of a block of 80 mm, slides and comes back: 2 s.
DeviceSample press(double time_s) {
  DeviceSample sample;
  const double down = time_s < 0.8   ? time_s / 0.8
                      : time_s < 1.2 ? 1.0
                                     : std::fmax(0.0, 1 - (time_s - 1.2) / 0.4);
  sample.position = Vec3(0.04 + 0.01 * (time_s > 0.8) * (time_s - 0.8), 0.04, 0.105 - 0.03 * down);
  sample.linear_velocity_valid = true;
  return sample;
}

SceneDescription pressed_block(Precision precision) {
  SceneDescription d = block_description({8, 8, 8}, 0.01);
  hold_bottom(d);
  d.tools.push_back(ball(0.02));
  d.contact.stiffness_N_m = 50;
  d.solver.precision = precision;
  d.solver.tolerance = 1e-4;
  return d;
}

std::vector<State> run(const Scene& scene, int steps, int threads, Isa isa = widest_isa(),
                       std::vector<StepReport>* reports = nullptr) {
  DeviceSample sample = press(0);
  const bool tool = !scene.settings.tools.empty();
  State state = initial_state(scene, std::span(&sample, tool ? 1 : 0));
  WorkspacePtr workspace = make_workspace(scene, threads, isa);
  StepReport report = make_report(scene);
  std::vector<State> states;
  for (int n = 0; n < steps; ++n) {
    sample = press((n + 1) * scene.settings.step_s);
    step(scene, std::span(&sample, tool ? 1 : 0), state, report, *workspace);
    states.push_back(state);
    if (reports != nullptr) reports->push_back(report);
  }
  return states;
}

void expect_same(const State& a, const State& b) {
  EXPECT_EQ(a.positions, b.positions);
  EXPECT_EQ(a.velocities, b.velocities);
  EXPECT_EQ(a.rotations, b.rotations);
  EXPECT_EQ(a.tool_poses, b.tool_poses);
  EXPECT_EQ(a.tool_momenta, b.tool_momenta);
  EXPECT_EQ(a.filtered_forces, b.filtered_forces);
  EXPECT_EQ(a.past_increments, b.past_increments);
  EXPECT_EQ(a.past_impulses, b.past_impulses);
}

TEST(Step, IsTheSameWhereverItsSearchBeginsAndThePastSavesMost) {
  std::vector<State> ends;
  std::vector<int> iterations;
  for (const FirstGuess first : {FirstGuess::past, FirstGuess::velocity, FirstGuess::rest}) {
    SceneDescription d = pressed_block(Precision::double_precision);
    d.solver.tolerance = 1e-9;
    d.solver.velocity_floor_m_s = 1e-13;
    d.solver.first_guess = first;
    std::vector<StepReport> reports;
    ends.push_back(run(build(std::move(d)), 40, 2, widest_isa(), &reports).back());
    iterations.push_back(0);
    for (const StepReport& report : reports) iterations.back() += report.iterations;
  }
  for (std::size_t k = 1; k < ends.size(); ++k) {
    for (std::size_t i = 0; i < ends[0].positions.size(); ++i)
      EXPECT_NEAR(ends[0].positions[i], ends[k].positions[i], 1e-9);
    EXPECT_GT(iterations[k], iterations[k - 1]);
  }
}

TEST(Step, TissueAtRestStaysAtRest) {
  SceneDescription d = block_description({3, 3, 3}, 0.02);
  d.solver.precision = Precision::single_precision;
  const Scene scene = build(std::move(d));
  const State state = run(scene, 20, 1).back();
  EXPECT_EQ(state.positions, flat_positions(scene.mesh));
}

TEST(Step, EnergyOfAFreeBodyNeverGrows) {
  const std::uint64_t seed = 31;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  SceneDescription d = block_description({4, 4, 4}, 0.01);
  d.damping = {0, 0};
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  for (double& x : state.positions) x += uniform(random, -0.002, 0.002);
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  step(scene, {}, state, report, *workspace);
  double before = report.kinetic_energy_J;
  for (int n = 0; n < 100; ++n) {
    const double kinetic = report.kinetic_energy_J;
    step(scene, {}, state, report, *workspace);
    const double energy = kinetic + report.elastic_energy_J;
    if (n > 0) {
      EXPECT_LE(energy, before * (1 + 1e-9)) << n;
    }
    before = energy;
  }
}

TEST(Step, InvertedElementsComeBack) {
  const std::uint64_t seed = 32;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (Precision precision : {Precision::single_precision, Precision::double_precision}) {
    SceneDescription d = block_description({2, 2, 2}, 0.01);
    d.material.poisson_ratio = 0.3;
    d.damping = {0, 0.1};
    d.solver.precision = precision;
    d.solver.tolerance = 1e-5;
    const Scene scene = build(std::move(d));
    State state = initial_state(scene, {});
    for (double& x : state.positions) x += uniform(random, -0.008, 0.008);
    EXPECT_GT(count_inverted(scene, state), 5);
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    for (int n = 0; n < 300; ++n) step(scene, {}, state, report, *workspace);
    EXPECT_EQ(count_inverted(scene, state), 0);
    EXPECT_TRUE(report.finite);
  }
}

TEST(Step, TissueAndToolKeepTheirMomentum) {
  SceneDescription d = block_description({6, 6, 6}, 0.01);
  d.tools.push_back(ball(0.015));
  d.tools[0].coupling = {0, 0, 0, 0};
  d.contact.stiffness_N_m = 20;
  d.solver.tolerance = 1e-12;
  d.solver.velocity_floor_m_s = 1e-14;
  const Scene scene = build(std::move(d));
  DeviceSample sample;
  sample.position = {0.033, 0.028, 0.08};
  State state = initial_state(scene, std::span(&sample, 1));
  const double speed = -0.3;  // m/s, towards the tissue
  state.tool_momenta[2] = 0.1 * speed;
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  bool touched = false;
  for (int n = 0; n < 40; ++n) {
    step(scene, std::span(&sample, 1), state, report, *workspace);
    touched = touched || report.tools[0].contacts > 0;
    Vec3 momentum(state.tool_momenta[0], state.tool_momenta[1], state.tool_momenta[2]);
    for (std::size_t i = 0; i < scene.elements.node_mass.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        momentum[static_cast<Eigen::Index>(k)] += scene.elements.node_mass[i] * state.velocities[3 * i + k];
      }
    }
    ASSERT_LT((momentum - Vec3(0, 0, 0.1 * speed)).norm(), 1e-10) << n;
  }
  EXPECT_TRUE(touched);
}

TEST(Step, PressedBlockPushesBackAndComesToRest) {
  std::vector<StepReport> reports;
  const Scene scene = build(pressed_block(Precision::single_precision));
  const State end = run(scene, 240, 2, widest_isa(), &reports).back();
  double force = 0;
  int contacts = 0;
  for (const StepReport& report : reports) {
    const ToolReport& tool = report.tools[0];
    ASSERT_TRUE(report.finite && report.converged);
    EXPECT_LT((tool.contact_force + tool.tissue_force).norm(), 1e-6);  // single-precision borders
    if (tool.contacts > 0) {
      EXPECT_GE(tool.min_push_N, -1e-6) << report.step;
    }
    force = std::fmax(force, tool.contact_force[2]);
    contacts = std::max(contacts, tool.contacts);
  }
  EXPECT_GT(force, 0.1);
  EXPECT_GT(contacts, 10);
  EXPECT_EQ(count_inverted(scene, end), 0);
  for (std::size_t n = 0; n < scene.mesh.rest_positions.size(); ++n) {
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(end.positions[3 * n + k], scene.mesh.rest_positions[n][static_cast<Eigen::Index>(k)], 1e-4);
    }
  }
}

TEST(Step, GivesTheSameBitsForEveryThreadCountAndInstructionSet) {
  for (Precision precision : {Precision::single_precision, Precision::double_precision}) {
    const Scene scene = build(pressed_block(precision));
    const std::vector<State> reference = run(scene, 60, 1, Isa::sse2);
    for (int threads : {1, 2}) expect_same(run(scene, 60, threads).back(), reference.back());
    // where cores are fewer than threads, these wait for each other most of the time
    for (int threads : {3, 4, 8}) expect_same(run(scene, 20, threads).back(), reference[19]);
    if (widest_isa() >= Isa::avx2) expect_same(run(scene, 60, 2, Isa::avx2).back(), reference.back());
  }
}

TEST(Step, BegunAtThePastGivesTheSameBitsForEveryThreadCount) {
  SceneDescription d = pressed_block(Precision::single_precision);
  d.solver.first_guess = FirstGuess::past;
  const Scene scene = build(std::move(d));
  const State reference = run(scene, 60, 1, Isa::sse2).back();
  EXPECT_GT(*std::max_element(reference.past_increments.begin(), reference.past_increments.end()), 0);
  for (int threads : {2, 3}) expect_same(run(scene, 60, threads).back(), reference);
}

TEST(Step, WorkspaceHoldsNothingOfTheFuture) {
  SceneDescription d = pressed_block(Precision::single_precision);
  d.solver.first_guess = FirstGuess::past;  // the state must hold what that needs
  const Scene scene = build(std::move(d));
  const std::vector<State> states = run(scene, 60, 1);
  State state = states[29];
  StepReport report = make_report(scene);
  for (int n = 30; n < 60; ++n) {  // a fresh workspace at every step
    const DeviceSample sample = press((n + 1) * scene.settings.step_s);
    WorkspacePtr workspace = make_workspace(scene, 1);
    step(scene, std::span(&sample, 1), state, report, *workspace);
  }
  expect_same(state, states[59]);
}

TEST(Step, AllocatesNothingAfterTheFirst) {
  SceneDescription d = pressed_block(Precision::single_precision);
  d.solver.first_guess = FirstGuess::past;
  const Scene scene = build(std::move(d));
  DeviceSample sample = press(0);
  State state = initial_state(scene, std::span(&sample, 1));
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  step(scene, std::span(&sample, 1), state, report, *workspace);
  const long before = allocation_count();
  int contacts = 0;
  for (int n = 1; n < 100; ++n) {
    sample = press((n + 1) * scene.settings.step_s);
    step(scene, std::span(&sample, 1), state, report, *workspace);
    contacts = std::max(contacts, report.tools[0].contacts);
  }
  EXPECT_GT(contacts, 10);
  EXPECT_EQ(allocation_count() - before, 0);
}

TEST(Step, RefusesAProcessorThatDropsSubnormalNumbers) {
  testing::FLAGS_gtest_death_test_style = "threadsafe";
  const Scene scene = build(block_description({2, 2, 2}, 0.01));
  WorkspacePtr workspace = make_workspace(scene, 1);
  State state = initial_state(scene, {});
  StepReport report = make_report(scene);
  const unsigned before = _mm_getcsr();
  _mm_setcsr(before | 0x8000);  // flush to zero
  EXPECT_FALSE(default_float_environment());
  EXPECT_THROW(make_workspace(scene, 1), EnvironmentError);
  EXPECT_DEATH(step(scene, {}, state, report, *workspace), "default_float_environment");
  _mm_setcsr(before);
  EXPECT_TRUE(default_float_environment());
}

TEST(Step, TakesAsManyToolsAsAScenarioNames) {
  SceneDescription d = block_description({6, 6, 6}, 0.01);
  d.contact.stiffness_N_m = 20;
  std::vector<DeviceSample> samples;
  for (int t = 0; t < 9; ++t) {  // a row of balls, two millimetres deep, away from the rounded edges
    d.tools.push_back(ball(0.005));
    samples.emplace_back();
    samples.back().position = {0.014 + 0.004 * t, 0.03, 0.063};
  }
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, samples);
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  step(scene, samples, state, report, *workspace);
  EXPECT_TRUE(report.finite && report.converged);
  for (const ToolReport& tool : report.tools) {
    EXPECT_GT(tool.contacts, 0);
    EXPECT_LT((tool.contact_force + tool.tissue_force).norm(), 1e-9);
  }
}

TEST(Step, SolverErrorFollowsTheTolerance) {
  double errors[2];
  int i = 0;
  for (double tolerance : {1e-1, 1e-4}) {
    SceneDescription d = pressed_block(Precision::single_precision);
    d.solver.tolerance = tolerance;
    const Scene scene = build(std::move(d));
    const State state = run(scene, 40, 1).back();
    const DeviceSample sample = press(41 * scene.settings.step_s);
    errors[i++] = measure_solver_error(scene, std::span(&sample, 1), state, 1);
  }
  EXPECT_LT(errors[1], 0.1 * errors[0]);
  EXPECT_LT(errors[1], 2e-3);
  EXPECT_GT(errors[0], 0);
}

TEST(Step, SolverErrorOfAFixedBudgetIsWhatTheBudgetLeaves) {
  double last = 1e9;
  for (int budget : {2, 16, 64}) {
    SceneDescription d = pressed_block(Precision::single_precision);
    d.solver.tolerance = 1e-4;
    d.solver.max_iterations = budget;
    const Scene scene = build(std::move(d));
    const State state = run(scene, 40, 1).back();
    const DeviceSample sample = press(41 * scene.settings.step_s);
    const double error = measure_solver_error(scene, std::span(&sample, 1), state, 1);
    EXPECT_LT(error, 0.5 * last) << budget;
    EXPECT_TRUE(budget > 2 || error > 0.1);
    last = error;
  }
}

TEST(Step, SmallTolerancesInSinglePrecisionReachWhatDoubleDoes) {
  double errors[2];
  int i = 0;
  for (Precision precision : {Precision::single_precision, Precision::double_precision}) {
    SceneDescription d = pressed_block(precision);
    d.solver.tolerance = 1e-8;
    d.solver.velocity_floor_m_s = 0;
    const Scene scene = build(std::move(d));
    const State state = run(scene, 40, 1).back();
    const DeviceSample sample = press(41 * scene.settings.step_s);
    errors[i++] = measure_solver_error(scene, std::span(&sample, 1), state, 1);
  }
  EXPECT_LT(errors[0], 1e-6);
  EXPECT_LT(errors[0], 10 * errors[1]);
}

TEST(Step, ErrorOfSinglePrecisionIsThatOfItsRoundingAndNoneInDouble) {
  for (Precision precision : {Precision::single_precision, Precision::double_precision}) {
    const Scene scene = build(pressed_block(precision));
    const State state = run(scene, 30, 1).back();
    const DeviceSample sample = press(31 * scene.settings.step_s);
    const double error = measure_precision_error(scene, std::span(&sample, 1), state, 1);
    if (precision == Precision::double_precision) {
      EXPECT_EQ(error, 0);
    } else {
      EXPECT_GT(error, 1e-8);
      EXPECT_LT(error, 1e-4);
      EXPECT_LT(error, measure_solver_error(scene, std::span(&sample, 1), state, 1));
    }
  }
}

TEST(BuildScene, MakesNoDistanceFieldWithoutATool) {
  EXPECT_EQ(build(block_description({2, 2, 2}, 0.01)).distance, nullptr);
  EXPECT_NE(build(pressed_block(Precision::single_precision)).distance, nullptr);
}

TEST(BuildScene, TakesTheNamedPreconditionerAndElseTheOneThatPays) {
  const auto takes_multigrid = [](Preconditioner named, double step_s, double contact_stiffness_N_m) {
    SceneDescription d = pressed_block(Precision::single_precision);
    d.solver.preconditioner = named;
    d.step_s = step_s;
    d.contact.stiffness_N_m = contact_stiffness_N_m;
    return build(std::move(d)).multigrid != nullptr;
  };
  constexpr auto automatic = Preconditioner::automatic;
  EXPECT_TRUE(takes_multigrid(automatic, 0.02, 10));
  EXPECT_FALSE(takes_multigrid(automatic, 0.001, 10));
  EXPECT_FALSE(takes_multigrid(automatic, 0.02, 1e6));
  EXPECT_TRUE(takes_multigrid(Preconditioner::multigrid, 0.001, 1e6));
  EXPECT_FALSE(takes_multigrid(Preconditioner::block_jacobi, 0.02, 10));
}

TEST(BuildScene, RefusesWhatCannotBeSimulated) {
  const auto refused = [](auto change) {
    SceneDescription d = pressed_block(Precision::single_precision);
    change(d);
    EXPECT_THROW(build(std::move(d)), InputError);
  };
  refused([](SceneDescription& d) { d.step_s = 0; });
  refused([](SceneDescription& d) { d.step_s = NAN; });
  refused([](SceneDescription& d) { d.material.youngs_modulus_Pa = -1; });
  refused([](SceneDescription& d) { d.material.poisson_ratio = 0.5; });
  refused([](SceneDescription& d) { d.material.density_kg_m3 = 0; });
  refused([](SceneDescription& d) { d.materials[1].youngs_modulus_Pa = INFINITY; });
  refused([](SceneDescription& d) { d.contact.stiffness_N_m = -1; });
  refused([](SceneDescription& d) { d.contact.anisotropy = 1.5; });
  refused([](SceneDescription& d) { d.tools[0].body.mass_kg = 0; });
  refused([](SceneDescription& d) { d.tools[0].body.inertia_kg_m2(0, 0) = -1; });
  refused([](SceneDescription& d) { d.tools[0].surface.vertices[0][1] = NAN; });
  refused([](SceneDescription& d) { d.fixed_nodes.push_back(1 << 30); });
  refused([](SceneDescription& d) { d.springs.push_back({0, -1, 0}); });
  refused([](SceneDescription& d) { d.solver.tolerance = 0; });
}

}  // namespace
}  // namespace sulcus
