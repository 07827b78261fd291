#include "verify/section.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"
#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

constexpr Colour red{200, 30, 30}, green{30, 200, 30};

// Two blocks of 8 x 8 x 8 voxels of 1 mm that touch at x = 7.5 mm and may part there, in cells of 4 mm.
struct TwoBlocks {
  LabelMap map = empty_map({20, 8, 8});
  EmbeddingMesh mesh;
  std::vector<double> nodes;
  SectionFrame frame;  // across, at z = 3.3 mm, pixels of half a millimetre
  SectionContent content;

  TwoBlocks() {
    map.spacing = Vec3::Constant(1e-3);
    for (int k = 0; k < 8; ++k) {
      for (int j = 0; j < 8; ++j) {
        for (int i = 0; i < 16; ++i) map.labels[map.index(i, j, k)] = i < 8 ? 1 : 2;
      }
    }
    mesh = build_embedding(map, make_separation_pairs({{1, 2}}), {.size_m = 4e-3});
    for (const Vec3& p : mesh.rest_positions) nodes.insert(nodes.end(), {p[0], p[1], p[2]});
    frame.middle = {9e-3, 3.5e-3, 3.3e-3};
    frame.pixel_m = 0.5e-3;
    frame.columns = 44;
    frame.rows = 24;
    content.map = &map;
    content.mesh = &mesh;
    content.node_positions = nodes;
    content.label_colours = {{1, red}, {2, green}};
  }
  // The second block aside.
  void part(double x_m) {
    std::vector<bool> moved(mesh.rest_positions.size(), false);
    for (std::size_t c = 0; c < mesh.cell_nodes.size(); ++c) {
      for (const std::int32_t node : mesh.cell_nodes[c]) {
        if (mesh.cell_label[c] == 2) moved[static_cast<std::size_t>(node)] = true;
      }
    }
    for (std::size_t n = 0; n < moved.size(); ++n) nodes[3 * n] += moved[n] ? x_m : 0;
  }
  // Calls visit(place in mm, pixel) for every pixel that lies clear of the voxels' faces.
  template <class Visit>
  void for_each_pixel(const Section& section, Visit&& visit) const {
    for (int row = 0; row < frame.rows; ++row) {
      for (int column = 0; column < frame.columns; ++column)
        visit(Vec3(1e3 * section.frame.centre(column, row)),
              static_cast<std::size_t>(row * frame.columns + column));
    }
  }
};

TEST(Section, AtRestShowsTheLabelsWhereTheyLie) {
  const TwoBlocks blocks;
  const Section section = paint_section(blocks.frame, blocks.content);
  int shown = 0;
  blocks.for_each_pixel(section, [&](const Vec3& at, std::size_t p) {
    const bool inside = at[0] > -0.5 && at[0] < 15.5 && at[1] > -0.5 && at[1] < 7.5;
    ASSERT_EQ(section.shown[p], inside) << at.transpose();
    shown += inside;
    if (inside) {
      ASSERT_EQ(section.colours[p], at[0] < 7.5 ? red : green) << at.transpose();
    }
  });
  EXPECT_EQ(shown, 32 * 16);
}

TEST(Section, AnOpenedFissureIsAGap) {
  TwoBlocks blocks;
  blocks.part(3e-3);
  const Section section = paint_section(blocks.frame, blocks.content);
  blocks.for_each_pixel(section, [&](const Vec3& at, std::size_t p) {
    if (at[1] < -0.5 || at[1] > 7.5 || at[0] < -0.5) return;
    const bool gap = at[0] > 7.5 && at[0] < 10.5;
    ASSERT_EQ(section.shown[p], !gap && at[0] < 18.5) << at.transpose();
    if (section.shown[p]) {
      ASSERT_EQ(section.colours[p], at[0] < 7.5 ? red : green) << at.transpose();
    }
  });
}

TEST(Section, AGreyImageTravelsWithTheTissue) {
  TwoBlocks blocks;
  blocks.part(3e-3);
  // 10 grey values a millimetre along x, from x = -2 mm on, one voxel each 2 mm
  std::vector<float> values(11 * 5 * 5);
  for (std::size_t v = 0; v < values.size(); ++v) values[v] = static_cast<float>(20 * (v % 11));
  GreyVolume grey;
  grey.geometry = {{11, 5, 5}, Vec3::Constant(2e-3), {-2e-3, -0.5e-3, -0.5e-3}, Mat3::Identity()};
  grey.values = values;
  blocks.content.grey = grey;
  const Section section = paint_section(blocks.frame, blocks.content);
  int gaps = 0, carried = 0, outside = 0;
  blocks.for_each_pixel(section, [&](const Vec3& at, std::size_t p) {
    const bool in_blocks = at[1] > -0.5 && at[1] < 7.5 && at[0] > -0.5 && at[0] < 18.5;
    const bool gap = in_blocks && at[0] > 7.5 && at[0] < 10.5;
    const double from = in_blocks && at[0] > 10.5 ? at[0] - 3 : at[0];  // mm, at rest
    if (gap) {
      ++gaps;
      ASSERT_EQ(section.colours[p], (Colour{0, 0, 0}));
      ASSERT_TRUE(section.shown[p]);
    } else if (at[1] < -1.5 || at[1] > 8.5) {
      ++outside;
      ASSERT_FALSE(section.shown[p]);
    } else if (in_blocks) {
      ++carried;
      ASSERT_NEAR(section.colours[p][0], std::min(10 * (from + 2), 200.0), 0.51) << at.transpose();
    }
  });
  EXPECT_EQ(gaps, 6 * 16);
  EXPECT_EQ(carried, 32 * 16);
  EXPECT_GT(outside, 0);
  blocks.content.tissue_only = true;
  const Section tissue = paint_section(blocks.frame, blocks.content);
  EXPECT_EQ(std::count(tissue.shown.begin(), tissue.shown.end(), 1), carried);
}

TEST(Section, ValuesAreLaidOverFromTheirLowerBoundOn) {
  TwoBlocks blocks;
  std::vector<double> values;  // Pa, ten a millimetre along x: linear, so exact within the elements
  for (const Vec3& p : blocks.mesh.rest_positions) values.push_back(1e4 * p[0]);
  blocks.content.node_values = values;
  blocks.content.bar = {"stress", "Pa", 100, 200, ColourMap::ember};
  blocks.content.overlay_opacity = 0.5;
  const Section section = paint_section(blocks.frame, blocks.content);
  blocks.for_each_pixel(section, [&](const Vec3& at, std::size_t p) {
    if (!section.shown[p]) return;
    const Colour below = at[0] < 7.5 ? red : green;
    if (at[0] < 9.9) {
      ASSERT_EQ(section.colours[p], below) << at.transpose();
      return;
    }
    const Colour above = colour_of(ColourMap::ember, (10 * at[0] - 100) / 100);
    for (std::size_t c = 0; c < 3; ++c)
      ASSERT_NEAR(section.colours[p][c], 0.5 * below[c] + 0.5 * above[c], 1.01) << at.transpose();
  });
}

TEST(Section, TornElementsAreGaps) {
  TwoBlocks blocks;
  std::vector<std::uint8_t> alive(blocks.mesh.tets.size(), 1);
  for (std::size_t t = 0; t < alive.size(); ++t)
    alive[t] = blocks.mesh.cell_label[t / static_cast<std::size_t>(blocks.mesh.tets_per_cell)] == 1;
  blocks.content.alive = alive;
  const Section section = paint_section(blocks.frame, blocks.content);
  blocks.for_each_pixel(section, [&](const Vec3& at, std::size_t p) {
    if (section.shown[p]) {
      ASSERT_LT(at[0], 7.5);
    }
  });
  EXPECT_EQ(std::count(section.shown.begin(), section.shown.end(), 1), 16 * 16);
}

TEST(Section, AFrameHoldsTheFeetOfAllPoints) {
  const std::vector<Vec3> points{{0.01, 0.02, 0.03}, {-0.02, 0.05, 0}, {0.03, -0.01, -0.02}, {NAN, 0, 0}};
  const Vec3 normal = Vec3(1, 2, -1);
  const SectionFrame frame = frame_section(points, {0.01, 0, 0}, normal, {0, 0, 1}, 100);
  EXPECT_NEAR((frame.normal() - normal.normalized()).norm(), 0, 1e-12);
  EXPECT_NEAR(frame.normal().dot(frame.middle - Vec3(0.01, 0, 0)), 0, 1e-12);
  EXPECT_GT(frame.up[2], 0);
  EXPECT_LE(std::max(frame.columns, frame.rows), 102);
  for (std::size_t p = 0; p < 3; ++p) {
    const Vec3 from_middle = points[p] - frame.middle;
    EXPECT_LE(std::abs(frame.right.dot(from_middle)), 0.5 * frame.pixel_m * frame.columns);
    EXPECT_LE(std::abs(frame.up.dot(from_middle)), 0.5 * frame.pixel_m * frame.rows);
  }
}

TEST(Section, GrowsByWholePixels) {
  const TwoBlocks blocks;
  Section section = paint_section(blocks.frame, blocks.content);
  const Section before = section;
  grow_section(section, 1);
  EXPECT_EQ(std::count(section.shown.begin(), section.shown.end(), 1), 32 * 16 + 2 * 32 + 2 * 16);
  for (std::size_t p = 0; p < before.shown.size(); ++p) {
    if (before.shown[p]) {
      ASSERT_EQ(section.colours[p], before.colours[p]);
    }
  }
}

TEST(Section, ItsMeshCoversWhatIsShown) {
  const TwoBlocks blocks;
  const Section section = paint_section(blocks.frame, blocks.content);
  const PictureMesh mesh = section_mesh(section, 1e-4);
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Vec3 twice =
        (mesh.positions[static_cast<std::size_t>(b)] - mesh.positions[static_cast<std::size_t>(a)])
            .cross(mesh.positions[static_cast<std::size_t>(c)] - mesh.positions[static_cast<std::size_t>(a)]);
    EXPECT_GT(twice[2], 0);  // faces the viewer
    area += 0.5 * twice.norm();
  }
  EXPECT_NEAR(area, 16e-3 * 8e-3, 1e-9);
  for (const Vec3& p : mesh.positions) ASSERT_NEAR(p[2], 3.4e-3, 1e-12);
}

TEST(Section, ArraysThatDoNotFitAreRefused) {
  const auto refused = [](auto&& change) {
    TwoBlocks blocks;
    change(blocks);
    EXPECT_THROW(paint_section(blocks.frame, blocks.content), InputError);
  };
  static const std::vector<double> three(3, 0.0);
  refused([](TwoBlocks& b) { b.content.map = nullptr; });
  refused([](TwoBlocks& b) { b.content.mesh = nullptr; });
  refused([](TwoBlocks& b) { b.content.node_positions = three; });
  refused([](TwoBlocks& b) { b.content.node_values = three; });
  refused([](TwoBlocks& b) { b.content.grey = GreyVolume{}; });
  refused([](TwoBlocks& b) { b.frame.rows = 0; });
}

}  // namespace
}  // namespace sulcus
