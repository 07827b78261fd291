// Scenarios that are patches of others, and what the hard ones ask for: a start out of shape, errors of a
// segmentation.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/scene/state.h"
#include "scenarios/loader/scenario.h"
#include "scenarios/loader/test_refusal.h"

namespace sulcus {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

json block() {
  return json::parse(R"({
    "sulcus": 1, "name": "block", "title": "A block",
    "label_map": {"generate": {"box": {"size_mm": [20, 20, 20], "voxel_size_mm": 2}}},
    "mesh": {"size_mm": 10},
    "tissue": {"default": {"youngs_modulus_Pa": 1000, "poisson_ratio": 0.4}, "rayleigh_beta_s": 0.05},
    "boundary": {"fixed": [{"below_mm": {"axis": "z", "value": -10}}]},
    "time": {"step_s": 0.02, "duration_s": 1}
  })");
}

// A folder with scenarios, removed at the end.
struct Folder {
  fs::path path = fs::path(testing::TempDir()) / ("sulcus_patch_" + std::to_string(getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  fs::path write(const std::string& name, const json& document) const {
    std::ofstream(path / name) << document.dump(1);
    return path / name;
  }
};

TEST(Patch, JoinsObjectsReplacesAllElseAndRemovesWithNull) {
  const Folder folder;
  folder.write("block.json", block());
  const fs::path patch = folder.write("hard.json", {{"sulcus", 1},
                                                    {"based_on", "block.json"},
                                                    {"name", "hard"},
                                                    {"tissue", {{"default", {{"poisson_ratio", 0.49}}}}},
                                                    {"boundary", nullptr}});
  const Scenario scenario = load_scenario(patch, {"/time/duration_s=2"});
  EXPECT_EQ(scenario.name, "hard");
  EXPECT_EQ(scenario.title, "A block");
  EXPECT_EQ(scenario.scene.material.poisson_ratio, 0.49);
  EXPECT_EQ(scenario.scene.material.youngs_modulus_Pa, 1000);
  EXPECT_TRUE(scenario.fixed.empty());
  EXPECT_EQ(scenario.duration_s, 2);
  EXPECT_EQ(scenario.input_files, (std::vector<fs::path>{patch, folder.path / "block.json"}));
  // what a recording keeps needs neither file
  EXPECT_EQ(load_scenario_text(scenario.resolved_json, "recording", "/").scene.material.poisson_ratio, 0.49);
}

TEST(Patch, ThatIsWrongIsRefused) {
  const Folder folder;
  folder.write("block.json", block());
  json document = {{"sulcus", 1}, {"based_on", "none.json"}, {"name", "hard"}};
  const fs::path patch = folder.write("hard.json", document);
  expect_refusal([&] { load_scenario(patch); }, {"none.json", "does not exist"});
  document["based_on"] = "block.json";
  document["mesh"] = {{"size", 3}};
  folder.write("hard.json", document);
  expect_refusal([&] { load_scenario(patch); }, {"hard.json", "/mesh/size", "size_mm"});
  folder.write("harder.json", {{"sulcus", 1}, {"based_on", "hard.json"}, {"name", "harder"}});
  expect_refusal([&] { load_scenario(folder.path / "harder.json"); }, {"hard.json", "patch itself"});
  folder.write("hard.json", {{"sulcus", 1}, {"based_on", 7}, {"name", "hard"}});
  expect_refusal([&] { load_scenario(patch); }, {"/based_on", "name of a scenario file"});
}

TEST(Patch, HardOnesAreListedToo) {
  const Folder folder;
  folder.write("block.json", block());
  fs::create_directories(folder.path / "hard");
  fs::create_directories(folder.path / "other");
  folder.write("other/other.json", block());
  folder.write("hard/hard.json", {{"sulcus", 1}, {"based_on", "../block.json"}, {"name", "hard"}});
  const auto summaries = list_scenarios(folder.path);
  ASSERT_EQ(summaries.size(), 2U);
  EXPECT_EQ(summaries[0].name, "block");
  EXPECT_EQ(summaries[1].name, "hard");
  EXPECT_EQ(summaries[1].error, "");
}

TEST(Initial, DeformationMovesAllNodesButThoseThatAreHeld) {
  json document = block();
  document["initial"] = {{"deformation_gradient", {1, 0, 0, 0, 2, 0, 0, 0.5, -1}},
                         {"centre_mm", {0, 0, -10}}};
  const Scene scene = make_scene(load_scenario_text(document.dump(), "test.json", "."));
  const State state = initial_state(scene, {});
  int held = 0, moved = 0;
  for (std::size_t n = 0; n < scene.free_node.size(); ++n) {
    const Vec3 rest = scene.mesh.rest_positions[n];
    const Vec3 start(state.positions[3 * n], state.positions[3 * n + 1], state.positions[3 * n + 2]);
    const Vec3 wanted(rest[0], 2 * rest[1], -0.01 + 0.5 * rest[1] - (rest[2] + 0.01));
    EXPECT_LT((start - (scene.free_node[n] ? wanted : rest)).norm(), 1e-15);
    ++(scene.free_node[n] ? moved : held);
  }
  EXPECT_EQ(held, 9);
  EXPECT_EQ(moved, 18);
  document["initial"]["deformation_gradient"] = {1, 0, 0};
  expect_refusal([&] { load_scenario_text(document.dump(), "test.json", "."); },
                 {"/initial/deformation_gradient", "9"});
}

TEST(Speckle, ChangesTheShareThatItIsAskedToAndTheSameVoxelsEveryTime) {
  json document = block();
  document["label_map"]["operations"] = {{{"speckle", {{"share", 0.1}, {"to", {0, 5}}, {"seed", 3}}}}};
  const Scenario scenario = load_scenario_text(document.dump(), "test.json", ".");
  const LabelMap map = load_label_map(scenario), again = load_label_map(scenario);
  EXPECT_EQ(map.labels, again.labels);
  const auto count = [&](std::int32_t label) {
    return std::count(map.labels.begin(), map.labels.end(), label);
  };
  EXPECT_EQ(count(0) + count(1) + count(5), 1000);
  EXPECT_NEAR(static_cast<double>(count(0)), 50, 25);  // of 1000 voxels; three standard deviations and more
  EXPECT_NEAR(static_cast<double>(count(5)), 50, 25);
}

}  // namespace
}  // namespace sulcus
