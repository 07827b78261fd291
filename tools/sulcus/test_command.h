// Runs the sulcus command and looks at what it says and leaves, for its tests.
#pragma once

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "engine/numerics/test_shell.h"

namespace sulcus::test {

// The command behind a line of the shell such as "ulimit -v 1000 &&"; its standard error is in the output.
inline Result command_after(const std::string& line, const std::string& arguments) {
  return shell("{ " + line + " '" SULCUS_COMMAND "' " + arguments + "; } 2>&1");
}

inline Result command(const std::string& arguments) {
  return command_after("", arguments);
}

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

inline std::string read(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

inline std::string fingerprint_of(const std::filesystem::path& run) {
  const std::string text = read(run / "summary.json");
  const auto at = text.find("\"fingerprint\": \"");
  return at == std::string::npos ? "" : text.substr(at + 16, 16);
}

}  // namespace sulcus::test
