// Who is around a node, and counting pieces: of the voxel graph cut by the pairs, and of a tetrahedral mesh.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/volume/label_map.h"
#include "engine/volume/separation.h"

namespace sulcus {

struct Pieces {
  std::vector<std::int32_t> piece;       // [items] number of the piece, -1 for items that are in none
  std::vector<std::int64_t> item_count;  // [pieces]; pieces are numbered by their first item
};

// 6-connected pieces of labelled voxels, faces between pairs cut.
Pieces voxel_pieces(const LabelMap& map, const SeparationPairs& pairs);

// The tetrahedra around each node.
struct NodeStars {
  std::vector<std::int32_t> start;     // [nodes+1] into incident
  std::vector<std::int32_t> incident;  // tet*4 + corner, ascending
};
NodeStars build_node_stars(std::span<const std::array<std::int32_t, 4>> tets, std::int64_t node_count);

// The tetrahedron behind each face: [tets], entry c lies across the face opposite corner c; -1: none. Throws
// InputError for a face that three tetrahedra share.
std::vector<std::array<std::int32_t, 4>> face_neighbours(std::span<const std::array<std::int32_t, 4>> tets);

// Pieces of tetrahedra that share nodes. `alive` (empty = all) leaves out removed elements.
Pieces mesh_pieces(std::span<const std::array<std::int32_t, 4>> tets, std::int64_t node_count,
                   std::span<const std::uint8_t> alive = {});

}  // namespace sulcus
