#include "verify/torn_statements.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "verify/test_run.h"

namespace sulcus {
namespace {

class TornStatements : public ::testing::Test {
 protected:
  void SetUp() override {
    run_ = test::small_run();
    run_.numbers["torn/label_3"] = 0;
  }
  Check check(const std::string& name, const TornBounds& bounds) const {
    const std::vector<Check> checks = check_torn(run_, bounds);
    const auto found =
        std::find_if(checks.begin(), checks.end(), [&](const Check& c) { return c.name == name; });
    return found == checks.end() ? failed_check("absent", "", "") : *found;
  }
  RunData run_;
};

TEST_F(TornStatements, HoldForARunThatTearsNothing) {
  TornBounds bounds;
  bounds.min_elements = 0;
  bounds.max_elements = 0;
  bounds.labels_stay = {3};
  const std::vector<Check> checks = check_torn(run_, bounds);
  EXPECT_EQ(checks.size(), 5U);
  for (const Check& c : checks) {
    EXPECT_TRUE(c.passed) << check_line(c);
    EXPECT_GT(c.comparisons, 0) << check_line(c);
  }
}

TEST_F(TornStatements, AnElementThatComesBackIsFoundInTheSeriesAndInTheFrames) {
  run_.series.at("tissue/alive_tets").values[4] = 1;
  EXPECT_FALSE(check("torn_stays_torn", {}).passed);
  SetUp();
  ASSERT_GT(run_.frames.size(), 1U);
  run_.frames[0].alive[1] = 0;
  EXPECT_FALSE(check("torn_stays_torn", {}).passed);
  EXPECT_NE(check("torn_stays_torn", {}).detail.find("element 1"), std::string::npos);
}

TEST_F(TornStatements, ASingularEdgeIsFoundUnlessTheSceneAllowsIt) {
  // two elements that share nodes 0 and 1 only; the run's own two share a face
  EXPECT_TRUE(check("manifold", {}).passed);
  run_.header.tets = {0, 1, 2, 3, 0, 1, 4, 5};
  run_.header.rest_positions.resize(18, 0.0);
  EXPECT_FALSE(check("manifold", {}).passed);
  EXPECT_NE(check("manifold", {}).detail.find("edge 0-1"), std::string::npos);
  EXPECT_EQ(check("manifold", {false, {}, {}, {}, {}, {}}).name, "absent");
}

TEST_F(TornStatements, TooFewTooManyAndForbiddenTearsAreFound) {
  run_.final_state.alive[0] = 0;
  TornBounds bounds;
  bounds.min_elements = 2;
  bounds.max_elements = 0;
  bounds.labels_stay = {3};
  run_.numbers["torn/label_3"] = 1;
  EXPECT_FALSE(check("torn_elements_at_least", bounds).passed);
  EXPECT_FALSE(check("torn_elements_at_most", bounds).passed);
  EXPECT_FALSE(check("labels_stay", bounds).passed);
  bounds.labels_stay = {4};  // not in the run
  EXPECT_FALSE(check("labels_stay", bounds).passed);
}

}  // namespace
}  // namespace sulcus
