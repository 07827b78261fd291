// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/fem/kernels.h"

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

// Nodal forces P g_a and records h_a = A g_a, lambda, mu: 16 numbers an element each.
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
  const V fourth[4] = {response.lambda, response.mu, zero, zero};
  for (int a = 0; a < 4; ++a) {
    const V* h = record + 3 * a;
    const V* t = force + 3 * a;
    scatter<Real>(h[0], h[1], h[2], fourth[a], records + 4 * a, 16);
    scatter<Real>(t[0], t[1], t[2], zero, forces + 4 * a, 16);
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
  turning.rotations = pass.rotations + 4 * first;
  turning.alive = nullptr;
  if (pass.alive != nullptr) remove_dead<Real>(pass.alive + first, rest.lambda, rest.mu, turning);
  gradients<Real>(pass, pass.nodes + block * 4 * 16 + lane, rest.g, turning.f, y);
}

template <class Real>
SULCUS_INLINE void answer(const ElementPass<Real>& pass, std::int64_t first, const RestLanes<Real>& rest,
                          Turning<Real>& turning, Lanes<Real>* y) {
  using V = Lanes<Real>;
  if (pass.linear != nullptr) {
    hold_rotations<Real>(pass.linear + first, turning.count, turning.rotations, turning.q);
  }
  const V ahead = pass.ahead != nullptr ? load<V>(pass.ahead + first) : V{};
  if (pass.ahead != nullptr) {
    for (int k = 0; k < 9; ++k) y[k] = turning.f[k] + ahead * (y[k] - turning.f[k]);
  }
  Response<Real> response = corotated_law<Real>(matrix_of<Real>(turning.q), y, rest.lambda, rest.mu);
  if (pass.ahead != nullptr) {
    response.lambda *= ahead;
    response.mu *= ahead;
  }
  store_response<Real>(response, rest.g, pass.records + 16 * first, pass.forces + 16 * first);
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

// Rows of a 3x3 block, padded to four, as many in one vector as a register holds.
template <class Real>
inline constexpr int wide_rows = lane_count<Real> < 4 ? 1 : lane_count<Real> / 4;
template <class Real>
using Wide = typename Vector<Real, 4 * wide_rows<Real>>::Type;

// The four numbers v in every row. By concatenations: gcc takes other widening shuffles through memory.
template <class Real>
SULCUS_INLINE Wide<Real> repeat(const Four<Real>& v) {
  if constexpr (wide_rows<Real> == 1) {
    return v;
  } else {
    const auto two = __builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7);
    if constexpr (wide_rows<Real> == 2) {
      return two;
    } else {
      return __builtin_shufflevector(two, two, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
  }
}

// Of a repeated vector: its number i all over row i, for the rows first, first + 1, ...
template <class Real, int first>
SULCUS_INLINE Wide<Real> spread(const Wide<Real>& v) {
  if constexpr (wide_rows<Real> == 1) {
    return __builtin_shufflevector(v, v, first, first, first, first);
  } else if constexpr (wide_rows<Real> == 2) {
    constexpr int a = first, b = first + 5;
    return __builtin_shufflevector(v, v, a, a, a, a, b, b, b, b);
  } else {
    return __builtin_shufflevector(v, v, 0, 0, 0, 0, 5, 5, 5, 5, 10, 10, 10, 10, 15, 15, 15, 15);
  }
}

template <class Real>
void edge_pass(const EdgePass<Real>& pass, std::int64_t first_edge, std::int64_t last_edge) {
  using F = Four<Real>;
  using W = Wide<Real>;
  constexpr int parts = wide_rows<Real> == 1 ? 3 : wide_rows<Real> == 2 ? 2 : 1;
  for (std::int64_t edge = first_edge; edge < last_edge; ++edge) {
    W rows[parts] = {};
    Real trace = 0;
    for (std::int32_t k = pass.edge_start[edge]; k < pass.edge_start[edge + 1]; ++k) {
      const std::int32_t item = pass.edge_items[k];
      const Real* record = pass.records + (item & ~15);
      const F ha = load<F>(pass.records + (item & ~3)), hb = load<F>(record + (item & 3) * 4);
      const W wide_a = repeat<Real>(ha), wide_b = repeat<Real>(hb);
      const W la = record[3] * wide_a, mb = record[7] * wide_b;
      rows[0] += spread<Real, 0>(la) * wide_b + spread<Real, 0>(mb) * wide_a;
      if constexpr (parts == 3) rows[1] += spread<Real, 1>(la) * wide_b + spread<Real, 1>(mb) * wide_a;
      if constexpr (parts > 1) {
        rows[parts - 1] += spread<Real, 2>(la) * wide_b + spread<Real, 2>(mb) * wide_a;
      }
      const F products = ha * (record[7] * hb);
      trace += products[0] + products[1] + products[2];
    }
    alignas(64) Real block[4 * parts * wide_rows<Real>];
    std::memcpy(block, rows, sizeof block);
    F row[3];
    for (int i = 0; i < 3; ++i) {
      row[i] = load<F>(block + 4 * i);
      row[i][i] += trace;
      store(pass.blocks + 12 * edge + 4 * i, pass.scale * row[i]);
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
SULCUS_INLINE void load_edge_blocks(const RowPass<Real>& pass, const std::int32_t* block, Real* values) {
  using V = Lanes<Real>;
  using Integer = typename MaskTypes<Real>::Type;
  alignas(64) std::int32_t index[16];
  alignas(64) Integer odd[16];
  bool padding = false;
  for (int l = 0; l < 16; ++l) {
    index[l] = block[l] < 0 ? 0 : block[l] >> 1;
    odd[l] = block[l] & 1;
    padding |= block[l] < 0;
  }
  for (int l = 0; l < 16; l += lane_count<Real>) {
    V planes[9];
    gather_planes<Real>(pass.blocks, 12, 4, index + l, planes);
    const auto transposed = load<typename Vector<Integer, lane_count<Real>>::Type>(odd + l) != 0;
    for (int i = 0; i < 3; ++i) {
      store(values + 16 * 4 * i + l, planes[4 * i]);
      for (int j = 0; j < i; ++j) {
        const V lower = planes[3 * i + j], upper = planes[3 * j + i];
        store(values + 16 * (3 * i + j) + l, transposed ? upper : lower);
        store(values + 16 * (3 * j + i) + l, transposed ? lower : upper);
      }
    }
  }
  for (int l = 0; padding && l < 16; ++l) {
    if (block[l] >= 0) continue;
    for (int k = 0; k < 9; ++k) values[16 * k + l] = Real(0);
  }
}

template <class Real>
void row_pass(const RowPass<Real>& pass, std::int64_t first_chunk, std::int64_t last_chunk) {
  using V = Lanes<Real>;
  for (std::int64_t chunk = first_chunk; chunk < last_chunk; ++chunk) {
    const std::int32_t* nodes = pass.node_of_slot + 16 * chunk;
    Real* diagonal = pass.diagonal + 9 * 16 * chunk;
    load_node_terms<Real>(pass, nodes, diagonal);
    for (std::int64_t entry = pass.chunk_start[chunk]; entry < pass.chunk_start[chunk + 1]; ++entry) {
      Real* values = pass.values + 9 * 16 * entry;
      load_edge_blocks<Real>(pass, pass.block + 16 * entry, values);
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
void force_pass(const ForcePass<Real>& pass, std::int64_t first_node, std::int64_t last_node) {
  for (std::int64_t node = first_node; node < last_node; ++node) {
    Four<Real> sum{};
    for (std::int32_t k = pass.incident_start[node]; k < pass.incident_start[node + 1]; ++k) {
      sum += load<Four<Real>>(pass.forces + 4 * static_cast<std::int64_t>(pass.incident[k]));
    }
    for (int d = 0; d < 3; ++d) pass.node_forces[3 * node + d] = static_cast<double>(sum[d]);
  }
}

}  // namespace

template <class Real>
FemKernels<Real> table() {
  return {element_pass<Real>, edge_pass<Real>, row_pass<Real>, force_pass<Real>};
}
template FemKernels<float> table<float>();
template FemKernels<double> table<double>();

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
