#include "verify/golden_provenance.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/numerics/error.h"
#include "verify/golden.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

const std::map<std::string, std::string> build = {{"git", "abc"}};

class Provenance : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = test::scratch_dir() / "golden" / "small";
    write_golden(test::small_run(), dir_);
  }
  std::filesystem::path dir_;
};

TEST_F(Provenance, AGoldenWithoutAReasonFails) {
  EXPECT_FALSE(check_provenance(dir_).passed);
  EXPECT_THROW(write_provenance(dir_, " \n", build, {}), InputError);
  write_provenance(dir_, "first", build, {});
  EXPECT_TRUE(check_provenance(dir_).passed) << check_line(check_provenance(dir_));
}

TEST_F(Provenance, AFileThatChangedCameOrWentAfterwardsFails) {
  write_provenance(dir_, "first", build, {});
  const std::string golden = test::read_text(dir_ / "golden.json");
  test::write_text(dir_ / "golden.json", golden + " ");
  EXPECT_NE(check_provenance(dir_).detail.find("golden.json"), std::string::npos);
  test::write_text(dir_ / "golden.json", golden);
  EXPECT_TRUE(check_provenance(dir_).passed);
  test::write_text(dir_ / "00_before.png", "picture");
  EXPECT_NE(check_provenance(dir_).detail.find("00_before.png"), std::string::npos);
  write_provenance(dir_, "with a picture", build, {});
  EXPECT_TRUE(check_provenance(dir_).passed);
  std::filesystem::remove(dir_ / "00_before.png");
  EXPECT_NE(check_provenance(dir_).detail.find("(gone)"), std::string::npos);
  test::write_text(dir_ / "provenance.json", "{");
  EXPECT_FALSE(check_provenance(dir_).passed);
}

TEST_F(Provenance, TheNewestReasonStandsFirstAndTheOldestGo) {
  for (std::size_t n = 0; n < provenance_entries + 2; ++n)
    write_provenance(dir_, "reason " + std::to_string(n), build, {});
  const std::string text = test::read_text(dir_ / "provenance.json");
  EXPECT_LT(text.find("reason 11"), text.find("reason 10"));
  EXPECT_EQ(text.find("reason 1\""), std::string::npos);
}

TEST_F(Provenance, ChangesAreNamedWithOldNewAndRelativeChange) {
  const std::string before = test::read_text(dir_ / "golden.json");
  EXPECT_TRUE(golden_changes(before, before).empty());
  EXPECT_EQ(golden_changes("", before).size(), 1u);
  RunData run = test::small_run();
  run.fingerprints.back() ^= 1;
  for (double& force : run.series.at("tools/0/contact_force_N").values) force *= 1.5;
  write_golden(run, dir_);
  const std::vector<GoldenChange> changes = golden_changes(before, test::read_text(dir_ / "golden.json"));
  ASSERT_GE(changes.size(), 2u);
  EXPECT_EQ(changes[0].quantity, "fingerprint");
  bool found = false;
  for (const GoldenChange& change : changes) {
    if (change.quantity != "series/tools/0/contact_force_N") continue;
    found = true;
    EXPECT_EQ(change.unit, "N");
    EXPECT_NEAR(change.relative, 0.5, 1e-6);
    EXPECT_NE(change.before, change.now);
  }
  EXPECT_TRUE(found);
}

}  // namespace
}  // namespace sulcus
