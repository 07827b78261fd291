// The energy ledger closes: what hands, gravity and paths put in is stored or lost to something with a name.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/contact/test_tools.h"
#include "engine/numerics/test_random.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// A ball pressed by hand into the top of a block on springs, turned and moved aside there, and withdrawn: 2
// s.
SceneDescription pressed(double step_s) {
  SceneDescription d = block_on_springs({5, 5, 5}, step_s, 50, 0.1);
  Tool ball;
  ball.name = "ball";
  ball.surface = sphere_tool(0.03);
  ball.body.inertia_kg_m2 = Vec3(5e-4, 2e-4, 3e-4).asDiagonal();
  d.tools.push_back(ball);
  d.detection = ContactDetection::surface_nodes;
  d.contact = {.stiffness_N_m = 50, .damping_N_s_m = 0.1, .anisotropy = 0.2};
  d.ledger = true;
  return d;
}

DeviceSample hand(double time_s) {
  const auto ramp = [&](double from_s, double to_s) {
    const double u = std::fmin(std::fmax((time_s - from_s) / (to_s - from_s), 0), 1);
    return u * u * (3 - 2 * u);
  };
  const auto rate = [&](double from_s, double to_s) {
    const double u = (time_s - from_s) / (to_s - from_s);
    return u <= 0 || u >= 1 ? 0 : 6 * u * (1 - u) / (to_s - from_s);
  };
  DeviceSample sample;
  sample.position = {0.05 + 0.015 * ramp(0.8, 1.2), 0.05, 0.135 - 0.025 * (ramp(0, 0.6) - ramp(1.4, 1.9))};
  sample.linear_velocity = {0.015 * rate(0.8, 1.2), 0, -0.025 * (rate(0, 0.6) - rate(1.4, 1.9))};
  sample.linear_velocity_valid = true;
  sample.orientation = quaternion_from_rotation_vector(Vec3(0, 0.7 * ramp(0.8, 1.2), 0));
  sample.angular_velocity = {0, 0.7 * rate(0.8, 1.2), 0};
  sample.angular_velocity_valid = true;
  return sample;
}

EnergyBalance balance_of(const Scene& scene, double duration_s = 2) {
  std::vector<DeviceSample> samples(scene.settings.tools.size(), hand(0));
  State state = initial_state(scene, samples);
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  const int steps = static_cast<int>(std::lround(duration_s / scene.settings.step_s));
  double worst = 0;
  for (int n = 1; n <= steps; ++n) {
    for (DeviceSample& sample : samples) sample = hand(n * scene.settings.step_s);
    step(scene, samples, state, report, *workspace);
    EXPECT_TRUE(report.finite);
    worst = std::fmax(worst, std::fabs(report.energy->balance.residual_J));
  }
  EnergyBalance balance = report.energy->balance;
  EXPECT_GT(balance.put_in_J, 0);
  balance.residual_J = worst;  // of all steps
  return balance;
}

TEST(EnergyLedger, ClosesOverAPressWithEveryResponse) {
  enum { implicit, explicit_forces, friction, led };
  for (const int kind : {implicit, explicit_forces, friction, led}) {
    SceneDescription d = pressed(0.005);
    d.solver.tolerance = 1e-10;
    d.solver.velocity_floor_m_s = 1e-14;
    d.contact.explicit_forces = kind == explicit_forces;
    if (kind == friction) d.contact.friction = 0.3;
    if (kind == led) d.contact = {.anisotropy = 0, .prescribed = true};
    const EnergyBalance balance = balance_of(build(std::move(d)));
    EXPECT_LT(balance.residual_J, 1e-6 * balance.put_in_J) << kind;
    EXPECT_GT(balance.damping_loss_J, 0.05 * balance.put_in_J) << kind;
  }
}

// The bound of the thesis' own steps, single precision and a tolerance of 1e-3: ten hundredths.
TEST(EnergyLedger, ClosesWithTheStepsAndTheToleranceOfRealTime) {
  for (const double step_s : {0.005, 0.017, 0.033}) {
    SceneDescription d = pressed(step_s);
    d.solver.precision = Precision::single_precision;
    d.solver.tolerance = 1e-3;
    const EnergyBalance balance = balance_of(build(std::move(d)));
    EXPECT_LT(balance.residual_J, (step_s < 0.01 ? 0.01 : 0.1) * balance.put_in_J) << step_s;
  }
}

TEST(EnergyLedger, OfAFreeBodyLosesOnlyToTimeIntegration) {
  const std::uint64_t seed = 5;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  SceneDescription d = block_description({3, 3, 3}, 0.01);
  d.damping = {0, 0};
  d.ledger = true;
  d.solver.tolerance = 1e-12;
  d.solver.velocity_floor_m_s = 1e-16;
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  for (double& x : state.positions) x += uniform(random, -0.001, 0.001);
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  step(scene, {}, state, report, *workspace);
  const double first = report.energy->balance.elastic_J;
  for (int n = 0; n < 60; ++n) step(scene, {}, state, report, *workspace);
  const EnergyBalance& balance = report.energy->balance;
  EXPECT_EQ(balance.put_in_J, 0);
  EXPECT_EQ(balance.damping_loss_J, 0);
  EXPECT_NEAR(balance.integration_loss_J + balance.elastic_J + balance.kinetic_J, first, 1e-9 * first);
  EXPECT_GT(balance.integration_loss_J, 0.5 * first);
}

// A block slides down a slope: gravity puts in m g sin times the way, friction takes mu m g cos times the
// way.
TEST(EnergyLedger, BooksTheWorkOfFriction) {
  SceneDescription d = block_description({4, 4, 1}, 0.01);
  d.material.youngs_modulus_Pa = 20000;
  d.damping = {0, 0.02};
  d.step_s = 0.005;
  const double angle = 0.5, mu = 0.3;
  d.gravity = 9.81 * Vec3(std::sin(angle), 0, -std::cos(angle));
  d.obstacles.push_back({"plate", box_tool({2, 2, 0.1}), Vec3(0, 0, -0.05), {}, {}});
  d.obstacles[0].contact = {.stiffness_N_m = 100, .damping_N_s_m = 0.5, .friction = mu};
  d.ledger = true;
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  double at_start = 0, way_at_start = 0, way = 0;
  for (int n = 0; n < 100; ++n) {
    way = 0;
    for (std::size_t i = 0; i < scene.elements.node_mass.size(); ++i)
      way += scene.elements.node_mass[i] / scene.total_mass_kg *
             (state.positions[3 * i] - scene.mesh.rest_positions[i][0]);
    step(scene, {}, state, report, *workspace);
    if (n == 50) {  // the block has come to sit on the plate
      at_start = report.energy->balance.contact_loss_J;
      way_at_start = way;
    }
  }
  const EnergyBalance& balance = report.energy->balance;
  const double expected = mu * scene.total_mass_kg * 9.81 * std::cos(angle) * (way - way_at_start);
  EXPECT_GT(way, 0.1);
  EXPECT_NEAR(balance.contact_loss_J - at_start, expected, 0.02 * expected);
  EXPECT_LT(std::fabs(balance.residual_J), 1e-6 * balance.put_in_J);
}

TEST(EnergyLedger, BooksPathsAndDampingOfMaterials) {
  SceneDescription d = block_description({2, 2, 6}, 0.01);
  d.material.damping = RayleighDamping{0.5, 0.03};
  d.solver.tolerance = 1e-11;
  d.solver.velocity_floor_m_s = 1e-15;
  d.step_s = 0.01;
  d.ledger = true;
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  d.motions.push_back(straight_motion(nodes_where(d, [](const Vec3& x) { return x[2] > 0.06 - 1e-9; }),
                                      {0, 0.01, 0.005}, 20));
  const EnergyBalance balance = balance_of(build(std::move(d)), 0.5);
  EXPECT_EQ(balance.hand_J, 0);
  EXPECT_GT(balance.paths_J, 0);
  EXPECT_GT(balance.damping_loss_J, 0);
  EXPECT_LT(balance.residual_J, 1e-6 * balance.put_in_J);
}

TEST(EnergyLedger, IsKeptOnlyWhereAskedForAndChangesNoBit) {
  std::vector<double> positions;
  for (const bool ledger : {false, true}) {
    SceneDescription d = pressed(0.033);
    d.ledger = ledger;
    d.energies = ledger;
    d.solver.precision = Precision::single_precision;
    d.solver.tolerance = 1e-3;
    const Scene scene = build(std::move(d));
    DeviceSample sample = hand(0);
    State state = initial_state(scene, std::span(&sample, 1));
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    EXPECT_EQ(report.energy.has_value(), ledger);
    for (int n = 1; n <= 30; ++n) {
      sample = hand(n * 0.033);
      step(scene, std::span(&sample, 1), state, report, *workspace);
    }
    if (positions.empty()) positions = state.positions;
    EXPECT_EQ(state.positions, positions);
  }
}

}  // namespace
}  // namespace sulcus
