#include "verify/statements.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "verify/test_run.h"

namespace sulcus {
namespace {

StatementBounds all_bounds() {
  StatementBounds bounds;
  bounds.max_penetration_m = 0.5e-3;
  bounds.max_displayed_force_N = 3.3;
  bounds.max_solver_error = 0.05;
  bounds.max_final_displacement_m = 1e-6;
  return bounds;
}

Check find(const std::vector<Check>& checks, const std::string& name) {
  const auto found =
      std::find_if(checks.begin(), checks.end(), [&](const Check& c) { return c.name == name; });
  return found == checks.end() ? failed_check("absent", "", "") : *found;
}

class Statements : public ::testing::Test {
 protected:
  void SetUp() override { run_ = test::small_run(); }
  Check check(const std::string& name, const StatementBounds& bounds = all_bounds()) const {
    return find(check_statements(run_, bounds), name);
  }
  double& number(const std::string& series, std::size_t index) {
    return run_.series.at(series).values.at(index);
  }
  // Fails for the stated reason, and nothing else fails.
  void expect_only_failure(const std::string& name, const std::string& detail) {
    for (const Check& c : check_statements(run_, all_bounds())) {
      EXPECT_EQ(c.passed, c.name != name) << check_line(c);
      EXPECT_TRUE(c.name != name || c.detail.find(detail) != std::string::npos) << check_line(c);
    }
  }
  RunData run_;
};

TEST_F(Statements, HoldForAGoodRunAndAllAreMade) {
  const std::vector<Check> checks = check_statements(run_, all_bounds());
  std::vector<std::string> names;
  for (const Check& check : checks) {
    EXPECT_TRUE(check.passed) << check_line(check);
    EXPECT_GT(check.comparisons, 0) << check_line(check);
    EXPECT_EQ(check.kind, "statement");
    names.push_back(check.name);
  }
  EXPECT_EQ(names, (std::vector<std::string>{"finite", "force_balance", "penetration", "pushing",
                                             "displayed_force", "pieces", "inverted_elements", "converged",
                                             "solver_error", "energy_at_rest", "final_displacement"}));
  EXPECT_NEAR(check("penetration").margin, 0.1, 1e-12);  // mm
  EXPECT_NEAR(check("displayed_force").value, 0.36, 1e-9);
}

TEST_F(Statements, OneNaNAnywhereIsFound) {
  number("tools/0/coupling_torque_N_m", 3 * 17 + 1) = std::numeric_limits<double>::quiet_NaN();
  expect_only_failure("finite", "tools/0/coupling_torque_N_m at step 17");
  run_ = test::small_run();
  run_.final_state.rotations[3] = std::numeric_limits<double>::infinity();
  expect_only_failure("finite", "final_state/rotations");
  run_ = test::small_run();
  number("finite", 40) = 0;
  expect_only_failure("finite", "the state at step 40");
  run_ = test::small_run();
  run_.frames[1].positions[2] = std::numeric_limits<double>::quiet_NaN();
  expect_only_failure("finite", "frame at step 51");
}

TEST_F(Statements, ForceThatDoesNotBalanceIsFound) {
  number("tools/0/tissue_force_N", 3 * 100 + 2) *= 1 + 8e-6;
  expect_only_failure("force_balance", "at step 100, tool spatula");
  number("tools/0/tissue_force_N", 3 * 100 + 2) /= 1 + 8e-6;
  EXPECT_TRUE(check("force_balance").passed);
}

TEST_F(Statements, NaNIsWorseThanAnyNumberInEveryStatement) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  number("tools/0/contact_force_N", 3) = nan;
  number("tools/0/max_penetration_m", 3) = nan;
  number("tools/0/displayed_force_N", 3) = nan;
  number("tools/0/min_push_N", 100) = nan;
  number("tissue/kinetic_energy_J", 100) = nan;
  number("solver/converged", 100) = nan;
  number("tissue/max_displacement_m", 299) = nan;
  run_.solver_errors[0].error = nan;
  run_.numbers["mesh_pieces"] = nan;
  run_.numbers["inverted_elements_at_end"] = nan;
  for (const Check& check : check_statements(run_, all_bounds()))
    EXPECT_FALSE(check.passed) << check_line(check);
}

TEST_F(Statements, PiecesOfTheMeshAreThoseDeclared) {
  StatementBounds bounds = all_bounds();
  bounds.pieces_at_start = 1;
  bounds.pieces_at_end = 1;
  const auto broken = [&] {
    std::vector<std::string> names;
    for (const Check& check : check_statements(run_, bounds)) {
      if (!check.passed) names.push_back(check.name);
    }
    return names;
  };
  using Names = std::vector<std::string>;
  EXPECT_EQ(broken(), Names{});
  bounds.pieces_at_start = 2;
  EXPECT_EQ(broken(), Names{"pieces_at_start"});
  bounds.pieces_at_start = 1;
  run_.final_state.alive.assign(run_.final_state.alive.size(), 0);  // all torn away
  EXPECT_EQ(broken(), Names{"pieces_at_end"});
  bounds.pieces_at_end = 0;
  EXPECT_EQ(broken(), Names{});
  run_.frames.clear();
  EXPECT_EQ(broken(), Names{"pieces_at_start"});
}

TEST_F(Statements, EachBoundIsHeld) {
  number("tools/0/max_penetration_m", 33) = 0.6e-3;
  expect_only_failure("penetration", "at step 33");
  run_ = test::small_run();
  number("tools/0/displayed_force_N", 3 * 44) = 4;
  expect_only_failure("displayed_force", "at step 44");
  run_ = test::small_run();
  number("tools/0/min_push_N", 77) = -1e-12;
  expect_only_failure("pushing", "at step 77");
  run_ = test::small_run();
  run_.numbers["mesh_pieces"] = 2;
  expect_only_failure("pieces", "pieces");
  run_ = test::small_run();
  run_.numbers["inverted_elements_at_end"] = 1;
  expect_only_failure("inverted_elements", "at the end");
  run_ = test::small_run();
  number("solver/converged", 9) = 0;
  expect_only_failure("converged", "at step 9");
  run_ = test::small_run();
  run_.solver_errors[1].error = 0.06;
  expect_only_failure("solver_error", "at step 150");
  run_ = test::small_run();
  number("tissue/max_displacement_m", 299) = 2e-6;
  expect_only_failure("final_displacement", "at the end");
  run_ = test::small_run();
  number("tools/0/contacts", 299) = 1;
  expect_only_failure("final_displacement", "still touches");
}

TEST_F(Statements, PushOfStepsWithoutContactDoesNotCount) {
  number("tools/0/min_push_N", 5) = -1;
  EXPECT_TRUE(check("pushing").passed);
}

// The window is steps 61-200: the tool stands still, the energy is 50 J/m^2 * (4 mm)^2.
TEST_F(Statements, EnergyThatGrowsAtRestIsFound) {
  const double peak = 50 * 4e-3 * 4e-3 + 1e-3 * 0.01 * 0.01;  // with the speed of step 60, 10 mm/s
  EXPECT_NEAR(check("energy_at_rest").bound, 0.01 * peak, 1e-15);
  number("tissue/elastic_energy_J", 151) += 0.011 * peak;  // end of step 150
  expect_only_failure("energy_at_rest", "at step 150, resting since step 61");
  number("tissue/elastic_energy_J", 151) -= 0.002 * peak;
  EXPECT_TRUE(check("energy_at_rest").passed);
}

TEST_F(Statements, EnergyThatCreepsUpAtRestIsFound) {
  const double peak = 50 * 4e-3 * 4e-3;
  for (std::size_t n = 61; n < 200; ++n)
    number("tissue/elastic_energy_J", n) += 2e-4 * peak * static_cast<double>(n - 60);
  EXPECT_FALSE(check("energy_at_rest").passed);
}

TEST_F(Statements, EnergyThatNobodyAccountsForIsFound) {
  for (const char* term : {"put_in_J", "kinetic_J", "elastic_J", "residual_J"}) {
    Series& series = run_.series[std::string("energy/") + term];
    series.components = 1;
    series.values.assign(300, 0.0);
  }
  number("energy/put_in_J", 299) = 2;
  number("energy/residual_J", 120) = -1.9e-3;
  EXPECT_TRUE(check("energy_ledger").passed);
  number("energy/residual_J", 120) = -2.1e-3;
  expect_only_failure("energy_ledger", "at step 120");
}

// A contact that was found and dropped again leaves what the solver leaves: no share of that means anything.
TEST_F(Statements, EnergyOfUntouchedTissueMayBeASolversRest) {
  for (std::size_t n = 0; n < 300; ++n) {
    number("tissue/kinetic_energy_J", n) = 0;
    number("tissue/elastic_energy_J", n) = 1e-18 * static_cast<double>(n);
  }
  EXPECT_TRUE(check("energy_at_rest").passed);
  for (std::size_t n = 0; n < 300; ++n) number("tissue/elastic_energy_J", n) *= 1e5;
  EXPECT_FALSE(check("energy_at_rest").passed);
}

TEST_F(Statements, EnergyMayGrowWhileTheToolMoves) {
  number("tissue/elastic_energy_J", 40) *= 2;
  EXPECT_TRUE(check("energy_at_rest").passed);
}

TEST_F(Statements, DriftOfToolOrDeviceAboveTheBoundIsNotRest) {
  StatementBounds bounds = all_bounds();
  const std::int64_t before = check("energy_at_rest").comparisons;
  for (const std::string name : {"tools/0/position_m", "device/0/position_m"}) {
    run_ = test::small_run();
    number(name, 3 * 100) += 1.01e-6;  // over rest_speed * h = 1e-6 m: two steps move, 99->100 and 100->101
    EXPECT_EQ(check("energy_at_rest", bounds).comparisons, before - 3) << name;
    number(name, 3 * 100) -= 0.02e-6;
    EXPECT_EQ(check("energy_at_rest", bounds).comparisons, before) << name;
  }
  run_ = test::small_run();
  number("device/0/orientation", 4 * 100) += 1e-4;
  EXPECT_EQ(check("energy_at_rest", bounds).comparisons, before - 3);
  run_ = test::small_run();
  for (std::size_t c = 0; c < 4; ++c) number("device/0/orientation", 4 * 100 + c) *= -1;  // the same rotation
  EXPECT_EQ(check("energy_at_rest", bounds).comparisons, before);
}

TEST_F(Statements, NothingToCompareFails) {
  run_.solver_errors.clear();
  for (double& x : run_.series.at("tools/0/contacts").values) x = 0;
  for (std::size_t n = 0; n < 300; ++n) number("device/0/position_m", 3 * n) = 1e-3 * static_cast<double>(n);
  for (const char* name : {"solver_error", "pushing", "energy_at_rest"}) {
    EXPECT_FALSE(check(name).passed) << name;
    EXPECT_NE(check(name).detail.find("nothing was compared"), std::string::npos) << check(name).detail;
  }
  StatementBounds bounds = all_bounds();
  bounds.contact_expected = false;
  EXPECT_TRUE(check("pushing", bounds).passed);
}

TEST_F(Statements, MissingNumbersAndSeriesFail) {
  run_.numbers.clear();
  run_.series.clear();
  for (const Check& c : check_statements(run_, all_bounds()))
    EXPECT_EQ(c.passed, c.name == "solver_error") << check_line(c);
  for (const Check& c : check_statements(RunData(), all_bounds())) EXPECT_FALSE(c.passed) << check_line(c);
}

TEST_F(Statements, ShortSeriesFail) {
  for (const char* name : {"tools/0/max_penetration_m", "tissue/elastic_energy_J", "solver/converged"})
    run_.series.at(name).values.pop_back();
  for (const char* name : {"penetration", "energy_at_rest", "converged"})
    EXPECT_FALSE(check(name).passed) << name;
}

TEST_F(Statements, WithoutToolsOnlyThoseOfTheTissueAreMade) {
  run_.header.tool_names.clear();
  run_.samples.clear();
  for (const char* name : {"force_balance", "penetration", "pushing", "displayed_force"})
    EXPECT_EQ(check(name).name, "absent") << name;
  EXPECT_TRUE(check("finite").passed);
  EXPECT_EQ(check("energy_at_rest").comparisons, test::run_steps - 2);
}

}  // namespace
}  // namespace sulcus
