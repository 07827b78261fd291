#include "verify/gnuplot.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "engine/numerics/error.h"

extern char** environ;

namespace sulcus {
namespace {

struct TemporaryFolder {
  std::filesystem::path path;
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "sulcus-chart-XXXXXX").string();
    if (!mkdtemp(pattern.data())) {
      throw EnvironmentError("no folder can be made in " + std::filesystem::temp_directory_path().string() +
                             " for a chart; set TMPDIR to a place with free space");
    }
    path = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
};

std::string read_all(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace

std::string draw_with_gnuplot(const std::string& script) {
  const TemporaryFolder folder;
  const std::string script_path = folder.path / "chart.gp", out = folder.path / "chart",
                    messages = folder.path / "messages";
  std::ofstream(script_path) << script;
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addopen(&actions, 2, messages.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  // -d: the user's own gnuplot settings do not change our charts.
  std::string program = "gnuplot", defaults = "-d", file = script_path;
  char* arguments[] = {program.data(), defaults.data(), file.data(), nullptr};
  pid_t child = 0;
  const int failed = posix_spawnp(&child, "gnuplot", &actions, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (failed != 0) {
    throw EnvironmentError(std::string("gnuplot, which draws the charts, cannot be started (") +
                           std::strerror(failed) + "); install it (Debian: gnuplot-nox)");
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  std::string drawing = read_all(out);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || drawing.empty()) {
    throw EnvironmentError("gnuplot could not draw a chart: " + read_all(messages) +
                           "; expected gnuplot 5.2 or later with the terminals svg and pngcairo");
  }
  return drawing;
}

std::string gnuplot_text(const std::string& text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'') out += '\'';
    out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return out + "'";
}

std::string gnuplot_number(double value) {
  if (!std::isfinite(value)) return "NaN";
  char text[40];
  std::snprintf(text, sizeof(text), "%.7g", value);
  return text;
}

}  // namespace sulcus
