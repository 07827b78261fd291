// Sessions as a user meets them: in real time, under load, with devices that fail, killed, and run again.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <hdf5.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <thread>

#include "hw_phantom/standin/control.h"
#include "tools/sulcus/test_command.h"
#include "tools/sulcus/test_scenario.h"
#include "verify/recording.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

using test::command;
using test::Result;

class Session : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("sulcus_session_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    std::ofstream(folder_ / "tiny.json") << test::tiny_scenario;
    setenv("SULCUS_LIBHD", PHANTOM_STANDIN, 1);
    unsetenv("SULCUS_STANDIN");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return "'" + (folder_ / name).string() + "'"; }

  Result session(const std::string& arguments, const std::string& out = "out") const {
    return command("session " + path("tiny.json") + " --out " + path(out) + " " + arguments);
  }
  RunData run(const std::string& out = "out") const { return read_run(folder_ / out / "run.h5"); }

  // Every step and every tick again, with the same bits.
  void expect_replay(const std::string& out = "out") const {
    const Result replay = command("replay " + path(out + "/run.h5"));
    EXPECT_EQ(replay.code, 0) << replay.output;
    EXPECT_NE(replay.output.find("SAME  tiny"), std::string::npos) << replay.output;
    EXPECT_NE(replay.output.find(" ticks of the servo"), std::string::npos) << replay.output;
  }

  // A session in the background; its process number.
  pid_t start(const std::string& arguments, const std::string& out = "out") const {
    const pid_t child = fork();
    if (child != 0) return child;
    std::signal(SIGINT, SIG_DFL);  // the shell that runs this test may ignore it
    const int quiet = open("/dev/null", O_WRONLY);
    dup2(quiet, STDOUT_FILENO);
    dup2(quiet, STDERR_FILENO);
    const std::string line = std::string("exec '") + SULCUS_COMMAND + "' session " + path("tiny.json") +
                             " --out " + path(out) + " " + arguments;
    execl("/bin/sh", "sh", "-c", line.c_str(), nullptr);
    _exit(98);
  }
  static int wait_for(pid_t child) {
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  fs::path folder_;
};

double value_of(const RunData& run, const std::string& name) {
  const auto found = run.numbers.find(name);
  EXPECT_NE(found, run.numbers.end()) << name;
  return found == run.numbers.end() ? -1 : found->second;
}

bool tells(const RunData& run, const std::string& words) {
  for (const RunEvent& event : run.events) {
    if (event.text.find(words) != std::string::npos) return true;
  }
  return false;
}

TEST_F(Session, OfAScriptEndsWithItAndRunsAgain) {
  const Result result = session("--no-realtime");
  ASSERT_EQ(result.code, 0) << result.output;
  expect_replay();
  const RunData recorded = run();
  EXPECT_GT(recorded.steps, 5);
  ASSERT_TRUE(recorded.session);
  EXPECT_GT(recorded.session->ticks[0].size(), 20u);
  EXPECT_EQ(recorded.header.session->servo[0].filter_Hz, 10);
  EXPECT_EQ(recorded.session->histograms.size(), 6u);
  EXPECT_FALSE(fs::exists(folder_ / "out/run.h5.log"));
  EXPECT_EQ(recorded.frames.back().step, recorded.steps);
  double most_N = 0;  // the ball does touch
  for (const ServoTick& tick : recorded.session->ticks[0]) most_N = std::max(most_N, tick.force.norm());
  EXPECT_GT(most_N, 1e-3);
  EXPECT_EQ(command("verify " + path("out")).code, 0) << command("verify " + path("out")).output;
}

// What the servo renders between two steps is no staircase: it goes on with the hand.
TEST_F(Session, TheServoRendersAtItsOwnRateBetweenSteps) {
  ASSERT_EQ(session("--no-realtime --set /time/step_s=0.05 --set /record/frame_every_steps=1").code, 0);
  const RunData recorded = run();
  const auto& ticks = recorded.session->ticks[0];
  std::int64_t same_coupling = 0, same_force = 0;
  for (std::size_t i = 1; i < ticks.size(); ++i) {
    if (ticks[i].coupling_step < 1 || ticks[i].coupling_step != ticks[i - 1].coupling_step) continue;
    ++same_coupling;
    same_force += ticks[i].force == ticks[i - 1].force;
  }
  EXPECT_GT(same_coupling, 50);
  EXPECT_LT(same_force, same_coupling / 20);
  expect_replay();
}

// ---- faults, under load

class UnderLoad : public Session {
 protected:
  void SetUp() override {
    Session::SetUp();
    const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
    for (unsigned i = 0; i < cores; ++i)
      load_.emplace_back([this] {
        while (!stop_.load(std::memory_order_relaxed)) {
        }
      });
  }
  void TearDown() override {
    stop_.store(true);
    for (std::thread& thread : load_) thread.join();
    Session::TearDown();
  }

  Result phantom(const std::string& standin, const std::string& arguments = "--duration-s 0.6") {
    setenv("SULCUS_STANDIN", ("swing_rad=0.2 swing_Hz=2 " + standin).c_str(), 1);
    const Result result = session("--device phantom --turn-deg 180 --no-realtime " + arguments);
    unsetenv("SULCUS_STANDIN");
    return result;
  }

  std::atomic<bool> stop_{false};
  std::vector<std::thread> load_;
};

TEST_F(UnderLoad, APhantomsSessionRunsAgain) {
  const Result result = phantom("");
  ASSERT_EQ(result.code, 0) << result.output;
  expect_replay();
  EXPECT_EQ(run().header.session->devices[0], "PHANTOM Omni");
  EXPECT_GT(run().session->ticks[0].size(), 100u);
}

TEST_F(UnderLoad, ASessionThatMissesItsDeadlinesRunsAgain) {
  const Result result = phantom("", "--duration-s 0.6 --set /time/step_s=0.0002 --set /mesh/size_mm=5");
  ASSERT_EQ(result.code, 0) << result.output;
  EXPECT_GT(value_of(run(), "session_missed_deadlines"), 10);
  expect_replay();
}

TEST_F(UnderLoad, ASessionWithJitterAndStallsRunsAgain) {
  const Result result = phantom("jitter_s=0.0008 stall_from=500 stall_s=0.06");
  ASSERT_EQ(result.code, 0) << result.output;
  EXPECT_GT(run().session->find("servo_interval_s")->max_s, 0.05);
  EXPECT_TRUE(tells(run(), "nothing new"));
  expect_replay();
}

TEST_F(UnderLoad, ASessionWithForceErrorsAndNanRunsAgain) {
  const Result result = phantom("error=513 error_from=450 nan_from=550 nan_ticks=10");
  ASSERT_EQ(result.code, 0) << result.output;
  expect_replay();
}

TEST_F(UnderLoad, ALostPhantomEndsTheSessionWithACompleteRecording) {
  const Result result = phantom("error=770 error_from=500 error_every=1", "");
  EXPECT_EQ(result.code, 3) << result.output;
  EXPECT_NE(result.output.find("a device failed"), std::string::npos) << result.output;
  EXPECT_GT(run().steps, 0);
  EXPECT_TRUE(tells(run(), "failed"));
  expect_replay();
}

TEST_F(UnderLoad, SpoiledScriptsRunAgain) {
  const Result result = session(
      "--no-realtime --hand light --fault lost_share=0.3 --fault jitter_s=0.003 "
      "--fault nan_from_s=0.15 --fault nan_for_s=0.4 --fault stuck_from_s=0.6 "
      "--fault stuck_for_s=0.1");
  ASSERT_EQ(result.code, 0) << result.output;
  EXPECT_GT(value_of(run(), "session_held_samples"), 0);
  EXPECT_TRUE(tells(run(), "nothing finite"));
  EXPECT_TRUE(std::isfinite(run().final_state.tool_poses[0]));
  expect_replay();
}

TEST_F(UnderLoad, ADisconnectionEndsTheSessionWithACompleteRecording) {
  const Result result = session("--no-realtime --fault disconnect_at_s=0.3");
  EXPECT_EQ(result.code, 3) << result.output;
  EXPECT_GT(run().steps, 0);
  EXPECT_LT(run().find("session/read_s")->values.back(), 0.5);
  expect_replay();
}

// ---- endings

TEST_F(Session, CtrlCEndsItCleanlyAndWithoutForce) {
  const std::string log = (folder_ / "motors.log").string();
  setenv("SULCUS_STANDIN_LOG", log.c_str(), 1);
  setenv("SULCUS_STANDIN", "swing_rad=0.2 swing_Hz=2", 1);
  const pid_t child = start("--device phantom --turn-deg 180 --no-realtime");
  unsetenv("SULCUS_STANDIN_LOG");
  while (!fs::exists(folder_ / "out/run.h5.log")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  kill(child, SIGINT);
  EXPECT_EQ(wait_for(child), 0);
  EXPECT_TRUE(tells(run(), "interrupted"));
  EXPECT_GT(run().steps, 5);
  expect_replay();
  standin::Log motors{};
  std::ifstream file(log, std::ios::binary);
  char bytes[sizeof motors] = {};
  file.read(bytes, sizeof bytes);
  std::memcpy(&motors, bytes, sizeof bytes);
  EXPECT_GT(motors.largest_force_N, 0.001);  // it did push
  EXPECT_EQ(motors.force_N, 0);
  EXPECT_EQ(motors.scheduler_runs, 0u);
}

TEST_F(Session, CtrlCStopsTheForceAtOnce) {
  setenv("SULCUS_STANDIN", "swing_rad=0.2 swing_Hz=2", 1);
  const pid_t child = start("--device phantom --turn-deg 180 --no-realtime --set /time/step_s=0.2");
  while (!fs::exists(folder_ / "out/run.h5.log")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::this_thread::sleep_for(std::chrono::milliseconds(610));  // in the middle of a step's time
  kill(child, SIGINT);
  EXPECT_EQ(wait_for(child), 0);
  const RunData recorded = run();
  const auto& ticks = recorded.session->ticks[0];
  double most_N = 0;
  for (const ServoTick& tick : ticks) most_N = std::max(most_N, tick.sample.force_sent.norm());
  EXPECT_GT(most_N, 0.001);  // it did push
  EXPECT_EQ(ticks.back().sample.force_sent, Vec3(0, 0, 0));
}

TEST_F(Session, ACutOffSessionIsRecovered) {
  const pid_t child = start("--no-realtime --duration-s 10 --device phantom");
  while (!fs::exists(folder_ / "out/run.h5.log")) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  kill(child, SIGKILL);
  ASSERT_EQ(wait_for(child), -1);
  EXPECT_EQ(command("replay " + path("out/run.h5")).code, 2);
  const Result recover = command("recover " + path("out"));
  EXPECT_EQ(recover.code, 0) << recover.output;
  EXPECT_NE(recover.output.find("cut off"), std::string::npos) << recover.output;
  EXPECT_TRUE(tells(run(), "cut off"));
  EXPECT_GT(run().steps, 0);
  expect_replay();
}

TEST_F(Session, RecoverNeedsALog) {
  const Result result = command("recover " + path("nothing"));
  EXPECT_EQ(result.code, 2);
  EXPECT_NE(result.output.find("run.h5.log"), std::string::npos) << result.output;
}

TEST_F(Session, AChangedTickIsFound) {
  ASSERT_EQ(session("--no-realtime").code, 0);
  const std::string file_name = (folder_ / "out/run.h5").string();
  const std::size_t ticks = run().session->ticks[0].size();
  {
    const hid_t file = H5Fopen(file_name.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t data = H5Dopen(file, "/session/ticks/0/position_m", H5P_DEFAULT);
    ASSERT_GE(data, 0);
    std::vector<double> positions(3 * ticks);
    ASSERT_GE(H5Dread(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, positions.data()), 0);
    positions[positions.size() / 6 * 3] += 1e-9;
    ASSERT_GE(H5Dwrite(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, positions.data()), 0);
    H5Dclose(data);
    H5Fclose(file);
  }
  seal_recording(file_name);
  const Result replay = command("replay " + path("out/run.h5"));
  EXPECT_EQ(replay.code, 1) << replay.output;
  EXPECT_NE(replay.output.find("what the servo rendered"), std::string::npos) << replay.output;
}

// ---- hands from files

TEST_F(Session, ARecordedHandMovesAgainAsItDid) {
  ASSERT_EQ(session("--no-realtime").code, 0);
  const Result again = session("--no-realtime --device recorded --from " + path("out/run.h5"), "again");
  ASSERT_EQ(again.code, 0) << again.output;
  expect_replay("again");
  const RunData first = run(), second = run("again");
  EXPECT_EQ(second.header.session->devices[0], "recorded");
  // every pose of the second session is one of the first
  std::set<double> heights;
  for (const ServoTick& tick : first.session->ticks[0]) heights.insert(tick.sample.position.z());
  for (const ServoTick& tick : second.session->ticks[0]) {
    const bool over = static_cast<DeviceError>(tick.error) == DeviceError::ended;
    ASSERT_TRUE(over || heights.contains(tick.sample.position.z())) << tick.number;
  }
  EXPECT_TRUE(tells(second, "the trajectory is over"));
}

TEST_F(Session, ARunsHandAndATableWorkToo) {
  ASSERT_EQ(command("run " + path("tiny.json") + " --no-pictures --out " + path("run")).code, 0);
  const Result from_run = session("--no-realtime --device recorded --from " + path("run/run.h5"), "a");
  EXPECT_EQ(from_run.code, 0) << from_run.output;
  expect_replay("a");
  std::ofstream(folder_ / "hand.csv") << "time_s,x_m,y_m,z_m,qs,qx,qy,qz\n0,0,0,0.03,1,0,0,0\n"
                                      << "0.2,0,0,0.02,1,0,0,0\n";
  const Result from_table = session("--no-realtime --device recorded --from " + path("hand.csv"), "b");
  EXPECT_EQ(from_table.code, 0) << from_table.output;
  expect_replay("b");
}

// ---- what is said

TEST_F(Session, NonsenseIsRefused) {
  const auto refused = [&](const std::string& arguments, const std::string& says) {
    const Result result = session(arguments);
    EXPECT_EQ(result.code, 2) << arguments << '\n' << result.output;
    EXPECT_NE(result.output.find(says), std::string::npos) << result.output;
    EXPECT_FALSE(fs::exists(folder_ / "out")) << arguments;
  };
  refused("--device teapot", "teapot");
  refused("--device recorded", "--from");
  refused("--fault sneeze=1", "jitter_s");
  refused("--fault jitter_s=much", "not a number");
  refused("--device phantom --fault jitter_s=1", "--fault");
  refused("--tool hammer", "ball");
  refused("--device recorded --from " + path("absent.h5"), "absent.h5");
  refused("--duration-s -1", "duration");
}

TEST_F(Session, APhantomThatIsNotThereIsSaid) {
  setenv("SULCUS_LIBHD", "/nowhere/libHD.so", 1);
  const Result result = session("--device phantom");
  EXPECT_EQ(result.code, 3) << result.output;
  EXPECT_NE(result.output.find("/nowhere/libHD.so"), std::string::npos) << result.output;
}

TEST_F(Session, DevicesAreListedAndChecked) {
  const Result list = command("device --list");
  EXPECT_EQ(list.code, 0);
  for (const char* name : {"scripted", "recorded", "phantom", "libHD.so"})
    EXPECT_NE(list.output.find(name), std::string::npos) << list.output;
  const std::string log = (folder_ / "motors.log").string();
  setenv("SULCUS_STANDIN_LOG", log.c_str(), 1);
  const Result check = command("device --check phantom --seconds 0.3");
  unsetenv("SULCUS_STANDIN_LOG");
  EXPECT_NE(check.output.find("ok    library"), std::string::npos) << check.output;
  EXPECT_NE(check.output.find("servo "), std::string::npos) << check.output;
  EXPECT_NE(check.output.find("inkwell"), std::string::npos) << check.output;
  EXPECT_NE(check.output.find("calibrated"), std::string::npos) << check.output;
  setenv("SULCUS_LIBHD", "/nowhere/libHD.so", 1);
  const Result absent = command("device --check phantom");
  EXPECT_EQ(absent.code, 1);
  EXPECT_NE(absent.output.find("FAIL  phantom: "), std::string::npos) << absent.output;
  EXPECT_EQ(command("device").code, 2);
}

}  // namespace
}  // namespace sulcus
