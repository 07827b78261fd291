#include "engine/mesh/topology.h"

#include <gtest/gtest.h>

#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

TEST(VoxelPieces, AreNumberedByTheirFirstVoxel) {
  LabelMap map = empty_map({5, 1, 1});
  map.labels = {3, 0, 1, 2, 2};
  const Pieces pieces = voxel_pieces(map, make_separation_pairs({{1, 2}}));
  EXPECT_EQ(pieces.piece, (std::vector<std::int32_t>{0, -1, 1, 2, 2}));
  EXPECT_EQ(pieces.item_count, (std::vector<std::int64_t>{1, 1, 2}));
}

TEST(VoxelPieces, DoNotConnectOverEdges) {
  LabelMap map = empty_map({2, 2, 1});
  map.labels = {1, 0, 0, 1};
  EXPECT_EQ(voxel_pieces(map, {}).item_count.size(), 2U);
}

TEST(MeshPieces, ShareNodesAndSkipTheDead) {
  const std::vector<std::array<std::int32_t, 4>> tets{{0, 1, 2, 3}, {4, 5, 6, 7}, {3, 8, 9, 4}};
  EXPECT_EQ(mesh_pieces(tets, 10).item_count, (std::vector<std::int64_t>{3}));
  const std::vector<std::uint8_t> alive{1, 1, 0};
  const Pieces pieces = mesh_pieces(tets, 10, alive);
  EXPECT_EQ(pieces.piece, (std::vector<std::int32_t>{0, 1, -1}));
}

}  // namespace
}  // namespace sulcus
