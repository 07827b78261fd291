// The parts of a scenario's document about tools, obstacles and their contact. Private to the loader.
#pragma once

#include <nlohmann/json.hpp>

#include "scenarios/loader/scenario.h"

namespace sulcus {

// What is wrong is appended to problems, with the JSON pointer of its place.

// directory: where relative file names are looked up.
void read_tools(const nlohmann::json& tools, const std::filesystem::path& directory, Scenario& scenario,
                std::vector<std::string>& problems);
void read_contact(const nlohmann::json& object, SceneDescription& scene);
// After tools and contact: names are unique among both, the law of contact is that of the scene unless an
// obstacle says otherwise.
void read_obstacles(const nlohmann::json& list, const std::filesystem::path& directory, Scenario& scenario,
                    std::vector<std::string>& problems);

}  // namespace sulcus
