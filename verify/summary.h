// The summary of a run: some numbers for people and scripts, of a recording and its checks.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "verify/check.h"
#include "verify/recording.h"

namespace sulcus {

struct TimeOfStep {
  double median_s = 0;  // s, wall clock
  double p95_s = 0;     // s, 95 % of the steps took no longer
};

struct ToolSummary {
  std::string name;
  double max_contact_force_N = 0;
  double max_displayed_force_N = 0;
  double max_contact_torque_N_m = 0;
  double max_penetration_m = 0;
  std::int64_t max_contacts = 0;
  std::int64_t steps_in_contact = 0;
};

// Statistics over all steps; NaN where nothing was recorded.
struct RunSummary {
  std::string name;
  std::uint64_t fingerprint = 0;
  std::int64_t steps = 0, nodes = 0, tets = 0;
  int threads = 1;
  double step_s = 0;
  TimeOfStep total;
  std::map<std::string, TimeOfStep> stages;  // by name of the stage
  double median_iterations = 0, max_iterations = 0, converged_share = 0;
  double median_solver_error = 0, max_solver_error = 0;  // of the steps that were measured
  std::int64_t solver_errors_measured = 0;
  std::vector<ToolSummary> tools;
};
RunSummary summarise(const RunData& run);

// summary.json: name, fingerprint (16 hexadecimal digits), steps, step_s, threads, mesh {nodes, tets, cells,
// ...: the recorded numbers}, time_per_step {median_ms, p95_ms, stages}, solver {...}, tools [...], verdicts
// {passed, checks [...]}, warnings. Numbers that are not finite are null.
std::string summary_json(const RunData& run, std::span<const Check> checks);

// Writes it atomically. Throws EnvironmentError with the place and the remedy.
void write_summary(const std::filesystem::path& path, const RunData& run, std::span<const Check> checks);

// Nearest-rank quantile, share in [0, 1]; NaN of nothing and of NaN.
double quantile(std::vector<double> values, double share);

}  // namespace sulcus
