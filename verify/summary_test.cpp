#include "verify/summary.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

TEST(Summary, HoldsTheNumbersOfTheRun) {
  const RunData run = test::small_run();
  const std::vector<Check> checks = {check_at_most("penetration", "statement", 1, 2, "mm", 1, "")};
  const auto json = nlohmann::json::parse(summary_json(run, checks));
  EXPECT_EQ(json["name"], "small");
  EXPECT_EQ(json["fingerprint"], hex16(run.fingerprint()));
  EXPECT_EQ(json["steps"], test::run_steps);
  EXPECT_EQ(json["mesh"]["nodes"], 5);
  EXPECT_EQ(json["mesh"]["tets"], 2);
  EXPECT_EQ(json["mesh"]["cells"], 1);
  EXPECT_DOUBLE_EQ(json["time_per_step"]["median_ms"], 7);
  EXPECT_DOUBLE_EQ(json["time_per_step"]["stages"]["solve"]["p95_ms"], 3);
  EXPECT_EQ(json["solver"]["iterations_median"], 11);
  EXPECT_EQ(json["solver"]["iterations_max"], 13);
  EXPECT_EQ(json["solver"]["converged_share"], 1);
  EXPECT_EQ(json["solver"]["errors_measured"], 3);
  EXPECT_DOUBLE_EQ(json["solver"]["error_max"], 0.025);
  EXPECT_DOUBLE_EQ(json["solver"]["error_median"], 0.015);
  ASSERT_EQ(json["tools"].size(), 1u);
  EXPECT_EQ(json["tools"][0]["name"], "spatula");
  EXPECT_NEAR(json["tools"][0]["max_force_N"], 0.4, 1e-9);
  EXPECT_NEAR(json["tools"][0]["max_penetration_mm"], 0.4, 1e-12);
  EXPECT_EQ(json["tools"][0]["max_contacts"], 12);
  EXPECT_EQ(json["verdicts"]["passed"], true);
  EXPECT_EQ(json["verdicts"]["checks"][0]["name"], "penetration");
  EXPECT_EQ(json["warnings"][0], "label 7 is absent");
}

TEST(Summary, OfAnEmptyRunHasNullsNotNumbers) {
  RunData run;
  run.header.scenario_name = "bad \xff name";
  run.header.tool_names = {"t"};
  const auto json = nlohmann::json::parse(summary_json(run, {}));
  EXPECT_TRUE(json["time_per_step"]["median_ms"].is_null());
  EXPECT_TRUE(json["solver"]["error_max"].is_null());
  EXPECT_TRUE(json["tools"][0]["max_force_N"].is_null());
  EXPECT_EQ(json["verdicts"]["passed"], false);
}

TEST(Summary, QuantileIsTheNearestRank) {
  EXPECT_EQ(quantile({5, 1, 3, 2, 4}, 0.5), 3);
  EXPECT_EQ(quantile({1, 2, 3, 4}, 0.5), 2);
  EXPECT_EQ(quantile({1, 2, 3, 4}, 0.0), 1);
  EXPECT_EQ(quantile({1, 2, 3, 4}, 1.0), 4);
  std::vector<double> hundred;
  for (int i = 1; i <= 100; ++i) hundred.push_back(i);
  EXPECT_EQ(quantile(hundred, 0.95), 95);
  EXPECT_TRUE(std::isnan(quantile({}, 0.5)));
  EXPECT_TRUE(std::isnan(quantile({1, std::nan(""), 3}, 0.5)));
}

TEST(Summary, PlaceThatCannotBeWrittenToIsAnEnvironmentError) {
  EXPECT_THROW(write_summary("/proc/nowhere/summary.json", RunData(), {}), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
