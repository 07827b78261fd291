// A part that is off costs nothing: the step of a scene without any part against the same step written out by
// hand (test_part_cost.cpp), which knows of no part; and a scene that names every part, but off, against one
// that names none. Instructions are counted by valgrind, which is no clock: the same on any machine and under
// any load.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>

#include "engine/numerics/test_shell.h"

namespace {

std::string output_of(const std::string& command) {
  const sulcus::test::Result result = sulcus::test::shell(command);
  return result.code == 0 ? result.output : "failed: " + result.output;
}

struct Counts {
  int steps = 0, iterations = 0;
  std::string hash;
  long scene_bytes = 0, workspace_bytes = 0;
};

Counts run_of(const std::string& part) {
  Counts run;
  std::string name;
  const std::string output = output_of(PART_COST " " + part + " 12 2>&1");
  std::istringstream(output) >> name >> run.steps >> run.iterations >> run.hash >> run.scene_bytes >>
      run.workspace_bytes;
  EXPECT_EQ(name, part) << output;
  return run;
}

bool valgrind_is_here() {
  return std::system("valgrind --version > /dev/null 2>&1") == 0;
}

// Instructions of the steps themselves, without what builds the scene.
double instructions_of(const std::string& part, const std::string& inside = "part_cost_steps") {
  const std::string output = output_of(
      "valgrind --tool=callgrind --callgrind-out-file=/dev/null "
      "--toggle-collect='" +
      inside + "' " PART_COST " " + part + " 4 2>&1");
  const std::string mark = "Collected : ";
  const auto at = output.find(mark);
  EXPECT_NE(at, std::string::npos) << output;
  return at == std::string::npos ? 0 : std::atof(output.c_str() + at + mark.size());
}

TEST(PartCost, TheStepWrittenByHandDoesTheSameJob) {
  const Counts step = run_of("none"), by_hand = run_of("by_hand"), off = run_of("off");
  EXPECT_GT(step.iterations, 50);
  EXPECT_EQ(step.iterations, by_hand.iterations);
  EXPECT_EQ(step.hash, by_hand.hash);
  EXPECT_EQ(step.hash, off.hash);
}

TEST(PartCost, AllPartsThatAreOffTakeNoMemory) {
  const Counts none = run_of("none"), by_hand = run_of("by_hand"), off = run_of("off");
  EXPECT_EQ(off.scene_bytes, none.scene_bytes);
  EXPECT_EQ(off.workspace_bytes, none.workspace_bytes);
  EXPECT_LT(static_cast<double>(none.scene_bytes), 1.01 * static_cast<double>(by_hand.scene_bytes));
  EXPECT_LT(static_cast<double>(none.workspace_bytes), 1.01 * static_cast<double>(by_hand.workspace_bytes));
  // that the counting sees parts that are on
  for (const char* part : {"fracture", "multigrid", "tool"}) {
    const Counts on = run_of(part);
    EXPECT_GT(on.scene_bytes + on.workspace_bytes, none.scene_bytes + none.workspace_bytes + 10000) << part;
  }
}

TEST(PartCost, AllPartsThatAreOffTakeLessThanAHundredthOfTheInstructions) {
  if (!valgrind_is_here()) GTEST_SKIP() << "valgrind is not installed: no instructions counted";
  const double by_hand = instructions_of("by_hand"), none = instructions_of("none"),
               off = instructions_of("off");
  EXPECT_LT(none, 1.01 * by_hand);
  EXPECT_LT(off, 1.01 * by_hand);
  EXPECT_GT(none, 0.99 * by_hand);  // else the two do not the same job
  // that the counting sees parts that are on
  for (const char* part : {"energies", "fracture"}) EXPECT_GT(instructions_of(part), 1.01 * by_hand) << part;
}

TEST(PartCost, FrictionThatIsOffTakesLessThanAHundredthOfAStepWithATool) {
  if (!valgrind_is_here()) GTEST_SKIP() << "valgrind is not installed: no instructions counted";
  const auto of_friction = [](const std::string& part) {
    return instructions_of(part, "sulcus::begin_friction*") +
           instructions_of(part, "sulcus::correct_friction*");
  };
  const double off = of_friction("tool"), on = of_friction("friction");
  EXPECT_GT(off, 0);  // else the functions have other names by now
  EXPECT_LT(off, 0.01 * instructions_of("tool"));
  EXPECT_GT(on, 10 * off);
}

}  // namespace
