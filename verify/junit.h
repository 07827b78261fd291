// Checks as a JUnit file, which continuous-integration services show.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "verify/check.h"

namespace sulcus {

struct JunitSuite {
  std::string name;  // of the scenario
  std::span<const Check> checks;
  double wall_s = -1;  // s; negative: not said
};

// One test suite each, one test case a check (classname: its kind); failed ones carry their detail. Valid
// XML 1.0 in UTF-8 whatever the texts hold: bytes that XML does not allow become '?'.
std::string junit_xml(std::span<const JunitSuite> suites);
std::string junit_xml(const std::string& suite, std::span<const Check> checks);

// Writes it atomically. Throws EnvironmentError with the place and the remedy.
void write_junit(const std::filesystem::path& path, const std::string& suite, std::span<const Check> checks);

}  // namespace sulcus
