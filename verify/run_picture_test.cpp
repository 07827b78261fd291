#include "verify/run_picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"
#include "engine/volume/test_maps.h"
#include "verify/picture_diff.h"

namespace sulcus {
namespace {

// A cube of 0.1 m with its corner in the origin, one cell of one tetrahedron that is large enough to carry
// it.
struct CubeRun {
  EmbeddedSurface surface;
  EmbeddingMesh mesh;
  std::vector<double> positions;
  ToolSurface tool;
  RunPicture run;

  CubeRun() {
    for (int c = 0; c < 8; ++c)
      surface.rest_positions.emplace_back(0.1 * (c & 1), 0.1 * (c >> 1 & 1), 0.1 * (c >> 2 & 1));
    const std::array<std::array<std::int32_t, 4>, 6> sides{
        {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}};
    for (const auto& [a, b, c, d] : sides) {
      surface.triangles.push_back({a, b, c});
      surface.triangles.push_back({a, c, d});
    }
    surface.triangle_label.assign(12, 1);
    surface.triangle_on_pair.assign(12, 0);
    mesh.rest_positions = {{0, 0, 0}, {0.3, 0, 0}, {0, 0.3, 0}, {0, 0, 0.3}};
    mesh.tets = {{0, 1, 2, 3}};
    for (const Vec3& p : surface.rest_positions) {
      for (int d = 0; d < 3; ++d) positions.push_back(p[d]);
      surface.tet.push_back(0);
      const Vec3 w = p / 0.3;
      surface.weights.push_back({static_cast<float>(1 - w.sum()), static_cast<float>(w.x()),
                                 static_cast<float>(w.y()), static_cast<float>(w.z())});
    }
    tool.vertices = {{-0.01, -0.01, 0}, {0.01, -0.01, 0}, {0, 0.01, 0}, {0, 0, 0.05}};
    tool.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    run.surface = &surface;
    run.surface_positions = positions;
    run.width = 160;
    run.height = 120;
    // From straight above: the side z = 0.1 fills the middle.
    run.camera = Camera{{0.05, 0.05, 0.6}, {0.05, 0.05, 0.1}, {0, 1, 0}, 30};
  }
  Colour middle() const {
    const Image image = render_run_picture(run);
    const std::size_t p = (60 * 160 + 80) * 3;
    return {image.rgb[p], image.rgb[p + 1], image.rgb[p + 2]};
  }
};

// Which of red, green and blue leads; light changes sizes, not the order.
int leading(const Colour& c) {
  return static_cast<int>(std::max_element(c.begin(), c.end()) - c.begin());
}

TEST(RunPicture, LabelsWearTheirColours) {
  CubeRun cube;
  cube.run.label_colours[1] = {40, 200, 40};
  EXPECT_EQ(leading(cube.middle()), 1);
  cube.run.label_colours[1] = {40, 40, 200};
  EXPECT_EQ(leading(cube.middle()), 2);
}

TEST(RunPicture, FissureWallsAreWarm) {
  CubeRun cube;
  cube.run.label_colours[1] = {40, 40, 200};
  cube.surface.triangle_on_pair.assign(12, 1);
  EXPECT_EQ(leading(cube.middle()), 0);
}

TEST(RunPicture, ValuesBecomeColoursOfTheMap) {
  CubeRun cube;
  const std::vector<double> low(4, 0.0), high(4, 500.0);
  cube.run.mesh = &cube.mesh;
  cube.run.bar = {"stress", "Pa", 0, 500, ColourMap::ember};
  cube.run.node_values = low;
  const Colour dark = cube.middle();
  cube.run.node_values = high;
  const Colour light = cube.middle();
  EXPECT_EQ(leading(dark), 2);
  EXPECT_EQ(leading(light), 0);
  EXPECT_GT(light[1], dark[1] + 80);
}

TEST(RunPicture, ElementsAreAveragedAroundTheirNodes) {
  EmbeddingMesh mesh;
  mesh.rest_positions.resize(6, Vec3::Zero());
  mesh.tets = {{0, 1, 2, 3}, {1, 2, 3, 4}};
  const std::vector<double> mean = node_means(mesh, std::vector<double>{2.0, 6.0});
  EXPECT_EQ(mean[0], 2);
  EXPECT_EQ(mean[1], 4);
  EXPECT_EQ(mean[4], 6);
  EXPECT_TRUE(std::isnan(mean[5]));
  EXPECT_EQ(node_means(mesh, std::vector<double>{NAN, 6.0})[1], 6);  // removed
  EXPECT_THROW(node_means(mesh, std::vector<double>{1.0}), InputError);
}

TEST(RunPicture, ToolsArrowsAndEdgesAppear) {
  CubeRun cube;
  const Image bare = render_run_picture(cube.run);
  const auto changed = [&] {
    return compare_pictures(bare, render_run_picture(cube.run), 5).differing_fraction;
  };
  cube.run.tools = {{&cube.tool, "", {0.05, 0.05, 0.11}, Quaternion{}, Vec3::Zero(), Vec3::Zero()}};
  const double tool = changed();
  EXPECT_GT(tool, 0.001);
  cube.run.tools[0].force_N = {1, 0, 0};
  cube.run.tools[0].force_at = {0.05, 0.05, 0.2};
  EXPECT_GT(changed(), tool);
  cube.run.tools.clear();
  cube.run.contact_points = {{0.02, 0.02, 0.1}};
  EXPECT_GT(changed(), 0);
  cube.run.contact_points.clear();
  std::vector<double> nodes;
  for (int c = 0; c < 8; ++c) {
    cube.mesh.rest_positions.resize(8, Vec3::Zero());
    for (int d = 0; d < 3; ++d) nodes.push_back(-0.02 + 0.14 * (c >> d & 1));
  }
  cube.mesh.cell_nodes = {{0, 1, 2, 3, 4, 5, 6, 7}};
  cube.run.mesh = &cube.mesh;
  cube.run.node_positions = nodes;
  EXPECT_GT(changed(), 0.001);
}

// A block of 10 voxels of 10 mm a side around the cube's middle, whose section is as large as the cube.
struct CutCube : CubeRun {
  LabelMap map = empty_map({10, 10, 10});
  EmbeddingMesh block;
  std::vector<double> nodes;

  CutCube() {
    map.spacing = Vec3::Constant(0.01);
    map.origin = Vec3::Constant(0.005);
    std::fill(map.labels.begin(), map.labels.end(), 7);
    block = build_embedding(map, {}, {.size_m = 0.05});
    for (const Vec3& p : block.rest_positions) nodes.insert(nodes.end(), {p[0], p[1], p[2]});
    run.mesh = &block;
    run.map = &map;
    run.node_positions = nodes;
    run.cell_edges = false;
    run.label_colours = {{1, {40, 40, 200}}, {7, {40, 200, 40}}};
    run.section = frame_section(surface.rest_positions, {0, 0, 0.05}, {0, 0, 1}, {0, 1, 0}, 50);
  }
};

TEST(RunPicture, ACutShowsTheLabelsInside) {
  CutCube cube;
  EXPECT_EQ(leading(cube.middle()), 1);
  cube.run.section.reset();
  EXPECT_EQ(leading(cube.middle()), 2);
}

TEST(RunPicture, ASliceShowsTheSectionAndTheToolsInIt) {
  CutCube cube;
  cube.run.slice = true;
  cube.run.camera.reset();
  const Image bare = render_run_picture(cube.run);
  const Colour middle = cube.middle();
  EXPECT_EQ(leading(middle), 1);
  EXPECT_NEAR(middle[1], 200, 1);  // no light in a slice
  const Colour corner{bare.rgb[0], bare.rgb[1], bare.rgb[2]};
  EXPECT_GT(corner[0], 200);  // nothing there
  cube.run.tools = {{&cube.tool, "", {0.05, 0.05, 0.04}, Quaternion{}, Vec3::Zero(), Vec3::Zero()}};
  EXPECT_EQ(leading(cube.middle()), 2);  // the tool goes through the plane
  cube.run.tools[0].position[2] = 0.06;
  EXPECT_EQ(render_run_picture(cube.run).rgb, bare.rgb);  // above it
}

TEST(RunPicture, HiddenMarksShineThrough) {
  CubeRun cube;
  const Image bare = render_run_picture(cube.run);
  cube.run.contact_points = {{0.05, 0.05, 0.05}};  // inside of the cube
  const double hidden = compare_pictures(bare, render_run_picture(cube.run), 5).mean_distance;
  cube.run.contact_points = {{0.05, 0.05, 0.11}};
  const double seen = compare_pictures(bare, render_run_picture(cube.run), 5).mean_distance;
  EXPECT_GT(hidden, 0);
  EXPECT_GT(seen, hidden);
}

TEST(RunPicture, TheSameRunGivesTheSameBytes) {
  CubeRun cube;
  cube.run.tools = {{&cube.tool, "", {0.05, 0.05, 0.11}, Quaternion{}, {0, 0, 1}, {0.05, 0.05, 0.1}}};
  cube.run.label_names[1] = "cube";
  EXPECT_EQ(render_run_picture(cube.run).rgb, render_run_picture(cube.run).rgb);
}

TEST(RunPicture, LabelColoursAreToldApart) {
  for (std::int32_t a = 1; a <= 12; ++a) {
    EXPECT_EQ(label_colour(a), label_colour(a));
    for (std::int32_t b = 1; b < a; ++b) {
      const Colour first = label_colour(a), second = label_colour(b);
      EXPECT_GT(colour_distance(first.data(), second.data()), 5) << a << " " << b;
    }
  }
}

TEST(RunPicture, ArraysThatDoNotFitAreRefused) {
  const auto refused = [](auto&& change) {
    CubeRun cube;
    change(cube);
    EXPECT_THROW(render_run_picture(cube.run), InputError);
  };
  static const std::vector<double> three(3, 0.0);
  refused([](CubeRun& c) { c.run.surface = nullptr; });
  refused([](CubeRun& c) { c.run.surface_positions = three; });
  refused([](CubeRun& c) { c.surface.triangle_label.pop_back(); });
  refused([](CubeRun& c) { c.surface.triangle_on_pair.pop_back(); });
  refused([](CubeRun& c) { c.run.node_values = three; });
  refused([](CubeRun& c) {
    c.run.mesh = &c.mesh;
    c.run.node_values = three;
  });
  refused([](CubeRun& c) { c.run.section = SectionFrame{}; });
  refused([](CubeRun& c) { c.run.slice = true; });
  refused([](CubeRun& c) { c.run.node_positions = three; });
  refused([](CubeRun& c) { c.run.tools = {PosedTool{}}; });
}

}  // namespace
}  // namespace sulcus
