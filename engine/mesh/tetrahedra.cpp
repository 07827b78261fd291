#include "engine/mesh/tetrahedra.h"

#include <utility>

namespace sulcus {

namespace {

constexpr CornerTet even_five[5] = {{0, 1, 2, 4}, {3, 2, 1, 7}, {5, 4, 7, 1}, {6, 7, 4, 2}, {1, 2, 4, 7}};
constexpr CornerTet odd_five[5] = {{1, 3, 0, 5}, {2, 0, 3, 6}, {4, 5, 6, 0}, {7, 6, 5, 3}, {0, 3, 5, 6}};
// Around the diagonal 0-7, one a path along the three axes.
constexpr CornerTet six[6] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                              {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};

constexpr int coordinate(std::uint8_t corner, int axis) {
  return corner >> axis & 1;
}

// Six times the volume, in units of the cell.
constexpr int volume(const CornerTet& t) {
  int e[3][3] = {};
  for (int v = 0; v < 3; ++v) {
    for (int a = 0; a < 3; ++a) e[v][a] = coordinate(t[v + 1], a) - coordinate(t[0], a);
  }
  return e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
         e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
         e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
}

// The tetrahedra with the vertex order that makes the volume positive, or negative if `mirrored`.
template <std::size_t Count>
constexpr std::array<CornerTet, Count> oriented(const CornerTet (&tets)[Count], bool mirrored) {
  std::array<CornerTet, Count> result{};
  for (std::size_t t = 0; t < Count; ++t) {
    result[t] = tets[t];
    if ((volume(tets[t]) > 0) == mirrored) std::swap(result[t][2], result[t][3]);
  }
  return result;
}

constexpr auto even_right = oriented(even_five, false), even_left = oriented(even_five, true);
constexpr auto odd_right = oriented(odd_five, false), odd_left = oriented(odd_five, true);
constexpr auto six_right = oriented(six, false), six_left = oriented(six, true);

}  // namespace

std::span<const CornerTet> cell_tets(TetSplit split, bool mirrored, const Index3& cell) {
  if (split == TetSplit::six) return mirrored ? six_left : six_right;
  if ((cell[0] + cell[1] + cell[2]) & 1) return mirrored ? odd_left : odd_right;
  return mirrored ? even_left : even_right;
}

std::array<double, 4> corner_tet_weights(const CornerTet& tet, const Vec3& point) {
  // Cramer's rule; the edges and determinants are small whole numbers.
  double e[3][3], p[3];
  for (int a = 0; a < 3; ++a) {
    for (int v = 0; v < 3; ++v) e[v][a] = coordinate(tet[v + 1], a) - coordinate(tet[0], a);
    p[a] = point[a] - coordinate(tet[0], a);
  }
  const auto triple = [](const double* a, const double* b, const double* c) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
  };
  const double whole = triple(e[0], e[1], e[2]);
  std::array<double, 4> weights{};
  weights[1] = triple(p, e[1], e[2]) / whole;
  weights[2] = triple(e[0], p, e[2]) / whole;
  weights[3] = triple(e[0], e[1], p) / whole;
  weights[0] = 1.0 - weights[1] - weights[2] - weights[3];
  return weights;
}

}  // namespace sulcus
