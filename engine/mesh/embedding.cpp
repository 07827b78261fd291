#include "engine/mesh/embedding.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "engine/mesh/superimpose.h"
#include "engine/mesh/tetrahedra.h"
#include "engine/numerics/error.h"
#include "engine/volume/large_array.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

std::string millimetres(double metres) {
  return std::to_string(metres * 1e3) + " mm";
}

Index3 whole_voxels(const LabelMap& map, double size_m) {
  const double voxel = std::min({map.spacing[0], map.spacing[1], map.spacing[2]});
  double extent = 0;  // m, the longest side of the image
  for (int a = 0; a < 3; ++a) extent = std::max(extent, map.size[a] * map.spacing[a]);
  if (!(size_m >= voxel * (1 - 1e-6))) {
    throw InputError("mesh size: " + millimetres(size_m) + " is smaller than a voxel (" + millimetres(voxel) +
                     "); give at least one voxel");
  }
  if (!(size_m <= extent * (1 + 1e-6))) {
    throw InputError("mesh size: " + millimetres(size_m) + " is larger than the image (" +
                     millimetres(extent) + "); give less");
  }
  Index3 voxels;
  for (int a = 0; a < 3; ++a) {
    // Spacings come from single-precision headers: a millionth above a whole number is that number.
    voxels[a] = std::max(1, static_cast<int>(std::ceil(size_m / map.spacing[a] * (1 - 1e-6))));
    if (map.size[a] == 1) voxels[a] = 1;
  }
  return voxels;
}

// Copies in pieces of at least `minimum` cells, the others taken out and all renumbered.
void remove_islands(std::int64_t minimum, CellCopies& copies,
                    std::vector<std::array<std::int32_t, 2>>& links) {
  const std::size_t count = copies.position.size();
  std::vector<std::int32_t> parent(count);
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](std::int32_t n) {
    while (parent[n] != n) n = parent[n] = parent[parent[n]];
    return n;
  };
  for (const auto& [a, b] : links) {
    const std::int32_t x = root(a), y = root(b);
    parent[std::max(x, y)] = std::min(x, y);
  }
  std::vector<std::int64_t> cells(count, 0);
  for (std::size_t c = 0; c < count; ++c) ++cells[root(static_cast<std::int32_t>(c))];

  std::vector<std::int32_t> number(count, -1);
  std::int32_t kept = 0;
  for (std::size_t c = 0; c < count; ++c) {
    if (cells[root(static_cast<std::int32_t>(c))] < minimum) continue;
    copies.position[kept] = copies.position[c];
    copies.voxels[kept] = copies.voxels[c];
    copies.label[kept] = copies.label[c];
    number[c] = kept++;
  }
  copies.position.resize(kept);
  copies.voxels.resize(kept);
  copies.label.resize(kept);
  std::int32_t before = 0;  // kept copies before the grid cell
  std::size_t old = 0;
  for (std::int32_t& first : copies.first_copy) {
    for (; old < static_cast<std::size_t>(first); ++old) before += number[old] >= 0;
    first = before;
  }
  std::erase_if(links, [&](const auto& link) { return number[link[0]] < 0; });
  for (auto& link : links) link = {number[link[0]], number[link[1]]};
  const auto voxels = static_cast<std::ptrdiff_t>(copies.copy_of_voxel.size());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t v = 0; v < voxels; ++v) {
    if (copies.copy_of_voxel[v] >= 0) copies.copy_of_voxel[v] = number[copies.copy_of_voxel[v]];
  }
}

void make_tets(const LabelMap& map, TetSplit split, EmbeddingMesh& mesh) {
  const auto cells = static_cast<std::ptrdiff_t>(mesh.cell_position.size());
  mesh.tets_per_cell = split == TetSplit::six ? 6 : 5;
  mesh.split = split;
  const Mat3& d = map.direction;
  mesh.mirrored = d(0, 0) * (d(1, 1) * d(2, 2) - d(1, 2) * d(2, 1)) -
                      d(0, 1) * (d(1, 0) * d(2, 2) - d(1, 2) * d(2, 0)) +
                      d(0, 2) * (d(1, 0) * d(2, 1) - d(1, 1) * d(2, 0)) <
                  0;
  mesh.tets =
      large_vector<std::array<std::int32_t, 4>>(static_cast<std::size_t>(cells) * mesh.tets_per_cell, {});
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t c = 0; c < cells; ++c) {
    auto* tet = mesh.tets.data() + c * mesh.tets_per_cell;
    for (const CornerTet& corners : cell_tets(split, mesh.mirrored, mesh.cell_position[c])) {
      for (int v = 0; v < 4; ++v) (*tet)[v] = mesh.cell_nodes[c][corners[v]];
      ++tet;
    }
  }
}

}  // namespace

EmbeddingMesh build_embedding(const LabelMap& map, const SeparationPairs& pairs,
                              const EmbeddingOptions& options) {
  check_label_map(map);
  EmbeddingMesh mesh;
  mesh.voxels_per_cell = whole_voxels(map, options.size_m);
  for (int a = 0; a < 3; ++a) mesh.grid_size[a] = (map.size[a] - 1) / mesh.voxels_per_cell[a] + 1;

  const VoxelLinks links = build_voxel_links(map, pairs);
  CellCopies copies = make_cell_copies(map, links, mesh.grid_size, mesh.voxels_per_cell, options.superimpose);
  if (copies.position.empty()) {
    throw InputError("label map: no voxel is labelled; give an image with at least one label other than 0");
  }
  mesh.cell_links =
      make_cell_links(map, links, mesh.grid_size, mesh.voxels_per_cell, copies, options.superimpose);
  if (options.min_island_cells > 1) remove_islands(options.min_island_cells, copies, mesh.cell_links);
  if (copies.position.empty()) {
    throw InputError("min_island_cells: " + std::to_string(options.min_island_cells) +
                     " leaves no cell; the largest piece is smaller, give less");
  }
  if (copies.position.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()) / 8) {
    throw InputError("mesh size: " + millimetres(options.size_m) + " gives " +
                     std::to_string(copies.position.size()) +
                     " cells, more than 268435455; give a larger size");
  }
  NodeCopies nodes = make_nodes(mesh.grid_size, copies, mesh.cell_links, options.superimpose);

  mesh.cell_nodes = std::move(nodes.cell_nodes);
  mesh.rest_positions = large_vector<Vec3>(nodes.position.size(), Vec3::Zero());
  const auto node_count = static_cast<std::ptrdiff_t>(nodes.position.size());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t n = 0; n < node_count; ++n) {
    Vec3 voxel;
    for (int a = 0; a < 3; ++a) voxel[a] = nodes.position[n][a] * mesh.voxels_per_cell[a] - 0.5;
    mesh.rest_positions[n] = map.to_world(voxel);
  }
  mesh.cell_position = std::move(copies.position);
  mesh.cell_voxels = std::move(copies.voxels);
  mesh.cell_label = std::move(copies.label);
  mesh.cell_of_voxel = std::move(copies.copy_of_voxel);
  make_tets(map, options.split, mesh);
  return mesh;
}

std::int32_t locate_tet_in_cell(const EmbeddingMesh& mesh, std::int32_t cell, const Vec3& point_voxel,
                                std::array<double, 4>& weights, std::span<const std::uint8_t> alive) {
  const Index3& position = mesh.cell_position[cell];
  Vec3 local;  // in the cell's unit cube
  for (int a = 0; a < 3; ++a) local[a] = (point_voxel[a] + 0.5) / mesh.voxels_per_cell[a] - position[a];
  const auto first = static_cast<std::ptrdiff_t>(cell) * mesh.tets_per_cell;
  const auto whole = alive.empty() ? alive : alive.subspan(first, mesh.tets_per_cell);
  const bool any = std::count(whole.begin(), whole.end(), std::uint8_t{1}) > 0;
  std::int32_t best = 0, number = 0;
  double best_smallest = -std::numeric_limits<double>::infinity();
  for (const TetMap& map : cell_tet_maps(mesh.split, mesh.mirrored, position)) {
    const std::array<double, 4> w = tet_weights(map, local);
    const double smallest = std::min({w[0], w[1], w[2], w[3]});
    if ((!any || whole[number]) && smallest > best_smallest) {
      best_smallest = smallest;
      best = number;
      weights = w;
      if (smallest > 0) break;  // within it, so outside all others
    }
    ++number;
  }
  return cell * mesh.tets_per_cell + best;
}

}  // namespace sulcus
