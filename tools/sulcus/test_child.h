// Commands in a child of the test's process, to be killed.
#pragma once

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <thread>

namespace sulcus::test {

// Does `action` in a child, whose output goes nowhere; returns when `log` is there, or after 20 s.
template <class Action>
pid_t start_child(const std::filesystem::path& log, Action&& action) {
  const pid_t child = fork();
  if (child != 0) {
    for (int ms = 0; ms < 20000 && !std::filesystem::exists(log); ++ms)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return child;
  }
  std::freopen("/dev/null", "w", stderr);
  std::freopen("/dev/null", "w", stdout);
  try {
    action();
  } catch (const std::exception&) {
    _exit(1);
  }
  _exit(0);
}

}  // namespace sulcus::test
