#include "scenarios/loader/schema.h"

#include <algorithm>
#include <map>
#include <regex>
#include <valijson/adapters/nlohmann_json_adapter.hpp>
#include <valijson/schema.hpp>
#include <valijson/schema_parser.hpp>
#include <valijson/validation_results.hpp>
#include <valijson/validator.hpp>

#include "scenarios/loader/scenario.h"

namespace sulcus {

namespace {

using nlohmann::json;

const json& schema_document() {
  static const json document = json::parse(scenario_schema());
  return document;
}

const json& resolved(const json& schema) {
  const auto reference = schema.find("$ref");
  if (reference == schema.end()) return schema;
  return schema_document().at(json::json_pointer(reference->get<std::string>().substr(1)));
}

// The schema of a member or element, or null.
const json* child_schema(const json& schema, const json& value, const std::string& token) {
  if (value.is_array()) {
    const auto items = schema.find("items");
    return items == schema.end() ? nullptr : &resolved(*items);
  }
  if (const auto known = schema.find("properties"); known != schema.end() && known->contains(token)) {
    return &resolved((*known)[token]);
  }
  if (const auto patterns = schema.find("patternProperties"); patterns != schema.end()) {
    for (const auto& [pattern, child] : patterns->items()) {
      if (std::regex_search(token, std::regex(pattern))) return &resolved(child);
    }
  }
  return nullptr;
}

std::string short_dump(const json& value) {
  if (value.is_object()) return "an object";
  if (value.is_array()) return "an array of " + std::to_string(value.size());
  const std::string text = value.dump();
  return text.size() <= 60 ? text : text.substr(0, 57) + "...";
}

bool has_type(const json& value, const std::string& type) {
  if (type == "number") return value.is_number();
  if (type == "integer") return value.is_number_integer();
  return value.type_name() == type;
}

std::string joined(const std::vector<std::string>& words, const std::string& glue) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : glue) + word;
  return text;
}

std::vector<std::string> known_keys(const json& schema) {
  std::vector<std::string> keys;
  const auto properties = schema.find("properties");
  if (properties != schema.end()) {
    for (const auto& member : properties->items()) keys.push_back(member.key());
  }
  return keys;
}

// "a number > 0 and <= 10"
std::string expected_number(const json& schema) {
  std::vector<std::string> bounds;
  for (const auto& [keyword, sign] : {std::pair{"exclusiveMinimum", "> "}, std::pair{"minimum", ">= "},
                                      std::pair{"exclusiveMaximum", "< "}, std::pair{"maximum", "<= "}}) {
    if (const auto bound = schema.find(keyword); bound != schema.end())
      bounds.push_back(sign + bound->dump());
  }
  const bool integer = schema.value("type", json()) == "integer";
  std::string text = integer ? "a whole number" : "a number";
  if (!bounds.empty()) text += " " + joined(bounds, " and ");
  if (schema.contains("not")) text += " other than " + schema["not"]["enum"][0].dump();
  return text;
}

bool within_bounds(const json& value, const json& schema) {
  const double number = value.get<double>();
  const auto bound = [&](const char* keyword) { return schema.at(keyword).get<double>(); };
  if (schema.contains("minimum") && !(number >= bound("minimum"))) return false;
  if (schema.contains("maximum") && !(number <= bound("maximum"))) return false;
  if (schema.contains("exclusiveMinimum") && !(number > bound("exclusiveMinimum"))) return false;
  if (schema.contains("exclusiveMaximum") && !(number < bound("exclusiveMaximum"))) return false;
  return !schema.contains("not") ||
         std::count(schema["not"]["enum"].begin(), schema["not"]["enum"].end(), value) == 0;
}

std::string wrong_type(const json& value, const json& schema) {
  if (!schema.contains("type")) return {};
  std::vector<std::string> types;
  if (schema["type"].is_array()) {
    types = schema["type"].get<std::vector<std::string>>();
  } else {
    types = {schema["type"].get<std::string>()};
  }
  for (std::string& type : types) {
    if (has_type(value, type)) return {};
    if (type == "number" || type == "integer") {
      type = expected_number(schema);
    } else {
      type.insert(0, type[0] == 'o' || type[0] == 'a' ? "an " : "a ");
    }
  }
  const std::string kind = value.is_string() ? "the string " : "";
  return "found " + kind + short_dump(value) + ", expected " + joined(types, " or ");
}

void object_violations(const json& value, const json& schema, const std::string& pointer,
                       std::vector<std::string>& lines) {
  const std::vector<std::string> keys = known_keys(schema);
  for (const auto& member : value.items()) {
    if (child_schema(schema, value, member.key()) != nullptr) continue;
    const std::string near = nearest_word(member.key(), keys);
    std::string hint = near.empty() ? "known keys: " + joined(keys, ", ") : "did you mean \"" + near + "\"?";
    if (keys.empty()) hint = "a key here is a whole number, such as \"35\"";
    lines.push_back(pointer + "/" + member.key() + ": unknown key; " + hint);
  }
  for (const json& required : schema.value("required", json::array())) {
    const std::string key = required.get<std::string>();
    if (!value.contains(key)) {
      const json& child = resolved(schema["properties"][key]);
      lines.push_back((pointer.empty() ? "/" : pointer) + ": the key \"" + key + "\" is missing (" +
                      child.value("description", "required") + ")");
    }
  }
  const std::size_t at_least = schema.value("minProperties", std::size_t{0});
  const std::size_t at_most = schema.value("maxProperties", value.size());
  if (value.size() < at_least || value.size() > at_most) {
    lines.push_back(pointer + ": found " + std::to_string(value.size()) +
                    " keys, expected exactly one of: " + joined(keys, ", "));
  }
}

// What is wrong with the value itself, not with its members.
void own_violations(const json& value, const json& schema, const std::string& pointer,
                    std::vector<std::string>& lines) {
  const std::string description =
      schema.contains("description") ? " (" + schema["description"].get<std::string>() + ")" : "";
  const std::string where = (pointer.empty() ? "/" : pointer) + ": ";
  if (const std::string type = wrong_type(value, schema); !type.empty()) {
    lines.push_back(where + type + description);
    return;
  }
  if (schema.contains("enum") && std::count(schema["enum"].begin(), schema["enum"].end(), value) == 0) {
    std::vector<std::string> choices;
    for (const json& choice : schema["enum"]) choices.push_back(choice.dump());
    lines.push_back(where + "found " + short_dump(value) + ", expected " + joined(choices, " or ") +
                    description);
  } else if (value.is_number() && !within_bounds(value, schema)) {
    lines.push_back(where + "found " + value.dump() + ", expected " + expected_number(schema) + description);
  } else if (value.is_string() && schema.contains("pattern") &&
             !std::regex_search(value.get<std::string>(), std::regex(schema["pattern"].get<std::string>()))) {
    lines.push_back(where + "found " + short_dump(value) + ", expected a text like " +
                    schema["pattern"].get<std::string>() + description);
  } else if (value.is_string() &&
             value.get<std::string>().size() < schema.value("minLength", std::size_t{0})) {
    lines.push_back(where + "the text is empty" + description);
  } else if (value.is_array()) {
    const std::size_t at_least = schema.value("minItems", std::size_t{0});
    const std::size_t at_most = schema.value("maxItems", value.size());
    if (value.size() < at_least || value.size() > at_most) {
      lines.push_back(where + "found " + std::to_string(value.size()) + " elements, expected " +
                      (at_least == at_most ? "" : "at least ") + std::to_string(at_least) + description);
    }
  } else if (value.is_object()) {
    object_violations(value, schema, pointer, lines);
  }
}

// valijson names the place as {"<root>", "[key]", "[0]", ...}.
std::vector<std::string> tokens_of(const std::vector<std::string>& context) {
  std::vector<std::string> tokens;
  for (const std::string& part : context) {
    if (part.size() >= 2 && part.front() == '[') tokens.push_back(part.substr(1, part.size() - 2));
  }
  return tokens;
}

}  // namespace

std::string nearest_word(const std::string& word, const std::vector<std::string>& known) {
  std::string nearest;
  std::size_t smallest = std::max<std::size_t>(word.size() / 2, 1) + 1;
  for (const std::string& candidate : known) {
    // Levenshtein distance, one row at a time.
    std::vector<std::size_t> row(candidate.size() + 1);
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = i;
    for (std::size_t j = 1; j <= word.size(); ++j) {
      std::size_t diagonal = row[0];
      row[0] = j;
      for (std::size_t i = 1; i < row.size(); ++i) {
        const std::size_t change = diagonal + (word[j - 1] == candidate[i - 1] ? 0 : 1);
        diagonal = row[i];
        row[i] = std::min({change, row[i] + 1, row[i - 1] + 1});
      }
    }
    // A word that goes on where the other ends (unit forgotten) is near, too.
    const std::size_t shared = std::min(word.size(), candidate.size());
    const bool prefix = shared >= 4 && word.compare(0, shared, candidate, 0, shared) == 0;
    const std::size_t distance = prefix ? std::min<std::size_t>(row.back(), 1) : row.back();
    if (distance < smallest) {
      smallest = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

std::vector<std::string> schema_violations(const json& document) {
  valijson::Schema schema;
  valijson::SchemaParser parser;
  parser.populateSchema(valijson::adapters::NlohmannJsonAdapter(schema_document()), schema);
  valijson::Validator validator;
  valijson::ValidationResults results;
  if (validator.validate(schema, valijson::adapters::NlohmannJsonAdapter(document), &results)) return {};

  // valijson finds the places (and their parents); the schema at each place says what was expected there.
  std::map<std::vector<std::string>, std::vector<std::string>> lines_at;
  std::map<std::vector<std::string>, std::string> unexplained;
  for (const auto& error : results) {
    const std::vector<std::string> tokens = tokens_of(error.context);
    if (lines_at.count(tokens) != 0) continue;
    const json* node = &document;
    const json* node_schema = &schema_document();
    std::string pointer;
    for (const std::string& token : tokens) {
      node_schema = child_schema(*node_schema, *node, token);
      if (node_schema == nullptr) break;
      node = node->is_array() ? &(*node)[std::stoul(token)] : &(*node)[token];
      pointer += "/" + token;
    }
    std::vector<std::string>& lines = lines_at[tokens];
    if (node_schema != nullptr) own_violations(*node, *node_schema, pointer, lines);
    if (lines.empty()) unexplained[tokens] = pointer + ": " + error.description;
  }
  std::vector<std::string> all;
  for (const auto& [tokens, lines] : lines_at) all.insert(all.end(), lines.begin(), lines.end());
  if (all.empty()) {
    for (const auto& entry : unexplained) all.push_back(entry.second);
  }
  return all;
}

}  // namespace sulcus
