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

}  // namespace
}  // namespace sulcus
