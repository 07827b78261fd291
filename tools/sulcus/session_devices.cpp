#include "tools/sulcus/session_devices.h"

#include <charconv>
#include <map>

#include "device_sim/csv.h"
#include "device_sim/hand.h"
#include "device_sim/perturbed.h"
#include "device_sim/recorded.h"
#include "engine/numerics/error.h"
#include "verify/recording.h"

namespace sulcus {
namespace {

double number_of(const std::string& text, const std::string& option) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    throw InputError(option + ": \"" + text + "\" is not a number");
  return value;
}

Perturbation perturbation_of(const std::vector<std::string>& faults) {
  Perturbation p;
  const std::map<std::string, double*> fields = {{"time_rate", &p.time_rate},
                                                 {"jitter_s", &p.jitter_s},
                                                 {"lost_share", &p.lost_share},
                                                 {"late_share", &p.late_share},
                                                 {"late_s", &p.late_s},
                                                 {"stuck_from_s", &p.stuck_from_s},
                                                 {"stuck_for_s", &p.stuck_for_s},
                                                 {"encoder_step_m", &p.encoder_step_m},
                                                 {"encoder_step_rad", &p.encoder_step_rad},
                                                 {"nan_from_s", &p.nan_from_s},
                                                 {"nan_for_s", &p.nan_for_s},
                                                 {"disconnect_at_s", &p.disconnect_at_s}};
  for (const std::string& fault : faults) {
    const std::size_t equals = fault.find('=');
    const auto field = fields.find(fault.substr(0, equals));
    if (equals == std::string::npos || field == fields.end()) {
      std::string known;
      for (const auto& [name, value] : fields) known += (known.empty() ? "" : ", ") + name;
      throw InputError("--fault " + fault + ": give name=value with one of " + known);
    }
    *field->second = number_of(fault.substr(equals + 1), "--fault " + fault);
  }
  return p;
}

VirtualHand hand_named(const std::string& name) {
  if (name == "light") return light_hand;
  if (name == "firm") return firm_hand;
  return device_alone;
}

std::size_t tool_named(const SessionOptions& options, const Scenario& scenario) {
  const auto& tools = scenario.scene.tools;
  if (tools.empty())
    throw InputError(options.scenario + ": has no tool, so there is nothing for a hand to move");
  if (scenario.scene.contact.prescribed) {
    throw InputError(options.scenario +
                     ": /contact/response \"prescribed\" has no virtual coupling that a servo could render; use "
                     "\"penalty\" in sessions");
  }
  if (options.tool.empty()) return 0;
  std::string names;
  for (std::size_t t = 0; t < tools.size(); ++t) {
    if (tools[t].name == options.tool) return t;
    names += (names.empty() ? "" : ", ") + tools[t].name;
  }
  throw InputError("--tool " + options.tool + ": the scenario's tools are " + names);
}

// The samples of a recording as a hand: of a session every tick of the servo, of a run one a step.
std::unique_ptr<Device> recorded_device(const RunData& run, std::size_t tool) {
  RecordedTrajectory trajectory;
  if (run.session && !run.session->ticks[tool].empty()) {
    for (const ServoTick& tick : run.session->ticks[tool]) {
      const auto error = static_cast<DeviceError>(tick.error);
      if (error == DeviceError::fatal || error == DeviceError::ended) continue;
      trajectory.samples.push_back(tick.sample);
      trajectory.read_times_s.push_back(tick.time_s);
    }
  } else {
    const auto tools = static_cast<std::size_t>(run.header.tool_count());
    const Series* read_s = run.find("session/read_s");
    for (std::size_t step = 0; step < static_cast<std::size_t>(run.steps); ++step) {
      trajectory.samples.push_back(run.samples[step * tools + tool]);
      if (read_s != nullptr) trajectory.read_times_s.push_back(read_s->values[step]);
    }
  }
  return make_recorded_device(std::move(trajectory));
}

void take_recorded(const SessionOptions& options, std::size_t tool, std::vector<SessionDevice>& devices) {
  if (options.from.empty())
    throw InputError("--device recorded: give --from with a run.h5 or a CSV file (docs/devices.md)");
  if (options.from.extension() == ".csv") {
    devices[tool].device = make_scripted_device(read_trajectory_csv(options.from.string()));
    return;
  }
  const RunData run = read_run(options.from);
  if (static_cast<std::size_t>(run.header.tool_count()) != devices.size()) {
    throw InputError(options.from.string() + ": has " + std::to_string(run.header.tool_count()) +
                     " tools, the scenario " + std::to_string(devices.size()) + "; they must be as many");
  }
  for (std::size_t t = 0; t < devices.size(); ++t) devices[t] = {recorded_device(run, t), true, false};
}

}  // namespace

PhantomSettings phantom_settings(const PhantomOptions& options) {
  PhantomSettings settings;
  settings.library = options.library;
  settings.device_name = options.device_name;
  if (options.max_force_N > 0) settings.safety.max_force_N = options.max_force_N;
  settings.hold_button = options.hold_button;
  settings.calibration_timeout_s = options.calibration_timeout_s;
  settings.mount.tip_offset_m = 1e-3 * options.tip_offset_mm;
  // The driver has y up and z towards the user; a scene has z up, and the user looks at it along +y.
  constexpr double quarter = 1.5707963267948966;
  settings.mount.orientation =
      normalised(quaternion_from_rotation_vector(Vec3(0, 0, options.turn_deg / 90 * quarter)) *
                 quaternion_from_rotation_vector(Vec3(quarter, 0, 0)));
  return settings;
}

std::vector<SessionDevice> make_session_devices(const SessionOptions& options, const Scenario& scenario) {
  const std::size_t tool = tool_named(options, scenario);
  std::vector<SessionDevice> devices;
  for (ToolHand hand : scenario.hands) {
    if (!options.hand.empty() && hand.push)
      throw InputError("--hand: the scenario's tool pushes until it feels a force; that is a hand already");
    if (!options.hand.empty() && hand.recording)
      throw InputError("--hand: the scenario's tool follows a recording, which feels no force");
    if (!options.hand.empty()) hand.hand = hand_named(options.hand);
    auto device = make_device(hand);
    devices.push_back({std::move(device), options.device == "scripted", false});
  }
  if (options.device != "scripted" && !options.hand.empty())
    throw InputError("--hand: only with --device scripted");
  if (options.device != "recorded" && !options.from.empty())
    throw InputError("--from: only with --device recorded");
  if (options.device == "phantom") {
    if (!options.faults.empty())
      throw InputError("--fault: not with --device phantom; it has faults of its own");
    devices[tool] = {make_phantom_device(phantom_settings(options.phantom)), true, true};
  } else if (options.device == "recorded") {
    devices[tool].leads = true;
    take_recorded(options, tool, devices);
  }
  if (!options.faults.empty())
    devices[tool].device =
        make_perturbed_device(std::move(devices[tool].device), perturbation_of(options.faults));
  return devices;
}

}  // namespace sulcus
