// Who moves the tools of a scenario: JSON -> scripts, hands, pushes, faults.
#pragma once

#include <nlohmann/json.hpp>

#include "scenarios/loader/scenario.h"

namespace sulcus {

// Way-points, checked; what is wrong is appended to problems. position_key: "position_mm" of a tool,
// "shift_mm" of nodes, whose first way-point may leave it out. run_s: the trajectory must not end before.
ScriptedTrajectory read_script(const nlohmann::json& waypoints, const char* position_key, double run_s,
                               const std::string& pointer, std::vector<std::string>& problems);

// The "device" of a tool. A file of a hand is looked up in `directory`, and not read yet; `tool` is the
// tool's name.
ToolHand read_hand(const nlohmann::json& device, double run_s, const std::filesystem::path& directory,
                   const std::string& tool, const std::string& pointer, std::vector<std::string>& problems);

// Reads the files of hands, tables always, recordings if there is a function for it.
void read_hand_files(Scenario& scenario, RecordingReader read_recording, std::vector<std::string>& problems);

}  // namespace sulcus
