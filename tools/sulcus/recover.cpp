#include <cstdio>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/support.h"
#include "tools/sulcus/torn.h"
#include "verify/fingerprint.h"
#include "verify/session_log.h"
#include "verify/summary.h"

namespace sulcus {
namespace fs = std::filesystem;

namespace {

void note_end(const Scene& scene, const State& state, RunWriter& writer) {
  writer.set_number("inverted_elements_at_end", static_cast<double>(count_inverted(scene, state)));
  if (!scene.fracture) return;
  HangingRecord hanging;
  look_at_hanging(scene, state, hanging);
  record_torn(scene, state, hanging, writer);
}

}  // namespace

void record_log(const fs::path& log, const fs::path& out, const Scenario& scenario, const Scene& scene,
                int threads) {
  WorkspacePtr workspace = make_workspace(scene, threads);
  StepReport report = make_report(scene);
  const SessionEngine engine{[&](State& state, std::span<const DeviceSample> samples) {
                               step(scene, samples, state, report, *workspace);
                             },
                             [&](const State& state, RunWriter& writer) { note_end(scene, state, writer); }};
  const RecoveredSession session = record_session_log(log, out / "run.h5", engine);
  fs::remove(log);
  const RunData run = read_run(out / "run.h5");
  write_summary(out / "summary.json", run, check_run(run, out, {}));
  std::printf("%s: %lld steps, fingerprint %s, in %s\n", scenario.name.c_str(),
              static_cast<long long>(session.steps), hex16(run.fingerprint()).c_str(), out.string().c_str());
  if (!session.ended) {
    std::printf("cut off: %llu bytes behind the last complete chunk of the log were left out\n",
                static_cast<unsigned long long>(session.ignored_bytes));
  }
  print_session(run);
}

void print_session(const RunData& run) {
  if (!run.session) return;
  const auto number = [&](const char* name) {
    const auto found = run.numbers.find(name);
    return found == run.numbers.end() ? 0.0 : found->second;
  };
  std::printf("%-16s %.0f missed of %lld; %.0f steps with a sample held\n", "deadlines",
              number("session_missed_deadlines"), static_cast<long long>(run.steps),
              number("session_held_samples"));
  std::size_t ticks = 0;
  for (const auto& of_tool : run.session->ticks) ticks += of_tool.size();
  std::printf("%-16s %zu recorded, %.0f lost, %.0f states to look at lost\n", "servo ticks", ticks,
              number("session_ticks_lost"), number("session_frames_lost"));
  for (const Histogram& h : run.session->histograms) {
    std::printf("%-16s median %.4f ms, 99 %% within %.4f ms, at most %.4f ms\n",
                h.name.substr(0, h.name.size() - 2).c_str(), 1e3 * h.median_s, 1e3 * h.p99_s, 1e3 * h.max_s);
  }
}

int recover_command(const RecoverOptions& options) {
  const fs::path log = options.folder / "run.h5.log";
  if (!fs::exists(log))
    throw InputError(log.string() +
                     ": there is no log of a session or a run, so there is nothing to recover");
  const RunHeader header = read_session_log_header(log);
  const Scenario scenario = load_scenario_text(header.scenario_json, log.string(), ".");
  const Scene scene = make_scene(scenario);
  const RunHeader now = make_run_header(scene);
  if (now.rest_positions != header.rest_positions || now.tets != header.tets ||
      now.tool_names != header.tool_names) {
    throw InputError(log.string() +
                     ": the scenario in it gives another mesh or other tools than it was made with; was its "
                     "label map changed?");
  }
  record_log(log, options.folder, scenario, scene, threads_or_all(options.threads));
  return 0;
}

}  // namespace sulcus
