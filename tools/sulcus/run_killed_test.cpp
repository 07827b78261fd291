// A run that is killed at a random moment, twenty times: what it had done is there, to the last whole step.
// The commands run in this process, the killed runs in its children.
#include <gtest/gtest.h>
#include <omp.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <functional>
#include <random>
#include <thread>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/test_child.h"
#include "tools/sulcus/test_scenario.h"
#include "verify/recording.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

// The tiny scenario, but so long that no run of it comes to its end here.
void write_scenario(const fs::path& file) {
  std::string text = test::tiny_scenario;
  for (const std::string& end : {std::string("\"time_s\": 0.6"), std::string("\"duration_s\": 0.6")})
    text.replace(text.find(end), end.size(), end.substr(0, end.find(':')) + ": 200");
  std::ofstream(file) << text;
}

RunOptions long_run(const fs::path& folder) {
  RunOptions options;
  options.scenario = (folder / "tiny.json").string();
  options.out = folder / "out";
  options.threads = 1;
  options.pictures = false;
  return options;
}

std::string refusal_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "not refused";
}

TEST(KilledRun, IsRecoveredToItsLastStepAndRunsAgain) {
  omp_set_num_threads(1);  // a child has none of its parent's threads and would wait for them
  const fs::path folder = fs::temp_directory_path() / ("sulcus_killed_run_" + std::to_string(getpid()));
  const fs::path recording = folder / "out/run.h5";
  fs::create_directories(folder);
  write_scenario(folder / "tiny.json");
  constexpr std::uint64_t seed = 90;
  std::mt19937_64 random(seed);
  int recovered = 0, with_frames = 0;
  std::int64_t most_steps = 0;
  for (int number = 0; number < 20; ++number) {
    SCOPED_TRACE("seed " + std::to_string(seed) + ", kill " + std::to_string(number));
    fs::remove_all(folder / "out");
    const pid_t child = test::start_child(folder / "out/run.h5.log", [&] { run_command(long_run(folder)); });
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 150000));
    if (number == 0) {  // nobody takes a run's log away while it goes on
      const std::string says = refusal_of([&] { recover_command({folder / "out", 1}); });
      EXPECT_TRUE(says.find("still goes on") != std::string::npos ||
                  says.find("before the first step") != std::string::npos)
          << says;
    }
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(!WIFEXITED(status) || WEXITSTATUS(status) == 0);
    if (WIFEXITED(status) || fs::exists(recording)) continue;  // it was faster
    const std::string refusal = refusal_of([&] { verify_command({folder / "out", {}}); });
    ASSERT_NE(refusal.find("sulcus recover " + (folder / "out").string()), std::string::npos) << refusal;
    ASSERT_EQ(refusal_of([&] { replay_command({recording, 1, {}, false}); }), refusal);
    try {
      ASSERT_EQ(recover_command({folder / "out", 1}), 0);
    } catch (const InputError& error) {  // killed while the first chunk was being written
      EXPECT_NE(std::string(error.what()).find("before the first step"), std::string::npos) << error.what();
      continue;
    }
    ++recovered;
    EXPECT_FALSE(fs::exists(folder / "out/run.h5.log"));
    EXPECT_FALSE(fs::exists(folder / "out/run.h5.part"));
    ASSERT_EQ(replay_command({recording, 1, {}, false}), 0);
    const RunData run = read_run(recording);
    most_steps = std::max(most_steps, run.steps);
    with_frames += run.frames.size() > 1;
    const auto frames = static_cast<std::int64_t>(run.frames.size()), expected = 1 + run.steps / 5;
    EXPECT_TRUE(frames == expected || (frames == expected - 1 && run.steps % 5 == 0)) << frames;
    EXPECT_FALSE(run.session);
    EXPECT_EQ(static_cast<std::int64_t>(run.stage_hashes.size()),
              run.steps * static_cast<std::int64_t>(run.header.stage_leaves.size()));
    // they reach the log with the first step
    EXPECT_EQ(run.numbers.count("mesh_pieces"), run.steps > 0 ? 1u : 0u);
    EXPECT_EQ(run.events.back().text, "cut off here; recovered from its log");
  }
  EXPECT_GT(recovered, 12);
  EXPECT_GT(with_frames, 5);
  EXPECT_GT(most_steps, 20);
  fs::remove_all(folder);
}

TEST(KilledRun, AFullDiskIsSaidAndWhatWasDoneIsRecovered) {
  const fs::path folder = fs::temp_directory_path() / ("sulcus_full_disk_" + std::to_string(getpid()));
  const fs::path disk = folder / "disk";
  fs::create_directories(disk);
  write_scenario(folder / "tiny.json");
  if (mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=400k") != 0)
    GTEST_SKIP() << "no right to mount a small disk";
  RunOptions options = long_run(folder);
  options.out = disk / "run";
  try {
    run_command(options);
    ADD_FAILURE() << "the disk was not full";
  } catch (const EnvironmentError& error) {
    EXPECT_NE(std::string(error.what()).find((disk / "run/run.h5").string()), std::string::npos)
        << error.what();
    EXPECT_NE(std::string(error.what()).find("sulcus recover"), std::string::npos) << error.what();
  }
  EXPECT_FALSE(fs::exists(disk / "run/run.h5"));
  fs::create_directories(folder / "out");  // somewhere with room
  fs::copy(disk / "run/run.h5.log", folder / "out/run.h5.log");
  EXPECT_EQ(umount(disk.c_str()), 0);
  ASSERT_EQ(recover_command({folder / "out", 1}), 0);
  EXPECT_EQ(replay_command({folder / "out/run.h5", 1, {}, false}), 0);
  EXPECT_GT(read_run(folder / "out/run.h5").steps, 20);
  fs::remove_all(folder);
}

TEST(KilledRun, AFinishedOneLeavesNoLog) {
  const fs::path folder = fs::temp_directory_path() / ("sulcus_finished_run_" + std::to_string(getpid()));
  fs::create_directories(folder);
  write_scenario(folder / "tiny.json");
  RunOptions options = long_run(folder);
  options.overrides = {"/time/duration_s=0.1"};
  ASSERT_EQ(run_command(options), 0);
  EXPECT_TRUE(fs::exists(folder / "out/run.h5"));
  EXPECT_FALSE(fs::exists(folder / "out/run.h5.log"));
  EXPECT_NE(refusal_of([&] {
              recover_command({folder / "out", 1});
            }).find("nothing to recover"),
            std::string::npos);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace sulcus
