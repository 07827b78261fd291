#include "scenarios/loader/schema.h"

#include <gtest/gtest.h>

#include <functional>

#include "scenarios/loader/scenario.h"

namespace sulcus {
namespace {

using nlohmann::json;

json small_scenario() {
  return json::parse(R"({
    "sulcus": 1, "name": "small",
    "label_map": {"generate": {"box": {"size_mm": [10, 10, 10]}}},
    "mesh": {"size_mm": 5},
    "tissue": {"default": {"youngs_modulus_Pa": 1000}},
    "time": {"duration_s": 1}
  })");
}

void expect_line(const json& document, const std::vector<std::string>& words) {
  const std::vector<std::string> lines = schema_violations(document);
  ASSERT_EQ(lines.size(), 1u) << json(lines).dump(1);
  for (const std::string& word : words) EXPECT_NE(lines[0].find(word), std::string::npos) << lines[0];
}

TEST(ScenarioSchema, AcceptsASmallScenario) {
  EXPECT_TRUE(schema_violations(small_scenario()).empty());
}

TEST(ScenarioSchema, NamesTheNearestKnownKey) {
  json document = small_scenario();
  document["tissue"]["default"]["youngs_modulus"] = 5;
  expect_line(document, {"/tissue/default/youngs_modulus", "did you mean \"youngs_modulus_Pa\""});
  document = small_scenario();
  document["tisue"] = 1;
  expect_line(document, {"/tisue", "did you mean \"tissue\""});
  document = small_scenario();
  document["qqqqqqqqqqq"] = 1;
  expect_line(document, {"/qqqqqqqqqqq", "known keys", "label_map"});
  document = small_scenario();
  document["tissue"]["labels"]["grey"] = json::object();
  expect_line(document, {"/tissue/labels/grey", "whole number"});
}

TEST(ScenarioSchema, SaysWhatWasFoundAndExpected) {
  json document = small_scenario();
  document["tissue"]["default"]["youngs_modulus_Pa"] = -5;
  expect_line(document, {"/tissue/default/youngs_modulus_Pa", "found -5", "a number > 0", "Pa"});
  document["tissue"]["default"]["youngs_modulus_Pa"] = "1000";
  expect_line(document, {"found the string \"1000\"", "a number > 0"});
  document = small_scenario();
  document["tissue"]["default"]["poisson_ratio"] = 0.5;
  expect_line(document, {"/tissue/default/poisson_ratio", "found 0.5", "> -1 and < 0.5"});
  document = small_scenario();
  document["mesh"]["split"] = "seven";
  expect_line(document, {"/mesh/split", "\"five\" or \"six\""});
  document = small_scenario();
  document["sulcus"] = 2;
  expect_line(document, {"/sulcus", "found 2", "expected 1"});
  document = small_scenario();
  document["separation_pairs"] = {{2, 3}, {4}};
  expect_line(document, {"/separation_pairs/1", "1 elements, expected 2"});
  document["separation_pairs"] = {{2, 3}, {4, 0}};
  expect_line(document, {"/separation_pairs/1/1", "found 0", "other than 0"});
  document["separation_pairs"] = {{2, 3.5}};
  expect_line(document, {"/separation_pairs/0/1", "found 3.5", "whole number"});
}

TEST(ScenarioSchema, NamesMissingKeys) {
  json document = small_scenario();
  document.erase("time");
  expect_line(document, {"\"time\" is missing"});
  document = small_scenario();
  document["mesh"].erase("size_mm");
  expect_line(document, {"/mesh", "\"size_mm\" is missing", "cell"});
}

TEST(ScenarioSchema, WantsExactlyOneShape) {
  json document = small_scenario();
  document["label_map"]["generate"]["sphere"] = json::object();
  expect_line(document, {"/label_map/generate", "found 2", "exactly one", "cylinder_three_segments"});
}

TEST(ScenarioSchema, ListsEveryViolation) {
  json document = small_scenario();
  document["mesh"]["size_mm"] = 0;
  document["time"]["steps_s"] = 1;
  document["tissue"]["default"]["density_kg_m3"] = nullptr;
  document["tissue"]["rayleigh_beta_s"] = -1;
  EXPECT_EQ(schema_violations(document).size(), 4u) << json(schema_violations(document)).dump(1);
}

TEST(ScenarioSchema, RefusesDocumentsThatAreNoObject) {
  expect_line(json::array(), {"found an array", "expected an object"});
  expect_line(json(5), {"found 5"});
}

TEST(ScenarioSchema, IsStrictAndDescribedEverywhere) {
  const json schema = json::parse(scenario_schema());
  const std::function<void(const json&, const std::string&)> visit = [&](const json& node,
                                                                         const std::string& place) {
    if (!node.is_object()) return;
    if (node.value("type", json()) == "object") {
      EXPECT_EQ(node.value("additionalProperties", json()), json(false)) << place;
    }
    if (const auto properties = node.find("properties");
        properties != node.end() && properties->is_object()) {
      for (const auto& [key, child] : properties->items()) {
        EXPECT_TRUE(child.contains("description") || child.contains("$ref")) << place << "/" << key;
      }
    }
    for (const auto& [key, child] : node.items()) {
      if (key != "default") visit(child, place + "/" + key);
    }
  };
  visit(schema, "");
}

TEST(NearestWord, IsByEditDistance) {
  EXPECT_EQ(nearest_word("tolerence", {"precision", "tolerance", "max_iterations"}), "tolerance");
  EXPECT_EQ(nearest_word("stiffness", {"damping_N_s_m", "stiffness_N_m"}), "stiffness_N_m");
  EXPECT_EQ(nearest_word("xyz", {"precision", "tolerance"}), "");
  EXPECT_EQ(nearest_word("", {"precision"}), "");
}

}  // namespace
}  // namespace sulcus
