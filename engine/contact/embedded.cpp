#include "engine/contact/embedded.h"

#include <omp.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/numerics/team.h"

namespace sulcus {
namespace {

struct Box {
  Vec3 low, high;
};

// On which sides of the box a point lies: one bit a side.
std::uint8_t sides_of(const double* point, const Box& box) {
  unsigned sides = 0;
  for (unsigned a = 0; a < 3; ++a) {
    sides |= static_cast<unsigned>(point[a] < box.low[a]) << a | static_cast<unsigned>(point[a] > box.high[a])
                                                                     << (a + 3);
  }
  return static_cast<std::uint8_t>(sides);
}

// The map from world coordinates to barycentric ones; false for a flat tetrahedron, which holds no point.
bool invert(const EmbeddingMesh& mesh, std::span<const double> positions, std::int32_t tet,
            CandidateTet& candidate) {
  const auto& nodes = mesh.tets[static_cast<std::size_t>(tet)];
  candidate.tet = tet;
  const Vec3 origin = node_vector(positions, nodes[0]);
  Vec3 edges[3];
  for (std::size_t c = 0; c < 3; ++c) edges[c] = node_vector(positions, nodes[c + 1]) - origin;
  const Vec3 areas[3] = {edges[1].cross(edges[2]), edges[2].cross(edges[0]), edges[0].cross(edges[1])};
  const double det = edges[0].dot(areas[0]);
  if (!(std::fabs(det) > 1e-24)) return false;
  candidate.weight[0] = {1, 0, 0, 0};
  for (std::size_t c = 0; c < 3; ++c) {
    const Vec3 slope = areas[c] / det;
    candidate.weight[c + 1] = {-slope.dot(origin), slope[0], slope[1], slope[2]};
    for (std::size_t k = 0; k < 4; ++k) candidate.weight[0][k] -= candidate.weight[c + 1][k];
  }
  return true;
}

// Tetrahedra whose deformed box meets the tool's: those without a side of the tool's box that all nodes are
// beyond, of cells likewise.
void collect_candidates(const EmbeddingMesh& mesh, std::span<const double> positions,
                        std::span<const std::uint8_t> alive, const Box& box, ContactSearch& search) {
  const auto nodes = static_cast<std::int64_t>(mesh.rest_positions.size());
  const auto cells = static_cast<std::int64_t>(mesh.cell_nodes.size());
  search.sides.resize(mesh.rest_positions.size());
  search.parts.resize(static_cast<std::size_t>(search.threads));
  const auto meets = [&](const std::int32_t* corners, int count) {
    unsigned all = 63;
    for (int c = 0; c < count; ++c) all &= search.sides[static_cast<std::size_t>(corners[c])];
    return all == 0;
  };
  const auto look_at_cell = [&](std::int64_t cell, std::vector<CandidateTet>& found) {
    if (!meets(mesh.cell_nodes[static_cast<std::size_t>(cell)].data(), 8)) return;
    for (std::int64_t t = cell * mesh.tets_per_cell; t < (cell + 1) * mesh.tets_per_cell; ++t) {
      const auto tet = static_cast<std::size_t>(t);
      if ((!alive.empty() && !alive[tet]) || !meets(mesh.tets[tet].data(), 4)) continue;
      CandidateTet candidate;
      if (invert(mesh, positions, static_cast<std::int32_t>(t), candidate)) found.push_back(candidate);
    }
  };
#pragma omp parallel num_threads(search.threads)
  {
    const int thread = omp_get_thread_num();
    const Range own_nodes = share(nodes, thread, search.threads);
    for (std::int64_t node = own_nodes.first; node < own_nodes.last; ++node)
      search.sides[static_cast<std::size_t>(node)] =
          sides_of(&positions[static_cast<std::size_t>(3 * node)], box);
    auto& found = search.parts[static_cast<std::size_t>(thread)];
    found.clear();
    const Range own_cells = share(cells, thread, search.threads);
#pragma omp barrier
    for (std::int64_t cell = own_cells.first; cell < own_cells.last; ++cell) look_at_cell(cell, found);
  }
  search.candidates.clear();
  for (const auto& part : search.parts)
    search.candidates.insert(search.candidates.end(), part.begin(), part.end());
}

// A uniform grid over the tool's box; each grid cell lists the candidates whose boxes meet it.
struct Grid {
  static constexpr int most = 16;  // grid cells along an axis
  Box box;
  Index3 size{1, 1, 1};
  Vec3 per_m = Vec3::Zero();  // grid cells a metre

  int along(int axis, double x) const {
    const double last = size[static_cast<std::size_t>(axis)] - 1;
    return static_cast<int>(std::clamp((x - box.low[axis]) * per_m[axis], 0.0, last));
  }
  std::size_t index(int i, int j, int k) const {
    return static_cast<std::size_t>((k * size[1] + j) * size[0] + i);
  }
};

Grid fill_grid(const EmbeddingMesh& mesh, std::span<const double> positions, const Box& box, double cell_edge,
               ContactSearch& search) {
  Grid grid;
  grid.box = box;
  for (int a = 0; a < 3; ++a) {
    const double width = box.high[a] - box.low[a], cells = width / (0.5 * cell_edge);
    grid.size[static_cast<std::size_t>(a)] = std::clamp(static_cast<int>(cells) + 1, 1, Grid::most);
    if (width > 0) grid.per_m[a] = grid.size[static_cast<std::size_t>(a)] / width;
  }
  const auto count = static_cast<std::size_t>(grid.size[0] * grid.size[1] * grid.size[2]);
  search.cell_start.assign(count + 1, 0);
  const auto for_cells_of = [&](std::int32_t tet, auto&& use) {
    const auto& nodes = mesh.tets[static_cast<std::size_t>(tet)];
    Vec3 low = node_vector(positions, nodes[0]), high = low;
    for (int c = 1; c < 4; ++c) {
      const Vec3 x = node_vector(positions, nodes[static_cast<std::size_t>(c)]);
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
    for (int k = grid.along(2, low[2]); k <= grid.along(2, high[2]); ++k) {
      for (int j = grid.along(1, low[1]); j <= grid.along(1, high[1]); ++j) {
        for (int i = grid.along(0, low[0]); i <= grid.along(0, high[0]); ++i) use(grid.index(i, j, k));
      }
    }
  };
  for (const CandidateTet& candidate : search.candidates) {
    for_cells_of(candidate.tet, [&](std::size_t cell) { ++search.cell_start[cell + 1]; });
  }
  for (std::size_t c = 0; c < count; ++c) search.cell_start[c + 1] += search.cell_start[c];
  search.cell_items.resize(static_cast<std::size_t>(search.cell_start[count]));
  // fill from the front; starts shift by one and are restored below
  for (std::size_t n = 0; n < search.candidates.size(); ++n) {
    for_cells_of(search.candidates[n].tet, [&](std::size_t cell) {
      search.cell_items[static_cast<std::size_t>(search.cell_start[cell]++)] = static_cast<std::int32_t>(n);
    });
  }
  for (std::size_t c = count; c > 0; --c) search.cell_start[c] = search.cell_start[c - 1];
  search.cell_start[0] = 0;
  return grid;
}

// Barycentric coordinates of x in a candidate; false outside.
bool barycentric(const CandidateTet& candidate, const Vec3& x, std::array<double, 4>& weights) {
  constexpr double edge = -1e-9;  // a point on a common face belongs to both
  for (std::size_t c = 0; c < 4; ++c) {
    const auto& slope = candidate.weight[c];
    weights[c] = slope[0] + slope[1] * x[0] + slope[2] * x[1] + slope[3] * x[2];
    if (!(weights[c] >= edge)) return false;
  }
  return true;
}

struct Voxel {
  Index3 at{0, 0, 0};
  std::size_t index = 0;
};

// Number of the voxel that holds a place along an axis; -2 for all that lies further before the first.
int nearest_whole(double place) {
  return static_cast<int>(std::clamp(place, -2.0, 1e9) + 2.5) - 2;
}

bool voxel_at(const LabelMap& map, const Vec3& point_voxel, Voxel& voxel) {
  for (std::size_t a = 0; a < 3; ++a) {
    voxel.at[a] = nearest_whole(point_voxel[static_cast<Eigen::Index>(a)]);
    if (voxel.at[a] < 0 || voxel.at[a] >= map.size[a]) return false;
  }
  voxel.index = map.index(voxel.at[0], voxel.at[1], voxel.at[2]);
  return true;
}

// The voxel owned by `cell` nearest to the point, among the 27 around it. Returns the squared distance in
// voxels, or a negative number if there is none.
double nearest_owned_voxel(const EmbeddedTissue& tissue, std::int32_t cell, const Vec3& point_voxel,
                           Voxel& nearest) {
  const LabelMap& map = tissue.map;
  const EmbeddingMesh& mesh = tissue.mesh;
  if (voxel_at(map, point_voxel, nearest) && mesh.cell_of_voxel[nearest.index] == cell) {
    return (Vec3(nearest.at[0], nearest.at[1], nearest.at[2]) - point_voxel).squaredNorm();
  }
  const VoxelBox& owned = tissue.owned[static_cast<std::size_t>(cell)];
  Index3 low, high;
  for (std::size_t a = 0; a < 3; ++a) {
    const int centre = nearest_whole(point_voxel[static_cast<Eigen::Index>(a)]);
    if (centre < owned.low[a] - 1 || centre > owned.high[a] + 1) return -1;
    low[a] = std::max(centre - 1, owned.low[a]);
    high[a] = std::min(centre + 1, owned.high[a]);
  }
  double best = -1;
  for (int k = low[2]; k <= high[2]; ++k) {
    for (int j = low[1]; j <= high[1]; ++j) {
      for (int i = low[0]; i <= high[0]; ++i) {
        const std::size_t index = map.index(i, j, k);
        if (mesh.cell_of_voxel[index] != cell) continue;
        const double distance = (Vec3(i, j, k) - point_voxel).squaredNorm();
        if (best < 0 || distance < best) {
          best = distance;
          nearest = {{i, j, k}, index};
        }
      }
    }
  }
  return best;
}

// Whether one can walk from voxel `from` to voxel `to` through connected faces, always towards the goal.
bool connected_straight(const LabelMap& map, const SeparationPairs& pairs, Voxel from, const Voxel& to) {
  while (from.index != to.index) {
    std::array<int, 3> axes{0, 1, 2};
    const auto left = [&](int a) {
      return std::abs(to.at[static_cast<std::size_t>(a)] - from.at[static_cast<std::size_t>(a)]);
    };
    // longest way first, lower axis at ties
    if (left(axes[1]) > left(axes[0])) std::swap(axes[0], axes[1]);
    if (left(axes[2]) > left(axes[1])) std::swap(axes[1], axes[2]);
    if (left(axes[1]) > left(axes[0])) std::swap(axes[0], axes[1]);
    bool moved = false;
    for (int a : axes) {
      if (left(a) == 0) break;
      Voxel next = from;
      next.at[static_cast<std::size_t>(a)] +=
          to.at[static_cast<std::size_t>(a)] > from.at[static_cast<std::size_t>(a)] ? 1 : -1;
      next.index = map.index(next.at[0], next.at[1], next.at[2]);
      if (!pairs.connected(map.labels[from.index], map.labels[next.index])) continue;
      from = next;
      moved = true;
      break;
    }
    if (!moved) return false;
  }
  return true;
}

// World normal n = cof(F) grad / |.|, by cof(F) = cof(now) rest^T / det(rest) for the edges as they are and
// at rest; false where the element is flat.
bool world_normal(const EmbeddingMesh& mesh, std::span<const double> positions, std::int32_t tet,
                  const Vec3& rest_normal, Vec3& normal) {
  const auto& nodes = mesh.tets[static_cast<std::size_t>(tet)];
  Vec3 rest[3], now[3];
  for (std::size_t a = 0; a < 3; ++a) {
    const std::int32_t node = nodes[a + 1];
    rest[a] = mesh.rest_positions[static_cast<std::size_t>(node)] -
              mesh.rest_positions[static_cast<std::size_t>(nodes[0])];
    now[a] = node_vector(positions, node) - node_vector(positions, nodes[0]);
  }
  const double volume = rest[0].dot(rest[1].cross(rest[2]));  // six times, m^3, > 0
  normal = rest[0].dot(rest_normal) * now[1].cross(now[2]) + rest[1].dot(rest_normal) * now[2].cross(now[0]) +
           rest[2].dot(rest_normal) * now[0].cross(now[1]);
  const double length = std::sqrt(normal.squaredNorm());
  if (!(length > 1e-9 * volume)) return false;
  normal /= length;
  return true;
}

constexpr double least_slope = 1e-6;  // of the distance, whose slope is about 1

// Distance and way out. Between two voxels that are equally deep the interpolated distance is flat; there it
// goes on as it does on the other side of the point's own voxel, up to the middle between the two.
DistanceSample sample_within(const LabelMap& map, const SeparationPairs& pairs, const DistanceField& distance,
                             const Vec3& point_voxel, const Voxel& home) {
  DistanceSample sample = sample_distance(map, pairs, distance, point_voxel, home.index);
  if (!(sample.distance < 0) || sample.gradient.squaredNorm() > least_slope * least_slope) return sample;
  const Vec3 centre(home.at[0], home.at[1], home.at[2]);
  const DistanceSample mirrored = sample_distance(map, pairs, distance, 2 * centre - point_voxel, home.index);
  sample.gradient = mirrored.gradient;
  sample.distance =
      2 * sample_distance(map, pairs, distance, centre, home.index).distance - mirrored.distance;
  return sample;
}

}  // namespace

std::vector<VoxelBox> find_owned_voxels(const LabelMap& map, const EmbeddingMesh& mesh) {
  std::vector<VoxelBox> owned(mesh.cell_position.size());
  for (std::size_t cell = 0; cell < owned.size(); ++cell) {
    VoxelBox& box = owned[cell];
    Index3 low, high;
    for (std::size_t a = 0; a < 3; ++a) {
      low[a] = mesh.cell_position[cell][a] * mesh.voxels_per_cell[a];
      high[a] = std::min(low[a] + mesh.voxels_per_cell[a], map.size[a]) - 1;
    }
    bool any = false;
    for (int k = low[2]; k <= high[2]; ++k) {
      for (int j = low[1]; j <= high[1]; ++j) {
        for (int i = low[0]; i <= high[0]; ++i) {
          if (mesh.cell_of_voxel[map.index(i, j, k)] != static_cast<std::int32_t>(cell)) continue;
          const Index3 at{i, j, k};
          for (std::size_t a = 0; a < 3; ++a) {
            box.low[a] = any ? std::min(box.low[a], at[a]) : at[a];
            box.high[a] = any ? std::max(box.high[a], at[a]) : at[a];
          }
          any = true;
        }
      }
    }
  }
  return owned;
}

void find_embedded_contacts(const EmbeddedTissue& tissue, std::span<const double> positions,
                            std::span<const std::uint8_t> alive, std::int32_t tool,
                            std::span<const Vec3> vertices_world, const Vec3& centre, ContactSearch& search,
                            std::vector<Contact>& contacts) {
  const LabelMap& map = tissue.map;
  const SeparationPairs& pairs = tissue.pairs;
  const EmbeddingMesh& mesh = tissue.mesh;
  if (vertices_world.empty()) return;
  Box box{vertices_world[0], vertices_world[0]};
  Vec3 sum = Vec3::Zero();
  for (const Vec3& v : vertices_world) {
    sum += v;
    box.low = box.low.cwiseMin(v);
    box.high = box.high.cwiseMax(v);
  }
  if (!sum.allFinite()) return;  // the step reports it as not finite
  collect_candidates(mesh, positions, alive, box, search);
  if (search.candidates.empty()) return;
  const double cell_edge = mesh.voxels_per_cell[0] * map.spacing[0];
  const Grid grid = fill_grid(mesh, positions, box, cell_edge, search);
  const double surface_inset =
      0.25 * map.spacing.minCoeff();  // m, how far inside the surface its voxel is looked up

  const auto count = static_cast<std::int64_t>(vertices_world.size());
  search.found.resize(vertices_world.size());
  search.touches.assign(vertices_world.size(), 0);
  // dealt out in turns: vertices in the tissue, which cost most, stand together
#pragma omp parallel for num_threads(search.threads) schedule(static, 8)
  for (std::int64_t vertex = 0; vertex < count; ++vertex) {
    const Vec3& p = vertices_world[static_cast<std::size_t>(vertex)];

    // of the tetrahedra that hold p, the one whose copy owns the nearest voxel
    double nearest = -1;
    std::int32_t tet = -1;
    Voxel home;
    Vec3 point_voxel;
    const std::size_t cell = grid.index(grid.along(0, p[0]), grid.along(1, p[1]), grid.along(2, p[2]));
    for (std::int32_t item = search.cell_start[cell]; item < search.cell_start[cell + 1]; ++item) {
      const CandidateTet& tested =
          search.candidates[static_cast<std::size_t>(search.cell_items[static_cast<std::size_t>(item)])];
      std::array<double, 4> weights;
      if (!barycentric(tested, p, weights)) continue;
      const std::int32_t candidate = tested.tet;
      Vec3 rest = Vec3::Zero();
      for (std::size_t c = 0; c < 4; ++c) {
        rest +=
            weights[c] *
            mesh.rest_positions[static_cast<std::size_t>(mesh.tets[static_cast<std::size_t>(candidate)][c])];
      }
      const Vec3 at = map.to_voxel(rest);
      Voxel voxel;
      const double away = nearest_owned_voxel(tissue, candidate / mesh.tets_per_cell, at, voxel);
      if (away >= 0 && (nearest < 0 || away < nearest)) {
        nearest = away;
        tet = candidate;
        home = voxel;
        point_voxel = at;
      }
    }
    if (tet < 0) continue;

    const DistanceSample sample = sample_within(map, pairs, tissue.distance, point_voxel, home);
    const double slope = std::sqrt(sample.gradient.squaredNorm());
    if (!(sample.distance < 0) || !(slope > least_slope)) continue;
    const Vec3 rest_normal = sample.gradient / slope;
    const Vec3 surface = map.to_world(point_voxel) - sample.distance * rest_normal;

    // the tetrahedron under the surface point: of the copy that owns the voxel just inside, if that is ours
    std::int32_t copy = tet / mesh.tets_per_cell;
    Voxel inside;
    if (voxel_at(map, map.to_voxel(surface - surface_inset * rest_normal), inside) &&
        mesh.cell_of_voxel[inside.index] >= 0 && connected_straight(map, pairs, home, inside)) {
      copy = mesh.cell_of_voxel[inside.index];
    }
    Contact& contact = search.found[static_cast<std::size_t>(vertex)];
    contact.tet = locate_tet_in_cell(mesh, copy, map.to_voxel(surface), contact.weights);
    if (!alive.empty() && !alive[static_cast<std::size_t>(contact.tet)]) continue;
    if (!world_normal(mesh, positions, contact.tet, rest_normal, contact.normal)) continue;
    Vec3 surface_world = Vec3::Zero();
    for (std::size_t c = 0; c < 4; ++c) {
      surface_world +=
          contact.weights[c] * node_vector(positions, mesh.tets[static_cast<std::size_t>(contact.tet)][c]);
    }
    contact.gap = p - surface_world;
    if (!(contact.gap.dot(contact.normal) < 0)) continue;  // folded tissue: already outside
    contact.slip = Vec3::Zero();
    contact.tool = tool;
    contact.vertex = static_cast<std::int32_t>(vertex);
    contact.arm = p - centre;
    contact.depth_m = -sample.distance;
    search.touches[static_cast<std::size_t>(vertex)] = 1;
  }
  for (std::size_t vertex = 0; vertex < vertices_world.size(); ++vertex) {
    if (search.touches[vertex]) contacts.push_back(search.found[vertex]);
  }
}

}  // namespace sulcus
