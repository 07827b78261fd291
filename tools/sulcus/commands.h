// The sulcus command, one function a subcommand. Each returns the exit code: 0 fine, 1 a check failed. Input
// that is wrong leaves as InputError (exit code 2), surroundings that failed as EnvironmentError (3).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace sulcus {

struct RunOptions {
  std::string scenario;  // file, or the name of one in the scenarios' folder
  std::filesystem::path out;
  std::vector<std::string> overrides;  // "/json/pointer=value"
  int threads = 0;                     // 0: as many as the machine has
  bool force = false;                  // replace an earlier run in `out`
  bool pictures = true;
};
int run_command(const RunOptions& options);

struct VerifyOptions {
  std::filesystem::path run;     // folder of a run
  std::filesystem::path golden;  // folder of golden outputs; empty: statements only
};
int verify_command(const VerifyOptions& options);

int summary_command(const std::filesystem::path& run, const std::filesystem::path& golden);

struct ReplayOptions {
  std::filesystem::path recording;  // run.h5
  int threads = 0;
};
int replay_command(const ReplayOptions& options);

struct ReportOptions {
  std::vector<std::filesystem::path> runs;
  std::filesystem::path out = "report.html";
  std::filesystem::path golden;  // as in VerifyOptions
};
int report_command(const ReportOptions& options);

struct MeshOptions {
  std::filesystem::path label_map, pairs, out;
  double size_mm = 10;
};
int mesh_command(const MeshOptions& options);

struct GoldenOptions {
  std::filesystem::path run, golden;
};
int golden_command(const GoldenOptions& options);

int list_command(const std::filesystem::path& directory);

}  // namespace sulcus
