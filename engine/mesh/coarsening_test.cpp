#include "engine/mesh/coarsening.h"

#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

// A random image with random pairs, embedded with one voxel a cell, or `voxels` a cell along each axis.
EmbeddingMesh random_mesh(std::uint64_t seed, int voxels) {
  Random random(seed);
  Index3 size;
  for (int& side : size) side = 4 + random_below(random, 9);
  const int labels = 1 + random_below(random, 4);
  LabelMap map = random_map(random, size, labels);
  map.labels[0] = 1;
  EmbeddingOptions options;
  options.size_m = map.spacing[0] * voxels;
  return build_embedding(map, random_pairs(random, labels), options);
}

TEST(CoarseLevels, AreTheMeshersOwnMeshesAtTwiceAndFourTimesTheSize) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE(seed);
    const std::vector<CoarseLevel> levels = build_coarse_levels(random_mesh(seed, 1), 1);
    for (std::size_t l = 0; l < std::min<std::size_t>(levels.size(), 2); ++l) {
      const EmbeddingMesh mesh = random_mesh(seed, 2 << l);
      ASSERT_EQ(levels[l].grid_size, mesh.grid_size);
      // copies within a grid cell may be numbered otherwise: by first cell, not by first voxel
      ASSERT_EQ(levels[l].cell_position, mesh.cell_position);
      ASSERT_EQ(levels[l].cell_links.size(), mesh.cell_links.size());
      ASSERT_EQ(levels[l].node_count, static_cast<std::int64_t>(mesh.rest_positions.size()));
    }
  }
}

TEST(CoarseLevels, InterpolateLinearFunctionsExactly) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE(seed);
    const EmbeddingMesh mesh = random_mesh(seed, 1);
    std::vector<Index3> position(mesh.rest_positions.size());  // of the finer nodes, in finer cells
    const auto place = [](const auto& cells, const auto& nodes, std::vector<Index3>& positions) {
      for (std::size_t c = 0; c < cells.size(); ++c) {
        for (std::size_t k = 0; k < 8; ++k) {
          const int corner = static_cast<int>(k);
          positions[static_cast<std::size_t>(nodes[c][k])] = {
              cells[c][0] + (corner & 1), cells[c][1] + (corner >> 1 & 1), cells[c][2] + (corner >> 2)};
        }
      }
    };
    place(mesh.cell_position, mesh.cell_nodes, position);
    for (const CoarseLevel& level : build_coarse_levels(mesh, 1)) {
      std::vector<Index3> coarse(static_cast<std::size_t>(level.node_count));
      place(level.cell_position, level.cell_nodes, coarse);
      ASSERT_EQ(level.start.size(), position.size() + 1);
      for (std::size_t n = 0; n < position.size(); ++n) {
        const auto first = static_cast<std::size_t>(level.start[n]);
        const auto last = static_cast<std::size_t>(level.start[n + 1]);
        ASSERT_GT(last, first);
        for (std::size_t a = 0; a < 3; ++a) {
          int sum = 0;
          for (std::size_t k = first; k < last; ++k)
            sum += 2 * coarse[static_cast<std::size_t>(level.among[k])][a];
          ASSERT_EQ(sum, position[n][a] * static_cast<int>(last - first));
        }
      }
      position = coarse;
    }
  }
}

TEST(CoarseLevels, GiveANodeTheSameValueFromEachOfItsCells) {
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    SCOPED_TRACE(seed);
    const EmbeddingMesh mesh = random_mesh(seed, 1);
    const std::vector<CoarseLevel> levels = build_coarse_levels(mesh, 1);
    if (levels.empty()) continue;
    const CoarseLevel& level = levels.front();
    for (std::size_t c = 0; c < mesh.cell_nodes.size(); ++c) {
      const auto& coarse = level.cell_nodes[static_cast<std::size_t>(level.parent[c])];
      const std::set<std::int32_t> own(coarse.begin(), coarse.end());
      for (std::int32_t node : mesh.cell_nodes[c]) {
        for (std::int32_t k = level.start[static_cast<std::size_t>(node)];
             k < level.start[static_cast<std::size_t>(node) + 1]; ++k) {
          ASSERT_TRUE(own.contains(level.among[static_cast<std::size_t>(k)]));
        }
      }
    }
  }
}

TEST(CoarseLevels, KeepTheBanksOfAFissureApart) {
  LabelMap map = empty_map({8, 8, 1});
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) map.labels[map.index(i, j, 0)] = i < 3 ? 1 : 2;
  }
  EmbeddingOptions options;
  options.size_m = map.spacing[0];
  const EmbeddingMesh mesh = build_embedding(map, make_separation_pairs({{1, 2}}), options);
  for (const CoarseLevel& level : build_coarse_levels(mesh, 1)) {
    std::vector<std::int32_t> bank(level.cell_position.size());
    std::iota(bank.begin(), bank.end(), 0);
    for (std::size_t sweep = 0; sweep < bank.size(); ++sweep) {
      for (const auto& [x, y] : level.cell_links) {
        auto& a = bank[static_cast<std::size_t>(x)];
        auto& b = bank[static_cast<std::size_t>(y)];
        a = b = std::min(a, b);
      }
    }
    EXPECT_EQ(std::set<std::int32_t>(bank.begin(), bank.end()).size(), 2U);
  }
}

}  // namespace
}  // namespace sulcus
