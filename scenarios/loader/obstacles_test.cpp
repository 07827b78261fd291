// Static obstacles, friction and the other responses: what the file says is what the scene has.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "scenarios/loader/scenario.h"
#include "scenarios/loader/test_refusal.h"
#include "scenarios/loader/tools.h"

namespace sulcus {
namespace {

using nlohmann::json;

json resting() {
  return json::parse(R"({
    "sulcus": 1, "name": "resting",
    "label_map": {"generate": {"box": {"size_mm": [20, 20, 20], "voxel_size_mm": 5}}},
    "mesh": {"size_mm": 10},
    "tissue": {"gravity_m_s2": [0, 0, -9.81]},
    "tools": [{"name": "ball", "shape": {"sphere": {"radius_mm": 5}},
               "device": {"scripted": {"waypoints": [{"time_s": 0, "position_mm": [0, 0, 40]}, {"time_s": 1, "path": "hold"}]}}}],
    "contact": {"detection": "surface_nodes", "stiffness_N_m": 40, "friction": 0.1, "friction_speed_m_s": 0.002},
    "obstacles": [
      {"name": "floor", "shape": {"floor": {"size_mm": 500}}, "position_mm": [0, 0, -12], "contact": {"stiffness_N_m": 200, "friction": 0.3}},
      {"name": "ring", "shape": {"torus": {"radius_mm": 40, "tube_radius_mm": 8}}, "position_mm": [0, 60, 0], "axis": [1, 0, 0], "angle_deg": 90,
       "contact": {"response": "explicit_penalty", "tension_rule": false}}],
    "time": {"step_s": 0.02, "duration_s": 1}
  })");
}

Scenario load(const json& document) {
  return load_scenario_text(document.dump(), "test.json", ".");
}

TEST(Obstacles, AreReadWithTheirPlaceAndLaw) {
  const Scenario scenario = load(resting());
  const auto& obstacles = scenario.scene.obstacles;
  ASSERT_EQ(obstacles.size(), 2U);
  EXPECT_EQ(obstacles[0].name, "floor");
  EXPECT_NEAR(obstacles[0].position[2], -0.012, 1e-15);
  EXPECT_EQ(obstacles[0].contact.stiffness_N_m, 200);
  EXPECT_EQ(obstacles[0].contact.friction, 0.3);
  EXPECT_EQ(obstacles[0].contact.friction_speed_m_s, 0.002);  // that of the scene
  EXPECT_FALSE(obstacles[0].contact.explicit_forces);
  EXPECT_EQ(obstacles[1].contact.stiffness_N_m, 40);
  EXPECT_TRUE(obstacles[1].contact.explicit_forces);
  EXPECT_FALSE(obstacles[1].contact.tension_rule);
  const Vec3 axis = rotation_matrix(obstacles[1].orientation) * Vec3::UnitZ();
  EXPECT_LT((axis - Vec3(0, -1, 0)).norm(), 1e-12);
  const Scene scene = make_scene(scenario);
  EXPECT_EQ(scene.obstacle_distances.size(), 2U);
  // inside the plate, above it, in the hole and in the tube of the ring
  EXPECT_NEAR(sample(scene.obstacle_distances[0], Vec3(0.1, 0.05, -0.004)), -0.004, 1e-6);
  EXPECT_GT(sample(scene.obstacle_distances[0], Vec3(0.1, 0.05, 0.004)), 0);
  EXPECT_NEAR(sample(scene.obstacle_distances[1], Vec3(0.04, 0, 0)), -0.008, 5e-4);
  EXPECT_GT(sample(scene.obstacle_distances[1], Vec3::Zero()), 0);
}

TEST(Obstacles, ThatAreWrongAreRefused) {
  json document = resting();
  document["obstacles"][1]["name"] = "ball";
  expect_refusal([&] { load(document); }, {"/obstacles/1/name", "ball", "taken"});
  document = resting();
  document["obstacles"][0]["shape"] = {{"torus", {{"radius_mm", 5}, {"tube_radius_mm", 8}}}};
  expect_refusal([&] { load(document); }, {"/obstacles/0/shape", "hole"});
  document = resting();
  document["obstacles"][0]["axis"] = {0, 0, 0};
  expect_refusal([&] { load(document); }, {"/obstacles/0/axis", "no length"});
  document = resting();
  document["obstacles"][0]["contact"]["frictoin"] = 1;
  expect_refusal([&] { load(document); }, {"/obstacles/0/contact", "frictoin", "friction"});
  document = resting();
  document["contact"]["friction_speed_m_s"] = 0;
  expect_refusal([&] { load(document); }, {"/contact/friction_speed_m_s"});
}

TEST(Obstacles, TorusIsAClosedRingWithTheVolumeOfPappus) {
  const ToolSurface surface = torus_surface({0.03, 0.01});
  const SolidMoments moments = solid_moments(surface);
  const double pi = 3.14159265358979323846;
  EXPECT_NEAR(moments.volume_m3, 2 * pi * pi * 0.03 * 0.01 * 0.01, 0.01 * moments.volume_m3);
  EXPECT_LT(moments.centre_m.norm(), 1e-12);
  EXPECT_EQ(2 * surface.vertices.size(), surface.triangles.size());  // Euler characteristic 0
}

}  // namespace
}  // namespace sulcus
