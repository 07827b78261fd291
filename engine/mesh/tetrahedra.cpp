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

// Barycentric coordinates by Cramer's rule; edges and volumes are small whole numbers.
constexpr TetMap map_of(const CornerTet& t) {
  TetMap map{};
  map[0][0] = 1;
  for (int v = 1; v < 4; ++v) {
    const std::uint8_t after = t[v % 3 + 1], behind = t[(v + 1) % 3 + 1];
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, c = (a + 2) % 3;
      const auto edge = [&](std::uint8_t corner, int axis) {
        return coordinate(corner, axis) - coordinate(t[0], axis);
      };
      const int area = edge(after, b) * edge(behind, c) - edge(after, c) * edge(behind, b);
      const double slope = static_cast<double>(area) / volume(t);
      map[v][a + 1] = slope;
      map[v][0] -= slope * coordinate(t[0], a);
    }
    for (int k = 0; k < 4; ++k) map[0][k] -= map[v][k];
  }
  return map;
}

template <std::size_t Count>
struct Split {
  std::array<CornerTet, Count> tets;
  std::array<TetMap, Count> maps{};
  constexpr Split(const CornerTet (&corners)[Count], bool mirrored) : tets(oriented(corners, mirrored)) {
    for (std::size_t t = 0; t < Count; ++t) maps[t] = map_of(tets[t]);
  }
};

constexpr Split<5> even_right(even_five, false), even_left(even_five, true);
constexpr Split<5> odd_right(odd_five, false), odd_left(odd_five, true);
constexpr Split<6> six_right(six, false), six_left(six, true);

// What `use` makes of the split of a cell.
template <class Use>
auto with_split(TetSplit split, bool mirrored, const Index3& cell, Use&& use) {
  if (split == TetSplit::six) return use(mirrored ? six_left : six_right);
  if ((cell[0] + cell[1] + cell[2]) & 1) return use(mirrored ? odd_left : odd_right);
  return use(mirrored ? even_left : even_right);
}

}  // namespace

std::span<const CornerTet> cell_tets(TetSplit split, bool mirrored, const Index3& cell) {
  return with_split(split, mirrored, cell,
                    [](const auto& of) { return std::span<const CornerTet>(of.tets); });
}

std::span<const TetMap> cell_tet_maps(TetSplit split, bool mirrored, const Index3& cell) {
  return with_split(split, mirrored, cell, [](const auto& of) { return std::span<const TetMap>(of.maps); });
}

}  // namespace sulcus
