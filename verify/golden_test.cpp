#include "verify/golden.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

class Golden : public ::testing::Test {
 protected:
  void SetUp() override {
    run_ = test::small_run();
    dir_ = test::scratch_dir() / "golden" / "small";
    write_golden(run_, dir_);
  }
  std::vector<Check> failures() const {
    std::vector<Check> failed;
    for (const Check& check : compare_golden(run_, dir_))
      if (!check.passed) failed.push_back(check);
    return failed;
  }
  std::string only_failure() const {
    const std::vector<Check> failed = failures();
    EXPECT_EQ(failed.size(), 1u);
    return failed.size() == 1 ? failed[0].name + ": " + failed[0].detail : "";
  }
  nlohmann::ordered_json json() const {
    return nlohmann::ordered_json::parse(test::read_text(dir_ / "golden.json"));
  }
  void rewrite(const nlohmann::ordered_json& json) { test::write_text(dir_ / "golden.json", json.dump()); }
  double& number(const std::string& series, std::size_t index) {
    return run_.series.at(series).values.at(index);
  }

  RunData run_;
  std::filesystem::path dir_;
};

#define EXPECT_SAYS(message, part) \
  EXPECT_NE((message).find(part), std::string::npos) << "message: " << (message)

TEST_F(Golden, RunThatWroteItAgreesInEveryPoint) {
  const std::vector<Check> checks = compare_golden(run_, dir_);
  EXPECT_EQ(checks.size(), 1u + 1 + 1 + 11 + 4);  // fingerprint, steps, counts, series, work
  for (const Check& check : checks) {
    EXPECT_TRUE(check.passed) << check_line(check);
    EXPECT_GT(check.comparisons, 0) << check_line(check);
  }
  EXPECT_EQ(checks[0].kind, "bits");
  EXPECT_LT(std::filesystem::file_size(dir_ / "golden.json"), 50'000u);
  EXPECT_EQ(json()["series"]["tools/0/contacts"]["values"].size(), 40u);
  EXPECT_EQ(json()["steps_kept"].front(), 0);
  EXPECT_EQ(json()["steps_kept"].back(), test::run_steps - 1);
}

TEST_F(Golden, BitsWithoutValuesIsArithmeticOnly) {
  run_.fingerprints.back() ^= 1;
  EXPECT_SAYS(only_failure(), "golden/fingerprint");
  EXPECT_SAYS(only_failure(), "arithmetic changed, physics did not");
}

TEST_F(Golden, BitsAndValuesIsMore) {
  run_.fingerprints.back() ^= 1;
  number("tools/0/contact_force_N", 3 * 299 + 2) += 1;
  const std::vector<Check> failed = failures();
  ASSERT_EQ(failed.size(), 2u);
  EXPECT_SAYS(failed[0].detail, "bits and values changed");
  EXPECT_SAYS(failed[1].name, "golden/tools/0/contact_force_N");
  EXPECT_SAYS(failed[1].detail, "at step 299");
}

TEST_F(Golden, ChangeOfAnySingleSeriesIsFound) {
  const auto series = json()["series"];
  for (const auto& [name, entry] : series.items()) {
    const double tolerance = entry["tolerance"].get<double>();
    const std::size_t last = run_.series.at(name).values.size() - 1;
    const double before = number(name, last);
    number(name, last) += 1.01 * tolerance + 1e-300;
    bool found = false;
    for (const Check& check : failures()) found = found || check.name == "golden/" + name;
    EXPECT_TRUE(found) << name;
    number(name, last) = before + 0.99 * tolerance;
    for (const Check& check : failures()) EXPECT_NE(check.name, "golden/" + name);
    number(name, last) = before;
  }
}

TEST_F(Golden, PeakBetweenTheKeptStepsIsFound) {
  const auto kept = json()["steps_kept"].get<std::vector<int>>();
  std::size_t between = 150;
  while (std::count(kept.begin(), kept.end(), static_cast<int>(between)) > 0) ++between;
  number("tools/0/max_penetration_m", between) = 1;
  EXPECT_SAYS(only_failure(), "golden/tools/0/max_penetration_m: largest difference of the highest value");
}

TEST_F(Golden, NaNInTheRunFails) {
  for (const std::size_t step : {0u, 151u, 299u}) {
    const double before = number("tissue/elastic_energy_J", step);
    number("tissue/elastic_energy_J", step) = std::numeric_limits<double>::quiet_NaN();
    EXPECT_SAYS(only_failure(), "golden/tissue/elastic_energy_J");
    number("tissue/elastic_energy_J", step) = before;
  }
}

TEST_F(Golden, MissingSeriesFailsOnEitherSide) {
  Series series = run_.series.extract("tissue/alive_tets").mapped();
  EXPECT_SAYS(only_failure(), "golden/tissue/alive_tets: the run has no such series");
  run_.series["tissue/alive_tets"] = series;
  auto golden = json();
  golden["series"].erase("tissue/alive_tets");
  rewrite(golden);
  EXPECT_SAYS(only_failure(), "golden/tissue/alive_tets: the golden has no such series");
}

TEST_F(Golden, OtherLengthFails) {
  run_ = test::small_run(299);
  const std::vector<Check> failed = failures();
  ASSERT_EQ(failed.size(), 2u);
  EXPECT_SAYS(failed[1].detail, "the run has 299 steps, the golden 300");
  run_ = test::small_run();
  auto golden = json();
  golden["series"]["tools/0/contacts"]["values"].erase(0);
  rewrite(golden);
  EXPECT_SAYS(only_failure(), "golden/tools/0/contacts: the lengths differ");
}

TEST_F(Golden, OtherTornElementsSayHowNearToItsThresholdOneStood) {
  Series margins{"", 1, std::vector<double>(static_cast<std::size_t>(run_.steps), 0.1)};
  margins.values[70] = 2e-6;
  run_.series["fracture/margin"] = margins;
  EXPECT_TRUE(failures().empty());
  for (double& alive : run_.series.at("tissue/alive_tets").values) alive -= 10;
  EXPECT_SAYS(only_failure(), "2e-06 of it away, at step 70: a rounding may have decided");
  run_.series["fracture/margin"].values[70] = 0.05;
  EXPECT_SAYS(only_failure(), "0.05 of it away, at step 70: no rounding decides that");
  run_.series.erase("fracture/margin");  // a run whose tissue cannot tear
  EXPECT_EQ(only_failure().find("threshold"), std::string::npos);
}

TEST_F(Golden, TopologyHasToAgreeExactly) {
  run_.numbers["mesh_pieces"] = 2;
  run_.numbers["cut_faces"] = 3;
  run_.numbers.erase("cells");
  const std::string message = only_failure();
  EXPECT_SAYS(message, "mesh_pieces is 2, golden 1");
  EXPECT_SAYS(message, "cut_faces = 3 is not in the golden");
  EXPECT_SAYS(message, "cells is not in the run");
}

TEST_F(Golden, WorkHasToAgreeWithinItsTolerance) {
  for (double& iterations : run_.series.at("solver/iterations").values)
    iterations += 1;  // 9 % more, below 2 a step
  EXPECT_SAYS(only_failure(), "golden/work/iterations");
}

TEST_F(Golden, MissingEmptyDamagedAndForeignGoldensFailClearly) {
  const std::string good = test::read_text(dir_ / "golden.json");
  const auto message_with = [&](const std::string& text) {
    test::write_text(dir_ / "golden.json", text);
    const std::vector<Check> checks = compare_golden(run_, dir_);
    EXPECT_FALSE(all_passed(checks));
    EXPECT_FALSE(checks.empty());
    std::string said;
    for (const Check& check : checks)
      if (!check.passed) said += check.detail + "\n";
    return said;
  };
  EXPECT_SAYS(message_with(""), "cannot be read");
  EXPECT_SAYS(message_with("{}"), "cannot be read");
  EXPECT_SAYS(message_with("[]"), "cannot be read");
  EXPECT_SAYS(message_with(good.substr(0, good.size() / 2)), "cannot be read");
  auto golden = nlohmann::ordered_json::parse(good);
  golden["series"] = nlohmann::ordered_json::object();
  EXPECT_SAYS(message_with(golden.dump()), "nothing was compared: the golden has no series");
  golden = nlohmann::ordered_json::parse(good);
  golden["counts"] = nlohmann::ordered_json::object();
  EXPECT_SAYS(message_with(golden.dump()), "nothing was compared");
  golden = nlohmann::ordered_json::parse(good);
  golden["series"]["tools/0/contacts"]["values"][3] = nullptr;
  EXPECT_SAYS(message_with(golden.dump()), "cannot be read");
  golden = nlohmann::ordered_json::parse(good);
  golden["series"]["tools/0/contacts"]["tolerance"] = -1;
  EXPECT_SAYS(message_with(golden.dump()), "tolerance");
  golden = nlohmann::ordered_json::parse(good);
  golden["scenario"] = "other";
  EXPECT_SAYS(message_with(golden.dump()), "belongs to scenario");
  golden = nlohmann::ordered_json::parse(good);
  golden["fingerprint"] = "zz";
  EXPECT_SAYS(message_with(golden.dump()), "not 16 hexadecimal digits");
  golden = nlohmann::ordered_json::parse(good);
  golden["format_version"] = 2;
  EXPECT_SAYS(message_with(golden.dump()), "format version");
  std::filesystem::remove(dir_ / "golden.json");
  const std::vector<Check> checks = compare_golden(run_, dir_);
  ASSERT_EQ(checks.size(), 1u);
  EXPECT_SAYS(checks[0].detail, "is missing");
}

TEST_F(Golden, TolerancesComeFromMeasuredSpreadAndAreKept) {
  RunData variant = run_;
  variant.series["tissue/elastic_energy_J"].values[123] += 1e-9;
  const GoldenVariant variants[] = {{"gcc -mfma", &variant}};
  write_golden(run_, dir_, variants);
  const auto entry = json()["series"]["tissue/elastic_energy_J"];
  EXPECT_NEAR(entry["tolerance"].get<double>(), spread_factor * 1e-9, 1e-14);
  EXPECT_SAYS(entry["basis"].get<std::string>(), "gcc -mfma");
  const double untouched = json()["series"]["tools/0/max_penetration_m"]["tolerance"].get<double>();
  EXPECT_NEAR(untouched, 1e-9 * 4e-4, 1e-18);

  write_golden(run_, dir_);  // without variants: what was measured stays
  EXPECT_EQ(json()["series"]["tissue/elastic_energy_J"], entry);
  EXPECT_TRUE(failures().empty());
}

TEST_F(Golden, WorkIsMeasuredByVariantsOfTheSameWorkOnly) {
  RunData tighter = run_, shifted = run_;
  for (double& iterations : tighter.series.at("solver/iterations").values) iterations *= 2;
  shifted.series.at("solver/iterations").values[10] += 1;
  const GoldenVariant variants[] = {{"tolerance / 10", &tighter, false}, {"one ulp", &shifted}};
  write_golden(run_, dir_, variants);
  EXPECT_EQ(json()["work"]["iterations"]["tolerance"].get<double>(), spread_factor);
  EXPECT_EQ(json()["series"]["solver/iterations"]["tolerance"].get<double>(), spread_factor);
}

TEST_F(Golden, CountsThatVaryHaveATolerance) {
  run_.numbers["torn_voxels"] = 100;
  RunData variant = run_;
  variant.numbers["torn_voxels"] = 104;
  const GoldenVariant variants[] = {{"one ulp", &variant}};
  write_golden(run_, dir_, variants);
  EXPECT_FALSE(json()["counts"].contains("torn_voxels"));
  EXPECT_TRUE(failures().empty());
  run_.numbers["torn_voxels"] = 112;
  EXPECT_TRUE(failures().empty());
  run_.numbers["torn_voxels"] = 113;
  EXPECT_SAYS(only_failure(), "golden/counts/torn_voxels: 113, golden 100");
}

TEST_F(Golden, MoreWorkForTheSamePhysicsIsArithmetic) {
  run_.fingerprints.back() ^= 1;
  for (double& iterations : run_.series.at("solver/iterations").values) iterations *= 2;
  EXPECT_SAYS(failures()[0].detail, "arithmetic changed, physics did not");
}

TEST_F(Golden, VariantOfAnotherLengthIsRefused) {
  const RunData variant = test::small_run(10);
  const GoldenVariant variants[] = {{"short", &variant}};
  EXPECT_THROW(write_golden(run_, dir_, variants), InputError);
}

TEST_F(Golden, BadRunsDoNotBecomeGolden) {
  const std::string before = test::read_text(dir_ / "golden.json");
  number("tools/0/contact_force_N", 100) = std::numeric_limits<double>::infinity();
  EXPECT_THROW(write_golden(run_, dir_), InputError);
  run_ = test::small_run(0);
  EXPECT_THROW(write_golden(run_, dir_), InputError);
  EXPECT_EQ(test::read_text(dir_ / "golden.json"), before);
}

TEST_F(Golden, RunsOfFewStepsKeepThemAll) {
  for (const std::int64_t steps : {1, 2, 39, 40, 41}) {
    run_ = test::small_run(steps);
    write_golden(run_, dir_);
    const auto kept = json()["steps_kept"].get<std::vector<std::int64_t>>();
    EXPECT_EQ(kept.size(), static_cast<std::size_t>(std::min<std::int64_t>(steps, 40)));
    EXPECT_TRUE(std::is_sorted(kept.begin(), kept.end()));
    EXPECT_EQ(std::adjacent_find(kept.begin(), kept.end()), kept.end());
    EXPECT_EQ(kept.back(), steps - 1);
    EXPECT_TRUE(failures().empty());
  }
}

TEST_F(Golden, PlaceThatCannotBeWrittenToIsAnEnvironmentError) {
  EXPECT_THROW(write_golden(run_, "/proc/golden"), EnvironmentError);
  test::write_text(dir_ / "file", "x");
  EXPECT_THROW(write_golden(run_, dir_ / "file" / "below"), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
