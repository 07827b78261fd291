// However a process ends while the motors push, the last thing that they are told is zero.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "hw_phantom/standin/control.h"

#ifdef __has_feature  // clang
#define SANITIZED (__has_feature(address_sanitizer) || __has_feature(thread_sanitizer))
#elif defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // gcc
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

namespace sulcus {
namespace {

struct Ending {
  int status = 0;  // of waitpid
  standin::Log log{};
};

std::string log_path(const char* how) {
  return std::string(SULCUS_BINARY_DIR) + "/phantom_exit_" + how + ".log";
}

pid_t start_child(const char* how) {
  const std::string path = log_path(how);
  std::filesystem::remove(path);
  const pid_t child = fork();
  if (child == 0) {
    for (const int number : {SIGINT, SIGQUIT, SIGHUP})
      std::signal(number, SIG_DFL);  // a shell may ignore them
    setenv("SULCUS_STANDIN_LOG", path.c_str(), 1);
    const int quiet = open("/dev/null", O_WRONLY);
    dup2(quiet, STDERR_FILENO);
    execl(PHANTOM_EXIT_CHILD, PHANTOM_EXIT_CHILD, how, nullptr);
    _exit(98);
  }
  return child;
}

standin::Log read_log(const char* how) {
  std::ifstream file(log_path(how), std::ios::binary);
  char bytes[sizeof(standin::Log)] = {};
  file.read(bytes, sizeof(bytes));
  EXPECT_TRUE(file.good());
  standin::Log log{};
  std::memcpy(&log, bytes, sizeof(bytes));
  return log;
}

Ending run_child(const char* how) {
  const pid_t child = start_child(how);
  Ending ending;
  waitpid(child, &ending.status, 0);
  ending.log = read_log(how);
  return ending;
}

void expect_killed_without_force(const char* how, int signal_number) {
  const Ending ending = run_child(how);
  EXPECT_TRUE(WIFSIGNALED(ending.status)) << ending.status;
  EXPECT_EQ(WTERMSIG(ending.status), signal_number);
  EXPECT_GT(ending.log.largest_force_N, 0.3);  // it did push
  EXPECT_EQ(ending.log.force_N, 0);
}

void expect_clean_exit(const char* how, std::uint64_t disabled) {
  const Ending ending = run_child(how);
  EXPECT_TRUE(WIFEXITED(ending.status)) << ending.status;
  EXPECT_EQ(WEXITSTATUS(ending.status), 0);
  EXPECT_GT(ending.log.largest_force_N, 0.3);
  EXPECT_EQ(ending.log.force_N, 0);
  EXPECT_EQ(ending.log.scheduler_runs, 0u);
  EXPECT_EQ(ending.log.disabled, disabled);
}

TEST(Exit, AbortLeavesNoForce) {
  expect_killed_without_force("abort", SIGABRT);
}
TEST(Exit, TerminateLeavesNoForce) {
  expect_killed_without_force("terminate", SIGABRT);
}
TEST(Exit, SegmentationFaultLeavesNoForce) {
#if SANITIZED
  GTEST_SKIP() << "the sanitizer handles this signal itself";
#else
  expect_killed_without_force("segv", SIGSEGV);
#endif
}
TEST(Exit, InterruptLeavesNoForce) {
  expect_killed_without_force("int", SIGINT);
}
TEST(Exit, TerminationLeavesNoForce) {
  expect_killed_without_force("term", SIGTERM);
}
TEST(Exit, QuitLeavesNoForce) {
  expect_killed_without_force("quit", SIGQUIT);
}
TEST(Exit, LimitOfTheSystemLeavesNoForce) {
  expect_killed_without_force("file_size", SIGXFSZ);
}
TEST(Exit, StackThatOverflowsLeavesNoForce) {
#if SANITIZED
  GTEST_SKIP() << "the sanitizer handles this signal itself";
#else
  expect_killed_without_force("overflow", SIGSEGV);
#endif
}
// Nobody would tick any more.
TEST(Exit, AbortInTheServosThreadLeavesNoForce) {
  expect_killed_without_force("servo_abort", SIGABRT);
}
TEST(Exit, SegmentationFaultInTheServosThreadLeavesNoForce) {
#if SANITIZED
  GTEST_SKIP() << "the sanitizer handles this signal itself";
#else
  expect_killed_without_force("servo_segv", SIGSEGV);
#endif
}
TEST(Exit, HaltLeavesNoForceUntilTheProcessGoesOn) {
  const pid_t child = start_child("halt");
  int status = 0;
  waitpid(child, &status, WUNTRACED);
  ASSERT_TRUE(WIFSTOPPED(status)) << status;
  const standin::Log halted = read_log("halt");
  EXPECT_GT(halted.largest_force_N, 0.3);
  EXPECT_EQ(halted.force_N, 0);
  kill(child, SIGCONT);
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}
TEST(Exit, ReaderThatGoesAwayEndsNothing) {
  expect_clean_exit("pipe", 1);
}
TEST(Exit, OrdinaryExitTearsDown) {
  expect_clean_exit("exit", 1);
}
TEST(Exit, ExitWithoutDisablingIsClean) {
  expect_clean_exit("skip_disable", 0);
}

}  // namespace
}  // namespace sulcus
