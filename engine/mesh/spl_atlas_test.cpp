// The mesher on a real brain against counts that were made by other programs (README of the data folder).
#include "engine/mesh/spl_atlas.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "engine/mesh/embedding.h"
#include "engine/mesh/topology.h"
#include "engine/volume/label_operations.h"

namespace sulcus {
namespace {

class SplBrain : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { map_ = read_spl_brain(); }
  static void TearDownTestSuite() { map_.reset(); }
  void SetUp() override {
    if (!map_) GTEST_SKIP() << "the SPL brain atlas is not in " << spl_atlas_folder();
  }
  static std::optional<LabelMap> map_;
};

std::optional<LabelMap> SplBrain::map_;

TEST_F(SplBrain, HasTheKnownVoxelsAndPieces) {
  std::set<std::int32_t> labels(map_->labels.begin(), map_->labels.end());
  EXPECT_EQ(labels.size() - labels.count(0), 229U);
  EXPECT_EQ(voxel_pieces(*map_, {}).item_count, (std::vector<std::int64_t>{1292465, 2, 1}));
  EXPECT_EQ(read_thesis_pairs("Sylvian fissure").pairs.size(), 22U);
}

TEST_F(SplBrain, HasTheKnownVoids) {
  LabelMap filled = *map_;
  EXPECT_EQ(fill_voids(filled), 3463);
  EXPECT_EQ(drop_small_pieces(filled, {}, 3), 3);
}

TEST_F(SplBrain, HasTheKnownCellsWithAllPairsCut) {
  const SeparationPairs pairs = read_thesis_pairs("");
  const std::pair<double, std::size_t> known[] = {
      {15e-3, 1284}, {10e-3, 2991}, {5e-3, 16083}, {2e-3, 184436}};
  for (const auto& [size_m, cells] : known) {
    EXPECT_EQ(build_embedding(*map_, pairs, {.size_m = size_m}).cell_position.size(), cells) << size_m;
  }
}

TEST_F(SplBrain, HasTheKnownCellsWithoutSplitting) {
  const SeparationPairs pairs = read_thesis_pairs("");
  const std::pair<double, std::size_t> known[] = {{15e-3, 696}, {10e-3, 2016}, {5e-3, 13610}, {2e-3, 182272}};
  for (const auto& [size_m, cells] : known) {
    const EmbeddingMesh mesh = build_embedding(*map_, pairs, {.size_m = size_m, .superimpose = false});
    EXPECT_EQ(mesh.cell_position.size(), cells) << size_m;
  }
}

TEST_F(SplBrain, HasTheKnownNodesAndPiecesWithTheSylvianPairsCut) {
  struct Known {
    double size_m;
    std::size_t cells, nodes, largest_cells, largest_nodes;
  };
  const SeparationPairs pairs = read_thesis_pairs("Sylvian fissure");
  for (const Known& known : {Known{15e-3, 1167, 2756, 1064, 1936}, Known{10e-3, 2845, 5360, 2742, 4540},
                             Known{5e-3, 15775, 22818, 15672, 21998}}) {
    SCOPED_TRACE(known.size_m);
    const EmbeddingMesh mesh = build_embedding(*map_, pairs, {.size_m = known.size_m});
    EXPECT_EQ(mesh.cell_position.size(), known.cells);
    EXPECT_EQ(mesh.rest_positions.size(), known.nodes);
    const Pieces pieces = mesh_pieces(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
    EXPECT_EQ(pieces.item_count.size(), 103U);
    const auto largest = std::max_element(pieces.item_count.begin(), pieces.item_count.end());
    EXPECT_EQ(*largest, static_cast<std::int64_t>(known.largest_cells) * 5);
    std::set<std::int32_t> nodes;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      if (pieces.piece[t] == largest - pieces.item_count.begin())
        nodes.insert(mesh.tets[t].begin(), mesh.tets[t].end());
    }
    EXPECT_EQ(nodes.size(), known.largest_nodes);
  }
}

}  // namespace
}  // namespace sulcus
