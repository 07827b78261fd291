// Bodies on obstacles that stand still: weight, friction on a slope, explicit contact, and the laws of the
// house.
#include <gtest/gtest.h>

#include <cmath>

#include "engine/contact/test_tools.h"
#include "engine/numerics/error.h"
#include "engine/scene/allocation_count.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// A block of 4 x 4 x 1 cells of 10 mm (16 g) just above a plate whose upper face is the plane z = 0.
SceneDescription block_on_plate(double step_s = 0.005) {
  SceneDescription d = block_description({4, 4, 1}, 0.01);
  d.material.youngs_modulus_Pa = 20000;
  d.material.poisson_ratio = 0.3;
  d.damping = {0, 0.02};
  d.step_s = step_s;
  d.gravity = {0, 0, -9.81};
  Obstacle plate;
  plate.name = "plate";
  plate.surface = box_tool({4, 4, 0.4});
  plate.position = {0.02, 0.02, -0.2};
  plate.contact.stiffness_N_m = 100;
  plate.contact.damping_N_s_m = 0.5;
  d.obstacles.push_back(plate);
  return d;
}

// Tilts plate and block by an angle about the y axis through the origin: gravity is tilted the other way, as
// seen from them.
void tilt(SceneDescription& d, double angle) {
  d.gravity = 9.81 * Vec3(std::sin(angle), 0, -std::cos(angle));
}

struct Motion {
  double way_m = 0, speed_m_s = 0;  // of the centre of mass along x
};

Motion motion_of(const Scene& scene, const State& state) {
  Motion motion;
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
    const double share = scene.elements.node_mass[n] / scene.total_mass_kg;
    motion.way_m += share * (state.positions[3 * n] - scene.mesh.rest_positions[n][0]);
    motion.speed_m_s += share * state.velocities[3 * n];
  }
  return motion;
}

struct Rest {
  State state;
  StepReport report;
};

Rest run(const Scene& scene, int steps, int threads = 1) {
  Rest r{initial_state(scene, {}), make_report(scene)};
  WorkspacePtr workspace = make_workspace(scene, threads);
  for (int n = 0; n < steps; ++n) step(scene, {}, r.state, r.report, *workspace);
  return r;
}

TEST(Obstacle, CarriesTheWeightOfABlock) {
  const Scene scene = build(block_on_plate());
  const Rest r = run(scene, 400);
  ASSERT_TRUE(r.report.finite);
  const double weight = 9.81 * scene.total_mass_kg;
  EXPECT_EQ(r.report.obstacles[0].contacts, 25);
  EXPECT_LT((r.report.obstacles[0].contact_force - Vec3(0, 0, -weight)).norm(), 1e-6 * weight);
  // every contact carries a part of the weight, depth = force / stiffness
  EXPECT_GT(r.report.obstacles[0].max_penetration_m, weight / (25 * 100));
  EXPECT_LT(r.report.obstacles[0].max_penetration_m, 2 * weight / (25 * 100));
}

TEST(Obstacle, PushesOutTheShortestWayWhateverTheNodesNormal) {
  // a plate on edge beside the block: its upper corner nodes have slanting normals, the force has not
  SceneDescription d = block_on_plate();
  d.gravity.setZero();
  d.obstacles[0].position = {0.02, 0.02, -0.1999};
  const Scene scene = build(std::move(d));
  Rest r{initial_state(scene, {}), make_report(scene)};
  WorkspacePtr workspace = make_workspace(scene, 1);
  step(scene, {}, r.state, r.report, *workspace);
  EXPECT_EQ(r.report.obstacles[0].contacts, 25);
  EXPECT_LT(r.report.obstacles[0].contact_force.head<2>().norm(), 1e-9);
  EXPECT_LT(r.report.obstacles[0].contact_force[2], -1e-3);
}

// Coulomb: a block stays on a slope up to tan(angle) = mu and slides on a steeper one with
// g (sin - mu cos). The regularised law creeps at v_s tan / sqrt(mu^2 - tan^2) on the gentler one.
TEST(Friction, HoldsABlockUpToTheAngleOfCoulombAndLetsItGoBeyond) {
  constexpr double mu = 0.5;
  for (const double ratio : {0.9, 0.98, 1.02, 1.1}) {
    SceneDescription d = block_on_plate(0.01);
    d.obstacles[0].contact.friction = mu;
    d.obstacles[0].contact.friction_speed_m_s = 1e-4;
    const double angle = std::atan(ratio * mu);
    tilt(d, angle);
    const Scene scene = build(std::move(d));
    const Rest early = run(scene, 100);
    const Rest late = run(scene, 200);
    const double speed = motion_of(scene, late.state).speed_m_s;
    if (ratio < 1) {
      EXPECT_LT(speed, 1.1e-4 * ratio / std::sqrt(1 - ratio * ratio)) << ratio;
      continue;
    }
    const double acceleration = (speed - motion_of(scene, early.state).speed_m_s) / (100 * 0.01);
    const double measured_mu = std::tan(angle) - acceleration / (9.81 * std::cos(angle));
    EXPECT_NEAR(measured_mu, mu, 0.02 * mu) << ratio;
    EXPECT_GT(speed, 0.01) << ratio;
  }
}

// Contacts come and go and are solved again, so what the last steps let expect is often wrong: followed all
// the way, it moves the block aside.
TEST(Friction, OnAStiffFloorABlockRestsWhereverASearchBegins) {
  std::vector<Vec3> ends;
  for (const FirstGuess first : {FirstGuess::velocity, FirstGuess::past}) {
    SceneDescription d = block_description({4, 4, 4}, 0.005);
    d.material = {1000, 0.45, 1000};
    d.damping = {0, 0.1};
    d.step_s = 0.02;
    d.gravity = {0, 0, -9.81};
    d.obstacles = block_on_plate().obstacles;
    d.obstacles[0].position = {0.01, 0.01, -0.201};
    d.obstacles[0].contact.stiffness_N_m = 1e5;
    d.obstacles[0].contact.damping_N_s_m = 0.1;
    d.obstacles[0].contact.friction = 0.5;
    d.solver.first_guess = first;
    d.solver.precision = Precision::single_precision;
    d.solver.tolerance = 1e-3;
    const Scene scene = build(std::move(d));
    const Rest r = run(scene, 400);
    ASSERT_TRUE(r.report.finite);
    ends.push_back(node_vector(std::span<const double>(r.state.positions), 0));
  }
  EXPECT_LT((ends[1] - ends[0]).norm(), 2e-5);  // m; followed all the way: 2e-4
}

// The same with the plate itself tilted, and the slope along a diagonal.
TEST(Friction, DoesNotDependOnTheDirectionOfTheSlope) {
  constexpr double mu = 0.3;
  for (const double ratio : {0.97, 1.1}) {
    SceneDescription d = block_on_plate(0.01);
    d.obstacles[0].contact.friction = mu;
    d.obstacles[0].contact.friction_speed_m_s = 1e-4;
    const double angle = std::atan(ratio * mu);
    d.gravity = 9.81 * Vec3(std::sin(angle) * 0.6, std::sin(angle) * 0.8, -std::cos(angle));
    const Scene scene = build(std::move(d));
    const Rest r = run(scene, 150);
    Vec3 velocity = Vec3::Zero();
    for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n)
      velocity += scene.elements.node_mass[n] / scene.total_mass_kg *
                  node_vector(r.state.velocities, static_cast<std::int32_t>(n));
    if (ratio < 1) {
      EXPECT_LT(velocity.norm(), 6e-4);
    } else {
      EXPECT_LT((velocity.head<2>().normalized() - Eigen::Vector2d(0.6, 0.8)).norm(), 1e-3);
      EXPECT_NEAR(velocity.norm(), 9.81 * std::cos(angle) * 0.1 * mu * 1.5, 0.1 * velocity.norm());
    }
  }
}

TEST(Friction, StepIsDefiniteAndSolvedWhateverTheCoefficient) {
  for (const double mu : {0.0, 0.2, 1.0, 10.0}) {
    SceneDescription d = block_on_plate(0.033);
    d.obstacles[0].contact.friction = mu;
    d.obstacles[0].contact.stiffness_N_m = 1e5;
    tilt(d, 0.4);
    const Scene scene = build(std::move(d));
    Rest r{initial_state(scene, {}), make_report(scene)};
    WorkspacePtr workspace = make_workspace(scene, 1);
    for (int n = 0; n < 30; ++n) {
      step(scene, {}, r.state, r.report, *workspace);
      ASSERT_TRUE(r.report.finite && r.report.converged) << mu << ", step " << n;
    }
  }
}

// A ball pressed into a block by its device for a second: force of the tissue on it at each step.
std::vector<double> pressed(bool explicit_forces, double stiffness_N_m) {
  SceneDescription d = block_description({5, 5, 5}, 0.02);
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  Tool ball;
  ball.surface = sphere_tool(0.03);
  d.tools.push_back(ball);
  d.detection = ContactDetection::surface_nodes;
  d.contact = {.stiffness_N_m = stiffness_N_m, .damping_N_s_m = 0.1, .anisotropy = 0, .tension_rule = false};
  d.contact.explicit_forces = explicit_forces;
  const Scene scene = build(std::move(d));
  DeviceSample sample;
  sample.position = {0.05, 0.05, 0.13};
  State state = initial_state(scene, std::span(&sample, 1));
  StepReport report = make_report(scene);
  WorkspacePtr workspace = make_workspace(scene, 1);
  std::vector<double> forces;
  for (int n = 0; n < 90; ++n) {
    sample.position[2] = 0.13 - 0.01 * std::fmin(n / 30.0, 1.0);
    step(scene, std::span(&sample, 1), state, report, *workspace);
    EXPECT_TRUE(report.finite);
    EXPECT_LT((report.tools[0].contact_force + report.tools[0].tissue_force).norm(), 1e-9 * (1 + n));
    forces.push_back(report.tools[0].contact_force[2]);
  }
  return forces;
}

double ripple(const std::vector<double>& forces) {  // N, largest change from step to step at the end
  double largest = 0;
  for (std::size_t n = 61; n < forces.size(); ++n)
    largest = std::fmax(largest, std::fabs(forces[n] - forces[n - 1]));
  return largest;
}

TEST(ExplicitContact, FindsTheSameBalanceAsLongAsItIsStableAndVibratesBeyond) {
  const std::vector<double> soft_implicit = pressed(false, 5), soft_explicit = pressed(true, 5);
  EXPECT_GT(soft_implicit.back(), 0.05);
  EXPECT_NEAR(soft_explicit.back(), soft_implicit.back(), 0.01 * soft_implicit.back());
  EXPECT_LT(ripple(pressed(false, 3000)), 0.01);
  EXPECT_GT(ripple(pressed(true, 3000)), 1);
}

TEST(Obstacle, GivesTheSameBitsForEveryThreadCountAndAllocatesNothing) {
  SceneDescription d = block_on_plate(0.01);
  d.obstacles[0].contact.friction = 0.4;
  d.obstacles.push_back(d.obstacles[0]);
  d.obstacles[1].surface = sphere_tool(0.02);
  d.obstacles[1].position = {0.02, 0.02, -0.015};
  d.solver.precision = Precision::single_precision;
  d.solver.tolerance = 1e-4;
  tilt(d, 0.3);
  const Scene scene = build(std::move(d));
  const Rest reference = run(scene, 60, 1);
  EXPECT_GT(reference.report.obstacles[1].contacts, 0);
  for (const int threads : {2, 4})
    EXPECT_EQ(run(scene, 60, threads).state.positions, reference.state.positions);

  State state = initial_state(scene, {});
  StepReport report = make_report(scene);
  WorkspacePtr workspace = make_workspace(scene, 2);
  step(scene, {}, state, report, *workspace);
  const long before = allocation_count();
  for (int n = 0; n < 40; ++n) step(scene, {}, state, report, *workspace);
  EXPECT_EQ(allocation_count() - before, 0);
}

TEST(Obstacle, CostsNothingWhereThereIsNone) {
  const Scene scene = build(block_description({2, 2, 2}, 0.01));
  EXPECT_TRUE(scene.faces.across.empty());
  EXPECT_FALSE(scene.nodes_touch());
  EXPECT_FALSE(scene.solves_again());
}

TEST(Obstacle, ThatIsWrongIsRefused) {
  const auto refused = [](auto change) {
    SceneDescription d = block_on_plate();
    change(d.obstacles[0]);
    EXPECT_THROW(build(std::move(d)), InputError);
  };
  refused([](Obstacle& o) { o.surface.triangles.clear(); });
  refused([](Obstacle& o) { o.position[1] = NAN; });
  refused([](Obstacle& o) { o.surface.vertices[3][0] = INFINITY; });
  refused([](Obstacle& o) { o.contact.stiffness_N_m = -1; });
  refused([](Obstacle& o) { o.contact.friction = NAN; });
  refused([](Obstacle& o) { o.contact.friction_speed_m_s = 0; });
}

}  // namespace
}  // namespace sulcus
