#include "engine/mesh/shares.h"

#include <gtest/gtest.h>

#include <map>

#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

TEST(TetShares, OfAFullBlockAreOne) {
  LabelMap map = empty_map({8, 6, 4});
  for (auto& label : map.labels) label = 3;
  map.spacing = {1e-3, 1e-3, 2e-3};
  for (const TetSplit split : {TetSplit::five, TetSplit::six}) {
    const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = 2e-3, .split = split});
    const TetShares shares = tet_shares(map, mesh);
    ASSERT_EQ(shares.filled.size(), mesh.tets.size());
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      EXPECT_NEAR(shares.filled[t], 1, 1e-12);
      EXPECT_EQ(shares.first[t + 1] - shares.first[t], 1);
      EXPECT_EQ(shares.label[shares.first[t]], 3);
    }
  }
}

// Beside points at random in a fine grid in every voxel, each given to the tetrahedron that holds it.
TEST(TetShares, AgreeWithCountingPoints) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Random random(seed);
    LabelMap map = random_map(random, {7, 6, 5}, 3);
    map.labels[0] = 1;
    map.spacing = {1e-3, 1.5e-3, 1e-3};
    if (seed % 3 == 0) map.direction(2, 2) = -1;
    const SeparationPairs pairs = random_pairs(random, 3);
    const TetSplit split = seed % 2 ? TetSplit::five : TetSplit::six;
    const EmbeddingMesh mesh =
        build_embedding(map, pairs, {.size_m = 1e-3 * (2 + random_below(random, 3)), .split = split});
    const TetShares shares = tet_shares(map, mesh);

    constexpr int fine = 8;
    std::vector<std::map<std::int32_t, double>> counted(mesh.tets.size());
    const double cell_points = double(fine * fine * fine) * mesh.voxels_per_cell[0] *
                               mesh.voxels_per_cell[1] * mesh.voxels_per_cell[2];
    for (std::size_t v = 0; v < map.voxel_count(); ++v) {
      if (mesh.cell_of_voxel[v] < 0) continue;
      for (int p = 0; p < fine * fine * fine; ++p) {
        Vec3 point(static_cast<double>(v % 7), static_cast<double>(v / 7 % 6), static_cast<double>(v / 42));
        const int step[3] = {p % fine, p / fine % fine, p / (fine * fine)};
        for (int a = 0; a < 3; ++a) point[a] += (step[a] + 0.001 * random_below(random, 1000)) / fine - 0.5;
        std::array<double, 4> weights{};
        const std::int32_t tet = locate_tet_in_cell(mesh, mesh.cell_of_voxel[v], point, weights);
        const bool middle = split == TetSplit::five && tet % 5 == 4;
        const double tet_part = split == TetSplit::six || !middle ? 1.0 / 6 : 1.0 / 3;
        counted[tet][map.labels[v]] += 1 / (cell_points * tet_part);
      }
    }
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      double sum = 0;
      for (std::int64_t e = shares.first[t]; e < shares.first[t + 1]; ++e) {
        EXPECT_NEAR(shares.share[e], counted[t][shares.label[e]], 0.06) << seed << " tet " << t;
        EXPECT_GE(shares.share[e], 0);
        sum += shares.share[e];
      }
      EXPECT_NEAR(sum, shares.filled[t], 1e-12);
      EXPECT_LE(shares.filled[t], 1 + 1e-12);
    }
    ASSERT_FALSE(HasFailure());
  }
}

TEST(TetShares, AddUpToTheVoxelsOfEachCell) {
  for (std::uint64_t seed = 100; seed < 200; ++seed) {
    Random random(seed);
    LabelMap map = random_map(random, {9, 10, 8}, 4);
    map.labels[0] = 1;
    const TetSplit split = seed % 2 ? TetSplit::five : TetSplit::six;
    const EmbeddingMesh mesh = build_embedding(
        map, random_pairs(random, 4), {.size_m = 1e-3 * (1 + random_below(random, 6)), .split = split});
    const TetShares shares = tet_shares(map, mesh);
    const double cell = double(mesh.voxels_per_cell[0]) * mesh.voxels_per_cell[1] * mesh.voxels_per_cell[2];
    for (std::size_t c = 0; c < mesh.cell_position.size(); ++c) {
      double voxels = 0;
      for (int t = 0; t < mesh.tets_per_cell; ++t) {
        const double part = split == TetSplit::six || t < 4 ? 1.0 / 6 : 1.0 / 3;
        voxels += shares.filled[c * mesh.tets_per_cell + t] * part * cell;
      }
      ASSERT_NEAR(voxels, mesh.cell_voxels[c], 1e-9 * cell);
    }
  }
}

}  // namespace
}  // namespace sulcus
