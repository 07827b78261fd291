#include "engine/mesh/topology.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "engine/mesh/embedding.h"
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

TEST(FaceNeighbours, EqualBruteForceAlsoWhereCopiesShareAFace) {
  const std::uint64_t seed = 99;
  SCOPED_TRACE(seed);
  Random random(seed);
  int shared = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const LabelMap map = random_map(random, {5, 5, 4}, 3);
    if (std::count(map.labels.begin(), map.labels.end(), 0) == static_cast<std::ptrdiff_t>(map.labels.size()))
      continue;
    EmbeddingOptions options;
    options.size_m = 2 * map.spacing[0];
    const EmbeddingMesh mesh = build_embedding(map, random_pairs(random, 3), options);
    std::vector<std::uint8_t> alive(mesh.tets.size());
    for (std::uint8_t& a : alive) a = random_below(random, 3) != 0;
    const FaceNeighbours faces = face_neighbours(mesh.tets);
    // the side of a face's plane on which a tetrahedron lies, from rest positions
    const auto side = [&](std::size_t t, std::size_t c, const std::array<std::int32_t, 3>& face) {
      const auto at = [&](std::int32_t n) { return mesh.rest_positions[static_cast<std::size_t>(n)]; };
      const Vec3 a = at(face[0]), b = at(face[1]) - a, d = at(face[2]) - a, e = at(mesh.tets[t][c]) - a;
      return b[0] * (d[1] * e[2] - d[2] * e[1]) + b[1] * (d[2] * e[0] - d[0] * e[2]) +
                 b[2] * (d[0] * e[1] - d[1] * e[0]) >
             0;
    };
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      for (std::size_t c = 0; c < 4; ++c) {
        std::array<std::int32_t, 3> face{mesh.tets[t][(c + 1) % 4], mesh.tets[t][(c + 2) % 4],
                                         mesh.tets[t][(c + 3) % 4]};
        std::sort(face.begin(), face.end());
        int behind = 0, beside = 0;
        for (std::size_t u = 0; u < mesh.tets.size(); ++u) {
          for (std::size_t d = 0; d < 4; ++d) {
            std::array<std::int32_t, 3> other{mesh.tets[u][(d + 1) % 4], mesh.tets[u][(d + 2) % 4],
                                              mesh.tets[u][(d + 3) % 4]};
            std::sort(other.begin(), other.end());
            if (other != face || u == t) continue;
            if (side(u, d, face) == side(t, c, face)) {
              ++beside;
            } else if (alive[u]) {
              ++behind;
            }
          }
        }
        const auto name = static_cast<std::int32_t>(4 * t + c);
        ASSERT_EQ(is_covered(faces, alive, name), behind > 0);
        int ring = 0;
        for (std::int32_t f = faces.beside[static_cast<std::size_t>(name)]; f != name;
             f = faces.beside[static_cast<std::size_t>(f)])
          ++ring;
        ASSERT_EQ(ring, beside);
        shared += beside > 0;
      }
    }
  }
  EXPECT_GT(shared, 100);
}

}  // namespace
}  // namespace sulcus
