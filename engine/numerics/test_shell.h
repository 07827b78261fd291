// Runs a line of the shell, for tests.
#pragma once

#include <sys/wait.h>

#include <cstdio>
#include <string>

namespace sulcus::test {

struct Result {
  int code = -1;       // -1: no exit
  std::string output;  // standard output, and what the line sends there
};

inline Result shell(const std::string& line) {
  Result result;
  FILE* pipe = popen(line.c_str(), "r");
  if (pipe == nullptr) return result;
  char buffer[4096];
  for (std::size_t n; (n = fread(buffer, 1, sizeof buffer, pipe)) > 0;) result.output.append(buffer, n);
  const int status = pclose(pipe);
  result.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return result;
}

}  // namespace sulcus::test
