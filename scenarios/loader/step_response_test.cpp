// Thesis 4.6.1: step response of the rotational coupling (equations.md 5, docs/scenarios.md).
#include <gtest/gtest.h>

#include <cmath>

#include "engine/numerics/quaternion.h"
#include "engine/scene/step.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {
namespace {

struct Response {
  double overshoot_rad = 0;  // past the device, about the axis of the step
  double settled_s = 0;      // after which the misalignment stays below 1 mrad
};

// One tool of the scenario, with another damping.
Response respond(const std::string& name, double damping_N_m_s_rad) {
  Scenario scenario = load_scenario(std::string(SULCUS_SOURCE_DIR) + "/scenarios/" + name + ".json",
                                    {"/label_map/generate/box/voxel_size_mm=10"});  // quick to mesh
  scenario.scene.tools.resize(1);
  scenario.scripts.resize(1);
  scenario.scene.tools[0].coupling.rotational_damping_N_m_s_rad = damping_N_m_s_rad;
  const Scene scene = make_scene(scenario);
  auto devices = make_devices(scenario);
  devices[0]->open();
  devices[0]->calibrate();
  devices[0]->arm();
  std::vector<DeviceSample> samples(1);
  EXPECT_EQ(devices[0]->read(0, samples[0]), DeviceError::none);
  State state = initial_state(scene, samples);
  const WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  const Vec3 axis = Vec3::Ones().normalized();
  Response response;
  for (std::int64_t n = 0; n < scenario.steps(); ++n) {
    const double time_s = static_cast<double>(n + 1) * scenario.scene.step_s;
    EXPECT_EQ(devices[0]->read(time_s, samples[0]), DeviceError::none);
    step(scene, samples, state, report, *workspace);
    const Vec3 left = rotation_vector(samples[0].orientation * conjugate(tool_state(state, 0).orientation));
    response.overshoot_rad = std::max(response.overshoot_rad, -left.dot(axis));
    if (left.norm() >= 1e-3) response.settled_s = time_s + scenario.scene.step_s;
  }
  return response;
}

// Smallest damping whose overshoot is at most `most_rad`, to 2e-5 N m s/rad.
double smallest_damping(const std::string& name, double most_rad) {
  double swings = 0.01, calm = 0.04;
  EXPECT_GT(respond(name, swings).overshoot_rad, most_rad);
  EXPECT_LE(respond(name, calm).overshoot_rad, most_rad);
  while (calm - swings > 2e-5) {
    const double middle = (swings + calm) / 2;
    (respond(name, middle).overshoot_rad <= most_rad ? calm : swings) = middle;
  }
  return calm;
}

struct Row {
  const char* scenario;
  double step_s, table_damping;  // of Table 4.1
  double settled_s, critical_settled_s;
  double damping_1e3, damping_1e6;  // smallest for an overshoot of 1 mrad, and of 1 microrad
};
// The values of equations.md 5, scheme H.
constexpr Row rows[] = {
    {"coupling_step_response", 0.017, 0.03, 0.629, 0.459, 0.0215, 0.0236},
    {"coupling_step_response_33ms", 0.033, 0.04, 0.957, 0.528, 0.0207, 0.0234},
    {"coupling_step_response_100ms", 0.1, 0.11, 2.9, 0.8, 0.0181, 0.0227},
};
const double critical = 2 * std::sqrt(5e-4 * 0.3);  // N m s/rad

TEST(StepResponse, SettlesAsLongAfterTheStepAsTheEquationsSay) {
  for (const Row& row : rows) {
    const Response with_table = respond(row.scenario, row.table_damping);
    EXPECT_NEAR(with_table.settled_s, row.settled_s, 0.5 * row.step_s) << row.scenario;
    EXPECT_LE(with_table.overshoot_rad, 1e-12) << row.scenario;
    const Response with_critical = respond(row.scenario, critical);
    EXPECT_NEAR(with_critical.settled_s, row.critical_settled_s, 0.5 * row.step_s) << row.scenario;
    EXPECT_LE(with_critical.overshoot_rad, 1e-12) << row.scenario;
  }
}

TEST(StepResponse, TheSmallestDampingWithoutOvershootHardlyDependsOnTheTimeStep) {
  for (const Row& row : rows) {
    const double to_1e3 = smallest_damping(row.scenario, 1e-3);
    const double to_1e6 = smallest_damping(row.scenario, 1e-6);
    EXPECT_NEAR(to_1e3, row.damping_1e3, 2e-4) << row.scenario;
    EXPECT_NEAR(to_1e6, row.damping_1e6, 2e-4) << row.scenario;
    EXPECT_LT(to_1e6, critical) << row.scenario;
  }
}

}  // namespace
}  // namespace sulcus
