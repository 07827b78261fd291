// Checks a JSON value against the scenario schema and says what is wrong so that a person can put it right.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace sulcus {

// One line for each violation, in the order of their pointers: "/tissue/default/youngs_modulus_Pa: found -5,
// expected a number > 0 (Pa.)". An unknown key comes with the nearest known one. Empty if the document is
// valid.
std::vector<std::string> schema_violations(const nlohmann::json& document);

// The word of `known` with the smallest edit distance to `word`; empty if none is near (more than half of the
// letters differ).
std::string nearest_word(const std::string& word, const std::vector<std::string>& known);

}  // namespace sulcus
