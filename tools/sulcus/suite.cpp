// `sulcus suite`: every scenario, run and replayed in processes of its own, so that none can spoil another.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <mutex>
#include <regex>
#include <thread>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/process.h"
#include "tools/sulcus/support.h"
#include "verify/junit.h"
#include "verify/suite_index.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::string name_of(const ScenarioSummary& scenario) {
  return scenario.name.empty() ? scenario.path.stem().string() : scenario.name;
}

std::vector<ScenarioSummary> chosen_scenarios(const SuiteOptions& options) {
  std::regex filter;
  try {
    filter = std::regex(options.filter.empty() ? ".*" : options.filter);
  } catch (const std::regex_error&) {
    throw InputError("--filter " + options.filter + ": is no regular expression; give one such as '^brain_'");
  }
  std::vector<ScenarioSummary> chosen;
  std::size_t left_out = 0;
  for (ScenarioSummary& scenario : list_scenarios(options.scenarios)) {
    if (!std::regex_search(name_of(scenario), filter)) continue;
    for (const ScenarioSummary& other : chosen) {
      if (name_of(other) == name_of(scenario))
        throw InputError(other.path.string() + " and " + scenario.path.string() + ": both are called \"" +
                         name_of(scenario) + "\"; give one another name");
    }
    if (!scenario.missing.empty()) {
      std::printf("left out  %s: %s\n", name_of(scenario).c_str(), scenario.missing.c_str());
      ++left_out;
      continue;
    }
    chosen.push_back(std::move(scenario));
  }
  if (chosen.empty() && left_out == 0) {
    throw InputError("no scenario in " + options.scenarios.string() + " has a name that fits --filter '" +
                     options.filter + "'; see `sulcus list`");
  }
  return chosen;
}

void prepare_suite_folder(const fs::path& out, bool force) {
  if (fs::exists(out) && !fs::is_directory(out))
    throw InputError(out.string() + " is not a folder; give another --out");
  if (fs::exists(out) && !fs::is_empty(out) && !force)
    throw InputError(out.string() +
                     " exists already; give another --out, or --force to replace what is in it");
  std::error_code error;
  fs::create_directories(out, error);
  if (error) {
    throw EnvironmentError(out.string() + ": cannot be made (" + error.message() +
                           "); give an --out that can be written to");
  }
}

Check program_check(const std::string& name, const std::string& kind, int code, const fs::path& log) {
  if (code != 0) return failed_check(name, kind, "exit code " + std::to_string(code) + ": " + last_line(log));
  Check check = check_at_most(name, kind, 0, 0, "", 1, last_line(log));
  check.value = check.bound = check.margin = std::nan("");
  return check;
}

SuiteEntry try_scenario(const SuiteOptions& options, const ScenarioSummary& scenario, int threads,
                        std::mutex& judge) {
  const auto start = Clock::now();
  const std::string name = name_of(scenario);
  const fs::path folder = options.out / name, log = options.out / (name + ".log");
  std::error_code error;
  fs::remove(log, error);
  SuiteEntry entry;
  entry.name = name;
  entry.reproduce = "sulcus suite --filter '^" + name + "$' --out DIR";
  const std::string program = own_program();
  const auto finish = [&] {
    entry.wall_s = seconds_since(start);
    return entry;
  };

  std::vector<std::string> run = {program, "run",       scenario.path,          "--out",
                                  folder,  "--threads", std::to_string(threads)};
  if (options.force && fs::exists(folder)) run.push_back("--force");
  entry.checks.push_back(program_check("runs", "statement", run_program(run, log), log));
  if (!entry.checks.back().passed) return finish();

  // with another number of threads than the run had: the bits must not know
  const int other = threads == 1 ? 2 : 1;
  const int replayed =
      run_program({program, "replay", folder / "run.h5", "--threads", std::to_string(other)}, log);
  entry.checks.push_back(program_check("replays", "bits", replayed, log));

  std::vector<std::string> report = {program, "report", folder, "--out", folder / "report.html"};
  if (!options.golden.empty()) report.insert(report.end(), {"--golden", options.golden});
  const int reported = run_program(report, log);
  if (reported == 0) entry.report = name + "/report.html";
  if (reported != 0) entry.checks.push_back(program_check("report", "statement", reported, log));

  const std::lock_guard lock(judge);  // HDF5 knows no threads
  const RunData data = read_run(folder / "run.h5");
  for (Check& check : check_run(data, folder, options.golden)) entry.checks.push_back(std::move(check));
  entry.summary = summarise(data);
  write_junit(folder / "junit.xml", name, entry.checks);
  return finish();
}

void print_entry(const SuiteEntry& entry, std::size_t done, std::size_t all) {
  const auto failed = std::count_if(entry.checks.begin(), entry.checks.end(),
                                    [](const Check& check) { return !check.passed; });
  std::printf("%s  %-28s %3zu checks, %5.1f s  (%zu of %zu)\n", failed == 0 ? "PASS" : "FAIL",
              entry.name.c_str(), entry.checks.size(), entry.wall_s, done, all);
  for (const Check& check : entry.checks) {
    if (!check.passed) std::printf("      %s\n", check_line(check).c_str());
  }
  std::fflush(stdout);
}

}  // namespace

int suite_command(const SuiteOptions& options) {
  const auto start = Clock::now();
  const std::vector<ScenarioSummary> scenarios = chosen_scenarios(options);
  if (scenarios.empty()) return 0;  // all left out, which was said
  prepare_suite_folder(options.out, options.force);
  const int cores = threads_or_all(0);
  const int jobs = std::min(options.jobs > 0 ? options.jobs : cores, static_cast<int>(scenarios.size()));
  const int threads = std::max(1, cores / jobs);

  std::vector<SuiteEntry> entries(scenarios.size());
  std::atomic<std::size_t> next = 0;
  std::size_t done = 0;
  std::mutex judge, print;
  const auto work = [&] {
    for (std::size_t s; (s = next++) < scenarios.size();) {
      try {
        entries[s] = try_scenario(options, scenarios[s], threads, judge);
      } catch (const std::exception& error) {
        entries[s].name = name_of(scenarios[s]);
        entries[s].checks.push_back(failed_check("runs", "statement", error.what()));
        entries[s].reproduce = "sulcus suite --filter '^" + entries[s].name + "$' --out DIR";
      }
      const std::lock_guard lock(print);
      print_entry(entries[s], ++done, scenarios.size());
    }
  };
  std::vector<std::thread> workers;
  for (int job = 1; job < jobs; ++job) workers.emplace_back(work);
  work();
  for (std::thread& worker : workers) worker.join();

  const double wall_s = seconds_since(start);
  std::vector<JunitSuite> suites;
  for (const SuiteEntry& entry : entries) suites.push_back({entry.name, entry.checks, entry.wall_s});
  write_file_atomically(options.out / "junit.xml", junit_xml(suites));
  write_file_atomically(options.out / "summary.md", suite_markdown(entries, wall_s));
  write_file_atomically(options.out / "index.html", suite_html(entries, wall_s));
  const SuiteTotals totals = totals_of(entries);
  std::printf("%zu of %zu scenarios hold, %zu checks, %.0f s: %s\n", totals.scenarios - totals.failed,
              totals.scenarios, totals.checks, wall_s,
              fs::absolute(options.out / "index.html").lexically_normal().c_str());
  return totals.failed == 0 ? 0 : 1;
}

}  // namespace sulcus
