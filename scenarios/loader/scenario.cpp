#include "scenarios/loader/scenario.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include "engine/numerics/error.h"
#include "scenarios/loader/devices.h"
#include "scenarios/loader/json_text.h"
#include "scenarios/loader/parse.h"
#include "scenarios/loader/schema.h"

namespace sulcus {

namespace {

std::string read_text(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    throw InputError(path.string() + ": this scenario does not exist");
  if (std::filesystem::is_directory(path, error)) {
    throw InputError(path.string() + ": this is a directory; give a scenario file (.json)");
  }
  std::ifstream stream(path, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  if (!stream) throw InputError(path.string() + ": the file is empty or cannot be read");
  return text.str();
}

// The document that a patch ("based_on") makes of the scenario it names; others are left as they are.
// base: the file of that scenario, if there is one.
nlohmann::json with_base(nlohmann::json document, const std::string& place,
                         const std::filesystem::path& directory, std::filesystem::path& base) {
  if (!document.is_object() || !document.contains("based_on")) return document;
  if (!document["based_on"].is_string())
    throw InputError(place + ": /based_on: expected the name of a scenario file");
  base = directory / document["based_on"].get<std::string>();
  nlohmann::json whole = parse_json(read_text(base), base.string());
  if (whole.is_object() && whole.contains("based_on"))
    throw InputError(place + ": /based_on: " + base.string() + " is a patch itself; name the scenario that " +
                     "it is based on");
  document.erase("based_on");
  whole.merge_patch(document);
  return whole;
}

}  // namespace

std::int64_t Scenario::steps() const {
  return std::llround(duration_s / scene.step_s);
}

Scenario load_scenario_text(const std::string& text, const std::string& place,
                            const std::filesystem::path& directory,
                            const std::vector<std::string>& overrides) {
  std::filesystem::path base;
  nlohmann::json document = with_base(parse_json(text, place), place, directory, base);
  for (const std::string& override_text : overrides) apply_override(document, override_text);
  const std::vector<std::string> violations = schema_violations(document);
  if (!violations.empty()) throw InputError(list_problems(place, violations));
  Scenario scenario = parse_scenario(document, place, directory);
  if (!base.empty()) scenario.input_files.insert(scenario.input_files.begin(), base);
  return scenario;
}

Scenario load_scenario(const std::filesystem::path& path, const std::vector<std::string>& overrides,
                       RecordingReader read_recording) {
  Scenario scenario = load_scenario_text(read_text(path), path.string(),
                                         std::filesystem::absolute(path).parent_path(), overrides);
  scenario.path = path;
  scenario.input_files.insert(scenario.input_files.begin(), path);
  std::vector<std::string> problems;
  read_hand_files(scenario, read_recording, problems);
  if (!problems.empty()) throw InputError(list_problems(path.string(), problems));
  if (scenario.name != path.stem().string()) {
    scenario.warnings.push_back("/name: \"" + scenario.name + "\" differs from the file's name " +
                                path.filename().string());
  }
  return scenario;
}

std::unique_ptr<Device> make_device(const ToolHand& hand) {
  if (hand.file && hand.script.waypoints.empty())
    throw InputError(hand.file->path.string() + ": this program reads no recordings; use `sulcus run`");
  std::unique_ptr<Device> device = hand.push        ? make_push_device(*hand.push)
                                   : hand.recording ? make_recorded_device(*hand.recording)
                                   : hand.hand      ? make_hand_device(hand.script, *hand.hand)
                                                    : make_scripted_device(hand.script);
  return hand.faults ? make_perturbed_device(std::move(device), *hand.faults) : std::move(device);
}

std::vector<std::unique_ptr<Device>> make_devices(const Scenario& scenario) {
  std::vector<std::unique_ptr<Device>> devices;
  for (const ToolHand& hand : scenario.hands) devices.push_back(make_device(hand));
  return devices;
}

}  // namespace sulcus
