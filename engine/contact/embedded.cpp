#include "engine/contact/embedded.h"

#include <omp.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

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
  for (std::size_t k = 0; k < 4; ++k) candidate.weight[k][0] = k == 0 ? 1 : 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const Vec3 slope = areas[c] / det;
    const double weight[4] = {-slope.dot(origin), slope[0], slope[1], slope[2]};
    for (std::size_t k = 0; k < 4; ++k) {
      candidate.weight[k][c + 1] = weight[k];
      candidate.weight[k][0] -= weight[k];
    }
  }
  return true;
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

Grid make_grid(const Box& box, double cell_edge) {
  Grid grid;
  grid.box = box;
  for (int a = 0; a < 3; ++a) {
    const double width = box.high[a] - box.low[a], cells = width / (0.5 * cell_edge);
    grid.size[static_cast<std::size_t>(a)] = std::clamp(static_cast<int>(cells) + 1, 1, Grid::most);
    if (width > 0) grid.per_m[a] = grid.size[static_cast<std::size_t>(a)] / width;
  }
  return grid;
}

// Some of the tool's vertices in the world, and their box.
void place_vertices(std::span<const Vec3> vertices, const Mat3& rotation, const Vec3& position, Range own,
                    std::vector<Vec3>& placed, ContactSearch::Part& part) {
  Vec3 sum = Vec3::Zero();
  part.low = Vec3::Constant(std::numeric_limits<double>::infinity());
  part.high = -part.low;
  for (std::int64_t v = own.first; v < own.last; ++v) {
    const auto vertex = static_cast<std::size_t>(v);
    placed[vertex] = position + rotation * vertices[vertex];
    sum += placed[vertex];
    part.low = part.low.cwiseMin(placed[vertex]);
    part.high = part.high.cwiseMax(placed[vertex]);
  }
  part.finite = sum.allFinite();
}

// Tetrahedra of some cells whose deformed box meets the tool's: those without a side of the tool's box that
// all nodes are beyond, of cells likewise.
void list_near(const EmbeddingMesh& mesh, std::span<const std::uint8_t> alive, Range cells,
               const std::vector<std::uint8_t>& sides, std::vector<std::int32_t>& near) {
  const auto meets = [&](const std::int32_t* corners, int count) {
    unsigned all = 63;
    for (int c = 0; c < count; ++c) all &= sides[static_cast<std::size_t>(corners[c])];
    return all == 0;
  };
  near.clear();
  for (std::int64_t cell = cells.first; cell < cells.last; ++cell) {
    if (!meets(mesh.cell_nodes[static_cast<std::size_t>(cell)].data(), 8)) continue;
    for (std::int64_t t = cell * mesh.tets_per_cell; t < (cell + 1) * mesh.tets_per_cell; ++t) {
      const auto tet = static_cast<std::size_t>(t);
      if ((alive.empty() || alive[tet]) && meets(mesh.tets[tet].data(), 4))
        near.push_back(static_cast<std::int32_t>(t));
    }
  }
}

// Makes candidates of what the parts list near the tool, in their order, and lists those of each grid cell.
void fill_grid(const EmbeddingMesh& mesh, std::span<const double> positions, const Grid& grid,
               const std::vector<ContactSearch::Part>& parts, ContactSearch::Part& own) {
  own.candidates.clear();
  for (const auto& part : parts) {
    for (const std::int32_t tet : part.near) {
      CandidateTet candidate;
      if (!invert(mesh, positions, tet, candidate)) continue;
      const auto& nodes = mesh.tets[static_cast<std::size_t>(tet)];
      Vec3 low = node_vector(positions, nodes[0]), high = low;
      for (std::size_t c = 1; c < 4; ++c) {
        const Vec3 x = node_vector(positions, nodes[c]);
        low = low.cwiseMin(x);
        high = high.cwiseMax(x);
      }
      for (int a = 0; a < 3; ++a) {
        candidate.low[static_cast<std::size_t>(a)] = static_cast<std::int8_t>(grid.along(a, low[a]));
        candidate.high[static_cast<std::size_t>(a)] = static_cast<std::int8_t>(grid.along(a, high[a]));
      }
      own.candidates.push_back(candidate);
    }
  }
  const auto count = static_cast<std::size_t>(grid.size[0] * grid.size[1] * grid.size[2]);
  own.cell_start.assign(count + 1, 0);
  const auto for_cells_of = [&](const CandidateTet& c, auto&& use) {
    for (int k = c.low[2]; k <= c.high[2]; ++k) {
      for (int j = c.low[1]; j <= c.high[1]; ++j) {
        for (int i = c.low[0]; i <= c.high[0]; ++i) use(grid.index(i, j, k));
      }
    }
  };
  for (const CandidateTet& candidate : own.candidates)
    for_cells_of(candidate, [&](std::size_t cell) { ++own.cell_start[cell + 1]; });
  for (std::size_t c = 0; c < count; ++c) own.cell_start[c + 1] += own.cell_start[c];
  own.cell_items.resize(static_cast<std::size_t>(own.cell_start[count]));
  // fill from the front; starts shift by one and are restored below
  for (std::size_t n = 0; n < own.candidates.size(); ++n) {
    for_cells_of(own.candidates[n], [&](std::size_t cell) {
      own.cell_items[static_cast<std::size_t>(own.cell_start[cell]++)] = static_cast<std::int32_t>(n);
    });
  }
  for (std::size_t c = count; c > 0; --c) own.cell_start[c] = own.cell_start[c - 1];
  own.cell_start[0] = 0;
}

// Barycentric coordinates of x in a candidate; false outside. All four without a branch: most candidates do
// not hold x.
bool barycentric(const CandidateTet& candidate, const Vec3& x, std::array<double, 4>& weights) {
  using Pair = double __attribute__((vector_size(16)));
  constexpr double edge = -1e-9;  // a point on a common face belongs to both
  Pair sums[2];
  for (std::size_t half = 0; half < 2; ++half) {
    Pair w[4];
    for (std::size_t k = 0; k < 4; ++k) std::memcpy(&w[k], &candidate.weight[k][2 * half], sizeof w[k]);
    sums[half] = w[0] + w[1] * x[0] + w[2] * x[1] + w[3] * x[2];
  }
  const Pair smaller = sums[0] < sums[1] ? sums[0] : sums[1];
  std::memcpy(weights.data(), sums, sizeof sums);
  return (smaller[0] < smaller[1] ? smaller[0] : smaller[1]) >= edge;
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
  double square[3][3];  // of the distance along each axis to the voxels low .. high
  for (std::size_t a = 0; a < 3; ++a) {
    const double place = point_voxel[static_cast<Eigen::Index>(a)];
    const int centre = nearest_whole(place);
    if (centre < owned.low[a] - 1 || centre > owned.high[a] + 1) return -1;
    low[a] = std::max(centre - 1, owned.low[a]);
    high[a] = std::min(centre + 1, owned.high[a]);
    for (int v = low[a]; v <= high[a]; ++v) square[a][v - low[a]] = (v - place) * (v - place);
  }
  double best = std::numeric_limits<double>::infinity();
  for (int k = low[2]; k <= high[2]; ++k) {
    for (int j = low[1]; j <= high[1]; ++j) {
      const std::size_t row = map.index(0, j, k);
      const double across = square[1][j - low[1]] + square[2][k - low[2]];
      for (int i = low[0]; i <= high[0]; ++i) {
        const double distance = square[0][i - low[0]] + across;
        if (distance >= best || mesh.cell_of_voxel[row + static_cast<std::size_t>(i)] != cell) continue;
        best = distance;
        nearest = {{i, j, k}, row + static_cast<std::size_t>(i)};
      }
    }
  }
  return best < std::numeric_limits<double>::infinity() ? best : -1;
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
  DistanceSample sample = sample_distance(map, pairs, distance, point_voxel, home.at);
  if (!(sample.distance < 0) || sample.gradient.squaredNorm() > least_slope * least_slope) return sample;
  const Vec3 centre(home.at[0], home.at[1], home.at[2]);
  const DistanceSample mirrored = sample_distance(map, pairs, distance, 2 * centre - point_voxel, home.at);
  sample.gradient = mirrored.gradient;
  sample.distance = 2 * sample_distance(map, pairs, distance, centre, home.at).distance - mirrored.distance;
  return sample;
}

// The contact of a tool's vertex at p, without what concerns the tool; false if it does not touch.
bool touch(const EmbeddedTissue& tissue, std::span<const double> positions,
           std::span<const std::uint8_t> alive, const Grid& grid, const ContactSearch::Part& near,
           const Vec3& p, Contact& contact) {
  const LabelMap& map = tissue.map;
  const SeparationPairs& pairs = tissue.pairs;
  const EmbeddingMesh& mesh = tissue.mesh;
  const double surface_inset =
      0.25 * map.spacing.minCoeff();  // m, how far inside the surface its voxel is looked up

  // of the tetrahedra that hold p, the one whose copy owns the nearest voxel
  double nearest = -1;
  std::int32_t tet = -1;
  Voxel home;
  Vec3 point_voxel;
  const std::size_t cell = grid.index(grid.along(0, p[0]), grid.along(1, p[1]), grid.along(2, p[2]));
  for (std::int32_t item = near.cell_start[cell]; item < near.cell_start[cell + 1]; ++item) {
    const CandidateTet& tested =
        near.candidates[static_cast<std::size_t>(near.cell_items[static_cast<std::size_t>(item)])];
    std::array<double, 4> weights;
    if (!barycentric(tested, p, weights)) continue;
    const auto& nodes = mesh.tets[static_cast<std::size_t>(tested.tet)];
    Vec3 rest = Vec3::Zero();
    for (std::size_t c = 0; c < 4; ++c)
      rest += weights[c] * mesh.rest_positions[static_cast<std::size_t>(nodes[c])];
    const Vec3 at = map.to_voxel(rest);
    Voxel voxel;
    const double away = nearest_owned_voxel(tissue, tested.tet / mesh.tets_per_cell, at, voxel);
    if (away >= 0 && (nearest < 0 || away < nearest)) {
      nearest = away;
      tet = tested.tet;
      home = voxel;
      point_voxel = at;
    }
  }
  if (tet < 0) return false;

  const DistanceSample sample = sample_within(map, pairs, tissue.distance, point_voxel, home);
  const double slope = std::sqrt(sample.gradient.squaredNorm());
  if (!(sample.distance < 0) || !(slope > least_slope)) return false;
  const Vec3 rest_normal = sample.gradient / slope;
  const Vec3 surface = map.to_world(point_voxel) - sample.distance * rest_normal;

  // the tetrahedron under the surface point: of the copy that owns the voxel just inside, if that is ours
  std::int32_t copy = tet / mesh.tets_per_cell;
  Voxel inside;
  if (voxel_at(map, map.to_voxel(surface - surface_inset * rest_normal), inside) &&
      mesh.cell_of_voxel[inside.index] >= 0 && connected_straight(map, pairs, home, inside)) {
    copy = mesh.cell_of_voxel[inside.index];
  }
  contact.tet = locate_tet_in_cell(mesh, copy, map.to_voxel(surface), contact.weights);
  if (!alive.empty() && !alive[static_cast<std::size_t>(contact.tet)]) return false;
  if (!world_normal(mesh, positions, contact.tet, rest_normal, contact.normal)) return false;
  Vec3 surface_world = Vec3::Zero();
  for (std::size_t c = 0; c < 4; ++c) {
    surface_world +=
        contact.weights[c] * node_vector(positions, mesh.tets[static_cast<std::size_t>(contact.tet)][c]);
  }
  contact.gap = p - surface_world;
  if (!(contact.gap.dot(contact.normal) < 0)) return false;  // folded tissue: already outside
  contact.depth_m = -sample.distance;
  return true;
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
                            std::span<const Vec3> vertices, const Mat3& rotation, const Vec3& position,
                            ContactSearch& search, std::vector<Contact>& contacts) {
  const EmbeddingMesh& mesh = tissue.mesh;
  if (vertices.empty()) return;
  const auto count = static_cast<std::int64_t>(vertices.size());
  const auto nodes = static_cast<std::int64_t>(mesh.rest_positions.size());
  const auto cells = static_cast<std::int64_t>(mesh.cell_nodes.size());
  search.vertices.resize(vertices.size());
  search.found.resize(vertices.size());
  search.touches.assign(vertices.size(), 0);
  search.sides.resize(mesh.rest_positions.size());
  search.parts.resize(static_cast<std::size_t>(search.threads));
  SpinBarrier barrier(search.threads);
#pragma omp parallel num_threads(search.threads)
  {
    const int thread = omp_get_thread_num();
    ContactSearch::Part& part = search.parts[static_cast<std::size_t>(thread)];
    place_vertices(vertices, rotation, position, share(count, thread, search.threads), search.vertices, part);
    barrier.wait();
    Box box{part.low, part.high};
    bool finite = true;
    for (const auto& other : search.parts) {
      box.low = box.low.cwiseMin(other.low);
      box.high = box.high.cwiseMax(other.high);
      finite = finite && other.finite;
    }
    if (finite) {  // else the step reports it
      const Grid grid = make_grid(box, mesh.voxels_per_cell[0] * tissue.map.spacing[0]);
      const Range own_nodes = share(nodes, thread, search.threads);
      for (std::int64_t node = own_nodes.first; node < own_nodes.last; ++node)
        search.sides[static_cast<std::size_t>(node)] =
            sides_of(&positions[static_cast<std::size_t>(3 * node)], box);
      barrier.wait();
      list_near(mesh, alive, share(cells, thread, search.threads), search.sides, part.near);
      barrier.wait();
      fill_grid(mesh, positions, grid, search.parts, part);
      // dealt out in turns: vertices in the tissue, which cost most, stand together
      const std::int64_t turn = 8, turns = part.candidates.empty() ? 0 : (count + turn - 1) / turn;
      for (std::int64_t n = thread; n < turns; n += search.threads) {
        for (std::int64_t v = turn * n; v < std::min(turn * (n + 1), count); ++v) {
          const auto vertex = static_cast<std::size_t>(v);
          const Vec3& p = search.vertices[vertex];
          Contact& contact = search.found[vertex];
          if (!touch(tissue, positions, alive, grid, part, p, contact)) continue;
          contact.slip = Vec3::Zero();
          contact.tool = tool;
          contact.vertex = static_cast<std::int32_t>(v);
          contact.arm = p - position;
          search.touches[vertex] = 1;
        }
      }
    }
  }
  for (std::size_t vertex = 0; vertex < vertices.size(); ++vertex) {
    if (search.touches[vertex]) contacts.push_back(search.found[vertex]);
  }
}

}  // namespace sulcus
