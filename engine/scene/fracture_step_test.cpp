// Scenes that tear: what follows a removal, and that it stays calm.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"
#include "engine/scene/alive_view.h"
#include "engine/scene/allocation_count.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// A bar of 4 x 4 x 8 cells whose upper end is pulled away at 50 mm/s; it tears in the weaker middle.
SceneDescription pulled_bar(bool avoid, Precision precision = Precision::single_precision) {
  SceneDescription d = block_description({4, 4, 8}, 0.01);
  for (int k = 3; k < 5; ++k) {
    for (int j = 0; j < 4; ++j) {
      for (int i = 0; i < 4; ++i) d.map.labels[d.map.index(i, j, k)] = 2;
    }
  }
  Material weak = d.material;
  weak.youngs_modulus_Pa = 400;
  weak.fracture_threshold_Pa = 120;
  d.materials[2] = weak;
  d.step_s = 0.02;
  d.solver.precision = precision;
  d.solver.tolerance = 1e-4;
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  d.motions.push_back(
      straight_motion(nodes_where(d, [](const Vec3& x) { return x[2] > 0.08 - 1e-9; }), {0.01, 0, 0.04}, 40));
  d.fracture.emplace();
  d.fracture->avoid_singularities = avoid;
  return d;
}

struct History {
  State state;
  std::vector<StepReport> reports;
};

History run(const Scene& scene, int steps, int threads = 2, Isa isa = widest_isa()) {
  History result{initial_state(scene, {}), {}};
  WorkspacePtr workspace = make_workspace(scene, threads, isa);
  StepReport report = make_report(scene);
  for (int n = 0; n < steps; ++n) {
    step(scene, {}, result.state, report, *workspace);
    result.reports.push_back(report);
  }
  return result;
}

TEST(FractureStep, TearsTheWeakMiddleAndStaysManifold) {
  const Scene scene = build(pulled_bar(true));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  std::vector<std::uint8_t> before = state.alive;
  int removed = 0;
  for (int n = 0; n < 60; ++n) {
    step(scene, {}, state, report, *workspace);
    ASSERT_TRUE(report.finite);
    const FractureReport& f = *report.fracture;
    removed += f.by_criterion + f.by_avoidance + f.detached;
    for (std::size_t t = 0; t < before.size(); ++t)
      ASSERT_LE(state.alive[t], before[t]) << "an element came back";
    before = state.alive;
    const Singularities left = find_singularities(scene.stars(), state.alive);
    ASSERT_TRUE(left.vertices.empty() && left.edges.empty()) << "step " << n;
  }
  EXPECT_GT(removed, 30);
  EXPECT_EQ(removed, std::count(state.alive.begin(), state.alive.end(), 0));
  EXPECT_GE(mesh_pieces(scene.mesh.tets, scene.node_count(), state.alive).item_count.size(), 2U);
  for (std::size_t t = 0; t < state.alive.size(); ++t) {
    if (state.alive[t]) continue;
    EXPECT_EQ(scene.mesh.cell_label[t / 5], 2) << "the body tore";
  }
}

TEST(FractureStep, GivesTheSameBitsForEveryThreadCountAndInstructionSet) {
  const Scene scene = build(pulled_bar(true));
  const History first = run(scene, 45, 1);
  EXPECT_GT(std::count(first.state.alive.begin(), first.state.alive.end(), 0), 10);
  for (const int threads : {1, 2, 3, 4}) {
    for (const Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
      if (isa > widest_isa()) continue;
      const History other = run(scene, 45, threads, isa);
      EXPECT_EQ(first.state.alive, other.state.alive);
      EXPECT_EQ(first.state.positions, other.state.positions);
      EXPECT_EQ(first.state.rotations, other.state.rotations);
    }
  }
}

TEST(FractureStep, UpdatedViewEqualsOneMadeFromNothing) {
  SceneDescription d = pulled_bar(true);
  d.detection = ContactDetection::surface_nodes;
  Scene scene = build(std::move(d));
  scene.faces = face_neighbours(scene.mesh.tets);
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  AliveView incremental;
  int changes = 0;
  for (int n = 0; n < 50; ++n) {
    step(scene, {}, state, report, *workspace);
    update(scene, state.alive, incremental);
    AliveView fresh;
    update(scene, state.alive, fresh);
    ASSERT_EQ(incremental.seen, fresh.seen);
    ASSERT_EQ(incremental.free_node, fresh.free_node);
    ASSERT_EQ(incremental.boundary, fresh.boundary);
    changes += report.fracture->by_criterion > 0;
  }
  EXPECT_GE(changes, 2);
  EXPECT_GT(std::count(state.alive.begin(), state.alive.end(), 0), 30);
}

TEST(FractureStep, EnergyDoesNotGrowInTheTenStepsAfterARemoval) {
  // pulled, halted, then torn by hand: no work from outside afterwards
  for (int torn_cells = 1; torn_cells <= 3; ++torn_cells) {
    SceneDescription d = pulled_bar(true, Precision::double_precision);
    d.solver.tolerance = 1e-9;
    d.damping = {0, 0.001};
    d.materials[2].fracture_threshold_Pa = 1e6;  // nothing else tears
    const Scene scene = build(std::move(d));
    State state = initial_state(scene, {});
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    for (int n = 0; n < 60; ++n) step(scene, {}, state, report, *workspace);
    FractureScratch scratch;
    scratch.star = make_star_scratch(scene.stars());
    std::vector<std::int32_t> removed;
    for (std::size_t t = 0; t < state.alive.size(); ++t) {
      const Index3& cell = scene.mesh.cell_position[t / 5];
      if (cell[2] == 3 && cell[0] < torn_cells && cell[1] < 3) {
        removed.push_back(static_cast<std::int32_t>(t));
        state.alive[t] = 0;
      }
    }
    remove_singularities(scene.stars(), state.alive, removed, scratch.star);
    step(scene, {}, state, report, *workspace);
    double kinetic = report.kinetic_energy_J, before = 1e9;
    for (int n = 0; n < 10; ++n) {
      step(scene, {}, state, report, *workspace);
      const double energy = kinetic + report.elastic_energy_J;
      EXPECT_LE(energy, before * (1 + 1e-7)) << n;
      before = energy;
      kinetic = report.kinetic_energy_J;
    }
  }
}

TEST(FractureStep, TheWholeMeshMayGoAtOnce) {
  SceneDescription d = pulled_bar(true);
  d.material.fracture_threshold_Pa = d.materials[2].fracture_threshold_Pa = 1e-3;
  d.gravity = {0, 0, -9.81};
  d.fracture->criterion = FractureCriterion::largest_absolute;
  const Scene scene = build(std::move(d));
  const History result = run(scene, 20);
  EXPECT_EQ(std::count(result.state.alive.begin(), result.state.alive.end(), 1), 0);
  for (const StepReport& report : result.reports) EXPECT_TRUE(report.finite);
  const State& state = result.state;
  for (std::size_t n = 0; n < scene.free_node.size(); ++n) {  // orphans rest
    if (!scene.free_node[n]) continue;
    EXPECT_EQ(state.velocities[3 * n + 2], 0);
  }
}

TEST(FractureStep, AllocatesNothingAfterTheFirst) {
  SceneDescription d = pulled_bar(true);
  d.fracture->steps_above = 2;
  d.fracture->remove_detached = true;
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  step(scene, {}, state, report, *workspace);
  const std::int64_t before = allocation_count();
  for (int n = 0; n < 50; ++n) step(scene, {}, state, report, *workspace);
  EXPECT_EQ(allocation_count(), before);
  EXPECT_GT(std::count(state.alive.begin(), state.alive.end(), 0), 10);
}

TEST(FractureStep, RefusesADetectionThatCannotFollow) {
  SceneDescription d = pulled_bar(true);
  Tool tool;
  tool.name = "point";
  tool.surface.vertices = {Vec3::Zero()};
  d.tools.push_back(tool);
  EXPECT_THROW(build(std::move(d)), InputError);
}

}  // namespace
}  // namespace sulcus
