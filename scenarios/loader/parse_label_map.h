// How the parser reads the label map of a scenario: its source, and what is done on its labels.
#pragma once

#include <filesystem>
#include <string>

#include "scenarios/loader/parse_json.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {

// Appends to problems if max is less than min along an axis.
void check_box(const Vec3& min_m, const Vec3& max_m, const std::string& pointer, Problems& problems);

// The member "label_map". missing: what to say if optional data are not here.
void read_label_map(const json& object, const std::filesystem::path& directory, Scenario& scenario,
                    std::string& missing, Problems& problems);

}  // namespace sulcus
