// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/fem/kernels.h"

#include <utility>

#include "engine/fem/laws.h"
#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

// Gradients of the two displacement fields over the element, plus the identity: F = I + sum_a d_a g_a^T.
template <class Real>
SULCUS_INLINE void gradients(const ElementPass<Real>& pass, const std::int32_t* nodes, const Lanes<Real>* g,
                             Lanes<Real>* f, Lanes<Real>* y) {
  using V = Lanes<Real>;
  V d[4][3], e[4][3];
  for (int c = 0; c < 4; ++c) {
    gather<Real>(pass.node_fields, 8, nodes + 16 * c, d[c][0], d[c][1], d[c][2]);
    gather<Real>(pass.node_fields + 4, 8, nodes + 16 * c, e[c][0], e[c][1], e[c][2]);
  }
  for (int i = 0; i < 3; ++i) {
    const V d1 = d[1][i] - d[0][i], d2 = d[2][i] - d[0][i], d3 = d[3][i] - d[0][i];
    const V e1 = e[1][i] - e[0][i], e2 = e[2][i] - e[0][i], e3 = e[3][i] - e[0][i];
    for (int j = 0; j < 3; ++j) {
      const V identity = V{} + (i == j ? Real(1) : Real(0));
      f[3 * i + j] = identity + (d1 * g[j] + d2 * g[3 + j] + d3 * g[6 + j]);
      y[3 * i + j] = identity + (e1 * g[j] + e2 * g[3 + j] + e3 * g[6 + j]);
    }
  }
}

// Removed elements carry nothing.
template <class Real>
SULCUS_INLINE void remove_dead(const std::uint8_t* alive, Lanes<Real>& lambda, Lanes<Real>& mu,
                               Turning<Real>& turning) {
  if (std::memchr(alive, 0, static_cast<std::size_t>(turning.count)) == nullptr) return;
  turning.alive = alive;
  for (int l = 0; l < turning.count; ++l) {
    lambda[l] = alive[l] ? lambda[l] : Real(0);
    mu[l] = alive[l] ? mu[l] : Real(0);
  }
}

// Plain linear elements do not turn: their rotation is and stays the identity.
template <class Real>
SULCUS_INLINE void hold_rotations(const std::uint8_t* linear, int count, double* rotations, Lanes<Real>* q) {
  for (int l = 0; l < count; ++l) {
    if (!linear[l]) continue;
    for (int k = 0; k < 4; ++k) {
      rotations[4 * l + k] = k == 0 ? 1.0 : 0.0;
      q[k][l] = k == 0 ? Real(1) : Real(0);
    }
  }
}

// Nodal forces P g_a, 12 numbers an element, and records of h_a = A g_a, 16 numbers.
template <class Real>
SULCUS_INLINE void store_response(const Response<Real>& response, const Lanes<Real>* g, Real* records,
                                  Real* forces) {
  using V = Lanes<Real>;
  const V* r = response.frame;
  const V* p = response.stress;
  V record[12], force[12];
  for (int a = 1; a < 4; ++a) {
    const V* ga = g + 3 * (a - 1);
    for (int i = 0; i < 3; ++i) {
      record[3 * a + i] = r[3 * i] * ga[0] + r[3 * i + 1] * ga[1] + r[3 * i + 2] * ga[2];
      force[3 * a + i] = p[3 * i] * ga[0] + p[3 * i + 1] * ga[1] + p[3 * i + 2] * ga[2];
    }
  }
  for (int i = 0; i < 3; ++i) {
    record[i] = -(record[3 + i] + record[6 + i] + record[9 + i]);
    force[i] = -(force[3 + i] + force[6 + i] + force[9 + i]);
  }
  const V zero{};
  const auto carries = response.mu > zero;
  const V root = square_root<Real>(response.mu);
  const V ratio = carries ? response.lambda / (carries ? response.mu : zero + Real(1)) : zero;
  for (int a = 0; a < 4; ++a) {
    const V* h = record + 3 * a;
    scatter<Real>(root * h[0], root * h[1], root * h[2], ratio,
                  [&](int l) { return records + 16 * l + 4 * a; });
  }
  for (int k = 0; k < 12; k += 4) {
    scatter<Real>(force[k], force[k + 1], force[k + 2], force[k + 3],
                  [&](int l) { return forces + 12 * l + k; });
  }
}

// The rest data of one register's elements.
template <class Real>
struct RestLanes {
  Lanes<Real> g[9], lambda, mu;
};

template <class Real>
SULCUS_INLINE void load_elements(const ElementPass<Real>& pass, std::int64_t first, RestLanes<Real>& rest,
                                 Turning<Real>& turning, Lanes<Real>* y) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  const std::int64_t block = first / 16, lane = first % 16;
  const Real* from = pass.rest + block * 12 * 16 + lane;
  for (int k = 0; k < 9; ++k) rest.g[k] = load<V>(from + 16 * k);
  rest.lambda = load<V>(from + 16 * 9);
  rest.mu = load<V>(from + 16 * 10);
  turning.count = pass.count - first < n ? static_cast<int>(pass.count - first) : n;
  turning.rotations = pass.rotations + 4 * (first - pass.rotations_from);
  turning.alive = nullptr;
  if (pass.alive != nullptr) remove_dead<Real>(pass.alive + first, rest.lambda, rest.mu, turning);
  gradients<Real>(pass, pass.nodes + block * 4 * 16 + lane, rest.g, turning.f, y);
}

// Adds the elastic energies of one register's elements to that of their block, in the order of the elements.
template <class Real>
SULCUS_INLINE void add_energies(const ElementPass<Real>& pass, std::int64_t first,
                                const RestLanes<Real>& rest, const Turning<Real>& turning,
                                const Rotation<Real>& turn) {
  const Lanes<Real> energy = corotated_energy<Real>(turn, turning.f, rest.lambda, rest.mu);
  double& sum = pass.energies[first / 16];
  if (first % 16 == 0) sum = 0;
  for (int l = 0; l < turning.count; ++l) sum += static_cast<double>(energy[l]);
}

template <class Real>
SULCUS_INLINE void answer(const ElementPass<Real>& pass, std::int64_t first, const RestLanes<Real>& rest,
                          Turning<Real>& turning, Lanes<Real>* y) {
  using V = Lanes<Real>;
  if (pass.linear != nullptr) {
    hold_rotations<Real>(pass.linear + first, turning.count, turning.rotations, turning.q);
  }
  const Rotation<Real> turn = matrix_of<Real>(turning.q);
  if (pass.energies != nullptr) add_energies(pass, first, rest, turning, turn);
  const V ahead = pass.ahead != nullptr ? load<V>(pass.ahead + first) : V{};
  if (pass.ahead != nullptr) {
    for (int k = 0; k < 9; ++k) y[k] = turning.f[k] + ahead * (y[k] - turning.f[k]);
  }
  Response<Real> response = corotated_law<Real>(turn, y, rest.lambda, rest.mu);
  if (pass.ahead != nullptr) {
    response.lambda *= ahead;
    response.mu *= ahead;
  }
  const std::int64_t place = first - pass.records_from;
  store_response<Real>(response, rest.g, pass.records + 16 * place, pass.forces + 12 * place);
}

template <class Real>
void element_pass(const ElementPass<Real>& pass, std::int64_t first_block, std::int64_t last_block) {
  constexpr int n = lane_count<Real>;
  const std::int64_t end = last_block * 16 < pass.count ? last_block * 16 : pass.count;
  RestLanes<Real> rest[tile_registers];
  Turning<Real> turning[tile_registers];
  Lanes<Real> y[tile_registers][9];
  for (std::int64_t first = first_block * 16; first < end; first += tile_registers * n) {
    const std::int64_t left = (end - first + n - 1) / n;
    const int registers = left < tile_registers ? static_cast<int>(left) : tile_registers;
    for (int r = 0; r < registers; ++r) load_elements(pass, first + r * n, rest[r], turning[r], y[r]);
    rotate(turning, registers);
    for (int r = 0; r < registers; ++r) answer(pass, first + r * n, rest[r], turning[r], y[r]);
  }
}

// Blocks of one register of edges, item by item of each.
template <class Real>
SULCUS_INLINE void sum_edges(const EdgePass<Real>& pass, const std::int32_t* edges, std::int32_t first_row,
                             std::int32_t last_row, int lane) {
  using V = Lanes<Real>;
  V block[9], trace{};
  for (V& entry : block) entry = V{};
  for (std::int32_t row = first_row; row < last_row; ++row) {
    const std::int32_t* corners = pass.lane_corners + 32 * static_cast<std::int64_t>(row) + lane;
    V a[3], b[3], ratio;
    gather<Real>(pass.records, 1, corners, a[0], a[1], a[2], ratio);
    gather<Real>(pass.records, 1, corners + 16, b[0], b[1], b[2]);
    for (int i = 0; i < 3; ++i) {
      const V scaled = ratio * a[i];
      for (int j = 0; j < 3; ++j) block[3 * i + j] += scaled * b[j] + b[i] * a[j];
    }
    trace += a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  }
  for (int i = 0; i < 3; ++i) {
    block[4 * i] += trace;
    scatter<Real>(pass.scale * block[3 * i], pass.scale * block[3 * i + 1], pass.scale * block[3 * i + 2],
                  V{}, [&](int l) { return pass.blocks + 12 * static_cast<std::int64_t>(edges[l]) + 4 * i; });
  }
}

template <class Real>
void edge_pass(const EdgePass<Real>& pass, std::int64_t first_group, std::int64_t last_group) {
  for (std::int64_t group = first_group; group < last_group; ++group) {
    for (int lane = 0; lane < 16; lane += lane_count<Real>) {
      sum_edges<Real>(pass, pass.lane_edges + 16 * group + lane, pass.lane_start[group],
                      pass.lane_start[group + 1], lane);
    }
  }
}

// Inverse of the symmetric 3x3 blocks of 16 lanes, by cofactors.
template <class Real>
SULCUS_INLINE void invert_blocks(const Real* d, Real* inverse) {
  using V = Lanes<Real>;
  for (int l = 0; l < 16; l += lane_count<Real>) {
    const V a = load<V>(d + l), b = load<V>(d + 16 + l), c = load<V>(d + 32 + l);
    const V e = load<V>(d + 64 + l), f = load<V>(d + 80 + l), i = load<V>(d + 128 + l);
    const V ca = e * i - f * f, cb = c * f - b * i, cc = b * f - c * e;
    const V det = a * ca + b * cb + c * cc;
    const V scale = Real(1) / det;
    const V ce = (a * i - c * c) * scale, cf = (b * c - a * f) * scale, ci = (a * e - b * b) * scale;
    const V entries[9] = {ca * scale, cb * scale, cc * scale, cb * scale, ce, cf, cc * scale, cf, ci};
    for (int k = 0; k < 9; ++k) store(inverse + 16 * k + l, entries[k]);
  }
}

// Nine planes of 16 lanes from rows of three numbers, `row` apart, at from + stride * index[lane].
template <class Real>
SULCUS_INLINE void gather_planes(const Real* from, int stride, int row, const std::int32_t* index,
                                 Lanes<Real>* planes) {
  for (int i = 0; i < 3; ++i)
    gather<Real>(from + row * i, stride, index, planes[3 * i], planes[3 * i + 1], planes[3 * i + 2]);
}

// Terms of the nodes in the diagonal block; 1 for padding.
template <class Real>
SULCUS_INLINE void load_node_terms(const RowPass<Real>& pass, const std::int32_t* nodes, Real* diagonal) {
  std::int32_t index[16];
  bool padding = false;
  for (int l = 0; l < 16; ++l) {
    index[l] = nodes[l] < 0 ? 0 : nodes[l];
    padding |= nodes[l] < 0;
  }
  for (int l = 0; l < 16; l += lane_count<Real>) {
    Lanes<Real> planes[9];
    gather_planes<Real>(pass.node_terms, 16, 3, index + l, planes);
    for (int k = 0; k < 9; ++k) store(diagonal + 16 * k + l, planes[k]);
  }
  for (int l = 0; padding && l < 16; ++l) {
    if (nodes[l] >= 0) continue;
    for (int k = 0; k < 9; ++k) diagonal[16 * k + l] = k % 4 == 0 ? Real(1) : Real(0);
  }
}

template <class Real>
struct MaskTypes;
template <>
struct MaskTypes<float> {
  using Type = std::int32_t;
};
template <>
struct MaskTypes<double> {
  using Type = std::int64_t;
};

// The off-diagonal blocks of one entry of 16 rows: the edge's block, transposed for the row of its larger
// node, zero for padding.
template <class Real>
SULCUS_INLINE void load_edge_blocks(const RowPass<Real>& pass, std::int64_t entry, Real* values) {
  using V = Lanes<Real>;
  using Integers = typename Vector<typename MaskTypes<Real>::Type, lane_count<Real>>::Type;
  Integers bit;
  for (int l = 0; l < lane_count<Real>; ++l) bit[l] = 1 << l;
  for (int l = 0; l < 16; l += lane_count<Real>) {
    V planes[9];
    gather_planes<Real>(pass.blocks, 1, 4, pass.block + 16 * entry + l, planes);
    const auto transposed = ((pass.transposed[entry] >> l) & bit) != 0;
    for (int i = 0; i < 3; ++i) {
      store(values + 16 * 4 * i + l, planes[4 * i]);
      for (int j = 0; j < i; ++j) {
        const V lower = planes[3 * i + j], upper = planes[3 * j + i];
        store(values + 16 * (3 * i + j) + l, transposed ? upper : lower);
        store(values + 16 * (3 * j + i) + l, transposed ? lower : upper);
      }
    }
  }
}

template <class Real, bool filled>
SULCUS_INLINE void make_rows(const RowPass<Real>& pass, std::int64_t first_chunk, std::int64_t last_chunk) {
  using V = Lanes<Real>;
  for (std::int64_t chunk = first_chunk; chunk < last_chunk; ++chunk) {
    const std::int32_t* nodes = pass.node_of_slot + 16 * chunk;
    Real* diagonal = pass.diagonal + 9 * 16 * chunk;
    load_node_terms<Real>(pass, nodes, diagonal);
    for (std::int64_t entry = pass.chunk_start[chunk]; entry < pass.chunk_start[chunk + 1]; ++entry) {
      Real* values = pass.values + 9 * 16 * entry;
      if constexpr (!filled) load_edge_blocks<Real>(pass, entry, values);
      for (int k = 0; k < 9 * 16; k += lane_count<Real>) {
        store(diagonal + k, load<V>(diagonal + k) - load<V>(values + k));
      }
    }
    Real* inverse = pass.inverse + 9 * 16 * chunk;
    invert_blocks(diagonal, inverse);
    for (int l = 0; l < 16; ++l) {
      if (nodes[l] >= 0 && pass.free_node[nodes[l]]) continue;
      for (int k = 0; k < 9; ++k) inverse[16 * k + l] = Real(0);
    }
  }
}

template <class Real>
void row_pass(const RowPass<Real>& pass, std::int64_t first_chunk, std::int64_t last_chunk) {
  make_rows<Real, false>(pass, first_chunk, last_chunk);
}

template <class Real>
void close_rows(const RowPass<Real>& pass, std::int64_t first_chunk, std::int64_t last_chunk) {
  make_rows<Real, true>(pass, first_chunk, last_chunk);
}

template <class Real>
void force_pass(const ForcePass<Real>& pass, std::int64_t first_node, std::int64_t last_node) {
  for (std::int64_t node = first_node; node < last_node; ++node) {
    Four<Real> sum{};
    for (std::int32_t k = pass.incident_start[node]; k < pass.incident_start[node + 1]; ++k) {
      sum += load<Four<Real>>(pass.forces + 3 * static_cast<std::int64_t>(pass.incident[k]));
    }
    for (int d = 0; d < 3; ++d) pass.node_forces[3 * node + d] = static_cast<double>(sum[d]);
  }
}

// Numbers at from + stride * index of each lane; any place, any stride.
template <std::size_t... l>
SULCUS_INLINE Lanes<double> pick(const double* from, const std::int64_t* index, std::index_sequence<l...>) {
  return Lanes<double>{from[index[l]]...};
}

// The rotation matrix of a quaternion of any length, operation by operation as rotation_matrix does it.
SULCUS_INLINE void rotation_of(const Lanes<double>* q, Lanes<double>* r) {
  using V = Lanes<double>;
  const V s = q[0], x = q[1], y = q[2], z = q[3];
  const V n = 1.0 / (s * s + x * x + y * y + z * z);
  r[0] = (s * s + x * x - y * y - z * z) * n;
  r[4] = (s * s - x * x + y * y - z * z) * n;
  r[8] = (s * s - x * x - y * y + z * z) * n;
  r[1] = 2.0 * (x * y - s * z) * n;
  r[3] = 2.0 * (x * y + s * z) * n;
  r[2] = 2.0 * (x * z + s * y) * n;
  r[6] = 2.0 * (x * z - s * y) * n;
  r[5] = 2.0 * (y * z - s * x) * n;
  r[7] = 2.0 * (y * z + s * x) * n;
}

// Energies of one register's elements from the edges of their deformed shapes (x_a - x_0, edge by edge). With
// the polar rotation R, |S - I|^2 is |F - R|^2 and tr(S - I) is R : F - 3. linear: [lanes] or nullptr: there
// R = I is not the polar rotation, and the skew part of F - I is no strain.
SULCUS_INLINE Lanes<double> energies(const Lanes<double>* edges, const Lanes<double>* turn,
                                     const double* rest, const std::uint8_t* linear) {
  using V = Lanes<double>;
  V strain{}, trace{}, gradient[9];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const V g0 = load<V>(rest + 16 * j), g1 = load<V>(rest + 16 * (3 + j)),
              g2 = load<V>(rest + 16 * (6 + j));
      const V f = edges[i] * g0 + edges[3 + i] * g1 + edges[6 + i] * g2;
      gradient[3 * i + j] = f;
      const V difference = f - turn[3 * i + j];
      strain += difference * difference;
      trace += difference * turn[3 * i + j];
    }
  }
  for (int l = 0; linear != nullptr && l < lane_count<double>; ++l) {
    if (!linear[l]) continue;
    for (int i = 0; i < 3; ++i) {
      for (int j = i + 1; j < 3; ++j) {
        const double skew = gradient[3 * i + j][l] - gradient[3 * j + i][l];
        strain[l] -= 0.5 * skew * skew;
      }
    }
  }
  const V lambda = load<V>(rest + 16 * 9), mu = load<V>(rest + 16 * 10);
  return mu * strain + 0.5 * lambda * trace * trace;
}

void energy_pass(const EnergyPass& pass, std::int64_t first_block, std::int64_t last_block) {
  using V = Lanes<double>;
  constexpr int n = lane_count<double>;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    const std::int64_t left = pass.count - block * 16;
    const int count = left < 16 ? static_cast<int>(left) : 16;
    double energy[16];
    for (int first = 0; first < count; first += n) {
      std::int64_t place[4][n], quaternion[n];
      for (int l = 0; l < n; ++l) {
        const std::int64_t element = first + l < count ? first + l : count - 1;
        for (int a = 0; a < 4; ++a)
          place[a][l] = 3 * std::int64_t{pass.nodes[(block * 4 + a) * 16 + element]};
        quaternion[l] = 4 * (block * 16 + element);
      }
      constexpr auto all = std::make_index_sequence<n>();
      V edges[9], q[4], turn[9];
      for (int i = 0; i < 3; ++i) {
        const V x0 = pick(pass.positions + i, place[0], all);
        for (int a = 1; a < 4; ++a) edges[3 * (a - 1) + i] = pick(pass.positions + i, place[a], all) - x0;
      }
      for (int k = 0; k < 4; ++k) q[k] = pick(pass.rotations + k, quaternion, all);
      rotation_of(q, turn);
      store(energy + first, energies(edges, turn, pass.rest + block * 12 * 16 + first,
                                     pass.linear != nullptr ? pass.linear + block * 16 + first : nullptr));
    }
    double sum = 0;
    for (int l = 0; l < count; ++l) {
      if (pass.alive == nullptr || pass.alive[block * 16 + l]) sum += energy[l];
    }
    pass.sums[block - first_block] = sum;
  }
}

}  // namespace

template <class Real>
FemKernels<Real> table() {
  return {element_pass<Real>, edge_pass<Real>,  row_pass<Real>,
          close_rows<Real>,   force_pass<Real>, energy_pass};
}
template FemKernels<float> table<float>();
template FemKernels<double> table<double>();

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
