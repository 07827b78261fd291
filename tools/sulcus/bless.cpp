// `sulcus bless`: changes a golden, with a reason, from a clean tree, with tolerances that were measured.
#include <cstdio>
#include <fstream>
#include <sstream>

#include "engine/numerics/error.h"
#include "tools/sulcus/build_info.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/golden_pictures.h"
#include "tools/sulcus/process.h"
#include "tools/sulcus/support.h"
#include "tools/sulcus/temporary_folder.h"
#include "verify/golden.h"
#include "verify/golden_provenance.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

std::string read_text(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// What git says in the tree that `folder` belongs to; throws if it fails.
std::string git(const fs::path& folder, std::vector<std::string> arguments, const fs::path& log) {
  std::error_code error;
  fs::remove(log, error);
  arguments.insert(arguments.begin(), {"git", "-C", folder.string()});
  if (run_program(arguments, log) != 0) {
    throw InputError(folder.string() + ": git cannot say whether its tree is clean (" + last_line(log) +
                     "); goldens are changed in a clone of the repository");
  }
  return read_text(log);
}

void refuse_unclean_tree(const fs::path& golden, const fs::path& log) {
  if (!fs::is_directory(golden))
    throw InputError(golden.string() + " is not a folder; give another --golden");
  const std::string outside = ":(top,exclude)" + fs::absolute(golden).lexically_normal().filename().string();
  const std::string changed = git(golden, {"status", "--porcelain", "--", ":/", outside}, log);
  if (!changed.empty()) {
    throw InputError(
        "the tree has changes that are not committed, so nobody could make this golden again:\n" + changed +
        "commit them first");
  }
  if (!fs::equivalent(golden, SULCUS_GOLDEN_DIR)) return;
  std::string commit = git(golden, {"describe", "--always"}, log);
  commit.resize(commit.find_last_not_of('\n') + 1);
  const std::string built = build_provenance().at("git");
  if (built != commit)
    throw InputError("this program was built of " + built + ", the tree stands at " + commit +
                     "; build again");
}

struct Variant {
  std::string label;
  std::vector<std::string> overrides;
  std::uint64_t start_shift_seed = 0;
  bool same_work = true;
};

// Arithmetic that must not matter to the physics.
std::vector<Variant> variants_of(const Scenario& scenario) {
  const SolverSettings& solver = scenario.scene.solver;
  const bool single = solver.precision == Precision::single_precision;
  std::ostringstream tighter;
  tighter << "/solver/tolerance=" << solver.tolerance / 10;
  return {{"start moved by one ulp", {}, 1, true},
          {std::string(single ? "double" : "single") + " precision",
           {std::string("/solver/precision=") + (single ? "double" : "single")},
           0,
           true},
          {"solver tolerance / 10", {tighter.str()}, 0, false}};
}

RunData record(const BlessOptions& bless, const Variant& variant, bool pictures, const fs::path& out) {
  RunOptions options;
  options.scenario = bless.scenario;
  options.threads = bless.threads;
  options.out = out;
  options.overrides = variant.overrides;
  options.start_shift_seed = variant.start_shift_seed;
  options.pictures = pictures;
  if (!pictures) options.overrides.push_back("/solver/measure_error_every_steps=0");
  if (run_command(options) != 0) throw InputError(bless.scenario + ": does not run; no golden written");
  return read_run(out / "run.h5");
}

void print_changes(const std::vector<GoldenChange>& changes) {
  for (const GoldenChange& change : changes) {
    std::printf("%-48s %s -> %s %s", change.quantity.c_str(), change.before.c_str(), change.now.c_str(),
                change.unit.c_str());
    if (std::isfinite(change.relative)) std::printf("  (%.2g of it)", change.relative);
    std::printf("\n");
  }
  if (changes.empty()) std::printf("nothing changed but the reason\n");
}

}  // namespace

int bless_command(const BlessOptions& options) {
  if (options.why.find_first_not_of(" \t\n") == std::string::npos)
    throw InputError("a golden changes for a reason; give it with --why \"...\"");
  const TemporaryFolder temporary;
  refuse_unclean_tree(options.golden, temporary.path / "git.log");
  const Scenario scenario = load_scenario(find_scenario(options.scenario));
  if (!scenario.golden.kept)
    throw InputError(options.scenario + ": it keeps no golden (/golden/kept is false); bless another one");

  const RunData run = record(options, {}, true, temporary.path / "run");
  const std::vector<Check> statements = check_run(run, temporary.path / "run", {});
  if (!all_passed(statements)) {
    for (const Check& check : statements) {
      if (!check.passed) std::printf("%s\n", check_line(check).c_str());
    }
    std::printf("no golden written: a run that breaks a statement is no golden\n");
    return 1;
  }
  const std::vector<Variant> variants = variants_of(scenario);
  std::vector<RunData> runs;
  for (std::size_t v = 0; v < variants.size(); ++v)
    runs.push_back(record(options, variants[v], false, temporary.path / std::to_string(v)));
  std::vector<GoldenVariant> measured;
  for (std::size_t v = 0; v < variants.size(); ++v)
    measured.push_back({variants[v].label, &runs[v], variants[v].same_work});

  const fs::path folder = options.golden / scenario.name;
  const std::string before = read_text(folder / "golden.json");
  write_golden(run, folder, measured);
  write_golden_pictures(scenario, temporary.path / "run", folder);
  const std::vector<GoldenChange> changes = golden_changes(before, read_text(folder / "golden.json"));
  write_provenance(folder, options.why, run.header.build, changes);
  print_changes(changes);
  std::printf("%s\n", folder.c_str());
  return 0;
}

}  // namespace sulcus
