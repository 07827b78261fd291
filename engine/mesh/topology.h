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

// Corners of the face opposite corner c, counter-clockwise from outside of a tetrahedron of positive volume.
inline constexpr std::array<std::array<std::size_t, 3>, 4> face_corners = {
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

// Who shares a face. Two superimposed copies of a cell may both be linked to one copy behind a face, so a
// face can have several tetrahedra on the same side. A face of a tetrahedron is named tet*4 + opposite
// corner.
struct FaceNeighbours {
  std::vector<std::int32_t> across;  // [4*tets] the lowest face on the other side; -1: none
  std::vector<std::int32_t>
      beside;  // [4*tets] the next face on the same side, in a ring; itself if it is alone
};
FaceNeighbours face_neighbours(std::span<const std::array<std::int32_t, 4>> tets);

// Whether any tetrahedron that is present lies behind the face. alive: [tets] or empty = all.
bool is_covered(const FaceNeighbours& faces, std::span<const std::uint8_t> alive, std::int32_t face);

// Pieces of tetrahedra that share nodes. `alive` (empty = all) leaves out removed elements.
Pieces mesh_pieces(std::span<const std::array<std::int32_t, 4>> tets, std::int64_t node_count,
                   std::span<const std::uint8_t> alive = {});

}  // namespace sulcus
