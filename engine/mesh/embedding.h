// The mesher: a label map embedded in a regular hexahedral grid with superimposed cells and nodes, so that
// closed fissures can open (thesis 2.4, 2.5), each hexahedron split into tetrahedra.
//
//   1. regular grid from voxel (0,0,0); a cell's edge is a whole number of voxels, ceil(H / spacing)
//   2. superimposed cells: one cell copy for each connected piece of voxels within a grid cell
//   3. cell links: two copies in face-neighbouring grid cells are linked if a voxel face between them
//   connects
//   4. superimposed nodes: around each grid corner, one node for each set of linked copies
//   5. five tetrahedra a cell with alternating parity (faces match across cells), or six
//
// Orders are lexicographic: cells by grid position (i fastest), then by first voxel; nodes by grid position,
// then by first cell; so the result depends neither on thread count nor on the numbering of labels.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/volume/label_map.h"
#include "engine/volume/large_array.h"
#include "engine/volume/separation.h"

namespace sulcus {

enum class TetSplit { five, six };

struct EmbeddingOptions {
  double size_m = 0.01;  // m, wanted cell edge H; must be at least one voxel
  TetSplit split = TetSplit::five;
  bool superimpose = true;            // false: one copy a grid cell, nodes shared (to show what is lost)
  std::int64_t min_island_cells = 0;  // pieces of fewer cells are left out; 0 keeps all
};

struct EmbeddingMesh {
  Index3 grid_size{0, 0, 0};        // grid cells along i, j, k
  Index3 voxels_per_cell{0, 0, 0};  // along i, j, k
  int tets_per_cell = 5;
  TetSplit split = TetSplit::five;
  bool mirrored = false;  // the image's direction matrix has determinant -1

  // Cells (copies). Corner c of a cell is at grid position cell_position + (c & 1, c >> 1 & 1, c >> 2 & 1).
  std::vector<Index3> cell_position;                    // [cells]
  std::vector<std::array<std::int32_t, 8>> cell_nodes;  // [cells]
  std::vector<std::int32_t> cell_voxels;                // [cells] voxels owned
  std::vector<std::int32_t> cell_label;  // [cells] most frequent label, the first to occur at ties
  std::vector<std::array<std::int32_t, 2>> cell_links;  // [links] linked copies, a < b, sorted

  // Voxels
  LargeVector<std::int32_t> cell_of_voxel;  // [voxels] owning copy; -1 for empty or left-out voxels

  // Nodes and tetrahedra. Tetrahedra of cell c are c*tets_per_cell ... ; all have positive volume.
  std::vector<Vec3> rest_positions;               // [nodes], m, world
  std::vector<std::array<std::int32_t, 4>> tets;  // [tets]
};

// Throws InputError for an empty map, H below a voxel or absurd, too many cells for 32-bit numbers.
EmbeddingMesh build_embedding(const LabelMap& map, const SeparationPairs& pairs,
                              const EmbeddingOptions& options);

// The tetrahedron (rest shape) of copy `cell` that holds the point given in voxel coordinates; points outside
// the cell get the tetrahedron whose smallest barycentric coordinate is largest; ties go to the lowest
// number. Writes the barycentric coordinates. alive ([tets] or empty = all): removed ones are passed over,
// unless the cell has no other.
std::int32_t locate_tet_in_cell(const EmbeddingMesh& mesh, std::int32_t cell, const Vec3& point_voxel,
                                std::array<double, 4>& weights, std::span<const std::uint8_t> alive = {});

}  // namespace sulcus
