// Runs whose tools are moved by hands that feel and by devices that fail, as a scenario says.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "tools/sulcus/test_command.h"
#include "tools/sulcus/test_scenario.h"
#include "verify/recording.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

using test::command;
using test::Result;

class Hands : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("sulcus_hands_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    std::ofstream(folder_ / "tiny.json") << test::tiny_scenario;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return "'" + (folder_ / name).string() + "'"; }
  Result run(const std::string& settings, const std::string& out = "out") const {
    return command("run " + path("tiny.json") + " --no-pictures --threads 1 --out " + path(out) + " " +
                   settings);
  }
  RunData recording(const std::string& out = "out") const { return read_run(folder_ / out / "run.h5"); }
  void expect_replay() const {
    const Result replay = command("replay --threads 2 " + path("out/run.h5"));
    EXPECT_EQ(replay.code, 0) << replay.output;
  }

  fs::path folder_;
};

bool tells(const RunData& run, const std::string& words) {
  return std::any_of(run.events.begin(), run.events.end(),
                     [&](const RunEvent& event) { return event.text.find(words) != std::string::npos; });
}

constexpr const char* push_setting =
    "--set '/tools/0/device={\"push\": {\"position_mm\": [0, 0, 27], \"speed_mm_s\": 20, "
    "\"threshold_N\": 0.15, \"hold_s\": 0.1}}' --set /tools/0/output_filter_Hz=0 "
    "--set /time/duration_s=1.8 --set /contact/stiffness_N_m=200 --set /tools/0/coupling/damping_N_s_m=1";

TEST_F(Hands, APushHoldsAtItsForceComesBackAndStays) {
  const Result result = run(push_setting);
  ASSERT_EQ(result.code, 0) << result.output;
  const RunData recorded = recording();
  double lowest_m = 1, highest_m = 0;
  for (const DeviceSample& sample : recorded.samples) {
    lowest_m = std::min(lowest_m, sample.position.z());
    highest_m = std::max(highest_m, sample.position.z());
  }
  EXPECT_LT(lowest_m, 0.0255);          // it touches at 25 mm ...
  EXPECT_GT(lowest_m, 0.012);           // ... and the force, not the way, ends the push
  EXPECT_NEAR(highest_m, 0.027, 3e-4);  // a step's way
  const Series* force = recorded.find("tools/0/displayed_force_N");
  ASSERT_NE(force, nullptr);
  const double most_N = *std::max_element(force->values.begin(), force->values.end());
  EXPECT_GT(most_N, 0.15);
  EXPECT_LT(most_N, 0.3);
  EXPECT_EQ(recorded.samples.back().position.z(), 0.027);
  EXPECT_TRUE(tells(recorded, "its way is over"));
  expect_replay();
}

TEST_F(Hands, AHandFeelsTheForce) {
  ASSERT_EQ(run("").code, 0);
  ASSERT_EQ(run("--set '/tools/0/device/scripted/hand={\"mass_kg\": 0.1}'", "hand").code, 0);
  ASSERT_EQ(run("--set '/tools/0/device/scripted/tremor={\"position_rms_mm\": 0.1}'", "tremor").code, 0);
  EXPECT_NE(recording("hand").fingerprint(), recording().fingerprint());
  EXPECT_NE(recording("tremor").fingerprint(), recording().fingerprint());
}

TEST_F(Hands, SpoiledSamplesAreHeldCountedAndTheSameEveryTime) {
  const std::string faults =
      "--set '/tools/0/device/faults={\"lost_share\": 0.3, \"jitter_s\": 0.004, \"nan_from_s\": 0.2, "
      "\"nan_for_s\": 0.1, \"encoder_step_mm\": 0.05}'";
  ASSERT_EQ(run(faults).code, 0);
  ASSERT_EQ(run(faults, "again").code, 0);
  const RunData recorded = recording();
  EXPECT_EQ(recorded.fingerprint(), recording("again").fingerprint());
  EXPECT_GT(recorded.numbers.at("held_samples"), 15);
  EXPECT_TRUE(tells(recorded, "last sound sample is held"));
  expect_replay();
}

TEST_F(Hands, ADeviceThatFailsEndsTheRunWithACompleteRecording) {
  const Result result = run("--set /tools/0/device/faults/disconnect_at_s=0.3");
  EXPECT_EQ(result.code, 3) << result.output;
  EXPECT_NE(result.output.find("a device failed after 29 steps"), std::string::npos) << result.output;
  EXPECT_EQ(recording().steps, 29);
  EXPECT_TRUE(tells(recording(), "failed"));
  expect_replay();
}

TEST_F(Hands, ThatMakeNoSenseAreRefused) {
  const auto refused = [&](const std::string& setting, const std::string& says) {
    const Result result = run("--set '" + setting + "'");
    EXPECT_EQ(result.code, 2) << result.output;
    EXPECT_NE(result.output.find(says), std::string::npos) << result.output;
    EXPECT_FALSE(fs::exists(folder_ / "out"));
  };
  refused("/tools/0/device/push={\"position_mm\": [0, 0, 27]}", "exactly one of");
  refused("/tools/0/device={}", "exactly one of");
  refused("/tools/0/device={\"push\": {\"position_mm\": [0, 0, 27], \"direction\": [0, 0, 0]}}", "direction");
  refused("/tools/0/device/scripted/tremor={\"low_Hz\": 12, \"high_Hz\": 8}", "band");
  refused("/tools/0/device/faults/lost_share=2", "lost_share");
}

std::string recorded(const std::string& file, const std::string& more = "") {
  return "--set '/tools/0/device={\"recorded\": {\"file\": \"" + file + "\"" + more + "}}'";
}

constexpr const char* table_header = "time_s,x_m,y_m,z_m,qs,qx,qy,qz\n";

TEST_F(Hands, OfARunMovesTheToolAgainToTheBit) {
  ASSERT_EQ(run("", "first").code, 0);
  const Result again = run(recorded("first/run.h5"));
  ASSERT_EQ(again.code, 0) << again.output;
  EXPECT_EQ(recording().fingerprint(), recording("first").fingerprint());
  EXPECT_TRUE(recording().header.inputs.contains((folder_ / "first/run.h5").string()));
  fs::remove_all(folder_ / "first");  // a recording does without the hand's file
  expect_replay();
}

TEST_F(Hands, OfASessionMovesTheToolAgainToTheBit) {
  const Result session =
      command("session " + path("tiny.json") + " --no-realtime --hand light --out " + path("session"));
  ASSERT_EQ(session.code, 0) << session.output;
  const std::int64_t steps = recording("session").steps;
  ASSERT_GT(steps, 5);
  const Result again = run(recorded("session/run.h5", ", \"tool\": \"ball\"") +
                           " --set /time/duration_s=" + std::to_string(0.01 * static_cast<double>(steps)));
  ASSERT_EQ(again.code, 0) << again.output;
  EXPECT_EQ(recording().fingerprint(), recording("session").fingerprint());
}

TEST_F(Hands, OfATableMovesTheToolAsWaypointsOnStraightWaysDo) {
  std::ofstream(folder_ / "hand.csv") << table_header << "0,0,0,0.027,1,0,0,0\n"
                                      << "0.3,0.001,0.002,0.02,1,0,0,0\n0.6,0,0,0.027,1,0,0,0\n";
  ASSERT_EQ(run(recorded("hand.csv")).code, 0);
  ASSERT_EQ(run("--set /tools/0/device/scripted/waypoints/1/path=linear "
                "--set /tools/0/device/scripted/waypoints/2/path=linear",
                "script")
                .code,
            0);
  EXPECT_EQ(recording().fingerprint(), recording("script").fingerprint());
  expect_replay();
  const Result session = command("session " + path("tiny.json") + " --no-realtime --hand firm --out " +
                                 path("session") + " " + recorded("hand.csv"));
  EXPECT_EQ(session.code, 0) << session.output;
}

TEST_F(Hands, FromBadFilesAreRefusedWithFileAndLine) {
  const auto refused = [&](const std::string& setting, const std::vector<std::string>& says) {
    const Result result = run(setting);
    EXPECT_EQ(result.code, 2) << result.output;
    for (const std::string& words : says)
      EXPECT_NE(result.output.find(words), std::string::npos) << result.output;
    EXPECT_FALSE(fs::exists(folder_ / "out"));
  };
  const auto table = [&](const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name) << text;
    return recorded(name);
  };
  const std::string line = "0,0,0,0.027,1,0,0,0\n", last = "1,0,0,0.027,1,0,0,0\n";
  const std::string pointer = "/tools/0/device/recorded/file: ";
  refused(recorded("none.csv"), {pointer, "none.csv: there is no such file"});
  refused(recorded("none.h5"), {pointer, "none.h5: there is no such file"});
  refused(table("hand.txt", line), {"hand.txt: expected a table (.csv) or a recording (.h5)"});
  refused(table("empty.csv", ""), {pointer, "empty.csv: no samples"});
  refused(table("header.csv", table_header), {"header.csv: no samples"});
  refused(table("nan.csv", table_header + line + "0.1,0,nan,0.027,1,0,0,0\n" + last),
          {"nan.csv: line 3", "finite"});
  refused(table("back.csv", table_header + line + last + "0.5,0,0,0.027,1,0,0,0\n"),
          {"back.csv: line 4", "increase"});
  refused(table("word.csv", table_header + line + "0.1,0,much,0.027,1,0,0,0\n"),
          {"word.csv: line 3: column 3"});
  refused(table("unit.csv", table_header + line + "1,0,0,0.027,2,0,0,0\n"), {"unit.csv: line 3"});
  refused(table("short.csv", table_header + line + "0.2,0,0,0.027,1,0,0,0\n"),
          {"short.csv: the motion ends at 0.2 s, the run lasts 0.6 s"});
  refused(table("text.h5", line), {pointer, "text.h5"});
  ASSERT_EQ(run("--set /time/duration_s=0.3", "half").code, 0);
  refused(recorded("half/run.h5"), {"the motion ends at 0.3 s"});
  refused(recorded("half/run.h5", ", \"tool\": \"spoon\""),
          {"it has no tool \"spoon\"; expected one of ball"});
  fs::resize_file(folder_ / "half/run.h5", fs::file_size(folder_ / "half/run.h5") / 2);
  refused(recorded("half/run.h5"), {pointer, "half/run.h5"});
}

}  // namespace
}  // namespace sulcus
