#include <cmath>
#include <cstdio>
#include <random>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/shots.h"
#include "tools/sulcus/support.h"
#include "tools/sulcus/torn.h"
#include "verify/fingerprint.h"
#include "verify/step_tree.h"
#include "verify/summary.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

std::vector<DeviceSample> read_devices(std::vector<std::unique_ptr<Device>>& devices, double time_s) {
  std::vector<DeviceSample> samples(devices.size());
  for (std::size_t d = 0; d < devices.size(); ++d) {
    const DeviceError error = devices[d]->read(time_s, samples[d]);
    if (error == DeviceError::ended) {
      throw InputError("device " + std::to_string(d) + ": its trajectory has no sample for " +
                       std::to_string(time_s) + " s; let its last way-point be at or after /time/duration_s");
    }
    if (error != DeviceError::none) {
      throw EnvironmentError("device " + std::to_string(d) + ": failed at " + std::to_string(time_s) + " s");
    }
  }
  return samples;
}

void print_warnings(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
}

// The clock, and the hashes, which take time that is none of the step's.
struct Observers : StageObserver {
  Observers(StageClock& the_clock, StepTree& the_tree) : clock(the_clock), tree(the_tree) {}
  void stage_done(Stage stage) override {
    clock.stage_done(stage);
    tree.stage_done(stage);
    clock.go_on();
  }
  StageClock& clock;
  StepTree& tree;
};

// Every coordinate one ulp up or down, at random.
void shift_by_an_ulp(std::uint64_t seed, State& state) {
  std::mt19937_64 random(seed);
  for (double& x : state.positions) x = std::nextafter(x, random() & 1 ? HUGE_VAL : -HUGE_VAL);
}

// Frames of the state at the moments of the pictures.
class ShotCollector {
 public:
  ShotCollector(const Scenario& scenario) : scenario_(scenario) {}

  void look(const State& state) {
    const double time_s = static_cast<double>(state.step) * scenario_.scene.step_s;
    for (const Shot& shot : scenario_.pictures.shots) {
      if (std::fabs(shot.time_s - time_s) <= 0.5 * scenario_.scene.step_s && !taken(shot.name)) {
        frames_.push_back({shot, state});
      }
    }
  }
  const std::vector<ShotFrame>& frames() const { return frames_; }

 private:
  bool taken(const std::string& name) const {
    for (const ShotFrame& frame : frames_) {
      if (frame.shot.name == name) return true;
    }
    return false;
  }
  const Scenario& scenario_;
  std::vector<ShotFrame> frames_;
};

}  // namespace

int run_command(const RunOptions& options) {
  const fs::path path = find_scenario(options.scenario);
  const Scenario scenario = load_scenario(path, options.overrides);
  std::vector<std::string> warnings = scenario.warnings;
  std::vector<std::unique_ptr<Device>> devices = make_devices(scenario);
  for (auto& device : devices) {
    device->open();
    device->calibrate();
    device->arm();
  }
  std::vector<std::string> notes;
  const Scene scene = make_scene(scenario, &warnings, &notes);
  print_warnings(warnings);
  prepare_folder(options.out, options.force);

  const int threads = threads_or_all(options.threads);
  const double h = scenario.scene.step_s;
  State state = initial_state(scene, read_devices(devices, 0));
  if (options.start_shift_seed != 0) shift_by_an_ulp(options.start_shift_seed, state);
  RunHeader header = recording_header(scenario, scene, options.overrides, threads);
  header.stage_leaves = stage_leaf_names();
  RunWriter writer(options.out / "run.h5", header, state);
  for (const std::string& warning : warnings) writer.add_warning(warning);
  for (const std::string& note : notes) writer.add_event(0, note);
  if (options.start_shift_seed != 0)
    writer.add_event(0, "every coordinate was moved by one ulp at the start");
  for (const auto& [name, value] : topology_numbers(scene)) writer.set_number(name, value);

  WorkspacePtr workspace = make_workspace(scene, threads);
  StepReport report = make_report(scene);
  ShotCollector shots(scenario);
  StageClock clock;
  StepTree tree(*workspace);
  Observers observers(clock, tree);
  shots.look(state);
  writer.write_frame(state, 0);
  const std::int64_t steps = scenario.steps();
  bool torn = false;
  HangingRecord hanging;
  {
    Progress progress(scenario.name + ": steps", steps);
    for (std::int64_t n = 0; n < steps; ++n) {
      const std::vector<DeviceSample> samples = read_devices(devices, static_cast<double>(n + 1) * h);
      const int every = scenario.measure_error_every_steps;
      if (every > 0 && n % every == every - 1) {
        writer.write_solver_error(n, measure_solver_error(scene, samples, state, threads));
      }
      tree.begin(samples);
      clock.start();
      step(scene, samples, state, report, *workspace, &observers);
      writer.write_step(samples, report, state, clock.seconds(), clock.total(), tree.hashes());
      for (std::size_t t = 0; t < devices.size(); ++t) {
        devices[t]->write(
            {report.tools[t].displayed_force, report.tools[t].displayed_torque, report.time_s + 2 * h});
      }
      if (!report.finite) {
        writer.add_event(n,
                         "the state is no longer finite, or the matrix was not positive definite; stopped");
        std::fprintf(stderr, "%s: step %lld: the state is no longer finite; the run stops here\n",
                     scenario.name.c_str(), static_cast<long long>(n));
        break;
      }
      if (report.fracture && report.fracture->by_criterion > 0 && !torn) {
        writer.add_event(n, "the tissue begins to tear");
        torn = true;
      }
      shots.look(state);
      if (scene.fracture && state.step % scenario.frame_every_steps == 0)
        look_at_hanging(scene, state, hanging);
      if (state.step % scenario.frame_every_steps == 0) writer.write_frame(state, report.time_s);
      progress.at(n + 1);
    }
  }
  for (auto& device : devices) device->close();
  writer.set_number("inverted_elements_at_end", static_cast<double>(count_inverted(scene, state)));
  if (scene.fracture) record_torn(scene, state, hanging, writer);
  writer.finish(state);

  if (options.pictures) render_shots(scenario, scene, shots.frames(), options.out / "pictures");
  const RunData run = read_run(options.out / "run.h5");
  write_summary(options.out / "summary.json", run, check_run(run, options.out, {}));
  std::printf("%s: %lld steps, fingerprint %s, in %s\n", scenario.name.c_str(),
              static_cast<long long>(run.steps), hex16(run.fingerprint()).c_str(),
              options.out.string().c_str());
  return 0;
}

}  // namespace sulcus
