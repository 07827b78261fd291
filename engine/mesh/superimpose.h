// Superimposed cells and nodes (thesis 2.5), the inside of build_embedding.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/numerics/types.h"
#include "engine/volume/label_map.h"
#include "engine/volume/large_array.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

struct CellCopies {
  std::vector<std::int32_t>
      first_copy;                    // [grid cells + 1] copies of grid cell g: first_copy[g] .. [g + 1] - 1
  std::vector<Index3> position;      // [copies]
  std::vector<std::int32_t> voxels;  // [copies] voxels owned
  std::vector<std::int32_t> label;   // [copies] most frequent label, the first to occur at ties
  LargeVector<std::int32_t> copy_of_voxel;  // [voxels], -1 for empty voxels
};

// One copy for each connected piece of voxels within a grid cell (or for all its voxels if not
// `superimpose`), ordered by grid position, then by first voxel. links: see volume/voxel_links.h. Throws
// InputError if the grid or the tetrahedra (tets_per_cell each) would outgrow 32 bits.
CellCopies make_cell_copies(const LabelMap& map, const VoxelLinks& links, const Index3& grid,
                            const Index3& voxels_per_cell, bool superimpose);

// Copies joined by a voxel face between two grid cells, a < b, sorted. Not `superimpose`: all face
// neighbours.
std::vector<std::array<std::int32_t, 2>> make_cell_links(const LabelMap& map, const VoxelLinks& links,
                                                         const Index3& grid, const Index3& voxels_per_cell,
                                                         const CellCopies& copies, bool superimpose);

struct NodeCopies {
  std::vector<Index3> position;                         // [nodes] grid corner
  std::vector<std::array<std::int32_t, 8>> cell_nodes;  // [copies]
};

// Around each grid corner one node for each set of linked copies, ordered by grid corner, then by first copy.
NodeCopies make_nodes(const Index3& grid, const CellCopies& copies,
                      const std::vector<std::array<std::int32_t, 2>>& cell_links, bool superimpose);

}  // namespace sulcus
