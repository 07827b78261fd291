// Pieces in words, and which of them can move freely.
#include "engine/scene/pieces.h"

#include <gtest/gtest.h>

#include "engine/numerics/error.h"
#include "engine/scene/statics.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// Two blocks of 2 x 2 x 2 cells of 10 mm, 10 mm apart.
SceneDescription two_blocks() {
  SceneDescription d = block_description({5, 2, 2}, 0.01);
  for (int k = 0; k < 2; ++k) {
    for (int j = 0; j < 2; ++j) d.map.labels[d.map.index(2, j, k)] = 0;
  }
  return d;
}

std::vector<std::int32_t> nodes_at(const SceneDescription& d, double x, double z = -1) {
  return nodes_where(
      d, [&](const Vec3& r) { return std::fabs(r[0] - x) < 1e-9 && (z < 0 || std::fabs(r[2] - z) < 1e-9); });
}

TEST(Pieces, AreNamedByNumberCellsAndPlace) {
  const Scene scene = build(two_blocks());
  const std::int32_t left = nodes_at(scene.settings, 0).front(),
                     right = nodes_at(scene.settings, 0.05).front();
  EXPECT_EQ(describe_piece(scene, {}, left), "piece 1 of 2 of the mesh (8 cells around (10, 10, 10) mm)");
  EXPECT_EQ(describe_piece(scene, {}, right), "piece 2 of 2 of the mesh (8 cells around (40, 10, 10) mm)");
  std::vector<std::uint8_t> alive(scene.mesh.tets.size(), 1);
  for (std::size_t t = 0; t < alive.size(); ++t) {
    for (std::int32_t node : scene.mesh.tets[t]) alive[t] &= node != right;
  }
  EXPECT_EQ(describe_piece(scene, alive, right).find("node " + std::to_string(right) + " at (50, 0, 0) mm"),
            0u);
}

void expect_loose(SceneDescription d, const std::string& words) {
  const Scene scene = build(std::move(d));
  const std::vector<std::string> loose = loose_pieces(scene, {});
  ASSERT_EQ(loose.size(), 1u) << words;
  EXPECT_NE(loose[0].find("piece 2 of 2 of the mesh (8 cells around (40, 10, 10) mm) " + words),
            std::string::npos)
      << loose[0];
  EXPECT_NE(loose[0].find("/boundary/fixed"), std::string::npos);
  State state = initial_state(scene, {});
  EXPECT_THROW(solve_static(scene, {}, state, 1), InputError);
}

TEST(Pieces, ThatNothingHoldsAreLoose) {
  SceneDescription d = two_blocks();
  d.fixed_nodes = nodes_at(d, 0);
  expect_loose(d, "is held by nothing");
  SceneDescription weak = d;  // springs without stiffness hold nothing
  weak.springs.push_back({nodes_at(d, 0.05).front(), 0, 1});
  expect_loose(weak, "is held by nothing");
}

TEST(Pieces, OnOneEdgeCanTurn) {
  SceneDescription d = two_blocks();
  d.fixed_nodes = nodes_at(d, 0);
  for (std::int32_t node : nodes_at(d, 0.05, 0)) d.fixed_nodes.push_back(node);
  expect_loose(d, "can turn freely about an axis along (0, 1, 0)");
}

TEST(Pieces, OnPlanesCanSlide) {
  SceneDescription d = two_blocks();
  d.fixed_nodes = nodes_at(d, 0);
  for (std::int32_t node : nodes_at(d, 0.05)) d.sliding.push_back({node, 0});
  for (std::int32_t node : nodes_at(d, 0.05, 0)) d.sliding.push_back({node, 2});
  expect_loose(d, "can slide freely along (0, 1, 0)");
}

TEST(Pieces, OnSpringsOrPathsAreHeld) {
  SceneDescription d = two_blocks();
  d.motions.push_back(straight_motion(nodes_at(d, 0), Vec3(0, 0, 0.001), 1));
  for (std::int32_t node : nodes_at(d, 0.05)) d.springs.push_back({node, 1, 0});
  const Scene scene = build(std::move(d));
  EXPECT_TRUE(loose_pieces(scene, {}).empty());
}

}  // namespace
}  // namespace sulcus
