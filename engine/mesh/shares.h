// What a tetrahedron of the embedding mesh holds: for stiffness and mass weighted by content instead of the
// whole cell's (thesis 2.8 and 6.2).
#pragma once

#include <cstdint>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

// Parts of each tetrahedron's rest volume, exact for voxels as boxes.
struct TetShares {
  std::vector<double> filled;  // [tets] 0..1: covered by voxels that its cell owns
  std::vector<std::int64_t>
      first;  // [tets + 1] labels of tetrahedron t: entries first[t] .. first[t + 1] - 1
  std::vector<std::int32_t>
      label;  // [entries] in order of their first voxel in the cell, the same for all its tets
  std::vector<double> share;  // [entries] 0..1; of one tetrahedron they add up to `filled`
};

// Deterministic for any thread count. Cost: in proportion to owned voxels times tetrahedra a cell.
TetShares tet_shares(const LabelMap& map, const EmbeddingMesh& mesh);

}  // namespace sulcus
