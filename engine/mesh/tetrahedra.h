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

// Barycentric coordinates of a tetrahedron of the cell's unit cube: the coordinate of corner v at the point p
// is map[v][0] + map[v][1] p_x + map[v][2] p_y + map[v][3] p_z.
using TetMap = std::array<std::array<double, 4>, 4>;

// Those of the tetrahedra of cell_tets, in the same order.
std::span<const TetMap> cell_tet_maps(TetSplit split, bool mirrored, const Index3& cell);

inline std::array<double, 4> tet_weights(const TetMap& map, const Vec3& point) {
  std::array<double, 4> weights;
  for (std::size_t v = 0; v < 4; ++v)
    weights[v] = map[v][0] + map[v][1] * point[0] + map[v][2] * point[1] + map[v][3] * point[2];
  return weights;
}

}  // namespace sulcus
