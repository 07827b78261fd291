// Contact by prescribed displacement: the touched nodes go where the tool takes them, and it feels them.
#include <gtest/gtest.h>

#include <cmath>

#include "engine/contact/test_tools.h"
#include "engine/numerics/error.h"
#include "engine/scene/allocation_count.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// A block of 6 x 6 x 6 cells of 10 mm, held at the bottom, and a ball of 30 mm above its middle.
SceneDescription ball_on_block(double anisotropy) {
  SceneDescription d = block_description({6, 6, 6}, 0.01);
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  Tool ball;
  ball.name = "ball";
  ball.surface = sphere_tool(0.03);
  d.tools.push_back(ball);
  d.detection = ContactDetection::surface_nodes;
  d.contact.anisotropy = anisotropy;
  d.contact.prescribed = true;
  return d;
}

// Down by `depth` in 30 steps, 60 steps there, up in 30 steps, 100 steps more.
DeviceSample press(int n, double depth_m, const Vec3& side = Vec3::Zero()) {
  DeviceSample sample;
  const double down = std::fmin(n / 30.0, 1) - std::fmin(std::fmax((n - 90) / 30.0, 0), 1);
  sample.position = Vec3(0.03, 0.03, 0.0905) - (depth_m + 0.0005) * down * Vec3::UnitZ();
  sample.position += side * std::fmin(std::fmax((n - 30) / 30.0, 0.0), 1.0);
  return sample;
}

struct Pressing {
  std::vector<StepReport> reports;
  State state;
};

Pressing run(const Scene& scene, int steps, double depth_m, const Vec3& side = Vec3::Zero(),
             int threads = 1) {
  DeviceSample sample = press(0, depth_m, side);
  Pressing p;
  p.state = initial_state(scene, std::span(&sample, 1));
  WorkspacePtr workspace = make_workspace(scene, threads);
  StepReport report = make_report(scene);
  for (int n = 1; n <= steps; ++n) {
    sample = press(n, depth_m, side);
    step(scene, std::span(&sample, 1), p.state, report, *workspace);
    p.reports.push_back(report);
  }
  return p;
}

TEST(PrescribedContact, BringsTheTouchedNodesToTheToolAndPushesAsAStiffPenaltyDoes) {
  constexpr double depth_m = 0.006;
  const Scene scene = build(ball_on_block(0));
  const Pressing led = run(scene, 90, depth_m);
  const ToolReport& tool = led.reports.back().tools[0];
  ASSERT_TRUE(led.reports.back().finite && led.reports.back().converged);
  EXPECT_GE(tool.contacts, 5);
  EXPECT_LT(tool.max_penetration_m, 2.5e-4);  // touch_m, and the distance grid of the tool
  EXPECT_GT(tool.min_push_N, 0);
  EXPECT_LT((tool.contact_force + tool.tissue_force).norm(), 1e-12);
  EXPECT_EQ(tool.coupling_force, tool.contact_force);  // what the hand feels
  SceneDescription d = ball_on_block(0);
  d.contact = {.stiffness_N_m = 3000, .damping_N_s_m = 0, .anisotropy = 0};
  d.tools[0].coupling.stiffness_N_m = 1e6;  // so that the tool is where the device is
  const Pressing pushed = run(build(std::move(d)), 90, depth_m - 1e-4);
  EXPECT_NEAR(tool.contact_force[2], pushed.reports.back().tools[0].contact_force[2],
              0.03 * tool.contact_force[2]);
}

TEST(PrescribedContact, NeverPullsAndLetsGo) {
  const Scene scene = build(ball_on_block(0));
  const Pressing p = run(scene, 220, 0.006);
  bool released = false;
  for (const StepReport& report : p.reports) {
    const ToolReport& tool = report.tools[0];
    ASSERT_TRUE(report.finite);
    if (tool.contacts > 0) {
      EXPECT_GT(tool.min_push_N, -1e-9) << report.step;
    }
    EXPECT_GT(tool.contact_force[2], -1e-9) << report.step;
    released = released || tool.dropped_contacts > 0;
  }
  EXPECT_TRUE(released);
  EXPECT_EQ(p.reports.back().tools[0].contacts, 0);
  for (std::size_t n = 0; n < scene.mesh.rest_positions.size(); ++n)
    EXPECT_LT(
        (node_vector(p.state.positions, static_cast<std::int32_t>(n)) - scene.mesh.rest_positions[n]).norm(),
        2e-4);
}

// The momentum of a body that nothing else holds changes by what the tool gives it.
TEST(PrescribedContact, GivesTheTissueTheMomentumThatTheToolReports) {
  for (const double anisotropy : {0.0, 1.0}) {
    SceneDescription d = ball_on_block(anisotropy);
    d.fixed_nodes.clear();
    d.solver.tolerance = 1e-12;
    d.solver.velocity_floor_m_s = 1e-15;
    const Scene scene = build(std::move(d));
    DeviceSample sample = press(0, 0.01);
    State state = initial_state(scene, std::span(&sample, 1));
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    Vec3 before = Vec3::Zero();
    double largest = 0;
    for (int n = 1; n <= 40; ++n) {
      sample = press(n, 0.01);
      step(scene, std::span(&sample, 1), state, report, *workspace);
      Vec3 momentum = Vec3::Zero();
      for (std::size_t i = 0; i < scene.elements.node_mass.size(); ++i)
        momentum += scene.elements.node_mass[i] * node_vector(state.velocities, static_cast<std::int32_t>(i));
      const Vec3 force = report.tools[0].tissue_force;
      ASSERT_LT(((momentum - before) / 0.017 - force).norm(), 1e-8) << n;
      largest = std::fmax(largest, force.norm());
      before = momentum;
    }
    EXPECT_GT(largest, 0.01);
  }
}

TEST(PrescribedContact, SlidesOrSticksAsItsAnisotropySays) {
  const Vec3 side(0.004, 0, 0);
  const Pressing slides = run(build(ball_on_block(0)), 80, 0.004, side);
  const Pressing sticks = run(build(ball_on_block(1)), 80, 0.004, side);
  const Scene scene = build(ball_on_block(1));
  // the node under the ball
  for (const std::int32_t node : nodes_where(
           ball_on_block(0), [](const Vec3& x) { return (x - Vec3(0.03, 0.03, 0.06)).norm() < 1e-9; })) {
    EXPECT_NEAR(node_vector(sticks.state.positions, node)[0], 0.034, 1e-4);
    EXPECT_LT(node_vector(slides.state.positions, node)[0], 0.0315);
  }
  EXPECT_LT(sticks.reports.back().tools[0].contact_force[0], -0.02);
}

// Two blades lie in a closed fissure and move apart.
TEST(PrescribedContact, TwoToolsOpenAFissureAndEachFeelsItsSide) {
  SceneDescription d;
  d.map = box_map(24, 12, 24, 0.002);
  for (int k = 0; k < 24; ++k) {
    for (int j = 0; j < 12; ++j) {
      for (int i = 0; i < 24; ++i) d.map.labels[d.map.index(i, j, k)] = k < 6 ? 3 : i < 12 ? 1 : 2;
    }
  }
  d.pairs = make_separation_pairs({{1, 2}});
  d.embedding.size_m = 0.008;  // the fissure lies between cells, so that both sides are alike
  d.damping = {0, 0.05};
  d.step_s = 0.02;
  d.solver.tolerance = 1e-5;
  const Vec3 middle = d.map.to_world(Vec3(11.5, 5.5, 16));
  d.fixed_nodes = nodes_where(d, [&](const Vec3& x) { return x[2] < d.map.origin[2]; });
  for (const char* name : {"left", "right"}) {
    Tool blade;
    blade.name = name;
    blade.surface = box_tool({0.001, 0.016, 0.02});
    // vertices on a grid of 2 mm over both broad faces, besides the corners: they are what detection looks at
    for (const double x : {-0.0005, 0.0005}) {
      for (double y = -0.007; y < 0.0071; y += 0.002) {
        for (double z = -0.009; z < 0.0091; z += 0.002) blade.surface.vertices.emplace_back(x, y, z);
      }
    }
    d.tools.push_back(blade);
  }
  d.contact.prescribed = true;
  const Scene scene = build(std::move(d));
  std::vector<DeviceSample> samples(2);
  samples[0].position = middle - Vec3(0.0008, 0, 0);
  samples[1].position = middle + Vec3(0.0008, 0, 0);
  State state = initial_state(scene, samples);
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  for (int n = 0; n < 60; ++n) {
    samples[0].position[0] -= 0.0001;
    samples[1].position[0] += 0.0001;
    step(scene, samples, state, report, *workspace);
    ASSERT_TRUE(report.finite) << n;
  }
  EXPECT_GT(report.tools[0].contacts, 0);
  EXPECT_GT(report.tools[1].contacts, 0);
  EXPECT_GT(report.tools[0].contact_force[0], 0.01);  // the left side pushes its blade back to the middle
  EXPECT_LT(report.tools[1].contact_force[0], -0.01);
  EXPECT_NEAR(report.tools[0].contact_force[0], -report.tools[1].contact_force[0],
              0.2 * report.tools[0].contact_force[0]);
}

TEST(PrescribedContact, GivesTheSameBitsForEveryThreadCountAndAllocatesNothing) {
  SceneDescription d = ball_on_block(0);
  d.solver.precision = Precision::single_precision;
  d.solver.tolerance = 1e-4;
  const Scene scene = build(std::move(d));
  const Pressing reference = run(scene, 60, 0.006);
  for (const int threads : {2, 3})
    EXPECT_EQ(run(scene, 60, 0.006, Vec3::Zero(), threads).state.positions, reference.state.positions);
  DeviceSample sample = press(0, 0.006);
  State state = initial_state(scene, std::span(&sample, 1));
  WorkspacePtr workspace = make_workspace(scene, 2);
  StepReport report = make_report(scene);
  step(scene, std::span(&sample, 1), state, report, *workspace);
  const long before = allocation_count();
  for (int n = 2; n < 100; ++n) {
    sample = press(n, 0.006);
    step(scene, std::span(&sample, 1), state, report, *workspace);
  }
  EXPECT_EQ(allocation_count() - before, 0);
}

TEST(PrescribedContact, ThatIsHalfStickingOrOfAnObstacleIsRefused) {
  EXPECT_THROW(build(ball_on_block(0.5)), InputError);
  SceneDescription d = ball_on_block(0);
  d.obstacles.push_back({"plate", box_tool({1, 1, 0.1}), Vec3(0, 0, -1), {}, {}});
  d.obstacles[0].contact.prescribed = true;
  EXPECT_THROW(build(std::move(d)), InputError);
}

}  // namespace
}  // namespace sulcus
