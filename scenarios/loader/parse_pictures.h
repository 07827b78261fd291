// The part of a scenario's document about pictures. Private to the loader.
#pragma once

#include <nlohmann/json.hpp>

#include "scenarios/loader/scenario.h"

namespace sulcus {

// After the duration is known. directory: where relative file names are looked up. What is wrong is appended
// to problems, with the JSON pointer of its place.
void read_pictures(const nlohmann::json& object, const std::filesystem::path& directory, Scenario& scenario,
                   std::vector<std::string>& problems);

}  // namespace sulcus
