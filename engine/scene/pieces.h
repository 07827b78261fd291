// Pieces of the mesh in words: what a message says of the place where something failed.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "engine/scene/scene.h"
#include "engine/scene/state.h"

namespace sulcus {

// "piece 2 of 3 of the mesh (57 cells around (12, -3, 40) mm)": the piece of present elements that holds the
// node; pieces are counted from 1, the place is the mean of its nodes at rest. For a node that no element
// holds: "node 17 at (12, -3, 40) mm, which belongs to no element". alive: [tets] or empty = all.
std::string describe_piece(const Scene& scene, std::span<const std::uint8_t> alive, std::int32_t node);

// One sentence for each piece that can move without deforming, with the motion that is free and the remedy;
// empty if every piece is held. Held nodes, springs and planes hold; mass does not.
std::vector<std::string> loose_pieces(const Scene& scene, std::span<const std::uint8_t> alive);

}  // namespace sulcus
