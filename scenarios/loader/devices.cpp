#include "scenarios/loader/devices.h"

#include "device_sim/csv.h"
#include "scenarios/loader/parse_json.h"

namespace sulcus {
namespace {

constexpr double end_slack_s = 1e-9;  // s, within which a scripted device still gives its last pose

Path path_named(const std::string& name) {
  if (name == "hold") return Path::hold;
  if (name == "linear") return Path::linear;
  if (name == "spline") return Path::spline;
  return Path::minimum_jerk;
}

Tremor read_tremor(const json& object) {
  Tremor tremor;
  read_mm(object, "position_rms_mm", tremor.position_rms_m);
  read(object, "rotation_rms_deg", tremor.rotation_rms_rad);
  tremor.rotation_rms_rad *= radians_per_degree;
  read(object, "low_Hz", tremor.low_Hz);
  read(object, "high_Hz", tremor.high_Hz);
  read(object, "seed", tremor.seed);
  return tremor;
}

VirtualHand read_virtual_hand(const json& object) {
  VirtualHand hand;
  read(object, "mass_kg", hand.mass_kg);
  read(object, "damping_N_s_m", hand.damping_N_s_m);
  read(object, "stiffness_N_m", hand.stiffness_N_m);
  return hand;
}

PushScript read_push(const json& object, const std::string& pointer, Problems& problems) {
  PushScript push;
  Vec3 axis = Vec3::UnitZ();
  double angle_deg = 0;
  read_mm(object, "position_mm", push.start_m);
  read(object, "axis", axis);
  read(object, "angle_deg", angle_deg);
  if (!(axis.norm() > 0)) problems.push_back(pointer + "/axis: the axis has no length; give a direction");
  push.orientation = quaternion_from_rotation_vector(axis.normalized() * (angle_deg * radians_per_degree));
  read(object, "direction", push.direction);
  read_mm(object, "speed_mm_s", push.speed_m_s);
  read(object, "threshold_N", push.threshold_N);
  read_mm(object, "max_way_mm", push.max_way_m);
  read(object, "hold_s", push.hold_s);
  return push;
}

Perturbation read_faults(const json& object) {
  Perturbation faults;
  read(object, "seed", faults.seed);
  read(object, "time_rate", faults.time_rate);
  read(object, "jitter_s", faults.jitter_s);
  read(object, "lost_share", faults.lost_share);
  read(object, "late_share", faults.late_share);
  read(object, "late_s", faults.late_s);
  read(object, "stuck_from_s", faults.stuck_from_s);
  read(object, "stuck_for_s", faults.stuck_for_s);
  read_mm(object, "encoder_step_mm", faults.encoder_step_m);
  read(object, "encoder_step_deg", faults.encoder_step_rad);
  faults.encoder_step_rad *= radians_per_degree;
  read(object, "nan_from_s", faults.nan_from_s);
  read(object, "nan_for_s", faults.nan_for_s);
  read(object, "disconnect_at_s", faults.disconnect_at_s);
  return faults;
}

}  // namespace

ScriptedTrajectory read_script(const json& waypoints, const char* position_key, double run_s,
                               const std::string& pointer, Problems& problems) {
  ScriptedTrajectory script;
  Waypoint waypoint;
  Vec3 axis = Vec3::UnitZ();
  double angle_deg = 0;
  for (const json& object : waypoints) {
    const std::string place = pointer + "/" + std::to_string(script.waypoints.size());
    const double before_s = waypoint.time_s;
    read(object, "time_s", waypoint.time_s);
    read_mm(object, position_key, waypoint.position_m);
    read(object, "axis", axis);
    read(object, "angle_deg", angle_deg);
    waypoint.path = path_named(object.value("path", "minimum_jerk"));
    if (!(axis.norm() > 0)) problems.push_back(place + "/axis: the axis has no length; give a direction");
    waypoint.orientation =
        quaternion_from_rotation_vector(axis.normalized() * (angle_deg * radians_per_degree));
    if (script.waypoints.empty() && std::string(position_key) == "position_mm" &&
        !object.contains(position_key)) {
      problems.push_back(place + ": the first way-point must have a position_mm");
    }
    if (!script.waypoints.empty() && !(waypoint.time_s > before_s)) {
      problems.push_back(place + "/time_s: found " + text_of(waypoint.time_s) + " s after " +
                         text_of(before_s) + " s; times must increase");
      return script;
    }
    script.waypoints.push_back(waypoint);
  }
  const double end_s = script.waypoints.back().time_s;
  if (end_s + end_slack_s < run_s) {
    problems.push_back(pointer + ": the trajectory ends at " + text_of(end_s) + " s, the run lasts " +
                       text_of(run_s) +
                       " s; add a way-point (path \"hold\" stays in place) or shorten /time/duration_s");
  }
  collect(problems, pointer, [&] { make_scripted_device(script); });
  return script;
}

ToolHand read_hand(const json& device, double run_s, const std::filesystem::path& directory,
                   const std::string& tool, const std::string& pointer, Problems& problems) {
  ToolHand hand;
  const std::size_t known_problems = problems.size();
  if (device.contains("scripted") + device.contains("push") + device.contains("recorded") != 1) {
    problems.push_back(pointer + ": expected exactly one of \"scripted\", \"push\" and \"recorded\"");
    return hand;
  }
  if (device.contains("faults")) hand.faults = read_faults(device["faults"]);
  if (device.contains("recorded")) {
    const json& recorded = device["recorded"];
    hand.file = {(directory / recorded["file"].get<std::string>()).lexically_normal(),
                 recorded.value("tool", tool)};
    return hand;
  }
  if (device.contains("push")) {
    hand.push = read_push(device["push"], pointer + "/push", problems);
    hand.script.waypoints = {{.position_m = hand.push->start_m, .orientation = hand.push->orientation}};
  } else {
    const json& scripted = device["scripted"];
    hand.script =
        read_script(scripted["waypoints"], "position_mm", run_s, pointer + "/scripted/waypoints", problems);
    if (scripted.contains("tremor")) hand.script.tremor = read_tremor(scripted["tremor"]);
    if (scripted.contains("hand")) hand.hand = read_virtual_hand(scripted["hand"]);
  }
  if (problems.size() == known_problems) collect(problems, pointer, [&] { make_device(hand); });
  return hand;
}

void read_hand_files(Scenario& scenario, RecordingReader read_recording, Problems& problems) {
  const double run_s = static_cast<double>(scenario.steps()) * scenario.scene.step_s;
  for (std::size_t tool = 0; tool < scenario.hands.size(); ++tool) {
    ToolHand& hand = scenario.hands[tool];
    if (!hand.file) continue;
    const std::string pointer = "/tools/" + std::to_string(tool) + "/device/recorded/file";
    const std::filesystem::path& path = hand.file->path;
    const bool table = path.extension() == ".csv";
    collect(problems, pointer, [&] {
      std::error_code error;
      if (!table && path.extension() != ".h5")
        throw InputError(path.string() + ": expected a table (.csv) or a recording (.h5)");
      if (!std::filesystem::is_regular_file(path, error))
        throw InputError(path.string() + ": there is no such file; names are looked up beside the scenario");
      scenario.input_files.push_back(path);
      double end_s = run_s;
      if (table) {
        hand.script = read_trajectory_csv(path.string());
        end_s = hand.script.waypoints.back().time_s;
      } else if (read_recording != nullptr) {
        hand.recording = read_recording(*hand.file);
        const DeviceSample& start = hand.recording->samples.front();
        hand.script.waypoints = {{.position_m = start.position, .orientation = start.orientation}};
        end_s = hand.recording->read_times_s.back();
      }
      if (end_s + end_slack_s < run_s)
        throw InputError(path.string() + ": the motion ends at " + text_of(end_s) + " s, the run lasts " +
                         text_of(run_s) + " s; shorten /time/duration_s");
      if (table || read_recording != nullptr) make_device(hand);
    });
  }
}

}  // namespace sulcus
