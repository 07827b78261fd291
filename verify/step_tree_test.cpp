#include "verify/step_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "verify/fingerprint.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

LeafArray doubles(const std::vector<double>& values) {
  LeafArray array;
  array.type = "f64";
  array.bytes.resize(8 * values.size());
  std::memcpy(array.bytes.data(), values.data(), array.bytes.size());
  return array;
}

TEST(StepTree, EveryArrayOfTheStateIsALeaf) {
  std::size_t found = 0;
  for (const std::string& field : state_field_names()) {
    for (const std::string& leaf : tree_leaf_names()) found += leaf.ends_with("/" + field);
  }
  EXPECT_EQ(found, state_field_names().size());
  EXPECT_EQ(tree_leaf_names().size(), state_field_names().size() + stage_leaf_names().size());
}

TEST(StepTree, LeavesStandInTheOrderOfTheStages) {
  const std::vector<std::string> order = {"sample", "contacts", "assembly", "solve", "coupling", "fracture"};
  std::size_t stage = 0;
  for (const std::string& leaf : tree_leaf_names()) {
    while (stage < order.size() && !leaf.starts_with(order[stage] + "/")) ++stage;
    ASSERT_LT(stage, order.size()) << leaf;
  }
}

TEST(StepTree, TheFirstDifferingLeafIsFoundAndMissingOnesAreNotCompared) {
  const std::vector<std::uint64_t> fields(state_field_names().size(), 7),
      stages(stage_leaf_names().size(), 9);
  const TreeRow row = tree_row(stages, fields);
  for (std::size_t leaf = 0; leaf < row.size(); ++leaf) {
    TreeRow other = row;
    ASSERT_TRUE(other[leaf].has_value()) << tree_leaf_names()[leaf];
    *other[leaf] ^= 1;
    EXPECT_EQ(differing_leaves(row, other), std::vector<std::size_t>{leaf});
    other[leaf].reset();
    EXPECT_TRUE(differing_leaves(row, other).empty());
  }
  EXPECT_FALSE(tree_row({}, fields)[0].has_value());
}

TEST(StepTree, RecordedHashesOfStagesComeBack) {
  RunHeader header = test::small_header();
  header.stage_leaves = stage_leaf_names();
  State state = test::small_state(header);
  const auto path = test::scratch_dir() / "run.h5";
  {
    RunWriter writer(path, header, state);
    for (std::int64_t n = 0; n < 5; ++n) {
      const test::SmallStep step = test::advance(header, n, state);
      const std::vector<std::uint64_t> hashes(stage_leaf_names().size(), 100 + static_cast<std::uint64_t>(n));
      writer.write_step(step.samples, step.report, state, step.stage_s, 0, hashes);
    }
    writer.finish(state);
  }
  const RunData run = read_run(path);
  EXPECT_EQ(recorded_tree_row(run, 3)[0], std::optional<std::uint64_t>(102));
  EXPECT_FALSE(recorded_tree_row(run, 0)[0].has_value());
  EXPECT_TRUE(recorded_tree_row(run, 0)[2].has_value()) << "of the state";
}

TEST(StepTree, ADifferenceIsNamedWithPlaceBothValuesAndUlps) {
  const std::vector<double> values = {0, 1, 2, 3, 4, 5};
  std::vector<double> other = values;
  other[4] = std::nextafter(std::nextafter(4.0, 5.0), 5.0);
  other[5] = -5;
  const std::string text = describe_difference("solve/positions", doubles(values), doubles(other));
  EXPECT_NE(text.find("index 4 (node 1, y): 4 (0x4010000000000000) against 4.00000000000000"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("(0x4010000000000002), 2 ulps apart; 2 of 6 numbers differ"), std::string::npos)
      << text;
  EXPECT_EQ(describe_difference("solve/positions", doubles(values), doubles(values)), "no difference");
  other = values;
  other.push_back(1);
  EXPECT_EQ(describe_difference("contacts/contacts", doubles(values), doubles(other)), "6 numbers against 7");
}

TEST(StepTree, UlpsCountThroughZero) {
  const double tiny = std::nextafter(0.0, 1.0);
  const std::string text = describe_difference("a/b", doubles({-tiny}), doubles({tiny}));
  EXPECT_NE(text.find(", 2 ulps apart"), std::string::npos) << text;
}

}  // namespace
}  // namespace sulcus
