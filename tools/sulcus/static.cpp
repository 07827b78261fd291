// The place of rest of a scenario, recorded as a run of one step that ends there.
#include <cmath>
#include <cstdio>

#include "engine/numerics/error.h"
#include "engine/scene/statics.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/shots.h"
#include "tools/sulcus/support.h"
#include "verify/fingerprint.h"
#include "verify/summary.h"

namespace sulcus {
namespace {

// The step whose places of the motions are meant.
std::int64_t step_at(double time_s, const Scenario& scenario) {
  if (time_s < 0) return scenario.steps();
  const double step = std::floor(time_s / scenario.scene.step_s + 0.5);
  if (step > static_cast<double>(scenario.steps())) {
    throw InputError("--time-s: found " + std::to_string(time_s) + ", the scenario ends at " +
                     std::to_string(scenario.duration_s) + " s (/time/duration_s)");
  }
  return static_cast<std::int64_t>(step);
}

StepReport as_step(const Scene& scene, const StaticReport& found, double time_s) {
  StepReport report = make_report(scene);
  report.time_s = time_s;
  report.iterations = found.linear_iterations;
  report.residual = found.balance;
  report.converged = found.converged;
  report.finite = std::isfinite(found.balance);
  report.elastic_energy_J = found.elastic_energy_J;
  report.motion_forces = found.motion_forces;
  report.plane_forces = found.plane_forces;
  return report;
}

void print(const Scenario& scenario, const StaticReport& found) {
  std::printf(
      "%s: forces balance to %.1e of %.3g N, after %d iterations of Newton in %d load steps (%d of the "
      "linear "
      "solver)\n",
      scenario.name.c_str(), found.balance, found.largest_force_N, found.iterations, found.load_steps,
      found.linear_iterations);
  const auto force = [](const std::string& what, const Vec3& f) {
    std::printf("  %-28s (%.4g, %.4g, %.4g) N\n", what.c_str(), f[0], f[1], f[2]);
  };
  if (!scenario.fixed.empty()) force("fixed nodes hold with", found.support_force);
  for (std::size_t m = 0; m < found.motion_forces.size(); ++m)
    force("motion " + scenario.motions[m].name, found.motion_forces[m]);
  for (std::size_t p = 0; p < found.plane_forces.size(); ++p)
    force("plane " + std::to_string(p), found.plane_forces[p]);
}

}  // namespace

int static_command(const StaticOptions& options) {
  const Scenario scenario = load_scenario(find_scenario(options.scenario), options.overrides);
  const std::int64_t to = step_at(options.time_s, scenario);
  std::vector<std::string> warnings = scenario.warnings, notes;
  const Scene scene = make_scene(scenario, &warnings, &notes);
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());

  const int threads = threads_or_all(options.threads);
  std::vector<DeviceSample> no_hands(scene.settings.tools.size());
  State state = initial_state(scene, no_hands);
  const State start = state;
  StageClock clock;
  clock.start();
  const StaticReport found =
      solve_static(scene, {}, to, state, threads);  // refuses before anything is written
  clock.stage_done(Stage::solve);

  prepare_folder(options.out, options.force);
  RunHeader header = recording_header(scenario, scene, options.overrides, threads);
  const double time_s = static_cast<double>(to) * scenario.scene.step_s;
  if (to > 0) header.step_s = time_s;
  state.step = 1;
  RunWriter writer(options.out / "run.h5", header, start);
  for (const std::string& warning : warnings) writer.add_warning(warning);
  for (const std::string& note : notes) writer.add_event(0, note);
  for (const auto& [name, value] : topology_numbers(scene)) writer.set_number(name, value);
  writer.write_frame(start, 0);
  writer.write_step({}, as_step(scene, found, time_s), state, clock.seconds(), clock.total());
  writer.write_frame(state, time_s);
  writer.add_event(0, found.converged ? "the place of rest, by a static solve" : "stopped: " + found.problem);
  writer.set_number("static/balance", found.balance);
  writer.set_number("static/iterations", found.iterations);
  writer.set_number("static/load_steps", found.load_steps);
  writer.set_number("static/largest_force_N", found.largest_force_N);
  writer.set_number("inverted_elements_at_end", static_cast<double>(count_inverted(scene, state)));
  writer.finish(state);

  if (options.pictures) {
    std::vector<ShotFrame> frames;
    for (const Shot& shot : scenario.pictures.shots) frames.push_back({shot, state, {}});
    render_shots(scenario, scene, frames, options.out / "pictures");
  }
  const RunData run = read_run(options.out / "run.h5");
  write_summary(options.out / "summary.json", run, check_run(run, options.out, {}));
  print(scenario, found);
  std::printf("%s: fingerprint %s, in %s\n", scenario.name.c_str(), hex16(run.fingerprint()).c_str(),
              options.out.string().c_str());
  if (!found.converged) std::fprintf(stderr, "%s: %s\n", scenario.name.c_str(), found.problem.c_str());
  return found.converged ? 0 : 1;
}

}  // namespace sulcus
