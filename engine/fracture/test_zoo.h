// Tetrahedral meshes for the tests of fracture: with alive flags and the elements around each node.
#pragma once

#include "engine/fem/test_meshes.h"
#include "engine/fracture/singularity.h"
#include "engine/mesh/topology.h"
#include "engine/volume/test_maps.h"

namespace sulcus {

struct StarMesh {
  std::vector<std::array<std::int32_t, 4>> tets;
  NodeStars around;
  std::vector<std::uint8_t> alive;

  MeshStars stars() const { return {tets, around.start, around.incident}; }
};

inline StarMesh star_mesh(std::vector<std::array<std::int32_t, 4>> tets) {
  StarMesh mesh;
  std::int32_t nodes = 0;
  for (const auto& tet : tets) {
    for (std::int32_t node : tet) nodes = std::max(nodes, node + 1);
  }
  mesh.around = build_node_stars(tets, nodes);
  mesh.alive.assign(tets.size(), 1);
  mesh.tets = std::move(tets);
  return mesh;
}

inline StarMesh star_cube(int cells, TetSplit split) {
  return star_mesh(box_mesh(cells, cells, cells, 0.01, split).tets);
}

// A label map of random grains with pairs: superimposed cells and nodes, loose pieces.
inline StarMesh star_label_map(Random& random) {
  for (;;) {
    const LabelMap map = random_map(random, {6, 5, 4}, 3);
    if (std::count(map.labels.begin(), map.labels.end(), 0) == static_cast<std::ptrdiff_t>(map.labels.size()))
      continue;
    EmbeddingOptions options;
    options.size_m = 2 * map.spacing[0];
    options.split = random_below(random, 2) ? TetSplit::five : TetSplit::six;
    return star_mesh(build_embedding(map, random_pairs(random, 3), options).tets);
  }
}

// `count` elements around the edge 0-1, closed or open.
inline StarMesh star_fan(int count, bool closed) {
  std::vector<std::array<std::int32_t, 4>> tets;
  for (int k = 0; k < count; ++k) tets.push_back({0, 1, 2 + k, closed && k + 1 == count ? 2 : 3 + k});
  return star_mesh(tets);
}

// A closed ring of `count` cells in a row around nothing: cells share faces, six elements each.
inline StarMesh star_ring(int count) {
  std::vector<std::array<std::int32_t, 4>> tets;
  constexpr int split[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                               {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
  for (int k = 0; k < count; ++k) {
    for (const auto& corners : split) {
      std::array<std::int32_t, 4> tet{};
      for (std::size_t c = 0; c < 4; ++c) {
        const int corner = corners[c];
        tet[c] = 4 * ((k + (corner & 1)) % count) + corner / 2;
      }
      tets.push_back(tet);
    }
  }
  return star_mesh(tets);
}

inline std::vector<StarMesh> star_zoo(Random& random) {
  std::vector<StarMesh> zoo = {star_cube(3, TetSplit::five),
                               star_cube(3, TetSplit::six),
                               star_cube(4, TetSplit::five),
                               star_fan(9, true),
                               star_fan(7, false),
                               star_ring(5),
                               star_ring(8)};
  for (int i = 0; i < 6; ++i) zoo.push_back(star_label_map(random));
  return zoo;
}

}  // namespace sulcus
