#include "tools/sulcus/session.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>

#include "engine/numerics/error.h"
#include "hw_phantom/emergency.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/realtime.h"
#include "tools/sulcus/recorded_hand.h"
#include "tools/sulcus/session_devices.h"
#include "tools/sulcus/support.h"
#include "verify/fingerprint.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

fs::path default_folder() {
  char name[64];
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  std::strftime(name, sizeof name, "session_%Y%m%d_%H%M%S", &local);
  return name;
}

// The first sound sample of an armed device. Waits for a stylus that is in its inkwell.
DeviceSample first_sample(Hand& hand) {
  constexpr double patience_s = 2;
  DeviceSample sample;
  bool told = false;
  for (double since_s = steady_now_s(); steady_now_s() - since_s < patience_s;) {
    if (InterruptGuard::interrupted()) throw EnvironmentError("session: interrupted before it began");
    const DeviceError error = hand.device().read(0, sample);
    if (error == DeviceError::none && !sample.docked) return sample;
    if (error == DeviceError::fatal || error == DeviceError::ended) break;
    if (error == DeviceError::none) {
      if (!told) std::fprintf(stderr, "take the stylus out of its inkwell to begin\n");
      told = true;
      since_s = steady_now_s();
    }
    sleep_until_s(steady_now_s() + 0.01);
  }
  throw EnvironmentError("device " + std::to_string(hand.tool()) + " (" + hand.device().capabilities().model +
                         "): gives no sample to begin with; run `sulcus device --check phantom`");
}

// Samples at the start, and where a stylus stands in the scene: where its tool starts.
std::vector<DeviceSample> take_hands(const Scenario& scenario, const std::vector<SessionDevice>& devices,
                                     const std::vector<std::unique_ptr<Hand>>& hands,
                                     std::vector<Placement>& placements) {
  std::vector<DeviceSample> samples;
  for (std::size_t h = 0; h < hands.size(); ++h) {
    samples.push_back(first_sample(*hands[h]));
    placements.emplace_back();
    if (!devices[h].place_at_tool) continue;
    const Waypoint& start = scenario.hands[h].script.waypoints.front();
    placements[h] = placement_for(samples[h], start.position_m, normalised(start.orientation));
    samples[h] = placed(placements[h], samples[h]);
  }
  return samples;
}

RunHeader session_header(const SessionOptions& options, const Scenario& scenario, const Scene& scene,
                         const std::vector<std::unique_ptr<Hand>>& hands, int threads) {
  RunHeader header = recording_header(scenario, scene, options.overrides, threads);
  if (!options.from.empty()) header.inputs[options.from.string()] = hash_file(options.from);
  header.stage_leaves = stage_leaf_names();
  header.session.emplace();
  for (const auto& hand : hands) {
    header.session->devices.push_back(hand->device().capabilities().model);
    header.session->servo.push_back(hand->settings());
  }
  return header;
}

struct Granted {
  bool memory = false, servo = false, drivers = true;
};

// Says, and records, what a session in real time had to do without.
void tell_realtime(const SessionOptions& options, const Granted& granted, const std::string& no_memory,
                   SessionLog& log) {
  if (!options.realtime) return;
  const auto tell = [&](const std::string& text) {
    std::fprintf(stderr, "warning: %s\n", text.c_str());
    log.push_warning(text);
  };
  if (!granted.servo)
    tell("no real-time priority for the servo: not permitted (limit rtprio, or CAP_SYS_NICE)");
  if (!granted.drivers) tell("no real-time priority asked for the driver's servo thread was granted");
  if (!granted.memory) tell("memory is not locked: " + no_memory);
}

// Devices stop and close, whatever happens.
struct ClosingHands {
  std::vector<std::unique_ptr<Hand>> hands;
  ~ClosingHands() { close(); }
  void close() {
    for (const auto& hand : hands) hand->close();
  }
};

}  // namespace

int session_command(const SessionOptions& options) {
  const Scenario scenario = load_scenario(find_scenario(options.scenario), options.overrides, recorded_hand);
  std::vector<SessionDevice> devices = make_session_devices(options, scenario);
  std::vector<std::string> warnings = scenario.warnings;
  const Scene scene = make_scene(scenario, &warnings);
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  const fs::path out = options.out.empty() ? default_folder() : options.out;
  prepare_folder(out, options.force);

  // One core is the servo's.
  const int threads = options.threads > 0 ? options.threads : std::max(1, threads_or_all(0) - 1);
  InterruptGuard interrupts;
  allow_forces();
  SessionOutcome outcome;
  const fs::path log_path = out / "run.h5.log";
  {
    std::unique_ptr<SessionLog> recorder;  // outlives the servos, which write into it
    ClosingHands armed;
    for (std::size_t tool = 0; tool < devices.size(); ++tool) {
      ServoSettings settings;
      settings.filter_Hz = options.filter_Hz >= 0 ? options.filter_Hz : scenario.scene.tools[tool].filter_Hz;
      armed.hands.push_back(
          std::make_unique<Hand>(std::move(devices[tool].device), tool, settings, devices[tool].leads));
    }
    for (const auto& hand : armed.hands) hand->arm();
    std::vector<Placement> placements;
    std::vector<DeviceSample> samples = take_hands(scenario, devices, armed.hands, placements);
    State state = initial_state(scene, samples);
    const RunHeader header = session_header(options, scenario, scene, armed.hands, threads);
    recorder = std::make_unique<SessionLog>(log_path, header, state);
    SessionLog& log = *recorder;
    for (const std::string& warning : warnings) log.push_warning(warning);
    for (const auto& [name, value] : topology_numbers(scene)) log.push_number(name, value);
    const std::string no_memory = options.realtime ? lock_memory() : "";

    SessionPlan plan;
    plan.duration_s = options.duration_s > 0         ? options.duration_s
                      : options.device == "scripted" ? scenario.duration_s
                                                     : std::numeric_limits<double>::infinity();
    plan.threads = threads;
    plan.state_every_steps = scenario.frame_every_steps;
    plan.clock.zero_s = steady_now_s();
    for (const auto& hand : armed.hands) {
      if (const auto zero_s = hand->device().clock_zero_s()) plan.clock.zero_s = *zero_s;
    }
    if (options.duration_s > 0) plan.duration_s += plan.clock.now_s();
    for (std::size_t h = 0; h < armed.hands.size(); ++h)
      armed.hands[h]->start(placements[h], plan.clock, log, options.realtime);
    Granted granted{.memory = no_memory.empty()};
    {
      ServoThread servo(armed.hands, plan.clock, options.realtime);
      std::fprintf(stderr, "%s: session begins, Ctrl-C ends it\n", scenario.name.c_str());
      outcome = run_session(scene, plan, armed.hands, header, samples, state, log);
      sleep_until_s(steady_now_s() + 0.02);  // the servos render nothing any more
      granted.servo = !servo.runs() || servo.realtime();
    }
    for (const auto& hand : armed.hands)
      granted.drivers = granted.drivers && (!hand->has_servo() || hand->realtime());
    armed.close();
    unlock_memory();
    tell_realtime(options, granted, no_memory, log);
    log.push_event(outcome.steps, std::string("the session ended: ") + end_text(outcome.end));
    log.push_number("session_held_samples", static_cast<double>(outcome.held_samples));
    if (outcome.end != SessionEnd::recorder) log.push_state(state);
    log.finish();
  }
  std::fprintf(stderr, "%s: the session ended: %s\n", scenario.name.c_str(), end_text(outcome.end));
  record_log(log_path, out, scenario, scene, threads);
  if (outcome.end == SessionEnd::not_finite) return 1;
  if (outcome.end != SessionEnd::device_fault && outcome.end != SessionEnd::recorder) return 0;
  throw EnvironmentError("session: " + std::string(end_text(outcome.end)) + " after " +
                         std::to_string(outcome.steps) + " steps; what came before is recorded in " +
                         (out / "run.h5").string());
}

}  // namespace sulcus
