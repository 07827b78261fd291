#include "engine/mesh/embedding.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/mesh/topology.h"
#include "engine/numerics/error.h"
#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

LabelMap block(const Index3& size) {
  LabelMap map = empty_map(size);
  for (auto& label : map.labels) label = 1;
  return map;
}

TEST(Embedding, OfABlockIsTheRegularGrid) {
  const EmbeddingMesh mesh = build_embedding(block({6, 4, 2}), {}, {.size_m = 2e-3});
  EXPECT_EQ(mesh.grid_size, (Index3{3, 2, 1}));
  EXPECT_EQ(mesh.cell_position.size(), 6U);
  EXPECT_EQ(mesh.rest_positions.size(), 24U);
  EXPECT_EQ(mesh.tets.size(), 30U);
  EXPECT_EQ(mesh.cell_links.size(), 7U);
  EXPECT_NEAR(mesh.rest_positions[0][0], -0.5e-3, 1e-15);
  EXPECT_NEAR(mesh.rest_positions[23][0], 5.5e-3, 1e-15);
}

TEST(Embedding, RefusesAbsurdSizesAndEmptyImages) {
  EXPECT_THROW(build_embedding(block({4, 4, 4}), {}, {.size_m = 0.5e-3}), InputError);
  EXPECT_THROW(build_embedding(block({4, 4, 4}), {}, {.size_m = 4.1e-3}), InputError);
  EXPECT_THROW(build_embedding(block({4, 4, 4}), {}, {.size_m = std::nan("")}), InputError);
  EXPECT_THROW(build_embedding(block({4, 4, 4}), {}, {.size_m = 2e-3, .min_island_cells = 9}), InputError);
  EXPECT_THROW(build_embedding(empty_map({4, 4, 4}), {}, {.size_m = 2e-3}), InputError);
}

TEST(Embedding, SizesAMillionthBesideWholeVoxelsAreWhole) {
  LabelMap map = block({20, 20, 20});
  map.spacing = Vec3::Constant(1e-3 * (1 - 1e-7));
  EXPECT_EQ(build_embedding(map, {}, {.size_m = 10e-3}).voxels_per_cell, (Index3{10, 10, 10}));
}

}  // namespace
}  // namespace sulcus
