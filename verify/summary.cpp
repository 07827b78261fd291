#include "verify/summary.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "verify/fingerprint.h"

namespace sulcus {

namespace {

using Json = nlohmann::ordered_json;

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

std::vector<double> values_of(const RunData& run, const std::string& name) {
  const Series* series = run.find(name);
  return series == nullptr ? std::vector<double>() : series->values;
}

// |v| at every step of a series of three components.
std::vector<double> norms_of(const RunData& run, const std::string& name) {
  const Series* series = run.find(name);
  std::vector<double> norms;
  if (series == nullptr || series->components != 3) return norms;
  for (std::size_t i = 0; i + 2 < series->values.size(); i += 3)
    norms.push_back(Vec3(series->values[i], series->values[i + 1], series->values[i + 2]).norm());
  return norms;
}

// NaN if there is none, or if one of them is.
double largest(const std::vector<double>& values) {
  double found = values.empty() ? nothing : values[0];
  for (const double value : values) {
    if (std::isnan(value)) return value;
    found = std::max(found, value);
  }
  return found;
}

TimeOfStep time_of(const RunData& run, const std::string& name) {
  const std::vector<double> seconds = values_of(run, name);
  return {quantile(seconds, 0.5), quantile(seconds, 0.95)};
}

ToolSummary summarise_tool(const RunData& run, std::size_t tool) {
  const std::string prefix = "tools/" + std::to_string(tool) + "/";
  ToolSummary summary;
  summary.name = run.header.tool_names[tool];
  summary.max_contact_force_N = largest(norms_of(run, prefix + "contact_force_N"));
  summary.max_displayed_force_N = largest(norms_of(run, prefix + "displayed_force_N"));
  summary.max_contact_torque_N_m = largest(norms_of(run, prefix + "contact_torque_N_m"));
  summary.max_penetration_m = largest(values_of(run, prefix + "max_penetration_m"));
  for (const double contacts : values_of(run, prefix + "contacts")) {
    if (!(contacts > 0 && contacts < 1e9)) continue;
    summary.max_contacts = std::max(summary.max_contacts, static_cast<std::int64_t>(contacts));
    ++summary.steps_in_contact;
  }
  return summary;
}

// A number that JSON can hold; whole numbers without a decimal point.
Json json_number(double value) {
  if (!std::isfinite(value)) return nullptr;
  if (value == std::floor(value) && std::abs(value) < 1e15) return static_cast<std::int64_t>(value);
  return value;
}

Json json_time(const TimeOfStep& time) {
  return {{"median_ms", json_number(time.median_s * 1e3)}, {"p95_ms", json_number(time.p95_s * 1e3)}};
}

Json json_check(const Check& check) {
  return {{"name", check.name},
          {"kind", check.kind},
          {"passed", check.passed},
          {"value", json_number(check.value)},
          {"bound", json_number(check.bound)},
          {"unit", check.unit},
          {"margin", json_number(check.margin)},
          {"comparisons", check.comparisons},
          {"detail", check.detail}};
}

}  // namespace

double quantile(std::vector<double> values, double share) {
  const auto is_nan = [](double value) { return std::isnan(value); };
  if (values.empty() || std::any_of(values.begin(), values.end(), is_nan)) return nothing;
  std::sort(values.begin(), values.end());
  const double rank = std::ceil(share * static_cast<double>(values.size()));
  const auto index = static_cast<std::size_t>(std::max(rank, 1.0)) - 1;
  return values[std::min(index, values.size() - 1)];
}

RunSummary summarise(const RunData& run) {
  RunSummary summary;
  summary.name = run.header.scenario_name;
  summary.fingerprint = run.fingerprint();
  summary.steps = run.steps;
  summary.nodes = run.header.node_count();
  summary.tets = run.header.tet_count();
  summary.threads = run.header.threads;
  summary.step_s = run.header.step_s;
  summary.total = time_of(run, "stage/total_s");
  for (const char* stage : stage_names)
    summary.stages[stage] = time_of(run, "stage/" + std::string(stage) + "_s");

  const std::vector<double> iterations = values_of(run, "solver/iterations");
  summary.median_iterations = quantile(iterations, 0.5);
  summary.max_iterations = largest(iterations);
  const std::vector<double> converged = values_of(run, "solver/converged");
  const auto good = std::count(converged.begin(), converged.end(), 1.0);
  summary.converged_share =
      converged.empty() ? nothing : static_cast<double>(good) / static_cast<double>(converged.size());
  std::vector<double> errors;
  for (const SolverErrorSample& sample : run.solver_errors) errors.push_back(sample.error);
  summary.solver_errors_measured = static_cast<std::int64_t>(errors.size());
  summary.median_solver_error = quantile(errors, 0.5);
  summary.max_solver_error = largest(errors);

  for (std::size_t tool = 0; tool < run.header.tool_names.size(); ++tool)
    summary.tools.push_back(summarise_tool(run, tool));
  return summary;
}

std::string summary_json(const RunData& run, std::span<const Check> checks) {
  const RunSummary summary = summarise(run);
  Json json;
  json["name"] = summary.name;
  json["fingerprint"] = hex16(summary.fingerprint);
  json["steps"] = summary.steps;
  json["step_s"] = json_number(summary.step_s);
  json["threads"] = summary.threads;
  json["mesh"] = {{"nodes", summary.nodes}, {"tets", summary.tets}};
  for (const auto& [name, value] : run.numbers)
    if (!json["mesh"].contains(name)) json["mesh"][name] = json_number(value);
  json["time_per_step"] = json_time(summary.total);
  for (const char* stage : stage_names)
    json["time_per_step"]["stages"][stage] = json_time(summary.stages.at(stage));
  json["solver"] = {{"iterations_median", json_number(summary.median_iterations)},
                    {"iterations_max", json_number(summary.max_iterations)},
                    {"converged_share", json_number(summary.converged_share)},
                    {"errors_measured", summary.solver_errors_measured},
                    {"error_median", json_number(summary.median_solver_error)},
                    {"error_max", json_number(summary.max_solver_error)}};
  json["tools"] = Json::array();
  for (const ToolSummary& tool : summary.tools)
    json["tools"].push_back({{"name", tool.name},
                             {"max_force_N", json_number(tool.max_contact_force_N)},
                             {"max_displayed_force_N", json_number(tool.max_displayed_force_N)},
                             {"max_torque_N_m", json_number(tool.max_contact_torque_N_m)},
                             {"max_penetration_mm", json_number(tool.max_penetration_m * 1e3)},
                             {"max_contacts", tool.max_contacts},
                             {"steps_in_contact", tool.steps_in_contact}});
  json["verdicts"] = {{"passed", all_passed(checks)}, {"checks", Json::array()}};
  for (const Check& check : checks) json["verdicts"]["checks"].push_back(json_check(check));
  json["warnings"] = run.warnings;
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void write_summary(const std::filesystem::path& path, const RunData& run, std::span<const Check> checks) {
  write_file_atomically(path, summary_json(run, checks));
}

}  // namespace sulcus
