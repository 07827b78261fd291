// JSON document -> Scenario.
#pragma once

#include <nlohmann/json.hpp>

#include "scenarios/loader/scenario.h"

namespace sulcus {

// The document has passed schema_violations. Throws InputError that lists everything else that is wrong:
// values that contradict each other, trajectories that end too early, a missing label map, ...
Scenario parse_scenario(const nlohmann::json& document, const std::string& place,
                        const std::filesystem::path& directory);

// "<place>: <problem>", or "<place>: 2 errors" and one line for each.
std::string list_problems(const std::string& place, const std::vector<std::string>& problems);

}  // namespace sulcus
