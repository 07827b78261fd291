#include "scenarios/loader/json_text.h"

#include <set>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

// nlohmann's texts are "[json.exception.parse_error.101] parse error at line 1, column 2: <detail>".
std::string syntax_message(const std::string& text) {
  const std::size_t line = text.find("line ");
  if (line != std::string::npos) return text.substr(line);
  const std::size_t end = text.find("] ");
  return end == std::string::npos ? text : text.substr(end + 2);
}

std::size_t array_index(const std::string& token, std::size_t size, const std::string& override_text) {
  const bool digits =
      !token.empty() && token.size() < 10 && token.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || std::stoul(token) >= size) {
    throw InputError("override '" + override_text + "': an array of " + std::to_string(size) +
                     " elements has no element " + token + " (they count from 0)");
  }
  return std::stoul(token);
}

// "/a/b~1c" -> {"a", "b/c"}
std::vector<std::string> pointer_tokens(const std::string& pointer) {
  std::vector<std::string> tokens;
  for (const char c : pointer) {
    if (c == '/') {
      tokens.emplace_back();
    } else {
      tokens.back() += c;
    }
  }
  for (std::string& token : tokens) {
    for (const auto& [code, character] : {std::pair{"~1", "/"}, std::pair{"~0", "~"}}) {
      for (std::size_t at = token.find(code); at != std::string::npos; at = token.find(code, at + 1)) {
        token.replace(at, 2, character);
      }
    }
  }
  return tokens;
}

}  // namespace

nlohmann::json parse_json(const std::string& text, const std::string& place) {
  std::vector<std::set<std::string>> keys;  // of the open objects
  std::string repeated;
  const auto watch = [&](int, nlohmann::json::parse_event_t event, nlohmann::json& value) {
    if (event == nlohmann::json::parse_event_t::object_start) keys.emplace_back();
    if (event == nlohmann::json::parse_event_t::object_end) keys.pop_back();
    if (event == nlohmann::json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second) {
      repeated = value.get<std::string>();
    }
    return true;
  };
  nlohmann::json document;
  try {
    document = nlohmann::json::parse(text, watch);
  } catch (const nlohmann::json::exception& error) {
    throw InputError(place + ": " + syntax_message(error.what()));
  }
  if (!repeated.empty())
    throw InputError(place + ": the key \"" + repeated + "\" stands twice in one object");
  return document;
}

void apply_override(nlohmann::json& document, const std::string& override_text) {
  const std::size_t mark = override_text.find('=');
  if (override_text.empty() || override_text[0] != '/' || mark == std::string::npos) {
    throw InputError("override '" + override_text +
                     "': expected /json/pointer=value, such as /time/step_s=0.01");
  }
  const std::string text = override_text.substr(mark + 1);
  nlohmann::json* node = &document;
  for (const std::string& token : pointer_tokens(override_text.substr(0, mark))) {
    if (node->is_array()) {
      node = &(*node)[array_index(token, node->size(), override_text)];
    } else if (node->is_object() || node->is_null()) {
      node = &(*node)[token];
    } else {
      throw InputError("override '" + override_text + "': " + node->dump() + " has no member \"" + token +
                       "\"");
    }
  }
  nlohmann::json value = nlohmann::json::parse(text, nullptr, false);
  *node = value.is_discarded() ? nlohmann::json(text) : std::move(value);
}

}  // namespace sulcus
