#include "engine/solver/multigrid.h"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/LU>

#include "engine/numerics/team.h"

namespace sulcus {
namespace {

constexpr std::int64_t enough_nodes = 40;  // a level that small needs no coarser one
constexpr std::int64_t shared_nodes = 64;  // in a smaller level a thread waits longer than it saves

std::size_t at(std::int64_t number) {
  return static_cast<std::size_t>(number);
}

// Lists of the places where each number below `count` stands in the lists start, items.
void transpose(const std::vector<std::int32_t>& start, const std::vector<std::int32_t>& items,
               std::int64_t count, std::vector<std::int32_t>& to_start, std::vector<std::int32_t>& to_items) {
  to_start.assign(at(count) + 1, 0);
  for (std::int32_t item : items) ++to_start[at(item) + 1];
  for (std::size_t n = 0; n < at(count); ++n) to_start[n + 1] += to_start[n];
  to_items.resize(items.size());
  std::vector<std::int32_t> next(to_start.begin(), to_start.end() - 1);
  for (std::size_t row = 0; row + 1 < start.size(); ++row) {
    for (std::int32_t k = start[row]; k < start[row + 1]; ++k) {
      to_items[at(next[at(items[at(k)])]++)] = static_cast<std::int32_t>(row);
    }
  }
}

// Without the levels whose cells are larger than a disturbance travels: what they would correct hardly moves.
void leave_out_useless(double reached, std::vector<CoarseLevel>& levels) {
  double edge = 4;
  std::size_t count = 1;
  for (; count < levels.size() && edge <= reached; ++count) edge *= 2;
  levels.resize(count);
}

void number_levels(const EmbeddingMesh& mesh, const std::vector<CoarseLevel>& levels, Multigrid& m) {
  m.levels = static_cast<std::int64_t>(levels.size());
  m.first_node.assign(1, 0);
  m.first_cell.assign(1, 0);
  for (const CoarseLevel& level : levels) {
    m.first_node.push_back(m.first_node.back() + level.node_count);
    m.first_cell.push_back(m.first_cell.back() + static_cast<std::int64_t>(level.cell_nodes.size()));
  }
  m.shared_levels = 1;
  while (m.shared_levels < m.levels && levels[at(m.shared_levels)].node_count >= shared_nodes)
    ++m.shared_levels;
  const auto mesh_cells = static_cast<std::int32_t>(mesh.cell_nodes.size());
  for (std::size_t l = 0; l < levels.size(); ++l) {
    const auto node = static_cast<std::int32_t>(m.first_node[l]);
    for (std::int32_t p : levels[l].parent)
      m.parent.push_back(p + static_cast<std::int32_t>(m.first_cell[l]));
    for (auto nodes : levels[l].cell_nodes) {
      for (std::int32_t& n : nodes) n += node;
      m.cell_nodes.push_back(nodes);
    }
    m.cell_position.insert(m.cell_position.end(), levels[l].cell_position.begin(),
                           levels[l].cell_position.end());
  }
  m.parent.resize(at(mesh_cells + m.first_cell.back()), -1);
}

// start, nodes: the coarse nodes of each slot.
void order_slots(const std::vector<std::int32_t>& start, const std::vector<std::int32_t>& nodes,
                 Multigrid& m) {
  constexpr std::size_t slots_per_block = Sparsity::chunk_rows * chunks_per_block;
  const std::size_t slots = start.size() - 1;
  for (std::size_t first = 0; first < slots; first += slots_per_block) {
    SlotGroup group;
    group.nodes = static_cast<std::int32_t>(m.slot_nodes.size());
    for (int k = 0; k < 4; ++k) {
      group.first[k] = static_cast<std::int32_t>(m.slot_order.size());
      for (std::size_t slot = first; slot < std::min(first + slots_per_block, slots); ++slot) {
        if (start[slot + 1] - start[slot] != 1 << k) continue;
        m.slot_order.push_back(static_cast<std::int32_t>(slot));
        m.slot_nodes.insert(m.slot_nodes.end(), nodes.begin() + start[slot], nodes.begin() + start[slot + 1]);
      }
    }
    group.first[4] = static_cast<std::int32_t>(m.slot_order.size());
    m.slot_groups.push_back(group);
  }
}

void make_transfers(const std::vector<CoarseLevel>& levels, const Sparsity& sparsity, Multigrid& m) {
  const CoarseLevel& first = levels.front();
  std::vector<std::int32_t> start(1, 0), nodes;  // of each slot, without repetitions
  for (std::int32_t node : sparsity.node_of_slot) {
    const std::int32_t from = node < 0 ? 0 : first.start[at(node)];
    const std::int32_t count = node < 0 ? 0 : first.start[at(node) + 1] - from;
    nodes.insert(nodes.end(), first.among.begin() + from, first.among.begin() + from + count);
    start.push_back(static_cast<std::int32_t>(nodes.size()));
    m.slot_share.push_back(count == 0 ? 0.0f : 1.0f / static_cast<float>(count));
  }
  order_slots(start, nodes, m);
  transpose(start, nodes, m.first_node[1], m.node_start, m.node_slots);
  m.up_start.assign(1, 0);
  for (std::size_t l = 1; l < levels.size(); ++l) {
    for (std::size_t n = 0; n + 1 < levels[l].start.size(); ++n) {
      for (std::int32_t k = levels[l].start[n]; k < levels[l].start[n + 1]; ++k) {
        m.up_nodes.push_back(levels[l].among[at(k)] + static_cast<std::int32_t>(m.first_node[l]));
      }
      m.up_start.push_back(static_cast<std::int32_t>(m.up_nodes.size()));
    }
  }
  m.up_start.resize(at(m.first_node.back()) + 1, static_cast<std::int32_t>(m.up_nodes.size()));
  transpose(m.up_start, m.up_nodes, m.first_node.back(), m.down_start, m.down_nodes);
}

// Which tetrahedra or cells a cell's mean rotation is taken from: of a cell of the mesh, its last
// tetrahedron, the middle one of five.
void list_children(const EmbeddingMesh& mesh, Multigrid& m) {
  const auto mesh_cells = static_cast<std::int64_t>(mesh.cell_nodes.size());
  std::vector<std::int32_t> one, item;
  for (std::size_t c = 0; c < m.parent.size(); ++c) {
    one.push_back(static_cast<std::int32_t>(item.size()));
    if (m.parent[c] >= 0) item.push_back(m.parent[c]);
  }
  one.push_back(static_cast<std::int32_t>(item.size()));
  transpose(one, item, m.first_cell.back(), m.child_start, m.children);
  for (std::int32_t& child : m.children) {
    child = child < mesh_cells ? child * mesh.tets_per_cell + mesh.tets_per_cell - 1
                               : child - static_cast<std::int32_t>(mesh_cells);
  }
}

void add_weights(const EmbeddingMesh& mesh, const ElementData& elements, Multigrid& m) {
  m.tets_per_cell = mesh.tets_per_cell;
  std::vector<double> sums(at(m.first_cell.back()), 0.0);
  for (std::int64_t e = 0; e < elements.count; ++e) {
    const double weight = elements.rest_double[at(e / 16 * 12 * 16 + 16 * 10 + e % 16)];
    m.tet_weight.push_back(static_cast<float>(weight));
    for (std::int32_t cell = m.parent[at(e / mesh.tets_per_cell)]; cell >= 0;
         cell = m.parent[mesh.cell_nodes.size() + at(cell)]) {
      sums[at(cell)] += weight;
    }
  }
  m.cell_weight.assign(sums.begin(), sums.end());
}

// Trilinear weights of the 8 corners of a cell of level l at a point in the coordinates of the mesh's grid.
std::array<double, 8> corner_weights(const Multigrid& m, std::int64_t level, std::int32_t cell,
                                     const Vec3& point) {
  double t[3];
  const double edge = static_cast<double>(std::int64_t{2} << level);
  for (std::size_t a = 0; a < 3; ++a) {
    t[a] = point[static_cast<Eigen::Index>(a)] / edge - m.cell_position[at(cell)][a];
  }
  std::array<double, 8> weights;
  for (int k = 0; k < 8; ++k) {
    weights[at(k)] = (k & 1 ? t[0] : 1 - t[0]) * (k >> 1 & 1 ? t[1] : 1 - t[1]) * (k >> 2 ? t[2] : 1 - t[2]);
  }
  return weights;
}

Vec3 grid_corner(const EmbeddingMesh& mesh, std::int64_t cell, std::size_t corner) {
  const Index3& position = mesh.cell_position[at(cell)];
  const int c = static_cast<int>(corner);
  return Vec3(position[0] + (c & 1), position[1] + (c >> 1 & 1), position[2] + (c >> 2));
}

std::size_t corner_of(const EmbeddingMesh& mesh, std::int64_t cell, std::int32_t node) {
  const auto& nodes = mesh.cell_nodes[at(cell)];
  return static_cast<std::size_t>(std::find(nodes.begin(), nodes.end(), node) - nodes.begin());
}

// The larger a row's entries beside its diagonal one, the smaller the weight. On a body that fills its grid
// they are as large as that one. Along a strip thinner than a cell the functions of the corners across it are
// nearly the same, and all of them would correct the same. products: [64*cells] gradients of the functions of
// each pair of corners.
void set_weights(const std::vector<double>& products, Multigrid& m) {
  constexpr double first = 0.8, above = 0.5;  // of a body that fills its grid; docs/decisions/0005
  std::vector<double> own(at(m.first_node.back()), 0.0), row(own);
  for (std::size_t c = 0; c < m.cell_nodes.size(); ++c) {
    for (std::size_t a = 0; a < 8; ++a) {
      const auto node = at(m.cell_nodes[c][a]);
      own[node] += products[64 * c + 9 * a];
      for (std::size_t b = 0; b < 8; ++b) row[node] += std::fabs(products[64 * c + 8 * a + b]);
    }
  }
  for (std::size_t n = 0; n < own.size(); ++n) {
    const double share = row[n] > 0 ? 2 * own[n] / row[n] : 1;
    m.weight.push_back(static_cast<float>((n < at(m.first_node[1]) ? first : above) * share));
  }
}

// (beta h + h^2) K_aa of the corners of all cells above each tetrahedron, and the levels' weights. The
// interpolated function of corner a has the constant gradient G = sum_i W_ia g_i in it, which gives V
// ((lambda + mu) G G^T + mu |G|^2 I).
void add_stiffness(const EmbeddingMesh& mesh, const ElementData& elements, const StepCoefficients& step,
                   std::span<const std::uint8_t> free_node, Multigrid& m) {
  std::vector<double> stiffness(48 * at(m.first_cell.back()), 0.0),
      products(64 * at(m.first_cell.back()), 0.0);
  for (std::int64_t e = 0; e < elements.count; ++e) {
    const double* rest = elements.rest_double.data() + e / 16 * 12 * 16 + e % 16;
    Vec3 gradient[4];
    for (int c = 1; c < 4; ++c) {
      for (int d = 0; d < 3; ++d) gradient[c][d] = rest[16 * (3 * (c - 1) + d)];
    }
    gradient[0] = -(gradient[1] + gradient[2] + gradient[3]);
    const double beta = elements.beta_s.empty() ? step.damping.beta_s : elements.beta_s[at(e)];
    const double scale = step.step_s * (beta + step.step_s);
    const double lambda = scale * rest[16 * 9], mu = scale * rest[16 * 10];
    const std::int64_t mesh_cell = e / mesh.tets_per_cell;
    std::int32_t cell = m.parent[at(mesh_cell)];
    for (std::int64_t level = 0; level < m.levels; ++level) {
      std::array<Vec3, 8> sums;
      sums.fill(Vec3::Zero());
      for (std::size_t i = 0; i < 4; ++i) {
        const std::int32_t node = mesh.tets[at(e)][i];
        if (!free_node[at(node)]) continue;
        const auto weights =
            corner_weights(m, level, cell, grid_corner(mesh, mesh_cell, corner_of(mesh, mesh_cell, node)));
        for (std::size_t a = 0; a < 8; ++a) sums[a] += weights[a] * gradient[i];
      }
      for (std::size_t a = 0; a < 8; ++a) {
        for (std::size_t b = 0; b < 8; ++b) products[64 * at(cell) + 8 * a + b] += mu * sums[a].dot(sums[b]);
        const Vec3& g = sums[a];
        const double square = mu * g.squaredNorm();
        double* to = &stiffness[48 * at(cell) + a];
        to[0] += (lambda + mu) * g[0] * g[0] + square;
        to[8] += (lambda + mu) * g[0] * g[1];
        to[16] += (lambda + mu) * g[0] * g[2];
        to[24] += (lambda + mu) * g[1] * g[1] + square;
        to[32] += (lambda + mu) * g[1] * g[2];
        to[40] += (lambda + mu) * g[2] * g[2] + square;
      }
      cell = m.parent[mesh.cell_nodes.size() + at(cell)];
    }
  }
  m.stiffness.assign(stiffness.begin(), stiffness.end());
  set_weights(products, m);
}

void add_masses(const EmbeddingMesh& mesh, std::span<const double> node_weights,
                std::span<const std::uint8_t> free_node, Multigrid& m) {
  std::vector<double> mass(at(m.first_node.back()), 0.0);
  std::vector<std::uint8_t> seen(mesh.rest_positions.size(), 0);
  for (std::size_t c = 0; c < mesh.cell_nodes.size(); ++c) {
    for (std::size_t corner = 0; corner < 8; ++corner) {
      const auto node = at(mesh.cell_nodes[c][corner]);
      if (seen[node] || !free_node[node]) continue;
      seen[node] = 1;
      std::int32_t cell = m.parent[c];
      for (std::int64_t level = 0; level < m.levels; ++level) {
        const auto weights =
            corner_weights(m, level, cell, grid_corner(mesh, static_cast<std::int64_t>(c), corner));
        for (std::size_t a = 0; a < 8; ++a) {
          mass[at(m.cell_nodes[at(cell)][a])] += node_weights[node] * weights[a] * weights[a];
        }
        cell = m.parent[mesh.cell_nodes.size() + at(cell)];
      }
    }
  }
  m.mass.assign(mass.begin(), mass.end());
}

// Adds b to a, turned the short way round.
template <class Real>
void add_quaternion(Real* a, const Real* b) {
  const Real dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  for (int k = 0; k < 4; ++k) a[k] += dot < Real(0) ? -b[k] : b[k];
}

// What of a cell is left, as a share. torn: mu V of what is gone, of the cells of the level below, and here
// of this one.
template <class Real>
Real share_left(const Multigrid& m, std::int64_t level, std::int64_t cell,
                std::span<const std::uint8_t> alive, std::vector<Real>& torn) {
  Real sum = 0;
  for (std::int32_t k = m.child_start[at(cell)]; k < m.child_start[at(cell) + 1]; ++k) {
    const std::int64_t child = m.children[at(k)];
    if (level > 0) {
      sum += torn[at(child)];
      continue;
    }
    const std::int64_t first = child - m.tets_per_cell + 1;
    std::uint8_t all = 1;
    for (std::int64_t tet = first; tet <= child; ++tet) all &= alive[at(tet)];
    if (all) continue;
    for (std::int64_t tet = first; tet <= child; ++tet)
      sum += alive[at(tet)] ? Real(0) : static_cast<Real>(m.tet_weight[at(tet)]);
  }
  torn[at(cell)] = sum;
  return std::max(Real(0), Real(1) - sum / static_cast<Real>(m.cell_weight[at(cell)]));
}

// Columns of the rotation by q / |q|, of the identity where q has no direction; times `size`.
template <class Real>
void store_turn(const Real* q, Real size, Real* columns) {
  const Real square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  const bool usable = square > Real(1e-6);
  const Real two = usable ? Real(2) / square : Real(0);
  const Real s = q[0], x = q[1], y = q[2], z = q[3];
  const Real r[9] = {
      Real(1) - two * (y * y + z * z), two * (x * y - s * z),           two * (x * z + s * y),
      two * (x * y + s * z),           Real(1) - two * (x * x + z * z), two * (y * z - s * x),
      two * (x * z - s * y),           two * (y * z + s * x),           Real(1) - two * (x * x + y * y)};
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) columns[4 * j + i] = size * r[3 * i + j];
    columns[4 * j + 3] = Real(0);
  }
}

}  // namespace

Reach reach_of_step(const EmbeddingMesh& mesh, const ElementData& elements, const StepCoefficients& step) {
  double volume = 0, mass = 0;        // m^3, kg
  double stiffest = 0, shearing = 0;  // (beta + h) (lambda + 2 mu) and (beta + h) mu, Pa s
  for (double m : elements.node_mass) mass += m;
  for (std::int64_t e = 0; e < elements.count; ++e) {
    const double* rest = elements.rest_double.data() + e / 16 * 12 * 16 + e % 16;
    Mat3 gradients;
    for (int k = 0; k < 9; ++k) gradients(k / 3, k % 3) = rest[16 * k];
    const double own = 1 / (6 * std::fabs(gradients.determinant()));
    const double beta = elements.beta_s.empty() ? step.damping.beta_s : elements.beta_s[at(e)];
    volume += own;
    stiffest = std::fmax(stiffest, (beta + step.step_s) * (rest[16 * 9] + 2 * rest[16 * 10]) / own);
    shearing = std::fmax(shearing, (beta + step.step_s) * rest[16 * 10] / own);
  }
  double edge = std::numeric_limits<double>::infinity();
  const auto& corners = mesh.cell_nodes.front();
  for (const std::size_t corner : {1, 2, 4}) {
    const Vec3 side = mesh.rest_positions[at(corners[corner])] - mesh.rest_positions[at(corners[0])];
    edge = std::fmin(edge, side.norm());
  }
  const double density = mass / volume;
  return {std::sqrt(step.step_s * stiffest / density) / edge,
          std::sqrt(step.step_s * shearing / density) / edge, density * edge * edge * edge};
}

bool multigrid_pays(const EmbeddingMesh& mesh, const Reach& reach, double contact_kg) {
  constexpr double cells = 1.5, stiff = 600;
  const double cell = reach.shear * reach.shear * reach.cell_kg;  // (beta h + h^2) mu times the edge, kg
  return std::ranges::min(mesh.grid_size) > 1 && cell > 0 &&
         reach.shear > cells * (1 + contact_kg / (stiff * cell));
}

template <class Real>
LevelView<Real> level_view(const Multigrid& m, MultigridWorkspace<Real>& w) {
  LevelView<Real> v;
  v.first_node = m.first_node.data();
  v.levels = m.levels;
  v.shared_levels = m.shared_levels;
  v.slot_groups = m.slot_groups.data();
  v.slot_order = m.slot_order.data();
  v.slot_nodes = m.slot_nodes.data();
  v.node_start = m.node_start.data();
  v.node_slots = m.node_slots.data();
  v.up_start = m.up_start.data();
  v.up_nodes = m.up_nodes.data();
  v.down_start = m.down_start.data();
  v.down_nodes = m.down_nodes.data();
  v.corner_start = m.corner_start.data();
  v.corners = m.corners.data();
  v.stiffness = m.stiffness.data();
  v.mass = m.mass.data();
  v.weight = m.weight.data();
  v.up_share = w.up_share.data();
  v.up_count = w.up_count.data();
  v.slot_share = m.slot_share.data();
  v.share = w.share.data();
  v.turns = w.turns.data();
  v.turned = w.turned.data();
  v.added = w.added.data();
  v.inverse = w.inverse.data();
  v.residual = w.residual.data();
  v.correction = w.correction.data();
  v.sums = w.sums.data();
  return v;
}

Multigrid build_multigrid(const EmbeddingMesh& mesh, const ElementData& elements, const Sparsity& sparsity,
                          const StepCoefficients& coefficients, std::span<const double> node_weights,
                          std::span<const std::uint8_t> free_node, bool tears) {
  Multigrid m;
  std::vector<CoarseLevel> levels = build_coarse_levels(mesh, enough_nodes);
  if (levels.empty()) return m;
  leave_out_useless(reach_of_step(mesh, elements, coefficients).pressure, levels);
  number_levels(mesh, levels, m);
  make_transfers(levels, sparsity, m);
  list_children(mesh, m);
  if (tears) add_weights(mesh, elements, m);
  std::vector<std::int32_t> one(m.cell_nodes.size() * 8 + 1), item;
  for (std::size_t c = 0; c < one.size(); ++c) one[c] = static_cast<std::int32_t>(c);
  for (const auto& nodes : m.cell_nodes) item.insert(item.end(), nodes.begin(), nodes.end());
  transpose(one, item, m.first_node.back(), m.corner_start, m.corners);
  add_stiffness(mesh, elements, coefficients, free_node, m);
  add_masses(mesh, node_weights, free_node, m);
  return m;
}

template <class Real>
MultigridWorkspace<Real> make_multigrid_workspace(const Multigrid& multigrid, std::int64_t chunks,
                                                  int threads) {
  MultigridWorkspace<Real> w;
  const auto nodes = at(multigrid.first_node.back()), cells = at(multigrid.first_cell.back());
  const auto level_0 = at(multigrid.first_node[1]);
  const auto shared = at(multigrid.first_node[at(multigrid.shared_levels)]);
  w.share.assign(at(48 * chunks), Real(0));
  w.turns.assign(12 * cells, Real(0));
  w.turned.assign(64 * cells, Real(0));
  w.added.assign(8 * nodes, Real(0));
  w.inverse.assign(12 * nodes, Real(0));
  w.residual.assign(4 * shared, Real(0));
  w.correction.assign(4 * shared, Real(0));
  w.upper.assign(at(threads), AlignedVector<Real>(8 * nodes, Real(0)));
  w.sums.assign((level_0 + nodes_per_sum - 1) / nodes_per_sum, 0.0);
  w.quaternions.assign(4 * cells, Real(0));
  w.torn.assign(multigrid.cell_weight.size(), Real(0));
  for (std::size_t n = 0; n < nodes; ++n) {
    const auto count = static_cast<Real>(std::max(1, multigrid.up_start[n + 1] - multigrid.up_start[n]));
    w.up_count.push_back(count);
    w.up_share.push_back(Real(1) / count);
  }
  return w;
}

template <class Real>
void clear_contacts(MultigridWorkspace<Real>& workspace) {
  std::fill(workspace.added.begin(), workspace.added.end(), Real(0));
}

template <class Real>
void add_contact(const Multigrid& m, const EmbeddingMesh& mesh, std::int32_t tet,
                 const std::array<double, 4>& weights, const Mat3& block,
                 MultigridWorkspace<Real>& workspace) {
  const std::int64_t mesh_cell = tet / mesh.tets_per_cell;
  Vec3 point = Vec3::Zero();
  for (std::size_t i = 0; i < 4; ++i) {
    point += weights[i] * grid_corner(mesh, mesh_cell, corner_of(mesh, mesh_cell, mesh.tets[at(tet)][i]));
  }
  std::int32_t cell = m.parent[at(mesh_cell)];
  for (std::int64_t level = 0; level < m.levels; ++level) {
    const auto sums = corner_weights(m, level, cell, point);
    for (std::size_t a = 0; a < 8; ++a) {
      const double scale = sums[a] * sums[a];
      Real* to = &workspace.added[8 * at(m.cell_nodes[at(cell)][a])];
      to[0] += static_cast<Real>(scale * block(0, 0));
      to[1] += static_cast<Real>(scale * block(0, 1));
      to[2] += static_cast<Real>(scale * block(0, 2));
      to[3] += static_cast<Real>(scale * block(1, 1));
      to[4] += static_cast<Real>(scale * block(1, 2));
      to[5] += static_cast<Real>(scale * block(2, 2));
    }
    cell = m.parent[mesh.cell_nodes.size() + at(cell)];
  }
}

template <class Real>
void set_up_multigrid(const Multigrid& m, const RowMatrix<Real>& matrix, std::span<const double> rotations,
                      std::span<const std::uint8_t> alive, const SolverKernels<Real>& kernels, int threads,
                      MultigridWorkspace<Real>& workspace) {
  const LevelView<Real> levels = level_view(m, workspace);
  SpinBarrier barrier(threads);
#pragma omp parallel num_threads(threads)
  {
    const int thread = omp_get_thread_num();
    const Range chunks = share(matrix.chunks, thread, threads);
    kernels.share_slots(matrix, levels, chunks.first, chunks.last);
    for (std::int64_t level = 0; level < m.levels; ++level) {
      const std::int64_t count = m.first_cell[at(level) + 1] - m.first_cell[at(level)];
      const Range cells = share(count, thread, threads);
      for (std::int64_t c = m.first_cell[at(level)] + cells.first; c < m.first_cell[at(level)] + cells.last;
           ++c) {
        Real* sum = &workspace.quaternions[at(4 * c)];
        for (int k = 0; k < 4; ++k) sum[k] = Real(0);
        for (std::int32_t k = m.child_start[at(c)]; k < m.child_start[at(c) + 1]; ++k) {
          const std::size_t child = 4 * at(m.children[at(k)]);
          Real q[4];
          for (std::size_t d = 0; d < 4; ++d) {
            q[d] = level == 0 ? static_cast<Real>(rotations[child + d]) : workspace.quaternions[child + d];
          }
          add_quaternion(sum, q);
        }
        const Real left = alive.empty() ? Real(1) : share_left(m, level, c, alive, workspace.torn);
        store_turn(sum, std::sqrt(left), &workspace.turns[at(12 * c)]);
        kernels.turn_corners(levels, c);
      }
      barrier.wait();
    }
    const Range nodes = share(m.first_node.back(), thread, threads);
    kernels.level_blocks(levels, nodes.first, nodes.last);
  }
}

#define SULCUS_INSTANTIATE(Real)                                                                          \
  template MultigridWorkspace<Real> make_multigrid_workspace<Real>(const Multigrid&, std::int64_t, int);  \
  template void clear_contacts<Real>(MultigridWorkspace<Real>&);                                          \
  template void add_contact<Real>(const Multigrid&, const EmbeddingMesh&, std::int32_t,                   \
                                  const std::array<double, 4>&, const Mat3&, MultigridWorkspace<Real>&);  \
  template void set_up_multigrid<Real>(const Multigrid&, const RowMatrix<Real>&, std::span<const double>, \
                                       std::span<const std::uint8_t>, const SolverKernels<Real>&, int,    \
                                       MultigridWorkspace<Real>&);                                        \
  template LevelView<Real> level_view<Real>(const Multigrid&, MultigridWorkspace<Real>&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
