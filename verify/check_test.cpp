#include "verify/check.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>

#include "engine/numerics/error.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

const double nan_value = std::numeric_limits<double>::quiet_NaN();
const double infinity = std::numeric_limits<double>::infinity();

TEST(Check, MarginIsWhatIsLeftToTheBound) {
  const Check below = check_at_most("a", "statement", 1.5, 2, "mm", 3, "");
  EXPECT_TRUE(below.passed);
  EXPECT_DOUBLE_EQ(below.margin, 0.5);
  const Check above = check_at_least("a", "statement", 1.5, 2, "N", 3, "");
  EXPECT_FALSE(above.passed);
  EXPECT_DOUBLE_EQ(above.margin, -0.5);
  EXPECT_TRUE(check_at_most("a", "statement", 2, 2, "", 1, "").passed);
  EXPECT_TRUE(check_at_least("a", "statement", 2, 2, "", 1, "").passed);
  EXPECT_FALSE(check_at_most("a", "statement", std::nextafter(2.0, 3.0), 2, "", 1, "").passed);
}

TEST(Check, NaNFails) {
  EXPECT_FALSE(check_at_most("a", "statement", nan_value, 2, "", 1, "").passed);
  EXPECT_FALSE(check_at_most("a", "statement", 1, nan_value, "", 1, "").passed);
  EXPECT_FALSE(check_at_least("a", "statement", nan_value, 2, "", 1, "").passed);
  EXPECT_FALSE(check_at_most("a", "statement", infinity, 2, "", 1, "").passed);
}

TEST(Check, NothingComparedFails) {
  const Check check = check_at_most("a", "statement", 0, 2, "", 0, "no contact");
  EXPECT_FALSE(check.passed);
  EXPECT_NE(check.detail.find("nothing was compared: no contact"), std::string::npos);
  EXPECT_FALSE(all_passed({}));
}

TEST(Check, OneFailureFailsAll) {
  std::vector<Check> checks = {check_at_most("a", "statement", 0, 2, "", 1, "")};
  EXPECT_TRUE(all_passed(checks));
  checks.push_back(failed_check("b", "values", "missing"));
  EXPECT_FALSE(all_passed(checks));
  EXPECT_EQ(check_line(checks[1]), "FAIL  b  missing");
  EXPECT_EQ(check_line(checks[0]), "PASS  a  0  (bound 2)");
}

TEST(WriteFile, ReplacesAsAWhole) {
  const auto path = test::scratch_dir() / "file";
  write_file_atomically(path, "first");
  write_file_atomically(path, "second");
  EXPECT_EQ(test::read_text(path), "second");
  EXPECT_FALSE(std::filesystem::exists(path.string() + ".part"));
}

TEST(WriteFile, FullDiskLeavesTheOldFileAndSaysSo) {
  const auto path = test::scratch_dir() / "file";
  test::write_text(path, "old");
  std::filesystem::create_symlink("/dev/full", path.string() + ".part");
  try {
    write_file_atomically(path, std::string(100'000, 'x'));
    FAIL() << "no error";
  } catch (const EnvironmentError& error) {
    EXPECT_NE(std::string(error.what()).find(path.string() + ": cannot be written (No space left on device)"),
              std::string::npos)
        << error.what();
  }
  EXPECT_EQ(test::read_text(path), "old");
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(path.string() + ".part")));
}

TEST(WriteFile, PlaceBelowAFileIsAnEnvironmentError) {
  const auto path = test::scratch_dir() / "file";
  test::write_text(path, "old");
  EXPECT_THROW(write_file_atomically(path / "below", "x"), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
