#include "scenarios/loader/scenario.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"
#include "scenarios/loader/test_refusal.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

json tool(const char* name) {
  return {
      {"name", name},
      {"shape", {{"sphere", {{"radius_mm", 2}, {"subdivisions", 1}}}}},
      {"device",
       {{"scripted",
         {{"waypoints",
           {{{"time_s", 0}, {"position_mm", {0, 0, 20}}}, {{"time_s", 1}, {"position_mm", {0, 0, 12}}}}}}}}}};
}

json full_scenario() {
  json document = json::parse(R"({
    "sulcus": 1, "name": "full", "title": "A block", "description": "Pressed by a ball.",
    "label_map": {"generate": {"box": {"size_mm": [10, 10, 20], "label": 3}},
                  "operations": [{"relabel": {"from": [3], "to": 4}}]},
    "mesh": {"size_mm": 5, "split": "six"},
    "tissue": {"default": {"youngs_modulus_Pa": 2000, "poisson_ratio": 0.4, "density_kg_m3": 900},
               "labels": {"4": {"youngs_modulus_Pa": 3000}},
               "rayleigh_beta_s": 0.1, "gravity_m_s2": [0, 0, -9.81]},
    "boundary": {"fixed": [{"below_mm": {"axis": "z", "value": -10}}],
                 "springs": [{"above_mm": {"axis": "z", "value": 10}, "stiffness_N_m": 5, "damping_N_s_m": 0.5}]},
    "contact": {"stiffness_N_m": 20, "anisotropy": 1, "tension_rule": false},
    "time": {"step_s": 0.01, "duration_s": 1},
    "solver": {"precision": "double", "tolerance": 1e-6, "measure_error_every_steps": 5},
    "checks": {"max_penetration_mm": 3, "solver_error": 0.01},
    "pictures": {"camera": {"eye_mm": [100, 0, 0], "target_mm": [0, 0, 0]},
                 "shots": [{"name": "end", "time_s": 1, "show": "max_principal_stress"}]},
    "label_colours": {"4": "#ff8000"}
  })");
  document["tools"] = json::array({tool("ball")});
  return document;
}

Scenario load(const json& document, const std::vector<std::string>& overrides = {}) {
  return load_scenario_text(document.dump(), "test.json", fs::temp_directory_path(), overrides);
}

void expect_refused(const json& document, const std::vector<std::string>& words) {
  expect_refusal([&] { load(document); }, words);
}

bool mentions(const std::vector<std::string>& lines, const std::string& words) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const std::string& line) { return line.find(words) != std::string::npos; });
}

TEST(Scenarios, AreReadInSIUnits) {
  const Scenario scenario = load(full_scenario());
  EXPECT_EQ(scenario.name, "full");
  EXPECT_DOUBLE_EQ(scenario.scene.embedding.size_m, 0.005);
  EXPECT_EQ(scenario.scene.embedding.split, TetSplit::six);
  EXPECT_EQ(scenario.scene.material.youngs_modulus_Pa, 2000);
  EXPECT_EQ(scenario.scene.materials.at(4).youngs_modulus_Pa, 3000);
  EXPECT_EQ(scenario.scene.materials.at(4).poisson_ratio, 0.4);
  EXPECT_EQ(scenario.scene.damping.beta_s, 0.1);
  EXPECT_EQ(scenario.scene.gravity, Vec3(0, 0, -9.81));
  EXPECT_DOUBLE_EQ(scenario.fixed.at(0).max_m[2], -0.010);
  EXPECT_EQ(scenario.springs.at(0).stiffness_N_m, 5);
  EXPECT_FALSE(scenario.scene.contact.tension_rule);
  EXPECT_EQ(scenario.scene.solver.precision, Precision::double_precision);
  EXPECT_EQ(scenario.scene.tools.at(0).surface.vertices.size(), 42u);
  EXPECT_DOUBLE_EQ(scenario.hands.at(0).script.waypoints.at(1).position_m[2], 0.012);
  EXPECT_DOUBLE_EQ(scenario.checks.max_penetration_m.value(), 0.003);
  EXPECT_FALSE(scenario.checks.max_force_N.has_value());
  EXPECT_DOUBLE_EQ(scenario.pictures.shots.at(0).camera.eye_m[0], 0.1);
  EXPECT_EQ(scenario.pictures.shots.at(0).show, ShotContent::max_principal_stress);
  EXPECT_EQ(scenario.label_colours.at(4), (std::array<std::uint8_t, 3>{255, 128, 0}));
  EXPECT_EQ(scenario.steps(), 100);
  EXPECT_TRUE(scenario.warnings.empty()) << scenario.warnings.front();
}

TEST(Scenarios, NameALawAndADampingForEachLabel) {
  const Scenario scenario =
      load(full_scenario(), {"/tissue/default/law=linear", "/tissue/labels/4/law=corotated",
                             "/tissue/labels/4/rayleigh_alpha_1_s=0.5"});
  EXPECT_EQ(scenario.scene.material.law, Law::linear);
  EXPECT_FALSE(scenario.scene.material.damping.has_value());
  const Material& named = scenario.scene.materials.at(4);
  EXPECT_EQ(named.law, Law::corotated);
  ASSERT_TRUE(named.damping.has_value());
  EXPECT_EQ(named.damping->alpha_1_s, 0.5);
  EXPECT_EQ(named.damping->beta_s, scenario.scene.damping.beta_s);  // what it does not name is the tissue's
  json wrong = full_scenario();
  wrong["tissue"]["default"]["law"] = "rubber";
  expect_refused(wrong, {"/tissue/default/law", "rubber", "corotated", "linear"});
}

TEST(Scenarios, ResolvedTextGivesTheSameScenario) {
  const Scenario first = load(full_scenario(), {"/mesh/size_mm=2.5"});
  const Scenario second = load_scenario_text(first.resolved_json, "again", fs::temp_directory_path());
  EXPECT_EQ(second.resolved_json, first.resolved_json);
  EXPECT_EQ(second.scene.embedding.size_m, 0.0025);
}

TEST(Scenarios, DefaultsOfTheSchemaAreThoseOfTheEngine) {
  json document = full_scenario();
  for (const char* key : {"tissue", "boundary", "contact", "solver", "checks", "pictures", "label_colours"}) {
    document.erase(key);
  }
  document["time"].erase("step_s");
  document["time"]["duration_s"] = 0.99;
  const Scenario scenario = load(document);
  const json schema = json::parse(scenario_schema());
  const auto default_of = [&](const std::string& pointer) {
    return schema.at(json::json_pointer(pointer + "/default")).get<double>();
  };
  EXPECT_EQ(scenario.scene.contact.stiffness_N_m, default_of("/properties/contact/properties/stiffness_N_m"));
  EXPECT_EQ(scenario.scene.contact.damping_N_s_m, default_of("/properties/contact/properties/damping_N_s_m"));
  EXPECT_EQ(scenario.scene.contact.anisotropy, default_of("/properties/contact/properties/anisotropy"));
  EXPECT_EQ(scenario.scene.step_s, default_of("/properties/time/properties/step_s"));
  EXPECT_EQ(scenario.scene.solver.tolerance, default_of("/properties/solver/properties/tolerance"));
  EXPECT_EQ(scenario.scene.solver.max_iterations, default_of("/properties/solver/properties/max_iterations"));
  EXPECT_EQ(scenario.scene.solver.velocity_floor_m_s,
            default_of("/properties/solver/properties/velocity_floor_m_s"));
  EXPECT_EQ(scenario.scene.material.youngs_modulus_Pa,
            default_of("/definitions/material/properties/youngs_modulus_Pa"));
  EXPECT_EQ(scenario.scene.material.poisson_ratio,
            default_of("/definitions/material/properties/poisson_ratio"));
  EXPECT_EQ(scenario.scene.material.density_kg_m3,
            default_of("/definitions/material/properties/density_kg_m3"));
  const std::string coupling = "/properties/tools/items/properties/coupling/properties/";
  EXPECT_EQ(scenario.scene.tools[0].coupling.stiffness_N_m, default_of(coupling + "stiffness_N_m"));
  EXPECT_EQ(scenario.scene.tools[0].coupling.damping_N_s_m, default_of(coupling + "damping_N_s_m"));
  EXPECT_EQ(scenario.scene.tools[0].coupling.rotational_stiffness_N_m_rad,
            default_of(coupling + "rotational_stiffness_N_m_rad"));
  EXPECT_EQ(scenario.scene.tools[0].coupling.rotational_damping_N_m_s_rad,
            default_of(coupling + "rotational_damping_N_m_s_rad"));
  const std::string golden = "/properties/golden/properties/";
  EXPECT_EQ(scenario.golden.picture_conformity, default_of(golden + "picture_conformity"));
  EXPECT_EQ(scenario.golden.picture_block_distance, default_of(golden + "picture_block_distance"));
}

TEST(Overrides, SetNumbersTextsAndWholeParts) {
  const Scenario scenario =
      load(full_scenario(), {"/solver/tolerance=1e-3", "/mesh/split=five", "/separation_pairs=[[4,5]]",
                             "/tools/0/device/scripted/waypoints/1/time_s=2", "/record/frame_every_steps=7"});
  EXPECT_EQ(scenario.scene.solver.tolerance, 1e-3);
  EXPECT_EQ(scenario.scene.embedding.split, TetSplit::five);
  EXPECT_TRUE(scenario.scene.pairs.contains(5, 4));
  EXPECT_EQ(scenario.hands[0].script.waypoints[1].time_s, 2);
  EXPECT_EQ(scenario.frame_every_steps, 7);  // a key that the file leaves out
  EXPECT_NE(scenario.resolved_json.find("\"frame_every_steps\": 7"), std::string::npos);
}

TEST(Overrides, ThatPointNowhereAreRefused) {
  const json document = full_scenario();
  expect_refusal([&] { load(document, {"/solver/tolerence=1e-3"}); },
                 {"/solver/tolerence", "did you mean \"tolerance\""});
  expect_refusal([&] { load(document, {"/tools/3/name=x"}); },
                 {"/tools/3/name=x", "1 elements", "no element 3"});
  expect_refusal([&] { load(document, {"/tools/-1/name=x"}); }, {"no element -1"});
  expect_refusal([&] { load(document, {"/mesh/size_mm/x=1"}); }, {"/mesh/size_mm/x=1", "no member"});
  expect_refusal([&] { load(document, {"solver/tolerance=1"}); }, {"expected /json/pointer=value"});
  expect_refusal([&] { load(document, {"/solver/tolerance"}); }, {"expected /json/pointer=value"});
  expect_refusal([&] { load(document, {"/mesh/size_mm=many"}); }, {"/mesh/size_mm", "\"many\"", "a number"});
}

TEST(ScenarioErrors, OfSyntaxHaveLineAndColumn) {
  const auto load_text = [](const std::string& text) { load_scenario_text(text, "bad.json", "."); };
  expect_refusal([&] { load_text("{\n  \"sulcus\": 1,\n  \"name\" \"x\"\n}"); },
                 {"bad.json", "line 3", "column 12"});
  expect_refusal([&] { load_text(""); }, {"bad.json", "line 1"});
  expect_refusal([&] { load_text("{\"sulcus\": 1, \"sulcus\": 1}"); }, {"\"sulcus\" stands twice"});
  expect_refusal([&] { load_text("{\"sulcus\": 1e999}"); }, {"bad.json", "1e999"});
  expect_refusal([&] { load_text("{\"sulcus\": NaN}"); }, {"line 1"});
}

TEST(ScenarioErrors, OfTheSchemaAreAllListed) {
  json document = full_scenario();
  document["contact"]["stiffness_N_m"] = -1;
  document["mesh"]["sizes_mm"] = 1;
  expect_refused(document,
                 {"test.json: 2 errors", "/contact/stiffness_N_m: found -1", "/mesh/sizes_mm: unknown key"});
}

TEST(ScenarioErrors, OfTrajectoriesCarryARemedy) {
  json document = full_scenario();
  document["time"]["duration_s"] = 2;
  expect_refused(document,
                 {"/tools/0/device/scripted/waypoints", "ends at 1.0 s", "lasts 2.0 s", "add a way-point"});
  document = full_scenario();
  json& waypoints = document["tools"][0]["device"]["scripted"]["waypoints"];
  waypoints[1]["time_s"] = 0;
  expect_refused(document, {"/waypoints/1/time_s", "times must increase"});
  document = full_scenario();
  document["tools"][0]["device"]["scripted"]["waypoints"][0].erase("position_mm");
  expect_refused(document, {"/waypoints/0", "position_mm"});
  document = full_scenario();
  document["tools"][0]["device"]["scripted"]["waypoints"][1]["path"] = "hold";
  expect_refused(document, {"/tools/0/device/scripted/waypoints", "hold"});
  document = full_scenario();
  document["tools"][0]["device"]["scripted"]["waypoints"][1]["axis"] = {0, 0, 0};
  expect_refused(document, {"/waypoints/1/axis", "no length"});
}

TEST(ScenarioErrors, OptionalDataThatAreNotHereAreSaidToBeMissingAndHowToGetThem) {
  json document = full_scenario();
  document["label_map"] = {{"file", "absent.nrrd"}, {"optional", "copy it from the atlas"}};
  try {
    load_scenario_text(document.dump(), "test.json", "/nowhere");
    FAIL() << "nothing was missing";
  } catch (const MissingData& missing) {
    const std::string text = missing.what();
    EXPECT_NE(text.find("/nowhere/absent.nrrd"), std::string::npos) << text;
    EXPECT_NE(text.find("copy it from the atlas"), std::string::npos) << text;
  }
  document["mesh"]["size_mm"] = -1;  // what is wrong is said first
  expect_refused(document, {"/mesh/size_mm"});
}

TEST(ScenarioErrors, MeasuresNameAToolAndABound) {
  json document = full_scenario();
  json measure = {{"what", "pull_N"}, {"tool", "ball"}, {"at_most", 0}};
  document["checks"]["measures"] = json::array({measure});
  EXPECT_EQ(load_scenario_text(document.dump(), "test.json", ".").checks.measures.size(), 1U);
  measure["tool"] = "knife";
  document["checks"]["measures"] = json::array({measure});
  expect_refused(document, {"/checks/measures/0/tool", "knife"});
  measure = {{"what", "least_position_mm"}, {"tool", "ball"}, {"at_least", 1}};
  document["checks"]["measures"] = json::array({measure});
  expect_refused(document, {"/checks/measures/0/tool", "leave it out"});
  measure = {{"what", "pull_N"}, {"tool", "ball"}};
  document["checks"]["measures"] = json::array({measure});
  expect_refused(document, {"/checks/measures/0", "at_least"});
  measure["at_most"] = 0;
  measure["along"] = {0, 0, 0};
  document["checks"]["measures"] = json::array({measure});
  expect_refused(document, {"/along", "no length"});
}

TEST(ScenarioErrors, OfContradictionsArePointedOut) {
  json document = full_scenario();
  document["label_map"]["file"] = "x.nrrd";
  expect_refused(document, {"/label_map", "exactly one"});
  document = full_scenario();
  document["label_map"] = {{"file", "/usr/share/mricron/templates/absent.nii.gz"}};
  expect_refused(document, {"/label_map/file", "does not exist", "mricron-data"});
  document = full_scenario();
  document["tools"].push_back(tool("ball"));
  expect_refused(document, {"/tools/1/name", "taken"});
  document = full_scenario();
  document["tools"][0]["inertia_kg_m2"] = {1, 2};
  expect_refused(document, {"/tools/0/inertia_kg_m2", "2 numbers"});
  document["tools"][0]["inertia_kg_m2"] = {1, 2, -3};
  expect_refused(document, {"/tools/0/inertia_kg_m2", "positive definite"});
  document = full_scenario();
  document["tools"][0]["shape"] = {{"retractor", {{"thickness_mm", 50}}}};
  expect_refused(document, {"/tools/0/shape", "thickness"});
  document = full_scenario();
  document["separation_pairs"] = {{2, 2}};
  expect_refused(document, {"/separation_pairs", "2"});
  document = full_scenario();
  document["pictures"]["shots"][0]["time_s"] = 3;
  EXPECT_TRUE(
      mentions(load(document).warnings, "/pictures/shots/0/time_s: found 3.0 s, the run ends at 1.0 s"));
  document = full_scenario();
  document["pictures"]["camera"]["target_mm"] = {100, 0, 5};
  expect_refused(document, {"/pictures/camera", "up direction"});
  document = full_scenario();
  document["pictures"].erase("camera");
  expect_refused(document, {"/pictures/shots/0", "no camera"});
  document = full_scenario();
  document["boundary"]["springs"][0]["box_mm"] = {{"min", {0, 0, 0}}, {"max", {1, 1, 1}}};
  expect_refused(document, {"/boundary/springs/0", "2 regions"});
  document = full_scenario();
  document["boundary"]["fixed"] = {{{"box_mm", {{"min", {0, 0, 0}}, {"max", {1, -1, 1}}}}}};
  expect_refused(document, {"/boundary/fixed/0/box_mm", "max is less than min"});
  document = full_scenario();
  document["tissue"]["labels"] = {{"99999999999", json::object()}};
  expect_refused(document, {"/tissue/labels/99999999999"});
}

TEST(Waypoints, KeepWhatIsLeftOut) {
  json document = full_scenario();
  document["tools"][0]["device"]["scripted"]["waypoints"] = json::parse(R"([
    {"time_s": 0, "position_mm": [1, 2, 30], "axis": [0, 0, 2], "angle_deg": 90},
    {"time_s": 0.5, "path": "hold"},
    {"time_s": 1, "angle_deg": 180, "path": "linear"}])");
  const Scenario scenario = load(document);
  const auto& waypoints = scenario.hands[0].script.waypoints;
  EXPECT_EQ(waypoints[1].position_m, waypoints[0].position_m);
  EXPECT_EQ(waypoints[2].position_m, waypoints[0].position_m);
  EXPECT_EQ(waypoints[1].path, Path::hold);
  EXPECT_LT((rotation_matrix(waypoints[1].orientation) * Vec3::UnitX() - Vec3::UnitY()).norm(), 1e-12);
  EXPECT_LT((rotation_matrix(waypoints[2].orientation) * Vec3::UnitX() + Vec3::UnitX()).norm(), 1e-12);
}

TEST(Devices, FollowTheirScripts) {
  const Scenario scenario = load(full_scenario());
  auto devices = make_devices(scenario);
  ASSERT_EQ(devices.size(), 1u);
  devices[0]->open();
  devices[0]->calibrate();
  devices[0]->arm();
  DeviceSample sample;
  ASSERT_EQ(devices[0]->read(1.0, sample), DeviceError::none);
  EXPECT_LT((sample.position - Vec3(0, 0, 0.012)).norm(), 1e-12);
}

TEST(LabelOperations, AreDoneInOrder) {
  json document = full_scenario();
  document["label_map"]["operations"] = json::parse(R"([
    {"keep_box_mm": {"min": [-5, -5, -10], "max": [5, 5, 0]}}, {"relabel": {"from": [3], "to": 8}},
    {"keep_labels": [8]}])");
  const LabelMap map = load_label_map(load(document));
  EXPECT_EQ(std::count(map.labels.begin(), map.labels.end(), 8), 1000);
  EXPECT_EQ(std::count(map.labels.begin(), map.labels.end(), 0), 1000);
  document["label_map"]["operations"] = json::parse(R"([{"keep_labels": [77]}])");
  expect_refusal([&] { load_label_map(load(document)); }, {"/label_map/operations", "no labelled voxel"});
}

TEST(Scenes, AreBuiltWithTheirBoundary) {
  std::vector<std::string> warnings;
  const Scene scene = make_scene(load(full_scenario()), &warnings);
  EXPECT_EQ(scene.tet_count(), 2 * 2 * 4 * 6);
  EXPECT_EQ(scene.settings.fixed_nodes.size(), 9u);
  EXPECT_EQ(scene.settings.springs.size(), 9u);
  EXPECT_EQ(scene.settings.springs[0].damping_N_s_m, 0.5);
  EXPECT_TRUE(warnings.empty()) << warnings.front();
}

TEST(Scenes, SpreadForcesByTheCellsAroundANodeAndCountPlanes) {
  json document = full_scenario();
  document["boundary"]["forces"] = {
      {{"above_mm", {{"axis", "z"}, {"value", 10}}}, {"force_N", {0.5, 0, -2}}}};
  document["boundary"]["planes"] = {{{"below_mm", {{"axis", "x"}, {"value", -5}}}, {"axis", "x"}},
                                    {{"below_mm", {{"axis", "y"}, {"value", -5}}}, {"axis", "y"}}};
  const Scene scene = make_scene(load(document));
  Vec3 sum = Vec3::Zero();
  double least = 1e9, most = 0;  // of the 3 x 3 nodes on top
  for (const NodeForce& load : scene.settings.forces) {
    sum += load.force_N;
    least = std::min(least, load.force_N[0]);
    most = std::max(most, load.force_N[0]);
  }
  EXPECT_EQ(scene.settings.forces.size(), 9u);
  EXPECT_LT((sum - Vec3(0.5, 0, -2)).norm(), 1e-12);
  EXPECT_NEAR(most, 4 * least, 1e-12);  // the middle has four cells, a corner one
  EXPECT_EQ(scene.plane_count, 2u);
  for (const SlidingNode& sliding : scene.settings.sliding) EXPECT_EQ(sliding.axis, sliding.plane);
  document["boundary"]["forces"][0].erase("force_N");
  expect_refused(document, {"/boundary/forces/0", "force_N"});
}

TEST(Scenes, WithoutNodesInARegionAreRefused) {
  json document = full_scenario();
  document["boundary"]["fixed"] = {{{"below_mm", {{"axis", "x"}, {"value", -50}}}}};
  expect_refusal([&] { make_scene(load(document)); }, {"/boundary/fixed/0", "no node", "x -5 .. 5"});
}

TEST(Scenes, WarnOfWhatIsOdd) {
  json document = full_scenario();
  document["separation_pairs"] = {{4, 9}};
  document["tissue"]["labels"]["7"] = json::object();
  document["boundary"] = json::object();
  document["tools"][0]["device"]["scripted"]["waypoints"][0]["position_mm"] = {0, 0, 9};
  document["time"]["duration_s"] = 1.004;
  const Scenario scenario = load(document);
  EXPECT_TRUE(mentions(scenario.warnings, "no whole number of steps"));
  std::vector<std::string> warnings;
  make_scene(scenario, &warnings);
  EXPECT_TRUE(mentions(warnings, "[4, 9]: the label map has no voxel of label 9"));
  EXPECT_TRUE(mentions(warnings, "/tissue/labels/7"));
  EXPECT_TRUE(mentions(warnings, "nothing holds the tissue"));
  EXPECT_TRUE(mentions(warnings, "start inside the tissue"));
}

TEST(ScenarioFiles, AreAllValid) {
  const auto summaries = list_scenarios(fs::path(SULCUS_SOURCE_DIR) / "scenarios");
  EXPECT_GE(summaries.size(), 2u);
  for (const ScenarioSummary& summary : summaries) {
    if (summary.error.find("mricron-data") != std::string::npos) continue;  // its input is not installed
    EXPECT_EQ(summary.error, "") << summary.path;
    EXPECT_NE(summary.title, "") << summary.path;
    EXPECT_EQ(summary.name, summary.path.stem().string());
  }
}

TEST(ScenarioFiles, GiveScenesWithoutWarnings) {
  for (const ScenarioSummary& summary : list_scenarios(fs::path(SULCUS_SOURCE_DIR) / "scenarios")) {
    if (!summary.error.empty() || !summary.missing.empty()) continue;
    if (summary.path.parent_path().filename() == "hard") continue;  // odd on purpose
    const Scenario scenario = load_scenario(summary.path);
    std::vector<std::string> warnings = scenario.warnings;
    const Scene scene = make_scene(scenario, &warnings);
    EXPECT_GT(scene.tet_count(), 0);
    for (const std::string& warning : warnings) ADD_FAILURE() << summary.path << ": " << warning;
  }
}

TEST(ScenarioFiles, ListNamesInputFilesAndErrors) {
  const fs::path directory = fs::path(testing::TempDir()) / ("sulcus_list_" + std::to_string(getpid()));
  fs::create_directories(directory);
  LabelMap map;
  map.size = {10, 10, 10};
  map.labels.assign(1000, 1);
  write_label_map(directory / "block.nrrd", map);
  json good = full_scenario();
  good["name"] = "good";
  good["label_map"] = {{"file", "block.nrrd"}};
  std::ofstream(directory / "good.json") << good.dump(1);
  good["mesh"]["size_mm"] = -1;
  std::ofstream(directory / "wrong.json") << good.dump(1);
  std::ofstream(directory / "torn.json") << "{";
  std::ofstream(directory / "other.json") << "{\"some\": \"thing\"}";
  const auto summaries = list_scenarios(directory);
  ASSERT_EQ(summaries.size(), 3u);
  EXPECT_EQ(summaries[0].name, "good");
  EXPECT_EQ(summaries[0].error, "");
  EXPECT_NE(summaries[1].error.find("line 1"), std::string::npos);
  EXPECT_NE(summaries[2].error.find("/mesh/size_mm"), std::string::npos);
  EXPECT_EQ(load_scenario(directory / "good.json").input_files,
            (std::vector<fs::path>{directory / "good.json", directory / "block.nrrd"}));
  // a recording's text finds its label map from any other place
  EXPECT_NO_THROW(load_scenario_text(load_scenario(directory / "good.json").resolved_json, "recording", "/"));
  EXPECT_THROW(list_scenarios(directory / "none"), InputError);
  expect_refusal([&] { load_scenario(directory / "none.json"); }, {"none.json", "does not exist"});
  expect_refusal([&] { load_scenario(directory); }, {"is a directory"});
  fs::remove_all(directory);
}

// A recording is read again from anywhere, and moves no hand again: it holds the samples.
TEST(Scenarios, FilesOfToolsAndHandsAreFoundBesideTheScenarioAndLaterFromAnywhere) {
  const fs::path directory = fs::temp_directory_path() / ("sulcus_hand_files_" + std::to_string(getpid()));
  fs::create_directories(directory);
  std::ofstream(directory / "hand.csv") << "time_s,x_m,y_m,z_m,qs,qx,qy,qz\n0,0,0,0.02,1,0,0,0\n"
                                        << "1,0,0,0.012,1,0,0,0\n";
  std::ofstream(directory / "wedge.obj") << "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\n"
                                         << "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
  json document = full_scenario();
  document["tools"][0]["shape"] = {{"mesh", {{"file", "wedge.obj"}}}};
  document["tools"][0]["device"] = {{"recorded", {{"file", "hand.csv"}}}};
  std::ofstream(directory / "full.json") << document;
  const Scenario scenario = load_scenario(directory / "full.json");
  ASSERT_EQ(scenario.hands.at(0).script.waypoints.size(), 2u);
  EXPECT_EQ(scenario.hands[0].script.waypoints[1].position_m, Vec3(0, 0, 0.012));
  EXPECT_EQ(scenario.input_files.back(), directory / "hand.csv");
  fs::remove(directory / "hand.csv");
  const Scenario again = load_scenario_text(scenario.resolved_json, "recording", "/");
  EXPECT_EQ(again.scene.tools[0].surface.vertices.size(), 4u);
  EXPECT_NO_THROW(make_scene(again));
  EXPECT_THROW(make_devices(again), InputError);
  fs::remove_all(directory);
}

}  // namespace
}  // namespace sulcus
