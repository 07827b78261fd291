// Scenarios that tear, and nodes on paths: what the file says is what the scene has.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "scenarios/loader/scenario.h"
#include "scenarios/loader/test_refusal.h"

namespace sulcus {
namespace {

using nlohmann::json;

json tearing() {
  return json::parse(R"({
    "sulcus": 1, "name": "tearing",
    "label_map": {"generate": {"box": {"size_mm": [20, 20, 40], "voxel_size_mm": 2.5, "label": 1}},
                  "operations": [{"paint_box_mm": {"min": [-10, -10, -5], "max": [10, 10, 5], "label": 2}}]},
    "mesh": {"size_mm": 5},
    "tissue": {"default": {"youngs_modulus_Pa": 2000, "poisson_ratio": 0.4},
               "labels": {"2": {"youngs_modulus_Pa": 500, "fracture_threshold_Pa": 150}}},
    "boundary": {"fixed": [{"below_mm": {"axis": "z", "value": -20}}],
                 "motions": [{"name": "pull", "above_mm": {"axis": "z", "value": 20}, "centre_mm": [0, 0, 20],
                              "waypoints": [{"time_s": 0}, {"time_s": 0.5, "shift_mm": [0, 0, 10], "path": "linear"},
                                            {"time_s": 1, "axis": [0, 0, 2], "angle_deg": 90, "path": "linear"}]}]},
    "fracture": {"criterion": "largest_absolute", "steps_above": 3, "avoid_singularities": false,
                 "remove_detached": true},
    "time": {"step_s": 0.05, "duration_s": 1},
    "checks": {"min_torn_elements": 4, "max_torn_elements": 90, "labels_stay": [1], "max_hanging_elements": 7,
               "min_hanging_energy_uJ": 2, "max_kinetic_energy_uJ": 50, "energy_growth": 0.2}
  })");
}

Scenario load(const json& document) {
  return load_scenario_text(document.dump(), "test.json", ".");
}

void expect_refused(const json& document, const std::vector<std::string>& words) {
  expect_refusal([&] { load(document); }, words);
}

TEST(TearingScenario, IsReadAsItStands) {
  const Scenario scenario = load(tearing());
  ASSERT_TRUE(scenario.scene.fracture.has_value());
  EXPECT_EQ(scenario.scene.fracture->criterion, FractureCriterion::largest_absolute);
  EXPECT_EQ(scenario.scene.fracture->steps_above, 3);
  EXPECT_FALSE(scenario.scene.fracture->avoid_singularities);
  EXPECT_TRUE(scenario.scene.fracture->remove_detached);
  EXPECT_EQ(scenario.scene.materials.at(2).fracture_threshold_Pa, 150);
  EXPECT_TRUE(std::isinf(scenario.scene.material.fracture_threshold_Pa));
  EXPECT_EQ(scenario.checks.min_torn_elements, 4);
  EXPECT_EQ(scenario.checks.max_torn_elements, 90);
  EXPECT_EQ(scenario.checks.labels_stay, std::vector<std::int32_t>{1});
  EXPECT_EQ(scenario.checks.max_hanging_elements, 7);
  EXPECT_NEAR(*scenario.checks.min_hanging_energy_J, 2e-6, 1e-18);
  EXPECT_NEAR(*scenario.checks.max_kinetic_energy_J, 5e-5, 1e-18);
  EXPECT_EQ(scenario.checks.max_energy_growth, 0.2);
}

TEST(TearingScenario, BecomesASceneWithThresholdsOfItsCellsAndAPathOfEachStep) {
  const Scenario scenario = load(tearing());
  const Scene scene = make_scene(scenario);
  ASSERT_NE(scene.fracture, nullptr);
  for (std::int64_t t = 0; t < scene.tet_count(); ++t) {
    const auto cell = static_cast<std::size_t>(t / 5);
    const double threshold = scene.fracture->threshold[static_cast<std::size_t>(t)];
    if (scene.mesh.cell_label[cell] == 2) {
      EXPECT_EQ(threshold, 150);
    } else {
      EXPECT_TRUE(std::isinf(threshold));
    }
  }
  ASSERT_EQ(scene.settings.motions.size(), 1U);
  const PrescribedMotion& motion = scene.settings.motions[0];
  EXPECT_EQ(motion.nodes.size(), 25U);  // the upper face
  ASSERT_EQ(motion.path.size(), 21U);
  EXPECT_NEAR(motion.path[5].shift[2], 0.005, 1e-12);
  EXPECT_NEAR(motion.path[20].shift[2], 0.010, 1e-12);
  const Vec3 turned = rotation_matrix(motion.path[20].turn) * Vec3(1, 0, 0);
  EXPECT_LT((turned - Vec3(0, 1, 0)).norm(), 1e-12);
}

TEST(TearingScenario, WithoutAThresholdOrWithOneOfZeroIsRefusedWithThePlace) {
  json document = tearing();
  document["tissue"]["labels"]["2"].erase("fracture_threshold_Pa");
  expect_refused(document, {"/fracture", "fracture_threshold_Pa"});
  for (const json& wrong : {json(0), json(-3), json("high")}) {
    document = tearing();
    document["tissue"]["labels"]["2"]["fracture_threshold_Pa"] = wrong;
    expect_refused(document, {"/tissue/labels/2/fracture_threshold_Pa"});
  }
}

TEST(TearingScenario, WithAToolNeedsTheDetectionThatFollowsTornTissue) {
  json document = tearing();
  document["tools"] = json::parse(R"([{"name": "ball", "shape": {"sphere": {"radius_mm": 3}},
    "device": {"scripted": {"waypoints": [{"time_s": 0, "position_mm": [0, 0, 60]},
                                          {"time_s": 1, "position_mm": [0, 0, 50]}]}}}])");
  expect_refused(document, {"/contact/detection", "surface_nodes"});
  document["contact"]["detection"] = "surface_nodes";
  EXPECT_EQ(make_scene(load(document)).tool_distances.size(), 1U);
}

TEST(Motions, ThatEndTooEarlyOrShareANameAreRefused) {
  json document = tearing();
  document["boundary"]["motions"][0]["waypoints"].erase(2);
  expect_refused(document, {"/boundary/motions/0/waypoints", "ends at 0.5 s"});
  document = tearing();
  document["boundary"]["motions"].push_back(document["boundary"]["motions"][0]);
  expect_refused(document, {"/boundary/motions/1/name", "taken"});
}

TEST(Motions, LeaveFixedNodesFixedAndSaySo) {
  json document = tearing();
  document["boundary"]["motions"][0].erase("above_mm");
  document["boundary"]["motions"][0]["below_mm"] = {{"axis", "z"}, {"value", -15}};
  std::vector<std::string> warnings;
  const Scene scene = make_scene(load(document), &warnings);
  EXPECT_EQ(scene.settings.motions[0].nodes.size(), 25U);  // the second layer; the first is fixed
  EXPECT_TRUE(std::any_of(warnings.begin(), warnings.end(), [](const std::string& w) {
    return w.find("/boundary/motions/0: 25 nodes are fixed") != std::string::npos;
  }));
}

TEST(Layer, BetweenPairsIsAsThickAsAskedAndClosesTheFissure) {
  json document = tearing();
  document["label_map"]["operations"] = json::parse(R"([
    {"paint_box_mm": {"min": [-10, -10, 0], "max": [10, 10, 20], "label": 2}},
    {"layer_between_pairs": {"label": 7, "voxels": 2}}])");
  document["separation_pairs"] = {{1, 2}};
  document["tissue"]["labels"] = json::parse(R"({"7": {"fracture_threshold_Pa": 50, "prevails": true}})");
  document["checks"].erase("labels_stay");
  const Scenario scenario = load(document);
  const LabelMap map = load_label_map(scenario);
  for (int k = 0; k < map.size[2]; ++k) {
    const int expected = k < 6 ? 1 : k < 10 ? 7 : 2;  // 16 layers, the pair's faces in the middle
    EXPECT_EQ(map.labels[map.index(3, 4, k)], expected) << k;
  }
  const Scene scene = make_scene(scenario);
  EXPECT_EQ(mesh_pieces(scene.mesh.tets, scene.node_count()).item_count.size(), 1U);
  for (std::size_t cell = 0; cell < scene.mesh.cell_label.size(); ++cell) {
    const int k = scene.mesh.cell_position[cell][2];
    EXPECT_EQ(scene.mesh.cell_label[cell], k < 3 ? 1 : k < 5 ? 7 : 2);
  }
}

TEST(Layer, ThinnerThanACellPrevailsWhereAsked) {
  for (const bool prevails : {false, true}) {
    json document = tearing();
    document["label_map"]["operations"] = json::parse(R"([
      {"paint_box_mm": {"min": [-10, -10, 2.5], "max": [10, 10, 5], "label": 7}}])");
    document["mesh"]["size_mm"] = 10;
    document["tissue"]["labels"] = {{"7", {{"fracture_threshold_Pa", 50}, {"prevails", prevails}}}};
    document["checks"].erase("labels_stay");
    const Scene scene = make_scene(load(document));
    const auto count = std::count(scene.mesh.cell_label.begin(), scene.mesh.cell_label.end(), 7);
    EXPECT_EQ(count, prevails ? 4 : 0);
  }
}

}  // namespace
}  // namespace sulcus
