// `sulcus fuzz`: random scenarios, judged by statements only.
#include <algorithm>
#include <chrono>
#include <cstdio>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/fuzz_scenario.h"
#include "tools/sulcus/process.h"
#include "tools/sulcus/support.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

enum class Outcome { holds, refused, fails };

// Runs in a process of its own: a crash is an outcome, not an end. Leaves nothing but the scenario.
Outcome try_seed(const fs::path& scenario, const fs::path& folder, std::string& why) {
  const fs::path log = folder.string() + ".log", run = folder;
  std::error_code error;
  const int code = run_program({own_program(), "run", scenario, "--out", run, "--no-pictures"}, log);
  Outcome outcome = Outcome::holds;
  if (code == 2) {
    outcome = Outcome::refused;
    why = last_line(log);
  } else if (code != 0) {
    outcome = Outcome::fails;
    why = "exit code " + std::to_string(code) + ": " + last_line(log);
  } else {
    for (const Check& check : check_run(read_run(run / "run.h5"), run, {})) {
      // a hand that never finds the tissue, or a tool that still settles at the end, in a scene that nobody
      // made on purpose, is no fault
      const bool may_be_empty = check.name == "pushing" || check.name == "energy_at_rest";
      if (check.passed || (may_be_empty && check.comparisons == 0)) continue;
      outcome = Outcome::fails;
      why += (why.empty() ? "" : "; ") + check_line(check);
    }
  }
  fs::remove_all(run, error);
  fs::remove(log, error);
  return outcome;
}

}  // namespace

int fuzz_command(const FuzzOptions& options) {
  std::error_code error;
  fs::create_directories(options.out, error);
  if (error)
    throw EnvironmentError(options.out.string() + ": cannot be made (" + error.message() +
                           "); give an --out that can be written to");
  const auto start = std::chrono::steady_clock::now();
  const auto seconds = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  std::int64_t tried = 0, refused = 0, failed = 0;
  std::uint64_t seed = options.seed;
  for (; seconds() < options.seconds && (options.seeds == 0 || tried < options.seeds); ++seed, ++tried) {
    const fs::path scenario = options.out / ("fuzz_" + std::to_string(seed) + ".json");
    write_file_atomically(scenario, fuzz_scenario(seed));
    std::string why;
    const Outcome outcome = try_seed(scenario, options.out / ("run_" + std::to_string(seed)), why);
    refused += outcome == Outcome::refused;
    failed += outcome == Outcome::fails;
    if (outcome == Outcome::fails) {
      std::printf("FAIL  seed %llu: %s\n      sulcus run %s --out DIR && sulcus verify DIR\n",
                  static_cast<unsigned long long>(seed), why.c_str(), scenario.c_str());
    } else {
      if (outcome == Outcome::refused)
        std::printf("refused  seed %llu: %s\n", static_cast<unsigned long long>(seed), why.c_str());
      fs::remove(scenario, error);
    }
    std::fflush(stdout);
  }
  std::printf("fuzz: seeds %llu to %llu, %lld run, %lld refused as scenarios, %lld failed, %.0f s\n",
              static_cast<unsigned long long>(options.seed), static_cast<unsigned long long>(seed - 1),
              static_cast<long long>(tried - refused), static_cast<long long>(refused),
              static_cast<long long>(failed), seconds());
  if (tried == refused) {
    std::printf("nothing was judged: give more --seconds\n");
    return 1;
  }
  return failed == 0 ? 0 : 1;
}

}  // namespace sulcus
