// Coarser copies of the embedding grid, for solvers that work on several scales. A coarse cell stands for the
// cells of a 2x2x2 block that hang together through cell links, so two banks of a fissure stay apart on every
// level; its links are those of its cells, and its nodes follow from them by the mesher's own rule. A level
// is the mesh that the mesher would make at twice the cell size.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

struct CoarseLevel {
  Index3 grid_size{0, 0, 0};
  std::vector<Index3> cell_position;                    // [cells]
  std::vector<std::array<std::int32_t, 8>> cell_nodes;  // [cells], corners as in EmbeddingMesh
  std::vector<std::array<std::int32_t, 2>> cell_links;  // [links] a < b, sorted
  std::vector<std::int32_t> parent;                     // [cells of the next finer level]
  std::int64_t node_count = 0;
  // Trilinear interpolation to the nodes of the next finer level, which stand at corners and midpoints: the
  // mean of 1, 2, 4 or 8 coarse nodes. Finer node n: among[start[n]] .. among[start[n + 1] - 1]. A node
  // shared by cells of several coarse cells follows the first; in meshes with superimposed nodes all agree.
  std::vector<std::int32_t> start;  // [finer nodes + 1]
  std::vector<std::int32_t> among;
};

// Levels from the one above the mesh upwards, until one has at most `enough_nodes` or no fewer than the one
// below it. Empty if the mesh has that few. Cost: a few passes over cells and links, once for a scene.
std::vector<CoarseLevel> build_coarse_levels(const EmbeddingMesh& mesh, std::int64_t enough_nodes);

}  // namespace sulcus
