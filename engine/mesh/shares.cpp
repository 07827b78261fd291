#include "engine/mesh/shares.h"

#include <algorithm>

#include "engine/mesh/tetrahedra.h"

namespace sulcus {

namespace {

// Volume of {u, v, w >= given, u + v + w <= 1}.
double corner_volume(double u, double v, double w) {
  const double left = std::max(0.0, 1 - u - v - w);
  return left * left * left / 6;
}

// Volume of {u <= u0, v <= v0, w <= w0, u >= v >= w >= 0}.
double path_volume(double u0, double v0, double w0) {
  const double top = std::min(u0, v0), middle = std::min(w0, top);
  return u0 * middle * middle / 2 - middle * middle * middle / 3 +
         w0 * (u0 * (top - middle) - (top * top - middle * middle) / 2);
}

// Volume of a box within a body, from the body's volumes beyond (or up to) the box' eight corners.
template <class Volume>
double box_volume(const double (&low)[3], const double (&high)[3], Volume volume) {
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    const double part = volume(c & 1 ? high[0] : low[0], c & 2 ? high[1] : low[1], c & 4 ? high[2] : low[2]);
    sum += ((c & 1) + (c >> 1 & 1) + (c >> 2)) % 2 ? -part : part;
  }
  return sum;
}

// Box (unit cube of the cell) within the corner tetrahedron at `apex`.
double within_corner(const double (&low)[3], const double (&high)[3], int apex) {
  double from[3], to[3];
  for (int a = 0; a < 3; ++a) {
    const bool far = apex >> a & 1;
    from[a] = far ? 1 - high[a] : low[a];
    to[a] = far ? 1 - low[a] : high[a];
  }
  return box_volume(from, to, corner_volume);
}

// Box within the tetrahedron around the main diagonal whose second and third corner on the way from 0 to 7
// are given.
double within_path(const double (&low)[3], const double (&high)[3], int second, int third) {
  const auto axis = [](int bit) { return bit == 1 ? 0 : bit == 2 ? 1 : 2; };
  const int order[3] = {axis(second), axis(third ^ second), axis(7 ^ third)};
  double from[3], to[3];
  for (int a = 0; a < 3; ++a) {
    from[a] = low[order[a]];
    to[a] = high[order[a]];
  }
  return -box_volume(from, to, path_volume);
}

// Part of each tetrahedron that each voxel of a cell covers: [voxels of a cell][tetrahedra].
std::vector<double> voxel_parts(const EmbeddingMesh& mesh, const Index3& cell) {
  const Index3& n = mesh.voxels_per_cell;
  const std::span<const CornerTet> tets = cell_tets(mesh.split, mesh.mirrored, cell);
  std::vector<double> parts;
  for (int k = 0; k < n[2]; ++k) {
    for (int j = 0; j < n[1]; ++j) {
      for (int i = 0; i < n[0]; ++i) {
        const int at[3] = {i, j, k};
        double low[3], high[3], volume = 1;
        for (int a = 0; a < 3; ++a) {
          low[a] = static_cast<double>(at[a]) / n[a];
          high[a] = static_cast<double>(at[a] + 1) / n[a];
          volume *= high[a] - low[a];
        }
        if (mesh.split == TetSplit::six) {
          for (const CornerTet& tet : tets) {
            int second = 0, third = 0;  // one and two steps from corner 0
            for (const int corner : tet) {
              if (corner == 1 || corner == 2 || corner == 4) second = corner;
              if (corner == 3 || corner == 5 || corner == 6) third = corner;
            }
            parts.push_back(6 * within_path(low, high, second, third));
          }
          continue;
        }
        double middle = volume;  // what the four corner tetrahedra leave
        for (int t = 0; t < 4; ++t) {
          const double corner = within_corner(low, high, tets[t][0]);
          middle -= corner;
          parts.push_back(6 * corner);
        }
        parts.push_back(3 * middle);
      }
    }
  }
  for (double& part : parts) part = std::clamp(part, 0.0, 1.0);  // rounding
  return parts;
}

// Labels and parts of one cell, tetrahedra one after another.
struct CellShares {
  std::vector<std::int32_t> labels;
  std::vector<double> shares;  // [tetrahedra][labels]
};

CellShares cell_shares(const LabelMap& map, const EmbeddingMesh& mesh, std::int32_t cell,
                       const std::vector<double>& parts) {
  const Index3& n = mesh.voxels_per_cell;
  const Index3& position = mesh.cell_position[cell];
  const int tets = mesh.tets_per_cell;
  CellShares result;
  std::vector<double> by_label;  // [labels][tetrahedra]
  std::size_t number = 0;
  for (int k = 0; k < n[2]; ++k) {
    for (int j = 0; j < n[1]; ++j) {
      for (int i = 0; i < n[0]; ++i, ++number) {
        const int x = position[0] * n[0] + i, y = position[1] * n[1] + j, z = position[2] * n[2] + k;
        if (x >= map.size[0] || y >= map.size[1] || z >= map.size[2]) continue;
        const std::size_t voxel = map.index(x, y, z);
        if (mesh.cell_of_voxel[voxel] != cell) continue;
        const auto found = std::find(result.labels.begin(), result.labels.end(), map.labels[voxel]);
        const std::size_t l = static_cast<std::size_t>(found - result.labels.begin());
        if (found == result.labels.end()) {
          result.labels.push_back(map.labels[voxel]);
          by_label.resize(by_label.size() + tets, 0);
        }
        for (int t = 0; t < tets; ++t) by_label[l * tets + t] += parts[number * tets + t];
      }
    }
  }
  for (int t = 0; t < tets; ++t) {
    for (std::size_t l = 0; l < result.labels.size(); ++l) result.shares.push_back(by_label[l * tets + t]);
  }
  return result;
}

}  // namespace

TetShares tet_shares(const LabelMap& map, const EmbeddingMesh& mesh) {
  const std::vector<double> parts[2] = {voxel_parts(mesh, {0, 0, 0}), voxel_parts(mesh, {1, 0, 0})};
  const auto cells = static_cast<std::ptrdiff_t>(mesh.cell_position.size());
  std::vector<CellShares> of_cell(static_cast<std::size_t>(cells));
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t c = 0; c < cells; ++c) {
    const Index3& p = mesh.cell_position[c];
    of_cell[c] = cell_shares(map, mesh, static_cast<std::int32_t>(c), parts[(p[0] + p[1] + p[2]) & 1]);
  }
  TetShares shares;
  shares.first.push_back(0);
  for (const CellShares& cell : of_cell) {
    const std::size_t labels = cell.labels.size();
    for (int t = 0; t < mesh.tets_per_cell; ++t) {
      double filled = 0;
      for (std::size_t l = 0; l < labels; ++l) {
        shares.label.push_back(cell.labels[l]);
        shares.share.push_back(cell.shares[t * labels + l]);
        filled += shares.share.back();
      }
      shares.filled.push_back(filled);
      shares.first.push_back(static_cast<std::int64_t>(shares.label.size()));
    }
  }
  return shares;
}

}  // namespace sulcus
