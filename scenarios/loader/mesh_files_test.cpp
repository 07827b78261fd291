// Tools from files: read, measured, and refused where they are no closed surface.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "scenarios/loader/mesh_files.h"
#include "scenarios/loader/scenario.h"
#include "scenarios/loader/test_refusal.h"
#include "scenarios/loader/tools.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;

struct Folder {
  fs::path path = fs::temp_directory_path() / ("sulcus_mesh_files_" + std::to_string(::getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(path / name) << text;
    return path / name;
  }
};

std::string obj(const ToolSurface& surface) {
  std::string text;
  for (const Vec3& v : surface.vertices)
    text += "v " + std::to_string(1e3 * v[0]) + " " + std::to_string(1e3 * v[1]) + " " +
            std::to_string(1e3 * v[2]) + "\n";
  for (const auto& t : surface.triangles)
    text += "f " + std::to_string(t[0] + 1) + " " + std::to_string(t[1] + 1) + " " +
            std::to_string(t[2] + 1) + "\n";
  return text;
}

std::string stl(const ToolSurface& surface) {
  std::string text = "solid tool\n";
  for (const auto& t : surface.triangles) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (const std::int32_t v : t) {
      const Vec3& x = surface.vertices[static_cast<std::size_t>(v)];
      text += "vertex " + std::to_string(1e3 * x[0]) + " " + std::to_string(1e3 * x[1]) + " " +
              std::to_string(1e3 * x[2]) + "\n";
    }
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid tool\n";
}

std::string ply(const ToolSurface& surface) {
  std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(surface.vertices.size()) +
                     "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                     std::to_string(surface.triangles.size()) +
                     "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Vec3& v : surface.vertices)
    text += std::to_string(1e3 * v[0]) + " " + std::to_string(1e3 * v[1]) + " " + std::to_string(1e3 * v[2]) +
            "\n";
  for (const auto& t : surface.triangles)
    text += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) + "\n";
  return text;
}

TEST(MeshFiles, AllThreeFormatsGiveTheSameSolid) {
  const Folder folder;
  ToolSurface box = box_surface({Vec3(0.01, 0.02, 0.03), 0.005});
  for (Vec3& v : box.vertices) v += Vec3(0.1, 0, 0);  // the centre of mass comes to the origin
  for (const auto& file : {folder.write("box.obj", obj(box)), folder.write("box.stl", stl(box)),
                           folder.write("box.ply", ply(box))}) {
    const ToolSurface surface = read_surface(file, 1e-3);
    EXPECT_EQ(surface.vertices.size(), box.vertices.size()) << file;
    EXPECT_EQ(surface.triangles.size(), box.triangles.size());
    const SolidMoments moments = solid_moments(surface);
    EXPECT_NEAR(moments.volume_m3, 6e-6, 1e-11);
    EXPECT_LT(moments.centre_m.norm(), 1e-9);
    EXPECT_NEAR(moments.inertia_m5(0, 0), 6e-6 / 12 * (4e-4 + 9e-4), 1e-14);
  }
}

TEST(MeshFiles, AnInsideOutSurfaceIsTurned) {
  const Folder folder;
  ToolSurface box = box_surface({Vec3(0.01, 0.02, 0.03), 0.01});
  for (auto& t : box.triangles) std::swap(t[0], t[1]);
  EXPECT_GT(solid_moments(read_surface(folder.write("out.obj", obj(box)), 1e-3)).volume_m3, 0);
}

TEST(MeshFiles, WhatIsNoClosedSurfaceIsRefused) {
  const Folder folder;
  const auto refused = [&](const std::string& text, const std::vector<std::string>& words,
                           double unit = 1e-3) {
    const fs::path file = folder.write("tool.obj", text);
    expect_refusal([&] { read_surface(file, unit); }, words);
  };
  const ToolSurface box = box_surface({Vec3(0.01, 0.02, 0.03), 0.01});
  ToolSurface broken = box;
  broken.triangles.pop_back();
  refused(obj(broken), {"tool.obj", "open", "3 edges", "mm"});
  broken = box;
  std::swap(broken.triangles[4][0], broken.triangles[4][1]);
  refused(obj(broken), {"not manifold", "face both ways"});
  broken = box;
  broken.triangles.push_back(broken.triangles[0]);
  refused(obj(broken), {"not manifold"});
  ToolSurface two = box;  // two boxes that overlap
  for (const auto& t : box.triangles) {
    const auto shift = static_cast<std::int32_t>(box.vertices.size());
    two.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  }
  for (const Vec3& v : box.vertices) two.vertices.push_back(v + Vec3(0.0041, 0.0032, 0.0023));
  refused(obj(two), {"passes through itself"});
  refused("", {"tool.obj"});
  refused("v 0 0 0\nv 1 0 0\nv 0 1 0\n", {"tool.obj"});
  refused(obj(box), {"30 m long", "unit_mm"}, 1.0);
  refused("this is no mesh", {"tool.obj"});
  expect_refusal([&] { read_surface(folder.path / "absent.stl", 1e-3); }, {"absent.stl", "no such file"});
  expect_refusal([&] { read_surface(folder.write("garbage.stl", "solid"), 1e-3); }, {"garbage.stl"});
}

TEST(MeshFiles, AScenarioTakesAToolFromAFileAndItsMassFromTheMesh) {
  const Folder folder;
  folder.write("tool.stl", stl(box_surface({Vec3(0.01, 0.02, 0.03), 0.01})));
  const auto document = nlohmann::json::parse(R"({
    "sulcus": 1, "name": "t", "label_map": {"generate": {"box": {"size_mm": [20, 20, 20], "voxel_size_mm": 5}}},
    "mesh": {"size_mm": 10}, "time": {"step_s": 0.02, "duration_s": 0.1},
    "tools": [{"name": "tool", "shape": {"mesh": {"file": "tool.stl"}}, "density_kg_m3": 2000,
               "device": {"scripted": {"waypoints": [{"time_s": 0, "position_mm": [0, 0, 60]}, {"time_s": 1, "path": "hold"}]}}}]
  })");
  const Scenario scenario = load_scenario_text(document.dump(), "t.json", folder.path);
  EXPECT_NEAR(scenario.scene.tools[0].body.mass_kg, 0.012, 1e-6);
  EXPECT_NEAR(scenario.scene.tools[0].body.inertia_kg_m2(2, 2), 0.012 / 12 * (1e-4 + 4e-4), 1e-9);
  EXPECT_EQ(scenario.input_files.back().filename(), "tool.stl");
  auto twice = document;
  twice["tools"][0]["mass_kg"] = 0.1;
  expect_refusal([&] { load_scenario_text(twice.dump(), "t.json", folder.path); },
                 {"/tools/0/density_kg_m3", "mass_kg"});
}

}  // namespace
}  // namespace sulcus
