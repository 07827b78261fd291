// Frames of the whole state that a scenario does not ask for cost a run nothing: instructions, counted by
// valgrind.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "engine/numerics/test_shell.h"
#include "tools/sulcus/temporary_folder.h"

namespace sulcus {
namespace {

// Of `function` and all that it calls, in a run of 90 steps.
double instructions_of(const std::string& function, int frame_every_steps) {
  const TemporaryFolder folder;
  const std::string output =
      test::shell(
          "valgrind --tool=callgrind --callgrind-out-file=/dev/null --toggle-collect='sulcus::" + function +
          "*' " SULCUS_COMMAND " run " SULCUS_SOURCE_DIR
          "/scenarios/hard/hard_press.json --threads 1 --no-pictures "
          "--set /time/duration_s=0.9 --set /solver/measure_error_every_steps=0 --set "
          "/record/frame_every_steps=" +
          std::to_string(frame_every_steps) + " --out " + (folder.path / "run").string() + " 2>&1")
          .output;
  const std::string mark = "Collected : ";
  const auto at = output.find(mark);
  EXPECT_NE(at, std::string::npos) << output;
  return at == std::string::npos ? 0 : std::atof(output.c_str() + at + mark.size());
}

TEST(RecordingCost, FramesThatAreOffTakeLessThanAHundredthOfTheInstructionsOfTheSteps) {
  if (std::system("valgrind --version > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "valgrind is not installed: no instructions counted";
  const double steps = instructions_of("step(", 1000000);
  const double off = instructions_of("RunWriter::write_frame", 1000000);  // the first frame always is
  const double on = instructions_of("RunWriter::write_frame", 1);
  EXPECT_GT(off, 0);  // else the function has another name by now
  EXPECT_LT(off, 0.01 * steps);
  EXPECT_GT(on, 10 * off);
}

}  // namespace
}  // namespace sulcus
