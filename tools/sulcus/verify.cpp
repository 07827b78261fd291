#include <cmath>
#include <cstdio>

#include "tools/sulcus/commands.h"
#include "tools/sulcus/golden_pictures.h"
#include "tools/sulcus/support.h"
#include "verify/fingerprint.h"
#include "verify/junit.h"
#include "verify/png.h"
#include "verify/report.h"
#include "verify/summary.h"

namespace sulcus {
namespace fs = std::filesystem;

int verify_command(const VerifyOptions& options) {
  const RunData run = read_run(options.run / "run.h5");
  const std::vector<Check> checks = check_run(run, options.run, options.golden);
  for (const Check& check : checks) std::printf("%s\n", check_line(check).c_str());
  write_junit(options.run / "junit.xml", run.header.scenario_name, checks);
  write_summary(options.run / "summary.json", run, checks);
  return all_passed(checks) ? 0 : 1;
}

int summary_command(const fs::path& dir, const fs::path& golden) {
  const RunData run = read_run(dir / "run.h5");
  const RunSummary summary = summarise(run);
  const std::vector<Check> checks = check_run(run, dir, golden);
  const auto number = [&](const char* name) {
    const auto found = run.numbers.find(name);
    return found == run.numbers.end() ? 0.0 : found->second;
  };
  std::printf("%-16s %s\n", "scenario", summary.name.c_str());
  std::printf("%-16s %.0f cells, %lld nodes, %lld tetrahedra\n", "mesh", number("cells"),
              static_cast<long long>(summary.nodes), static_cast<long long>(summary.tets));
  std::printf("%-16s %lld of %g s on %d threads\n", "steps", static_cast<long long>(summary.steps),
              summary.step_s, summary.threads);
  std::printf("%-16s median %.2f ms, 95 %% within %.2f ms\n", "time per step", 1e3 * summary.total.median_s,
              1e3 * summary.total.p95_s);
  std::printf("%-16s median %.0f, at most %.0f a step\n", "iterations", summary.median_iterations,
              summary.max_iterations);
  std::printf("%-16s median %.1e, at most %.1e of the velocity increment (%lld steps measured)\n",
              "solver error", summary.median_solver_error, summary.max_solver_error,
              static_cast<long long>(summary.solver_errors_measured));
  if (run.numbers.count("single_precision_error") != 0) {
    std::printf("%-16s at most %.1e of it, against double precision\n", "of single",
                number("single_precision_error"));
  }
  for (const ToolSummary& tool : summary.tools) {
    std::printf("%-16s at most %.3f N shown, %.2f mm penetration, %lld contacts\n", tool.name.c_str(),
                tool.max_displayed_force_N, 1e3 * tool.max_penetration_m,
                static_cast<long long>(tool.max_contacts));
  }
  print_session(run);
  for (const Check& check : checks)
    std::printf("%-16s %s\n", check.passed ? "holds" : "BROKEN", check.name.c_str());
  std::printf("%-16s %s\n", "fingerprint", hex16(summary.fingerprint).c_str());
  std::printf("%-16s %s\n", "verdict", all_passed(checks) ? "everything holds" : "NOT everything holds");
  return all_passed(checks) ? 0 : 1;
}

int report_command(const ReportOptions& options) {
  std::vector<RunData> runs;
  runs.reserve(options.runs.size());
  std::vector<RunReportInput> inputs;
  for (const fs::path& dir : options.runs) {
    runs.push_back(read_run(dir / "run.h5"));
    const RunData& run = runs.back();
    const Scenario scenario = load_scenario_text(run.header.scenario_json, (dir / "run.h5").string(), ".");
    RunReportInput input;
    input.name = scenario.title.empty() ? scenario.name : scenario.title;
    input.description = scenario.description;
    input.run = &run;
    input.checks = check_run(run, dir, options.golden);
    if (!options.golden.empty() && scenario.golden.kept) {
      const fs::path golden = golden_folder(options.golden, run.header.scenario_name);
      input.golden = golden_bands(golden);
      input.differences = differing_pictures(dir, golden, scenario.golden);
    }
    for (const fs::path& file : picture_files(dir)) {
      std::string caption = file.stem().string().substr(3);
      for (char& c : caption) c = c == '_' ? ' ' : c;
      double time_s = std::nan("");
      for (const Shot& shot : scenario.pictures.shots) {
        if (shot.name == file.stem().string().substr(3)) time_s = shot.time_s;
      }
      input.pictures.push_back({caption, read_png(file), time_s});
    }
    input.reproduce = "sulcus run " + scenario.name + " --out DIR";
    if (run.session) input.reproduce = "sulcus replay " + (dir / "run.h5").string();
    for (const std::string& override : run.session ? std::vector<std::string>() : run.header.overrides)
      input.reproduce += " --set '" + override + "'";
    inputs.push_back(std::move(input));
  }
  write_report(inputs, options.out);
  std::printf("%s\n", fs::absolute(options.out).lexically_normal().c_str());
  return 0;
}

}  // namespace sulcus
