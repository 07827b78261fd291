// Splits of a cell into tetrahedra. Corner c of a cell stands at (c & 1, c >> 1 & 1, c >> 2 & 1) of the unit
// cube.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "engine/mesh/embedding.h"

namespace sulcus {

using CornerTet = std::array<std::uint8_t, 4>;  // corners of a cell, positive volume in the cell's own axes

// The tetrahedra of a cell at grid position `cell`, of positive volume in world axes: the image is `mirrored`
// if its direction matrix has determinant -1. Five: one of two mirrored splits by the parity of i + j + k, so
// that the diagonals of a face shared by two cells agree; six: around the main diagonal, the same in every
// cell.
std::span<const CornerTet> cell_tets(TetSplit split, bool mirrored, const Index3& cell);

// Barycentric coordinates of a point given in the cell's unit cube.
std::array<double, 4> corner_tet_weights(const CornerTet& tet, const Vec3& point);

}  // namespace sulcus
