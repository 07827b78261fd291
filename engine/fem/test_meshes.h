// Meshes for the tests of the engine: label maps of one voxel a cell, through the real mesher.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/mesh/embedding.h"
#include "engine/numerics/test_random.h"

namespace sulcus {

inline LabelMap box_map(int nx, int ny, int nz, double edge_m) {
  LabelMap map;
  map.size = {nx, ny, nz};
  map.spacing = Vec3::Constant(edge_m);
  map.origin = Vec3::Constant(0.5 * edge_m);  // so that the box starts at the world's origin
  map.labels.assign(static_cast<std::size_t>(nx * ny * nz), 1);
  return map;
}

// A box of nx*ny*nz cubes of edge_m, its corner at the origin.
inline EmbeddingMesh box_mesh(int nx, int ny, int nz, double edge_m, TetSplit split = TetSplit::five) {
  EmbeddingOptions options;
  options.size_m = edge_m;
  options.split = split;
  return build_embedding(box_map(nx, ny, nz, edge_m), {}, options);
}

inline std::vector<double> flat_positions(const EmbeddingMesh& mesh) {
  std::vector<double> positions;
  for (const Vec3& x : mesh.rest_positions) positions.insert(positions.end(), {x[0], x[1], x[2]});
  return positions;
}

}  // namespace sulcus
