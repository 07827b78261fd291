// What hangs on hinges: for reports.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/mesh/topology.h"

namespace sulcus {

// Elements, ascending, that are connected by shared faces with no held node, but by shared nodes or edges
// with elements that are: they swing without stiffness. (Pieces that touch nothing held at all are loose, not
// hanging.) alive: [tets]; held: [nodes]. Cost: in proportion to the elements.
std::vector<std::int32_t> hanging_elements(std::span<const std::array<std::int32_t, 4>> tets,
                                           const FaceNeighbours& faces, std::span<const std::uint8_t> alive,
                                           std::span<const std::uint8_t> held);

}  // namespace sulcus
