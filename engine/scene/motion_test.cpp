// Nodes on prescribed paths, and the forces that this takes.
#include <gtest/gtest.h>

#include <cmath>

#include "engine/numerics/error.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// Uniaxial bar of equations.md 7.2: 20 x 20 x 100 mm, E = 2000 Pa, nu = 0.45, stretched by a tenth. One face
// is held along the bar and slides; Poisson's contraction is free because each moved node is its own path.
SceneDescription bar(Precision precision) {
  SceneDescription d = block_description({2, 2, 10}, 0.01);
  d.material.youngs_modulus_Pa = 2000;
  d.solver.precision = precision;
  d.solver.velocity_floor_m_s = 0;
  d.solver.tolerance = precision == Precision::single_precision ? 1e-6 : 1e-11;
  return d;
}

TEST(PrescribedMotion, MovesItsNodesAndTheForcesAtBothEndsAreOpposite) {
  SceneDescription d = bar(Precision::double_precision);
  d.motions.push_back(
      straight_motion(nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; }), Vec3::Zero(), 1));
  d.motions.push_back(
      straight_motion(nodes_where(d, [](const Vec3& x) { return x[2] > 0.1 - 1e-9; }), {0, 0, 0.01}, 20));
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  for (int n = 0; n < 400; ++n) step(scene, {}, state, report, *workspace);
  for (std::int32_t node : scene.settings.motions[1].nodes) {
    const auto at = static_cast<std::size_t>(node);
    EXPECT_NEAR(state.positions[3 * at + 2], 0.11, 1e-12);
    EXPECT_NEAR(state.positions[3 * at], scene.mesh.rest_positions[at][0], 1e-12);
  }
  const Vec3 low = report.motion_forces[0], high = report.motion_forces[1];
  EXPECT_LT((low + high).norm(), 1e-8 * high.norm());
  // clamped ends stiffen the bar: more than E A strain = 0.08 N, and not much more
  EXPECT_GT(high[2], 0.080);
  EXPECT_LT(high[2], 0.092);
}

// Both ends are given the exact uniaxial deformation, Poisson's contraction included, one path a node: the
// force is E A strain exactly, because the law is linear in nominal stress.
TEST(PrescribedMotion, UniaxialBarTakesExactlyTheForceOfTheory) {
  for (const Precision precision : {Precision::double_precision, Precision::single_precision}) {
    SceneDescription d = bar(precision);
    const auto ends = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9 || x[2] > 0.1 - 1e-9; });
    const EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
    for (std::int32_t node : ends) {
      const Vec3 x = mesh.rest_positions[static_cast<std::size_t>(node)];
      d.motions.push_back(straight_motion({node}, Vec3(-0.045 * x[0], -0.045 * x[1], 0.1 * x[2]), 10));
    }
    const Scene scene = build(std::move(d));
    State state = initial_state(scene, {});
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    for (int n = 0; n < 600; ++n) step(scene, {}, state, report, *workspace);
    double top = 0, bottom = 0;
    for (std::size_t m = 0; m < ends.size(); ++m) {
      const bool high = mesh.rest_positions[static_cast<std::size_t>(ends[m])][2] > 0.05;
      (high ? top : bottom) += report.motion_forces[m][2];
    }
    const double tolerance = precision == Precision::double_precision ? 1e-9 : 2e-6;
    EXPECT_NEAR(top, 0.08, tolerance);
    EXPECT_NEAR(bottom, -0.08, tolerance);
  }
}

TEST(PrescribedMotion, TurnsItsNodesAboutItsCentre) {
  SceneDescription d = block_description({2, 2, 2}, 0.01);
  PrescribedMotion motion;
  motion.nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  motion.centre = Vec3(0.01, 0.01, 0);
  const Quaternion turn = quaternion_from_rotation_vector(Vec3(0, 0, 1.2));
  for (int k = 0; k <= 30; ++k)
    motion.path.push_back({Vec3::Zero(), quaternion_from_rotation_vector(Vec3(0, 0, 0.04 * k))});
  d.motions.push_back(motion);
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  for (int n = 0; n < 300; ++n) step(scene, {}, state, report, *workspace);
  for (std::size_t n = 0; n < scene.mesh.rest_positions.size(); ++n) {  // the whole body has followed
    const Vec3 expected =
        motion.centre + rotation_matrix(turn) * (scene.mesh.rest_positions[n] - motion.centre);
    for (int k = 0; k < 3; ++k)
      EXPECT_NEAR(state.positions[3 * n + static_cast<std::size_t>(k)], expected[k], 1e-5);
  }
}

TEST(PrescribedMotion, GivesTheSameBitsForEveryThreadCount) {
  std::vector<double> first;
  for (const int threads : {1, 2, 3}) {
    SceneDescription d = bar(Precision::single_precision);
    d.motions.push_back(straight_motion(nodes_where(d, [](const Vec3& x) { return x[2] > 0.1 - 1e-9; }),
                                        {0, 0.004, 0.01}, 20));
    const Scene scene = build(std::move(d));
    State state = initial_state(scene, {});
    WorkspacePtr workspace = make_workspace(scene, threads);
    StepReport report = make_report(scene);
    for (int n = 0; n < 20; ++n) step(scene, {}, state, report, *workspace);
    if (first.empty()) first = state.positions;
    EXPECT_EQ(state.positions, first);
  }
}

TEST(PrescribedMotion, OfAFixedNodeIsRefused) {
  SceneDescription d = block_description({2, 2, 2}, 0.01);
  d.fixed_nodes = {3};
  d.motions.push_back(straight_motion({3}, {0, 0, 0.01}, 5));
  EXPECT_THROW(build(std::move(d)), InputError);
  SceneDescription endless = block_description({2, 2, 2}, 0.01);
  endless.motions.push_back(straight_motion({3}, {0, 0, std::nan("")}, 5));
  EXPECT_THROW(build(std::move(endless)), InputError);
}

// A slab one cell thick whose nodes keep their plane: stretched by a tenth along x it narrows along y by the
// plane strain ratio nu / (1 - nu), and stays in its plane exactly.
TEST(SlidingNodes, GivePlaneStrain) {
  SceneDescription d = block_description({6, 6, 1}, 0.01);
  d.material.poisson_ratio = 0.3;
  d.solver.velocity_floor_m_s = 0;
  d.solver.tolerance = 1e-11;
  for (const std::int32_t node : nodes_where(d, [](const Vec3&) { return true; }))
    d.sliding.push_back({node, 2});
  const double ratio = 0.3 / 0.7;
  const EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
  for (const std::int32_t node :
       nodes_where(d, [](const Vec3& x) { return x[0] < 1e-9 || x[0] > 0.06 - 1e-9; })) {
    const Vec3 x = mesh.rest_positions[static_cast<std::size_t>(node)];
    d.motions.push_back(straight_motion({node}, Vec3(0.02 * x[0], -0.02 * ratio * (x[1] - 0.03), 0), 10));
  }
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  for (int n = 0; n < 400; ++n) step(scene, {}, state, report, *workspace);
  for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
    const Vec3& x = mesh.rest_positions[n];
    EXPECT_EQ(state.positions[3 * n + 2], x[2]);
    EXPECT_NEAR(state.positions[3 * n], 1.02 * x[0], 1e-10);
    EXPECT_NEAR(state.positions[3 * n + 1], x[1] - 0.02 * ratio * (x[1] - 0.03), 1e-10);
  }
}

}  // namespace
}  // namespace sulcus
