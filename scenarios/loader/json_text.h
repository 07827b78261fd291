// Scenario text -> JSON value: syntax errors with line and column, repeated keys refused, overrides applied.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace sulcus {

// Throws InputError: "<place>: line 3, column 7: ...", or for a key that stands twice in one object, or a
// number that no double can hold.
nlohmann::json parse_json(const std::string& text, const std::string& place);

// Sets the value of "/json/pointer=value": the value is read as JSON, else taken as a string. Objects on the
// way are made; an array must have the element. Throws InputError for anything else (schema errors show up
// later).
void apply_override(nlohmann::json& document, const std::string& override_text);

}  // namespace sulcus
