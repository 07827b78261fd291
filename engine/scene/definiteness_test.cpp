// The system of a step is symmetric and positive definite whatever touches what, and Hertz' contact.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>

#include "engine/contact/test_tools.h"
#include "engine/numerics/test_random.h"
#include "engine/scene/contact_system.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

using Dense = Eigen::MatrixXd;

Vec3 random_vector(std::mt19937_64& random, double size) {
  return {uniform(random, -size, size), uniform(random, -size, size), uniform(random, -size, size)};
}

// The whole system [A B; B^T C] of tissue and tools, as the workspace holds it after a solve.
Dense whole_system(const Scene& scene, Workspace& workspace) {
  Numbers<double>& numbers = *workspace.twice;
  RowMatrix<double> matrix;
  matrix.chunks = scene.sparsity.chunks;
  matrix.chunk_start = scene.sparsity.chunk_start.data();
  matrix.column = scene.sparsity.column.data();
  matrix.values = numbers.system.values.data();
  matrix.diagonal = numbers.system.diagonal.data();
  matrix.inverse = numbers.system.inverse.data();
  auto& solver = numbers.solver;
  const auto nodes = static_cast<std::int32_t>(scene.node_count());
  const auto tools = static_cast<Eigen::Index>(workspace.tools.size());
  const auto blocks = static_cast<std::int64_t>(solver.pq.size());
  Dense a = Dense::Zero(3 * nodes + 6 * tools, 3 * nodes + 6 * tools);
  for (std::int32_t node = 0; node < nodes; ++node) {
    for (std::size_t d = 0; d < 3; ++d) {
      std::fill(solver.z.begin(), solver.z.end(), 0.0);
      std::fill(solver.p.begin(), solver.p.end(), 0.0);
      solver.z[solver_entry(scene, node, d)] = 1;
      solver.kernels.direct(matrix, 0.0, solver.z.data(), solver.p.data(), solver.packed.data(), 0, blocks);
      solver.kernels.multiply(matrix, solver.p.data(), solver.packed.data(), solver.q.data(),
                              solver.pq.data(), 0, blocks);
      for (std::int32_t other = 0; other < nodes; ++other) {
        for (std::size_t e = 0; e < 3; ++e)
          a(3 * other + static_cast<int>(e), 3 * node + static_cast<int>(d)) =
              solver.q[solver_entry(scene, other, e)];
      }
    }
  }
  for (Eigen::Index t = 0; t < tools; ++t) {
    const auto tool = static_cast<std::size_t>(t);
    a.block<6, 6>(3 * nodes + 6 * t, 3 * nodes + 6 * t) = workspace.tools[tool].matrix;
    for (const auto& row : numbers.borders[tool].rows) {
      for (std::int32_t node = 0; node < nodes; ++node) {
        if (static_cast<std::int64_t>(solver_entry(scene, node, 0)) != row.offset) continue;
        for (int i = 0; i < 3; ++i) {
          for (int j = 0; j < 6; ++j) {
            a(3 * node + i, 3 * nodes + 6 * t + j) = row.b[static_cast<std::size_t>(6 * i + j)];
            a(3 * nodes + 6 * t + j, 3 * node + i) = row.b[static_cast<std::size_t>(6 * i + j)];
          }
        }
      }
    }
  }
  return a;
}

TEST(System, IsSymmetricAndPositiveDefiniteInAThousandConfigurations) {
  const std::uint64_t seed = 17;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  double worst = 0, least = 1e300;
  const RigidDistance plate =
      build_rigid_distance(box_tool({0.01, 0.01, 0.01}), 0.001);  // made once: it costs most
  for (int trial = 0; trial < 1000; ++trial) {
    SceneDescription d = block_description({1, 1, 1}, 0.01);
    d.step_s = trial % 3 == 0 ? 0.001 : trial % 3 == 1 ? 0.017 : 0.1;
    d.damping = {uniform(random, 0, 2), trial % 4 == 0 ? 0 : uniform(random, 0, 0.1)};
    d.contact.stiffness_N_m = std::pow(10, uniform(random, -1, 5));
    d.contact.damping_N_s_m = trial % 2 == 0 ? 0 : uniform(random, 0, 1);
    d.contact.anisotropy = trial % 5 == 0 ? 0 : trial % 5 == 1 ? 1 : uniform(random, 0, 1);
    if (trial % 4 == 1) d.contact.friction = uniform(random, 0.01, 2);
    for (int t = 0; t < 1 + trial % 2; ++t) {
      Tool tool;
      tool.surface = box_tool({0.01, 0.01, 0.01});
      const Mat3 turn = rotation_matrix(quaternion_from_rotation_vector(random_vector(random, 1.5)));
      tool.body.inertia_kg_m2 =
          turn *
          Vec3(uniform(random, 0.1, 8), uniform(random, 0.1, 8), uniform(random, 0.1, 8)).asDiagonal() *
          1e-4 * turn.transpose();
      tool.body.inertia_kg_m2 =
          (0.5 * (tool.body.inertia_kg_m2 + tool.body.inertia_kg_m2.transpose())).eval();
      tool.body.mass_kg = uniform(random, 0.01, 0.5);
      d.tools.push_back(tool);
    }
    d.solver.tolerance = 0.5;
    Scene scene = build(std::move(d));
    scene.settings.obstacles.push_back({"plate", {}, Vec3(0, 0, -1), {}, scene.settings.contact});
    scene.obstacle_distances.push_back(plate);
    std::vector<DeviceSample> samples(scene.settings.tools.size());
    for (DeviceSample& sample : samples) sample.position = random_vector(random, 0.05);
    State state = initial_state(scene, samples);
    for (double& x : state.positions) x += uniform(random, -0.003, 0.003);
    for (double& v : state.velocities) v = uniform(random, -0.5, 0.5);
    for (double& p : state.tool_momenta) p = uniform(random, -1e-3, 1e-3);
    for (DeviceSample& sample : samples) {
      Vec3 turn = random_vector(random, 1);
      turn *= uniform(random, 0, 3) / turn.norm();
      sample.orientation = quaternion_from_rotation_vector(turn);
    }
    WorkspacePtr workspace = make_workspace(scene, 1);
    for (int c = 0; c < 12; ++c) {
      Contact contact;
      contact.tool = static_cast<std::int32_t>(random() % (samples.size() + 1));
      contact.tet = static_cast<std::int32_t>(random() % 5);
      double sum = 0;
      for (double& w : contact.weights) sum += w = c % 4 == 0 ? 0 : uniform(random, -0.1, 1);
      if (c % 4 == 0) sum = contact.weights[random() % 4] = 1;
      for (double& w : contact.weights) w /= sum;
      contact.arm = random_vector(random, 0.08);
      contact.normal = random_vector(random, 1).normalized();
      contact.gap = -uniform(random, 0, 0.01) * contact.normal + random_vector(random, 0.002);
      contact.slip = random_vector(random, 0.05);
      contact.slip -= contact.normal.dot(contact.slip) * contact.normal;
      workspace->contacts.push_back(contact);
    }
    assemble_and_solve(scene, samples, state, *workspace->twice, *workspace, nullptr, {0.5, 0, 1000});
    const Dense a = whole_system(scene, *workspace);
    worst = std::fmax(worst, (a - a.transpose()).norm() / a.norm());
    // of the scaled matrix, so that kilograms beside kilogram square metres do not decide
    const Eigen::VectorXd scale = a.diagonal().cwiseSqrt().cwiseInverse();
    ASSERT_TRUE(scale.allFinite()) << trial;
    const Dense scaled = scale.asDiagonal() * (0.5 * (a + a.transpose())) * scale.asDiagonal();
    const Eigen::LDLT<Dense> factors(scaled);
    least = std::fmin(least, factors.vectorD().minCoeff());
    ASSERT_GT(factors.vectorD().minCoeff(), 0) << trial;
  }
  EXPECT_LT(worst, 1e-14);
  std::printf("largest asymmetry %.2g, smallest pivot of the scaled matrix %.2g\n", worst, least);
}

// A rigid ball of 30 mm pressed 5 mm into the cube of thesis 4.6.2 (0.1 m, E 2000 Pa, nu 0.45), frictionless.
double indentation_force(int cells) {
  SceneDescription d = block_description({cells, cells, cells}, 0.1 / cells);
  d.material = {2000, 0.45, 1000};
  d.damping = {0, 0.02};
  d.step_s = 0.2;
  d.solver.tolerance = 1e-6;
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  Tool ball;
  ball.surface = sphere_tool(0.03, 5);
  ball.coupling.stiffness_N_m = 1e6;
  d.tools.push_back(ball);
  d.detection = ContactDetection::surface_nodes;
  d.contact = {.stiffness_N_m = 5000, .damping_N_s_m = 0, .anisotropy = 0};
  const Scene scene = build(std::move(d));
  DeviceSample sample;
  sample.position = {0.05, 0.05, 0.1301};
  State state = initial_state(scene, std::span(&sample, 1));
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  for (int n = 1; n <= 14; ++n) {
    sample.position[2] = 0.13 - 0.005 * std::fmin(n / 5.0, 1.0);
    step(scene, std::span(&sample, 1), state, report, *workspace);
  }
  return report.tools[0].contact_force[2];
}

TEST(Hertz, ForceOfABallInABlockConverges) {
  const double hertz = 4.0 / 3 * 2000 / (1 - 0.45 * 0.45) * std::sqrt(0.03) * std::pow(0.005, 1.5);
  EXPECT_NEAR(hertz, 0.20476, 1e-5);
  const double coarse = indentation_force(5), thesis = indentation_force(10), fine = indentation_force(14);
  std::printf("force over Hertz': %.3f with 5 cells, %.3f with 10, %.3f with 14\n", coarse / hertz,
              thesis / hertz, fine / hertz);
  EXPECT_NEAR(thesis, hertz, 0.1 * hertz);
  EXPECT_NEAR(fine, hertz, 0.1 * hertz);
  EXPECT_LT(std::fabs(fine - hertz), std::fabs(coarse - hertz));
}

// Set C of thesis 4.6.2 and beyond: on withdrawal nothing sticks, whatever the stiffness.
TEST(TensionRule, LeavesNoStickingForceOnWithdrawalAtAnyStiffness) {
  for (const double stiffness : {50.0, 1000.0, 1e4, 1e5}) {
    double pull[2] = {0, 0};
    for (const bool rule : {false, true}) {
      SceneDescription d = block_description({5, 5, 5}, 0.02);
      d.material = {2000, 0.45, 1000};
      d.damping = {0, 0.1};
      for (const std::int32_t node : nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; }))
        d.springs.push_back({node, 50, 0.1});
      Tool ball;
      ball.surface = sphere_tool(0.03);
      d.tools.push_back(ball);
      d.detection = ContactDetection::surface_nodes;
      d.contact = {.stiffness_N_m = stiffness, .damping_N_s_m = 0.1, .anisotropy = 0, .tension_rule = rule};
      const Scene scene = build(std::move(d));
      DeviceSample sample;
      sample.position = {0.05, 0.05, 0.135};
      State state = initial_state(scene, std::span(&sample, 1));
      WorkspacePtr workspace = make_workspace(scene, 1);
      StepReport report = make_report(scene);
      for (int n = 1; n <= 90; ++n) {
        sample.position[2] = 0.135 - 0.025 * (std::fmin(n / 40.0, 1) - std::fmax((n - 60) / 15.0, 0));
        step(scene, std::span(&sample, 1), state, report, *workspace);
        pull[rule] = std::fmax(pull[rule], -report.tools[0].contact_force[2]);
      }
    }
    if (stiffness >= 1000) {
      EXPECT_GT(pull[0], 0.05) << stiffness;
    }
    EXPECT_LT(pull[1], 1e-6) << stiffness;
  }
}

}  // namespace
}  // namespace sulcus
