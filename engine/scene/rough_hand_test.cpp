// Hands and tools that do what they should not: the run stays finite, and the report says what was done.
#include <gtest/gtest.h>

#include <cmath>

#include "engine/contact/test_tools.h"
#include "engine/numerics/error.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

SceneDescription ball_over_block(ContactDetection detection,
                                 Precision precision = Precision::single_precision) {
  SceneDescription d = block_description({5, 5, 5}, 0.02);
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  d.solver.precision = precision;
  d.solver.tolerance = 1e-3;
  Tool ball;
  ball.surface = sphere_tool(0.02);
  d.tools.push_back(ball);
  d.detection = detection;
  d.contact.stiffness_N_m = 100;
  return d;
}

// Runs `steps` steps with the hand at where(step); calls look(report) after each.
template <class Where, class Look>
void run(const Scene& scene, int steps, Where&& where, Look&& look) {
  DeviceSample sample = where(0);
  State state = initial_state(scene, std::span(&sample, 1));
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  for (int n = 1; n <= steps; ++n) {
    sample = where(n);
    step(scene, std::span(&sample, 1), state, report, *workspace);
    ASSERT_TRUE(report.finite) << n;
    look(report);
  }
}

DeviceSample at(double x, double y, double z) {
  DeviceSample sample;
  sample.position = {x, y, z};
  sample.linear_velocity_valid = true;
  return sample;
}

TEST(RoughHand, JumpOfAMetreIsSurvivedAndItsForceKeptWithinTheDevice) {
  for (const auto detection : {ContactDetection::embedded_vertices, ContactDetection::surface_nodes}) {
    SceneDescription d = ball_over_block(detection);
    d.tools[0].max_force_N = 3.3;
    d.tools[0].max_torque_N_m = 0.1;
    int limited = 0;
    run(
        build(std::move(d)), 60,
        [](int n) {
          return n == 20 ? at(0.05, 0.05, -0.88) : at(0.05, 0.05, 0.12);
        },  // through all of the block
        [&](const StepReport& report) {
          limited += report.tools[0].force_limited;
          EXPECT_LE(report.tools[0].displayed_force.norm(), 3.3 * (1 + 1e-12));
          EXPECT_LE(report.tools[0].displayed_torque.norm(), 0.1 * (1 + 1e-12));
          if (!report.tools[0].force_limited) {
            EXPECT_LT((report.tools[0].displayed_force - report.tools[0].coupling_force).norm(), 1e-12);
          }
        });
    EXPECT_GT(limited, 0);
  }
}

TEST(RoughHand, WithoutAFinitePoseLetsGoForTheStep) {
  int refused = 0;
  run(
      build(ball_over_block(ContactDetection::embedded_vertices)), 30,
      [](int n) {
        DeviceSample sample = at(0.05, 0.05, 0.118);
        if (n == 10) sample.position[1] = NAN;
        if (n == 12) sample.orientation.x = INFINITY;
        if (n == 14) sample.linear_velocity[0] = NAN;  // the pose is used, the velocity is not
        return sample;
      },
      [&](const StepReport& report) {
        EXPECT_EQ(report.tools[0].sample_refused, report.step == 9 || report.step == 11) << report.step;
        refused += report.tools[0].sample_refused;
      });
  EXPECT_EQ(refused, 2);
}

TEST(RoughHand, StartDeepInsideIsSurvived) {
  for (const auto detection : {ContactDetection::embedded_vertices, ContactDetection::surface_nodes}) {
    for (const bool prescribed : {false, true}) {
      SceneDescription d = ball_over_block(detection);
      d.contact.prescribed = prescribed;
      double deepest = 0;
      run(
          build(std::move(d)), 40, [](int) { return at(0.05, 0.05, 0.075); },
          [&](const StepReport& report) { deepest = std::fmax(deepest, report.tools[0].max_penetration_m); });
      // led nodes report no depth, and no node of the boundary lies so deep
      if (!prescribed && detection == ContactDetection::embedded_vertices) {
        EXPECT_GT(deepest, 0.01);
      }
    }
  }
}

TEST(RoughHand, StiffnessBeyondAllDigitsIsRefusedAndTheStiffestSurvived) {
  for (const double stiffness : {1e12, 1e8, double{INFINITY}, std::nan("")}) {
    SceneDescription stiff = ball_over_block(ContactDetection::surface_nodes);
    stiff.contact.stiffness_N_m = stiffness;
    EXPECT_THROW(build(std::move(stiff)), InputError);
  }
  SceneDescription stiffest = ball_over_block(ContactDetection::surface_nodes);
  stiffest.contact.stiffness_N_m = 1e7;
  run(
      build(std::move(stiffest)), 40, [](int n) { return at(0.05, 0.05, 0.122 - 0.0002 * n); },
      [](const StepReport&) {});
}

TEST(RoughHand, StiffnessOfZeroTouchesAndPushesNothing) {
  for (const auto detection : {ContactDetection::embedded_vertices, ContactDetection::surface_nodes}) {
    SceneDescription d = ball_over_block(detection, Precision::double_precision);
    d.contact.stiffness_N_m = d.contact.damping_N_s_m = 0;
    std::int32_t touches = 0;
    run(
        build(std::move(d)), 40, [](int n) { return at(0.05, 0.05, 0.122 - 0.0005 * n); },
        [&](const StepReport& report) {
          touches += report.tools[0].contacts;
          EXPECT_EQ(report.tools[0].tissue_force, Vec3(0, 0, 0));
          EXPECT_LT(report.tools[0].contact_force.norm(), 1e-12);  // by the tool's momentum
          EXPECT_EQ(report.kinetic_energy_J, 0);                   // the tissue does not notice
        });
    EXPECT_GT(touches, 0);
  }
}

}  // namespace
}  // namespace sulcus
