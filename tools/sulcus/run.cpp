#include <cmath>
#include <cstdio>
#include <random>

#include "engine/numerics/error.h"
#include "engine/scene/pieces.h"
#include "engine/scene/precision_error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/recorded_hand.h"
#include "tools/sulcus/run_recorder.h"
#include "tools/sulcus/shots.h"
#include "tools/sulcus/support.h"
#include "tools/sulcus/torn.h"
#include "verify/fingerprint.h"
#include "verify/step_tree.h"
#include "verify/summary.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

// What the tools are given at each step. A sample that is not new or not finite is replaced by the last sound
// one, as in a session; a tool whose way is over stays where it ended.
class Hands {
 public:
  explicit Hands(const Scenario& scenario) : devices_(make_devices(scenario)), told_(devices_.size(), false) {
    for (const ToolHand& hand : scenario.hands) {
      const Waypoint& start = hand.script.waypoints.front();
      samples_.emplace_back();
      samples_.back().position = start.position_m;
      samples_.back().orientation = normalised(start.orientation);
    }
    for (auto& device : devices_) {
      device->open();
      device->calibrate();
      device->arm();
    }
  }

  // False: a device has failed. What is odd is appended to events.
  bool read(double time_s, std::vector<std::string>& events) {
    bool held = false;
    for (std::size_t d = 0; d < devices_.size(); ++d) {
      const std::string name = "device " + std::to_string(d) + " (" + devices_[d]->capabilities().model + ")";
      DeviceSample sample;
      const DeviceError error = devices_[d]->read(time_s, sample);
      if (error == DeviceError::fatal) {
        events.push_back(name + " failed: it gives no more samples");
        return false;
      }
      const bool sound = error == DeviceError::none && is_finite(sample);
      if (sound) samples_[d] = sample;
      if (!sound && !told_[d])
        events.push_back(name + (error == DeviceError::ended
                                     ? ": its way is over; the tool stays there"
                                     : " gives nothing new or nothing finite; its last "
                                       "sound sample is held"));
      told_[d] = !sound;
      held = held || (!sound && error != DeviceError::ended);
    }
    if (held) ++held_;
    return true;
  }

  void write(std::size_t tool, const DeviceCommand& command) { devices_[tool]->write(command); }
  void close() {
    for (auto& device : devices_) device->close();
  }
  const std::vector<DeviceSample>& samples() const { return samples_; }
  std::int64_t held() const { return held_; }  // steps with a sample held

 private:
  std::vector<std::unique_ptr<Device>> devices_;
  std::vector<DeviceSample> samples_;
  std::vector<bool> told_;  // [devices] since its last sound sample
  std::int64_t held_ = 0;
};

void print_warnings(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
}

// Every coordinate one ulp up or down, at random.
void shift_by_an_ulp(std::uint64_t seed, State& state) {
  std::mt19937_64 random(seed);
  for (double& x : state.positions) x = std::nextafter(x, random() & 1 ? HUGE_VAL : -HUGE_VAL);
}

// Frames of the state at the moments of the pictures.
class ShotCollector {
 public:
  ShotCollector(const Scenario& scenario) : scenario_(scenario) {}

  void look(const State& state, const StepReport& report) {
    const double time_s = static_cast<double>(state.step) * scenario_.scene.step_s;
    for (const Shot& shot : scenario_.pictures.shots) {
      if (std::fabs(shot.time_s - time_s) <= 0.5 * scenario_.scene.step_s && !taken(shot.name)) {
        frames_.push_back({shot, state, contact_forces(report)});
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
  const Scenario scenario = load_scenario(path, options.overrides, recorded_hand);
  std::vector<std::string> warnings = scenario.warnings;
  Hands hands(scenario);
  std::vector<std::string> notes;
  const Scene scene = make_scene(scenario, &warnings, &notes);
  print_warnings(warnings);
  prepare_folder(options.out, options.force);

  const int threads = threads_or_all(options.threads);
  const double h = scenario.scene.step_s;
  bool device_failed = !hands.read(0, notes);
  State state = initial_state(scene, hands.samples());
  if (options.start_shift_seed != 0) shift_by_an_ulp(options.start_shift_seed, state);
  RunHeader header = recording_header(scenario, scene, options.overrides, threads);
  header.stage_leaves = stage_leaf_names();
  RunRecorder recorder(options.out, header, state);
  for (const std::string& warning : warnings) recorder.warning(warning);
  for (const std::string& note : notes) recorder.event(0, note);
  if (options.start_shift_seed != 0) recorder.event(0, "every coordinate was moved by one ulp at the start");
  for (const auto& [name, value] : topology_numbers(scene)) recorder.number(name, value);

  WorkspacePtr workspace = make_workspace(scene, threads);
  StepReport report = make_report(scene);
  ShotCollector shots(scenario);
  StageClock clock;
  StepTree tree(*workspace);
  ClockAndTree observers(clock, tree);
  shots.look(state, report);
  const std::int64_t steps = scenario.steps();
  bool torn = false, stopped = false;
  HangingRecord hanging;
  double precision_error = 0;
  std::vector<std::int64_t> last_touch(scene.settings.tools.size(), -1);  // step
  {
    Progress progress(scenario.name + ": steps", steps);
    for (std::int64_t n = 0; n < steps && !device_failed; ++n) {
      std::vector<std::string> events;
      device_failed = !hands.read(static_cast<double>(n + 1) * h, events);
      for (const std::string& event : events) recorder.event(n, event);
      if (device_failed) break;
      const std::vector<DeviceSample>& samples = hands.samples();
      const int every = scenario.measure_error_every_steps;
      if (every > 0 && n % every == every - 1) {
        recorder.solver_error(n, measure_solver_error(scene, samples, state, threads));
        precision_error = std::fmax(precision_error, measure_precision_error(scene, samples, state, threads));
      }
      tree.begin(samples);
      clock.start();
      step(scene, samples, state, report, *workspace, &observers);
      recorder.step(samples, report, state, clock.seconds(), clock.total(), tree.hashes());
      for (std::size_t t = 0; t < samples.size(); ++t) {
        if (report.tools[t].contacts > 0) last_touch[t] = n;
        hands.write(
            t, {report.tools[t].displayed_force, report.tools[t].displayed_torque, report.time_s + 2 * h});
      }
      if (!report.finite) {
        const std::string why = explain_failure(scene, samples, state);
        recorder.event(n, "stopped: " + why);
        std::fprintf(stderr, "%s: step %lld: the run stops here: %s\n", scenario.name.c_str(),
                     static_cast<long long>(n), why.c_str());
        stopped = true;
        break;
      }
      if (report.fracture && report.fracture->by_criterion > 0 && !torn) {
        recorder.event(n, "the tissue begins to tear");
        torn = true;
      }
      shots.look(state, report);
      if (scene.fracture && state.step % scenario.frame_every_steps == 0)
        look_at_hanging(scene, state, hanging);
      if (state.step % scenario.frame_every_steps == 0) recorder.frame(state);
      progress.at(n + 1);
    }
  }
  for (std::size_t t = 0; t < last_touch.size(); ++t) {
    if (last_touch[t] >= 0 && last_touch[t] + 1 < steps)
      recorder.event(last_touch[t] + 1, scene.settings.tools[t].name + " touches nothing from here on");
  }
  hands.close();
  if (hands.held() > 0) recorder.number("held_samples", static_cast<double>(hands.held()));
  recorder.number("inverted_elements_at_end", static_cast<double>(count_inverted(scene, state)));
  if (precision_error > 0) recorder.number("single_precision_error", precision_error);
  if (scene.fracture) record_torn(scene, state, hanging, recorder.writer());
  recorder.finish(state);

  if (options.pictures) render_shots(scenario, scene, shots.frames(), options.out / "pictures");
  const RunData run = read_run(options.out / "run.h5");
  write_summary(options.out / "summary.json", run, check_run(run, options.out, {}));
  std::printf("%s: %lld steps, fingerprint %s, in %s\n", scenario.name.c_str(),
              static_cast<long long>(run.steps), hex16(run.fingerprint()).c_str(),
              options.out.string().c_str());
  if (device_failed) {
    throw EnvironmentError(scenario.name + ": a device failed after " + std::to_string(run.steps) +
                           " steps; what came before is recorded in " + (options.out / "run.h5").string());
  }
  return stopped ? 1 : 0;
}

}  // namespace sulcus
