// What surrounds a run goes wrong: no disk, no memory, no right to write, stopped, crowded, a clock
// that jumps. Nothing is lost, nothing hangs, and what failed is said.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>
#include <vector>

#include "tools/sulcus/test_command.h"
#include "tools/sulcus/test_scenario.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;
using test::command_after;
using test::contains;
using test::fingerprint_of;
using test::read;
using test::Result;

class Surroundings : public testing::Test {
 protected:
  void SetUp() override {
    folder = fs::temp_directory_path() / ("sulcus_surroundings_" + std::to_string(getpid()));
    fs::remove_all(folder);
    fs::create_directories(folder);
    std::ofstream(folder / "tiny.json") << test::tiny_scenario;
  }
  void TearDown() override { fs::remove_all(folder); }

  std::string path(const std::string& name) const { return "'" + (folder / name).string() + "'"; }
  std::string run_of(const std::string& out) const {
    return "run " + path("tiny.json") + " --no-pictures --threads 2 --out " + path(out);
  }
  std::string fingerprint(const std::string& out) const { return fingerprint_of(folder / out); }
  fs::path folder;
};

TEST_F(Surroundings, AFileThatMayNotGrowLeavesNoFinishedRecordingAndASessionThatIsRecovered) {
  const Result run = command_after("ulimit -f 20 &&", run_of("run"));
  EXPECT_EQ(run.code, 3) << run.output;
  EXPECT_TRUE(contains(run.output, "error: ") && contains(run.output, "run.h5")) << run.output;
  EXPECT_FALSE(fs::exists(folder / "run" / "run.h5"));

  const Result session =
      command_after("ulimit -f 60 &&", "session " + path("tiny.json") + " --out " + path("session"));
  EXPECT_EQ(session.code, 3) << session.output;
  EXPECT_TRUE(contains(session.output, "sulcus recover")) << session.output;
  const Result recovered = test::command("recover " + path("session"));
  EXPECT_EQ(recovered.code, 0) << recovered.output;
  const Result replay = test::command("replay " + path("session/run.h5"));
  EXPECT_EQ(replay.code, 0) << replay.output;
}

// A scene of half a million tetrahedra, in what the libraries take and a little more.
TEST_F(Surroundings, TooLittleMemoryIsSaid) {
  for (const int megabytes : {330, 400, 450}) {
    const Result run = command_after(
        "ulimit -v " + std::to_string(1000 * megabytes) + " &&",
        run_of("run") + " --set /label_map/generate/box/voxel_size_mm=0.5 --set /mesh/size_mm=0.8");
    EXPECT_EQ(run.code, 3) << megabytes << " MB\n" << run.output;
    EXPECT_TRUE(contains(run.output, "error: out of memory")) << megabytes << " MB\n" << run.output;
    EXPECT_FALSE(fs::exists(folder / "run" / "run.h5"));
  }
  const Result enough = command_after("ulimit -v 2000000 &&", run_of("enough"));
  EXPECT_EQ(enough.code, 0) << enough.output;
}

TEST_F(Surroundings, APlaceThatCannotBeWrittenToIsNamedByEveryCommand) {
  ASSERT_EQ(test::command(run_of("run")).code, 0);
  const std::string tiny = path("tiny.json"), run = path("run");
  std::ofstream(folder / "rest.json") << R"({"sulcus": 1, "name": "rest",
    "label_map": {"generate": {"box": {"size_mm": [40, 40, 40], "voxel_size_mm": 5}}}, "mesh": {"size_mm": 20},
    "boundary": {"fixed": [{"below_mm": {"axis": "z", "value": -15}}]}, "time": {"step_s": 0.01, "duration_s": 0.1}})";
  const std::vector<std::string> commands = {
      "run " + tiny + " --out /proc/x",
      "session " + tiny + " --out /proc/x",
      "static " + path("rest.json") + " --out /proc/x",
      "report " + run + " --out /proc/x.html",
      "suite --scenarios " + path("") + " --filter tiny --golden '' --out /proc/x",
      "export-volume " + run + " --out /proc/x.nrrd",
      "fuzz --seeds 1 --out /proc/x",
      "work-precision " + tiny + " --vary /solver/tolerance=1e-2 --out /proc/x",

      "perf-report --out /proc/x.html"};
  for (const std::string& arguments : commands) {
    const Result result = test::command(arguments);
    EXPECT_TRUE(result.code == 2 || result.code == 3) << arguments << ": " << result.code << '\n'
                                                      << result.output;
    EXPECT_TRUE(contains(result.output, "error: ")) << arguments << '\n' << result.output;
    EXPECT_TRUE(contains(result.output, "/proc/")) << arguments << '\n' << result.output;
  }
}

// To the program, the time it stood still is a jump of every clock.
TEST_F(Surroundings, ASessionThatStoodStillRunsAgain) {
  const pid_t child = fork();
  if (child == 0) {
    const int log = open((folder / "log").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    dup2(log, 1);
    dup2(log, 2);
    execl(SULCUS_COMMAND, SULCUS_COMMAND, "session", (folder / "tiny.json").c_str(), "--out",
          (folder / "run").c_str(), nullptr);
    _exit(99);
  }
  while (waitpid(child, nullptr, WNOHANG) == 0 && !fs::exists(folder / "run" / "run.h5.log"))
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  kill(child, SIGSTOP);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  kill(child, SIGCONT);
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << read(folder / "log");
  const Result replay = test::command("replay " + path("run/run.h5"));
  EXPECT_EQ(replay.code, 0) << replay.output;
}

TEST_F(Surroundings, AWallClockThatJumpsChangesNothing) {
  const std::string jumping = "env LD_PRELOAD='" JUMPING_CLOCK "'";
  const Result date = test::shell(jumping + " date +%s; date +%s");
  long jumped = 0, now = 0;
  ASSERT_EQ(std::sscanf(date.output.c_str(), "%ld %ld", &jumped, &now), 2) << date.output;
  ASSERT_GT(std::abs(jumped - now), 3000) << "the clock does not jump: " << date.output;

  ASSERT_EQ(test::command(run_of("still")).code, 0);
  const Result run = command_after(jumping, run_of("jumping"));
  EXPECT_EQ(run.code, 0) << run.output;
  EXPECT_EQ(fingerprint("jumping"), fingerprint("still"));

  const Result session = command_after(jumping, "session " + path("tiny.json") + " --out " + path("session"));
  EXPECT_EQ(session.code, 0) << session.output;
  const Result replay = command_after(jumping, "replay " + path("session/run.h5"));
  EXPECT_EQ(replay.code, 0) << replay.output;
}

TEST_F(Surroundings, FourRunsAndFourSuitesAtOnceGiveTheSameBits) {
  std::vector<Result> runs(4), suites(4);
  std::vector<std::thread> all;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::string number = std::to_string(i);
    all.emplace_back([&, i, number] { runs[i] = test::command(run_of("run" + number)); });
    all.emplace_back([&, i, number] {
      suites[i] = test::command("suite --scenarios " + path("") + " --filter tiny --golden '' --out " +
                                path("suite" + number));
    });
  }
  for (std::thread& one : all) one.join();
  for (std::size_t i = 0; i < 4; ++i) {
    const std::string number = std::to_string(i);
    EXPECT_EQ(runs[i].code, 0) << runs[i].output;
    EXPECT_EQ(fingerprint("run" + number), fingerprint("run0"));
    EXPECT_FALSE(fingerprint("run" + number).empty());
    // the tiny scene ends as its tool leaves the tissue: one statement has no rest to look at
    EXPECT_LE(suites[i].code, 1) << suites[i].output;
    EXPECT_EQ(fingerprint("suite" + number + "/tiny"), fingerprint("run0")) << suites[i].output;
    EXPECT_TRUE(fs::exists(folder / ("suite" + number) / "index.html"));
  }
}

}  // namespace
}  // namespace sulcus
