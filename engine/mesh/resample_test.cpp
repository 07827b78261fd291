#include "engine/mesh/resample.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <limits>

#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

std::vector<double> interleaved(const EmbeddingMesh& mesh) {
  std::vector<double> nodes;
  for (const Vec3& p : mesh.rest_positions) nodes.insert(nodes.end(), {p[0], p[1], p[2]});
  return nodes;
}

std::vector<float> ramp(const LabelMap& map) {
  std::vector<float> grey;
  for (std::size_t v = 0; v < map.voxel_count(); ++v) grey.push_back(static_cast<float>(v % 97) * 0.37F + 1);
  return grey;
}

std::vector<std::int32_t> resample_labels(const LabelMap& map, const TissueImage& tissue, std::int32_t fill) {
  return resample_image<std::int32_t>(geometry_of(map), map.labels, tissue, Interpolation::nearest, fill);
}

TEST(Resample, AtRestIsTheIdentityExactly) {
  for (std::uint64_t seed = 1; seed < 150; ++seed) {
    Random random(seed);
    LabelMap map = random_map(random, {11, 9, 7}, 4);
    map.labels[0] = 1;
    map.spacing = {1e-3, 1.7e-3, 0.9e-3};
    map.origin = {0.013, -0.17, 0.031};
    map.direction << 0, 0, 1, 1, 0, 0, 0, -1, 0;
    const SeparationPairs pairs = random_pairs(random, 4);
    const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 1e-3 * (1 + random_below(random, 8))});
    const TissueImage tissue = locate_tissue(map, mesh, interleaved(mesh), {}, geometry_of(map));
    EXPECT_EQ(resample_labels(map, tissue, 0), map.labels) << seed;
    EXPECT_EQ(tissue.folded_voxels, 0) << seed;
    EXPECT_EQ(tissue.gap_voxels, 0) << seed;
    EXPECT_EQ(tissue.background_voxels, std::count(map.labels.begin(), map.labels.end(), 0)) << seed;
    const std::vector<float> grey = ramp(map);
    for (const Interpolation how : {Interpolation::nearest, Interpolation::linear}) {
      EXPECT_EQ(resample_image<float>(geometry_of(map), grey, tissue, how, -1), grey) << seed;
    }
    ASSERT_FALSE(HasFailure());
  }
}

TEST(Resample, AtRestIsTheIdentityInAnyGeometry) {
  for (std::uint64_t seed = 500; seed < 560; ++seed) {
    Random random(seed);
    LabelMap map = random_map(random, {8, 9, 7}, 3);
    map.labels[5] = 1;
    map.spacing = {1e-3, 1.3e-3, 0.9e-3};
    map.direction << 0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, -1;
    const EmbeddingMesh mesh =
        build_embedding(map, random_pairs(random, 3), {.size_m = 1e-3 * (1 + random_below(random, 6))});
    ImageGeometry wanted;
    wanted.size = {17, 15, 16};
    wanted.spacing = {0.7e-3, 0.45e-3 * (1 + random_below(random, 3)), 0.65e-3};
    wanted.origin = map.to_world(Vec3(-1.5, random_below(random, 4) - 2, 0.5));
    if (seed % 2) wanted.direction = map.direction;
    std::vector<std::uint16_t> values(17 * 15 * 16);
    for (auto& value : values) value = static_cast<std::uint16_t>(random());
    const TissueImage tissue = locate_tissue(map, mesh, interleaved(mesh), {}, wanted);
    EXPECT_EQ(tissue.gap_voxels + tissue.folded_voxels, 0) << seed;
    for (const Interpolation how : {Interpolation::nearest, Interpolation::linear}) {
      EXPECT_EQ(resample_image<std::uint16_t>(wanted, values, tissue, how, 7), values) << seed;
    }
  }
}

// Two blocks that touch at i = 7.5, in one row of cells of four voxels.
LabelMap two_blocks() {
  LabelMap map = empty_map({16, 8, 8});
  for (int k = 0; k < 8; ++k) {
    for (int j = 0; j < 8; ++j) {
      for (int i = 2; i < 13; ++i) map.labels[map.index(i, j, k)] = i < 6 ? 1 : 2;
    }
  }
  return map;
}

TEST(Resample, MovesAWholeNumberOfVoxelsAlong) {
  const LabelMap map = two_blocks();
  const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = 4e-3});
  std::vector<double> nodes = interleaved(mesh);
  for (std::size_t n = 0; n < nodes.size(); n += 3) nodes[n] += 3e-3;
  const TissueImage tissue = locate_tissue(map, mesh, nodes, {}, geometry_of(map));
  const std::vector<std::int32_t> labels = resample_labels(map, tissue, 0);
  for (int i = 0; i < 16; ++i) {
    EXPECT_EQ(labels[map.index(i, 4, 4)], i < 3 ? 0 : map.labels[map.index(i - 3, 4, 4)]) << i;
  }
  EXPECT_EQ(tissue.folded_voxels, 0);
}

// The pair opens inside a cell: its two copies move apart, each with its own voxels.
TEST(Resample, OpensAFissureInsideACell) {
  const LabelMap map = two_blocks();
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 4e-3});
  std::vector<double> nodes = interleaved(mesh);
  for (std::size_t c = 0; c < mesh.cell_nodes.size(); ++c) {
    if (mesh.cell_label[c] != 2) continue;
    for (const std::int32_t n : mesh.cell_nodes[c])
      nodes[3 * static_cast<std::size_t>(n)] = mesh.rest_positions[n][0] + 2e-3;
  }
  const TissueImage tissue = locate_tissue(map, mesh, nodes, {}, geometry_of(map));
  const std::vector<std::int32_t> labels = resample_labels(map, tissue, 0);
  for (int i = 0; i < 16; ++i) {
    const int expected = i >= 2 && i < 6 ? 1 : i >= 8 && i < 15 ? 2 : 0;
    EXPECT_EQ(labels[map.index(i, 4, 4)], expected) << i;
  }
  EXPECT_EQ(tissue.gap_voxels, 2 * 64);
  EXPECT_EQ(tissue.folded_voxels, 0);
}

TEST(Resample, CountsWhereTissueFolds) {
  const LabelMap map = two_blocks();
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 4e-3});
  std::vector<double> nodes = interleaved(mesh);
  for (std::size_t c = 0; c < mesh.cell_nodes.size(); ++c) {
    if (mesh.cell_label[c] != 2) continue;
    for (const std::int32_t n : mesh.cell_nodes[c])
      nodes[3 * static_cast<std::size_t>(n)] = mesh.rest_positions[n][0] - 2e-3;
  }
  const TissueImage tissue = locate_tissue(map, mesh, nodes, {}, geometry_of(map));
  EXPECT_EQ(tissue.folded_voxels, 2 * 64);
  EXPECT_EQ(resample_labels(map, tissue, 77)[map.index(4, 4, 4)], 77);
  EXPECT_EQ(resample_labels(map, tissue, 77)[map.index(6, 4, 4)], 2);
}

TEST(Resample, FollowsAnAffineDeformationIntoAnyGeometry) {
  Random random(9);
  LabelMap map = empty_map({14, 13, 12});
  for (auto& label : map.labels) label = 1;
  const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = 5e-3});
  Mat3 stretch;
  stretch << 1.1, 0.1, 0, -0.05, 0.9, 0.1, 0, 0.08, 1.2;
  std::vector<double> nodes;
  for (const Vec3& p : mesh.rest_positions) {
    const Vec3 q = stretch * p;
    nodes.insert(nodes.end(), {q[0], q[1], q[2]});
  }
  ImageGeometry wanted;
  wanted.size = {20, 20, 20};
  wanted.spacing = {0.6e-3, 0.5e-3, 0.7e-3};
  wanted.origin = {2e-3, 1e-3, 3e-3};
  wanted.direction << 0, 1, 0, 1, 0, 0, 0, 0, 1;
  std::vector<float> grey;  // linear in the voxel's coordinates
  for (int v = 0; v < 8000; ++v)
    grey.push_back(static_cast<float>(2 * (v % 20) - 3 * (v / 20 % 20) + v / 400));
  const TissueImage tissue = locate_tissue(map, mesh, nodes, {}, wanted);
  const std::vector<float> values = resample_image<float>(wanted, grey, tissue, Interpolation::linear, -100);
  int checked = 0;
  for (std::size_t v = 0; v < values.size(); ++v) {
    if (tissue.voxel[v] < 0) continue;
    const Vec3 at(static_cast<double>(v % 20), static_cast<double>(v / 20 % 20),
                  static_cast<double>(v / 400));
    Vec3 source = at;  // in wanted voxels
    for (int a = 0; a < 3; ++a) source[a] -= static_cast<double>(tissue.moved[v][a]);
    const auto world = [&](const Vec3& point) {
      return wanted.origin + wanted.direction * wanted.spacing.cwiseProduct(point);
    };
    ASSERT_LT((stretch * world(source) - world(at)).norm(), 1e-9);
    bool within = true;
    for (int a = 0; a < 3; ++a) within &= source[a] >= 0 && source[a] <= 19;
    if (!within) continue;
    ++checked;
    ASSERT_NEAR(values[v], 2 * source[0] - 3 * source[1] + source[2], 1e-4);
  }
  EXPECT_GT(checked, 3000);
}

TEST(Resample, SkipsRemovedAndBrokenTetrahedraAndCarriesTheirValues) {
  const LabelMap map = two_blocks();
  const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = 4e-3});
  std::vector<std::uint8_t> alive(mesh.tets.size(), 1);
  for (int t = 0; t < mesh.tets_per_cell; ++t)
    alive[mesh.cell_of_voxel[map.index(5, 2, 2)] * mesh.tets_per_cell + t] = 0;
  const TissueImage tissue = locate_tissue(map, mesh, interleaved(mesh), alive, geometry_of(map));
  EXPECT_EQ(tissue.voxel[map.index(5, 2, 2)], gap_voxel);
  EXPECT_GE(tissue.voxel[map.index(5, 6, 6)], 0);
  std::vector<float> values;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) values.push_back(static_cast<float>(t));
  const std::vector<float> overlay = resample_tet_values(values, tissue, -1);
  EXPECT_EQ(overlay[map.index(5, 2, 2)], -1);
  EXPECT_EQ(overlay[map.index(5, 6, 6)], static_cast<float>(tissue.tet[map.index(5, 6, 6)]));

  std::vector<double> nodes = interleaved(mesh);
  nodes[0] = std::numeric_limits<double>::quiet_NaN();
  nodes[4] = std::numeric_limits<double>::infinity();
  EXPECT_NO_THROW(locate_tissue(map, mesh, nodes, {}, geometry_of(map)));
}

TEST(Resample, IsTheSameForAnyThreadCount) {
  Random random(21);
  const LabelMap map = random_map(random, {20, 18, 17}, 3);
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 4e-3});
  std::vector<double> nodes = interleaved(mesh);
  for (double& x : nodes) x += 1e-6 * random_below(random, 2000);
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const TissueImage one = locate_tissue(map, mesh, nodes, {}, geometry_of(map));
  omp_set_num_threads(3);
  const TissueImage three = locate_tissue(map, mesh, nodes, {}, geometry_of(map));
  omp_set_num_threads(threads);
  EXPECT_EQ(one.voxel, three.voxel);
  EXPECT_EQ(one.tet, three.tet);
  EXPECT_EQ(one.moved, three.moved);
  EXPECT_EQ(one.folded_voxels, three.folded_voxels);
}

}  // namespace
}  // namespace sulcus
