// A session that is killed at a random moment, fifty times. Without starting a program each time: the
// commands run in this process, the killed sessions in its children.
#include <gtest/gtest.h>
#include <omp.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>
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

pid_t start_session(const fs::path& folder, const std::string& device) {
  SessionOptions options;
  options.scenario = (folder / "tiny.json").string();
  options.device = device;
  options.out = folder / "out";
  options.duration_s = 10;
  options.threads = 1;
  options.realtime = false;
  return test::start_child(folder / "out/run.h5.log", [&] { session_command(options); });
}

TEST(KilledSession, IsRecoveredAndRunsAgain) {
  omp_set_num_threads(1);  // a child has none of its parent's threads and would wait for them
  const fs::path folder = fs::temp_directory_path() / ("sulcus_killed_test_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "tiny.json") << test::tiny_scenario;
  setenv("SULCUS_LIBHD", PHANTOM_STANDIN, 1);
  setenv("SULCUS_STANDIN", "swing_rad=0.2 swing_Hz=2", 1);
  constexpr std::uint64_t seed = 50;
  std::mt19937_64 random(seed);
  int recovered = 0;
  std::int64_t most_steps = 0, most_ticks = 0;
  for (int number = 0; number < 50; ++number) {
    SCOPED_TRACE("seed " + std::to_string(seed) + ", kill " + std::to_string(number));
    fs::remove_all(folder / "out");
    const pid_t child = start_session(folder, number % 5 == 4 ? "phantom" : "scripted");
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 120000));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    ASSERT_FALSE(fs::exists(folder / "out/run.h5"));
    try {
      ASSERT_EQ(recover_command({folder / "out", 1}), 0);
    } catch (const InputError& error) {  // killed while the first chunk was being written
      EXPECT_NE(std::string(error.what()).find("before the first step"), std::string::npos) << error.what();
      continue;
    }
    ++recovered;
    ASSERT_EQ(replay_command({folder / "out/run.h5", 1, {}, false}), 0);
    const RunData run = read_run(folder / "out/run.h5");
    most_steps = std::max(most_steps, run.steps);
    most_ticks = std::max(most_ticks, static_cast<std::int64_t>(run.session->ticks[0].size()));
  }
  EXPECT_GT(recovered, 40);
  EXPECT_GT(most_steps, 5);
  EXPECT_GT(most_ticks, 50);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace sulcus
