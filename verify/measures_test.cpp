#include "verify/measures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "engine/numerics/quaternion.h"

namespace sulcus {
namespace {

constexpr double h = 0.017;          // s
constexpr std::int64_t count = 480;  // steps

// A run of one tool whose series are given functions of the time.
RunData run_of(const std::function<Vec3(double)>& force, const std::function<double(double)>& turn_rad) {
  RunData run;
  run.header.step_s = h;
  run.header.tool_names = {"ball"};
  run.header.rest_positions = {0, 0, 0, 0.01, 0, 0};
  run.final_state.positions = {0.1, 0, 0, 0.09, 0.5, 0};
  run.steps = count;
  Series forces{"N", 3, {}}, depths{"m", 1, {}}, tool{"", 4, {}}, device{"", 4, {}};
  const Vec3 axis = Vec3::Ones().normalized();
  for (std::int64_t n = 0; n < count; ++n) {
    const double t = static_cast<double>(n + 1) * h;
    const Vec3 f = force(t);
    forces.values.insert(forces.values.end(), f.data(), f.data() + 3);
    depths.values.push_back(1e-3 * t);
    const Quaternion q = quaternion_from_rotation_vector(axis * turn_rad(t));
    tool.values.insert(tool.values.end(), {q.s, q.x, q.y, q.z});
    const Quaternion d = quaternion_from_rotation_vector(axis * 1.0);
    device.values.insert(device.values.end(), {d.s, d.x, d.y, d.z});
  }
  run.series = {{"tools/0/contact_force_N", forces},
                {"tools/0/max_penetration_m", depths},
                {"tools/0/orientation", tool},
                {"device/0/orientation", device}};
  return run;
}

double value_of(const RunData& run, Measure measure) {
  if (measure.what != "least_position_mm" && measure.tool.empty()) measure.tool = "ball";
  measure.at_least = 0;
  const std::vector<Check> checks = check_measures(run, std::span(&measure, 1));
  EXPECT_EQ(checks.size(), 1U);
  return checks.at(0).value;
}

Measure measure_of(const std::string& what) {
  Measure measure;
  measure.what = what;
  return measure;
}

const auto no_turn = [](double) { return 1.0; };

TEST(Measures, RippleIsTheEffectiveValueOfAVibrationAndNotOfASlowMotion) {
  const double amplitude = 0.3, pi = std::numbers::pi;
  Measure ripple = measure_of("force_ripple_N");
  ripple.above_Hz = 6;
  const auto vibrating = [&](double t) { return Vec3(0, 0, amplitude * std::sin(2 * pi * 17.3 * t)); };
  EXPECT_NEAR(value_of(run_of(vibrating, no_turn), ripple), amplitude / std::numbers::sqrt2, 1e-3);
  const auto circling = [&](double t) -> Vec3 {
    return amplitude * Vec3(std::cos(2 * pi * 11 * t), std::sin(2 * pi * 11 * t), 0);
  };
  EXPECT_NEAR(value_of(run_of(circling, no_turn), ripple), amplitude, 1e-3);
  // a press of 8 s, ten times as large, that ends elsewhere than it began
  const auto slow = [&](double t) { return Vec3(0, 3 * t / 8, 3 * std::sin(pi * t / 8)); };
  EXPECT_LT(value_of(run_of(slow, no_turn), ripple), 1e-4);
  const auto both = [&](double t) -> Vec3 { return slow(t) + vibrating(t); };
  EXPECT_NEAR(value_of(run_of(both, no_turn), ripple), amplitude / std::numbers::sqrt2, 1e-3);
  ripple.above_Hz = 20;  // above the vibration
  EXPECT_LT(value_of(run_of(vibrating, no_turn), ripple), 1e-3);
}

TEST(Measures, RippleLooksAtItsWindowAlone) {
  Measure ripple = measure_of("force_ripple_N");
  ripple.above_Hz = 6;
  const auto first_half = [](double t) {
    return Vec3(t < 4 ? std::sin(2 * std::numbers::pi * 20 * t) : 0, 0, 0);
  };
  const RunData run = run_of(first_half, no_turn);
  ripple.to_s = 3.9;
  EXPECT_NEAR(value_of(run, ripple), 1 / std::numbers::sqrt2, 1e-3);
  ripple.from_s = 4.1;
  ripple.to_s = 100;
  EXPECT_LT(value_of(run, ripple), 1e-12);
  ripple.from_s = 8.1;  // too few steps for a spectrum
  EXPECT_TRUE(std::isnan(value_of(run, ripple)));
}

TEST(Measures, PullIsWhatGoesAgainstTheWayOut) {
  const RunData run = run_of([](double t) { return Vec3(0, 5, t < 6 ? 1.0 : -0.25); }, no_turn);
  Measure pull = measure_of("pull_N");
  pull.along = {0, 0, 10};
  EXPECT_DOUBLE_EQ(value_of(run, pull), 0.25);
  pull.to_s = 5.9;
  EXPECT_EQ(value_of(run, pull), 0);
  EXPECT_NEAR(value_of(run, measure_of("contact_force_N")), std::sqrt(26), 1e-12);
  Measure depth = measure_of("penetration_mm");
  depth.to_s = 100 * h;  // its borders belong to the window
  EXPECT_NEAR(value_of(run, depth), 100 * h, 1e-12);
}

TEST(Measures, StepResponseIsSettledAfterTheLastStepThatIsNot) {
  // 1 rad away at first, 0.2 rad past the goal in steps 10 to 19, 5e-4 rad from it later
  const RunData run = run_of([](double) { return Vec3(0, 0, 0); },
                             [](double t) { return t < 10.5 * h   ? 0
                                                   : t < 20.5 * h ? 1.2
                                                                  : 0.9995; });
  EXPECT_NEAR(value_of(run, measure_of("overshoot_rad")), 0.2, 1e-12);
  Measure settling = measure_of("settling_s");
  settling.within_rad = 1e-3;
  EXPECT_NEAR(value_of(run, settling), 21 * h, 1e-12);
  settling.within_rad = 1e-4;  // never
  EXPECT_TRUE(std::isnan(value_of(run, settling)));
}

TEST(Measures, PositionIsThatOfTheNodeThatIsFarthestBehind) {
  const RunData run = run_of([](double) { return Vec3(0, 0, 0); }, no_turn);
  Measure position = measure_of("least_position_mm");
  position.along = {2, 0, 0};
  EXPECT_NEAR(value_of(run, position), 90, 1e-9);
}

TEST(Measures, OpeningIsBetweenNodesThatShareAPlaceAtRest) {
  RunData run = run_of([](double) { return Vec3(0, 0, 0); }, no_turn);
  run.header.rest_positions = {0, 0, 0, 0.01, 0, 0, 0.01, 0, 0};
  Frame closed{0, 0, run.header.rest_positions, {}, {}, {}}, open = closed;
  open.step = 100;
  open.time_s = 100 * h;
  open.positions = {0.5, 0, 0, 0.01, 0.003, 0, 0.01, -0.001, 0};
  run.frames = {closed, open, closed};
  Measure opening = measure_of("opening_mm");
  opening.at_least = 0;
  EXPECT_NEAR(check_measures(run, std::span(&opening, 1))[0].value, 4, 1e-12);
  opening.to_s = 1;
  EXPECT_EQ(check_measures(run, std::span(&opening, 1))[0].value, 0);
  run.header.rest_positions[3] = 0.02;  // nothing shares a place
  EXPECT_FALSE(check_measures(run, std::span(&opening, 1))[0].passed);
}

TEST(Measures, HaveACheckForEachBoundAndFailWithoutData) {
  RunData run = run_of([](double) { return Vec3(0, 0, 1); }, no_turn);
  Measure force = measure_of("contact_force_N");
  force.tool = "ball";
  force.at_least = 0.5;
  force.at_most = 0.9;
  std::vector<Check> checks = check_measures(run, std::span(&force, 1));
  ASSERT_EQ(checks.size(), 2U);
  EXPECT_TRUE(checks[0].passed);
  EXPECT_FALSE(checks[1].passed);
  EXPECT_EQ(checks[1].name, "contact_force_N/ball");
  EXPECT_EQ(checks[1].unit, "N");
  EXPECT_EQ(checks[1].kind, "statement");

  force.at_most.reset();
  force.from_s = 1000;  // no step
  EXPECT_FALSE(check_measures(run, std::span(&force, 1))[0].passed);
  force.from_s = 0;
  force.tool = "knife";
  EXPECT_FALSE(check_measures(run, std::span(&force, 1))[0].passed);
  force.tool = "ball";
  run.series.at("tools/0/contact_force_N").values.pop_back();
  EXPECT_FALSE(check_measures(run, std::span(&force, 1))[0].passed);
  run = run_of([](double) { return Vec3(0, 0, NAN); }, no_turn);
  EXPECT_FALSE(check_measures(run, std::span(&force, 1))[0].passed);
  force.what = "force_ripple_N";
  EXPECT_FALSE(check_measures(run, std::span(&force, 1))[0].passed);
}

TEST(Measures, OfTissueAndPathsAreThoseOfTheirWindow) {
  RunData run;
  run.header.step_s = 0.1;
  run.header.tool_names = {"ball"};
  run.header.motion_names = {"one", "two"};
  run.steps = 4;
  run.series = {{"tissue/max_displacement_m", {"m", 1, {0.009, 0.002, 0.005, 0.004}}},
                {"motions/0/force_N", {"N", 3, std::vector<double>(12, 0.0)}},
                {"motions/1/force_N", {"N", 3, {0, 0, 9, 3, 0, 0, 0, 4, 3, 0, 0, 1}}}};
  const auto value = [&](const std::string& what, const std::string& path) {
    Measure measure = measure_of(what);
    measure.path = path;
    measure.from_s = 0.2;
    measure.at_most = 1;
    return check_measures(run, std::span(&measure, 1)).at(0).value;
  };
  EXPECT_NEAR(value("displacement_mm", ""), 5, 1e-12);
  EXPECT_NEAR(value("drift_mm", ""), 3, 1e-12);
  EXPECT_NEAR(value("path_force_N", "two"), 5, 1e-12);
  EXPECT_EQ(value("path_force_N", "one"), 0);
  EXPECT_TRUE(std::isnan(value("path_force_N", "three")));
  Measure contacts = measure_of("contacts");
  contacts.tool = "ball";
  contacts.at_least = 0;
  EXPECT_FALSE(check_measures(run, std::span(&contacts, 1)).at(0).passed);  // not recorded
}

}  // namespace
}  // namespace sulcus
