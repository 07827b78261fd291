// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/solver/kernels.h"

#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

constexpr int rows = 16;

#define SULCUS_MEMBER inline __attribute__((always_inline))

// Sum of 16 running sums by a fixed tree: halves are added to each other until one number is left.
template <class Real>
SULCUS_INLINE double tree_sum(const Real* sums) {
  using Half = typename Vector<Real, 8>::Type;
  using Eight = typename Vector<double, 8>::Type;
  const Eight eight =
      __builtin_convertvector(load<Half>(sums), Eight) + __builtin_convertvector(load<Half>(sums + 8), Eight);
  const auto four =
      __builtin_shufflevector(eight, eight, 0, 1, 2, 3) + __builtin_shufflevector(eight, eight, 4, 5, 6, 7);
  const auto two = __builtin_shufflevector(four, four, 0, 1) + __builtin_shufflevector(four, four, 2, 3);
  return two[0] + two[1];
}

#ifndef SULCUS_FREE_ORDER
// 16 running sums, one sum a block.
template <class Real>
struct RunningSum {
  Lanes<Real> running[rows / lane_count<Real>] = {};

  SULCUS_MEMBER void add(int l, const Lanes<Real>& v) { running[l / lane_count<Real>] += v; }
  SULCUS_MEMBER void end_block(double* sum) {
    Real sums[rows];
    for (int l = 0; l < rows; l += lane_count<Real>) store(sums + l, running[l / lane_count<Real>]);
    *sum = tree_sum(sums);
    for (Lanes<Real>& r : running) r = Lanes<Real>{};
  }
  SULCUS_MEMBER void end(double*) {}
};
#else
// What the benchmark compares with: one sum a thread, in as many parts as a register has lanes.
template <class Real>
struct RunningSum {
  Lanes<Real> running{};

  SULCUS_MEMBER void add(int, const Lanes<Real>& v) { running += v; }
  SULCUS_MEMBER void end_block(double* sum) { *sum = 0; }
  SULCUS_MEMBER void end(double* sum) {
    for (int l = 0; l < lane_count<Real>; ++l) *sum += static_cast<double>(running[l]);
  }
};
#endif

SULCUS_INLINE std::int64_t last_chunk(std::int64_t block, std::int64_t chunks) {
  const std::int64_t last = (block + 1) * chunks_per_block;
  return last < chunks ? last : chunks;
}

template <class Real>
void multiply(const RowMatrix<Real>& a, const Real* p, const Real* packed, Real* q, double* sums,
              std::int64_t first_block, std::int64_t last_block) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  RunningSum<Real> sum;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    for (std::int64_t chunk = block * chunks_per_block; chunk < last_chunk(block, a.chunks); ++chunk) {
      const Real* own = p + chunk * 3 * rows;
      const Real* diagonal = a.diagonal + chunk * 9 * rows;
      for (int l = 0; l < rows; l += n) {
        const V px = load<V>(own + l), py = load<V>(own + rows + l), pz = load<V>(own + 2 * rows + l);
        V y[3];
        for (int i = 0; i < 3; ++i) {
          const Real* d = diagonal + 3 * i * rows + l;
          y[i] = load<V>(d) * px + load<V>(d + rows) * py + load<V>(d + 2 * rows) * pz;
        }
        for (std::int64_t entry = a.chunk_start[chunk]; entry < a.chunk_start[chunk + 1]; ++entry) {
          const std::int32_t* column = a.column + entry * rows + l;
          V x0, x1, x2;
          gather<Real>(packed, 4, column, x0, x1, x2);
          const Real* values = a.values + entry * 9 * rows + l;
          for (int i = 0; i < 3; ++i) {
            const Real* v = values + 3 * i * rows;
            y[i] += load<V>(v) * x0 + load<V>(v + rows) * x1 + load<V>(v + 2 * rows) * x2;
          }
        }
        Real* out = q + chunk * 3 * rows + l;
        store(out, y[0]);
        store(out + rows, y[1]);
        store(out + 2 * rows, y[2]);
        sum.add(l, px * y[0] + py * y[1] + pz * y[2]);
      }
    }
    sum.end_block(sums + block);
  }
  if (first_block < last_block) sum.end(sums + first_block);
}

// levels, packed: for multigrid, or null.
template <class Real, bool packs>
SULCUS_INLINE void next_residual(const RowMatrix<Real>& a, const LevelView<Real>* levels, Real alpha,
                                 const Real* p, const Real* q, Real* x, Real* r, Real* z, Real* packed,
                                 double* sums, std::int64_t first_block, std::int64_t last_block) {
  using V = Lanes<Real>;
  RunningSum<Real> sum;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    for (std::int64_t chunk = block * chunks_per_block; chunk < last_chunk(block, a.chunks); ++chunk) {
      const Real* inverse = a.inverse + chunk * 9 * rows;
      for (int l = 0; l < rows; l += lane_count<Real>) {
        const std::int64_t at = chunk * 3 * rows + l;
        V residual[3];
        for (int i = 0; i < 3; ++i) {
          store(x + at + i * rows, load<V>(x + at + i * rows) + alpha * load<V>(p + at + i * rows));
          residual[i] = load<V>(r + at + i * rows) - alpha * load<V>(q + at + i * rows);
          store(r + at + i * rows, residual[i]);
        }
        V product{};
        for (int i = 0; i < 3; ++i) {
          const Real* d = inverse + 3 * i * rows + l;
          const V out = load<V>(d) * residual[0] + load<V>(d + rows) * residual[1] +
                        load<V>(d + 2 * rows) * residual[2];
          store(z + at + i * rows, out);
          product += residual[i] * out;
        }
        sum.add(l, product);
        if constexpr (packs) {
          const Real* share = levels->share + at;
          Real* to = packed + 4 * (chunk * rows + l);
          scatter<Real>(load<V>(share) * residual[0], load<V>(share + rows) * residual[1],
                        load<V>(share + 2 * rows) * residual[2], V{},
                        [&](int lane) { return to + 4 * lane; });
        }
      }
    }
    sum.end_block(sums + block);
  }
  if (first_block < last_block) sum.end(sums + first_block);
}

template <class Real>
void advance(const RowMatrix<Real>& a, Real alpha, const Real* p, const Real* q, Real* x, Real* r, Real* z,
             double* sums, std::int64_t first_block, std::int64_t last_block) {
  next_residual<Real, false>(a, nullptr, alpha, p, q, x, r, z, nullptr, sums, first_block, last_block);
}

template <class Real>
void advance_packing(const RowMatrix<Real>& a, const LevelView<Real>& levels, Real alpha, const Real* p,
                     const Real* q, Real* x, Real* r, Real* z, Real* packed, double* sums,
                     std::int64_t first_block, std::int64_t last_block) {
  next_residual<Real, true>(a, &levels, alpha, p, q, x, r, z, packed, sums, first_block, last_block);
}

// Sum of four numbers each at from + 4 * list[first .. last).
template <class Real>
SULCUS_INLINE Four<Real> sum_listed(const Real* from, const std::int32_t* list, std::int32_t first,
                                    std::int32_t last) {
  using F = Four<Real>;
  const auto place = [&](std::int32_t k) { return load<F>(from + 4 * static_cast<std::int64_t>(list[k])); };
  F even{}, odd{};  // two sums, so that one addition need not wait for the other
  std::int32_t k = first;
  for (; k + 1 < last; k += 2) {
    even += place(k);
    odd += place(k + 1);
  }
  if (k < last) even += place(k);
  return even + odd;
}

// The mean of the corrections of `count` coarse nodes into each of some slots; returns the nodes behind them.
template <class Real, int count>
SULCUS_INLINE const std::int32_t* interpolate_to(const LevelView<Real>& levels, std::int32_t first,
                                                 std::int32_t last, const std::int32_t* nodes, Real* packed) {
  for (std::int32_t k = first; k < last; ++k, nodes += count)
    store(packed + 4 * static_cast<std::int64_t>(levels.slot_order[k]),
          sum_listed(levels.correction, nodes, 0, count) * (Real(1) / Real(count)));
  return nodes;
}

// The corrections of level 0 in the slots of a block, four numbers each; where no node is, what stood there.
template <class Real>
SULCUS_INLINE void interpolate(const LevelView<Real>& levels, std::int64_t block, Real* packed) {
  const SlotGroup& group = levels.slot_groups[block];
  const std::int32_t* nodes = levels.slot_nodes + group.nodes;
  nodes = interpolate_to<Real, 1>(levels, group.first[0], group.first[1], nodes, packed);
  nodes = interpolate_to<Real, 2>(levels, group.first[1], group.first[2], nodes, packed);
  nodes = interpolate_to<Real, 4>(levels, group.first[2], group.first[3], nodes, packed);
  interpolate_to<Real, 8>(levels, group.first[3], group.first[4], nodes, packed);
}

template <class Real, bool corrected>
SULCUS_INLINE void next_direction(const LevelView<Real>* levels, Real beta, const Real* z, Real* p,
                                  Real* packed, std::int64_t first_chunk, std::int64_t end_chunk) {
  using F = Four<Real>;
  for (std::int64_t chunk = first_chunk; chunk < end_chunk; ++chunk) {
    if constexpr (corrected) {
      if (chunk % chunks_per_block == 0) interpolate(*levels, chunk / chunks_per_block, packed);
    }
    for (int l = 0; l < rows; l += 4) {
      const std::int64_t at = chunk * 3 * rows + l;
      const std::int64_t slot = chunk * rows + l;
      F coarse[4] = {};
      if constexpr (corrected) {
        for (int k = 0; k < 4; ++k) coarse[k] = load<F>(packed + 4 * (slot + k));
        transpose_groups(coarse[0], coarse[1], coarse[2], coarse[3]);
      }
      F d[4] = {};
      for (int i = 0; i < 3; ++i) {
        F preconditioned = load<F>(z + at + i * rows);
        if constexpr (corrected) {
          const auto moves = load<F>(levels->share + at + i * rows) != Real(0);
          preconditioned += moves ? coarse[i] : F{};
        }
        d[i] = preconditioned + beta * load<F>(p + at + i * rows);
        store(p + at + i * rows, d[i]);
      }
      transpose_groups(d[0], d[1], d[2], d[3]);
      for (int k = 0; k < 4; ++k) store(packed + 4 * (slot + k), d[k]);
    }
  }
}

template <class Real>
void direct(const RowMatrix<Real>& a, Real beta, const Real* z, Real* p, Real* packed,
            std::int64_t first_block, std::int64_t last_block) {
  if (first_block >= last_block) return;
  next_direction<Real, false>(nullptr, beta, z, p, packed, first_block * chunks_per_block,
                              last_chunk(last_block - 1, a.chunks));
}

template <class Real>
void direct_corrected(const RowMatrix<Real>& a, const LevelView<Real>& levels, Real beta, const Real* z,
                      Real* p, Real* packed, std::int64_t first_block, std::int64_t last_block) {
  if (first_block >= last_block) return;
  next_direction<Real, true>(&levels, beta, z, p, packed, first_block * chunks_per_block,
                             last_chunk(last_block - 1, a.chunks));
}

template <class Real>
void restrict_slots(const LevelView<Real>& levels, const Real* packed, std::int64_t first_node,
                    std::int64_t last_node) {
  for (std::int64_t node = first_node; node < last_node; ++node) {
    store(levels.residual + 4 * node,
          levels.up_share[node] *
              sum_listed(packed, levels.node_slots, levels.node_start[node], levels.node_start[node + 1]));
  }
}

// Inverse of the node's block times its residual, plus its share of the corrections above.
template <class Real>
SULCUS_INLINE Four<Real> corrected(const LevelView<Real>& levels, std::int64_t node, const Real* residual,
                                   const Real* above) {
  using F = Four<Real>;
  const Real* inverse = levels.inverse + 12 * node;
  const F own = load<F>(inverse) * residual[0] + load<F>(inverse + 4) * residual[1] +
                load<F>(inverse + 8) * residual[2];
  return own + levels.up_share[node] *
                   sum_listed(above, levels.up_nodes, levels.up_start[node], levels.up_start[node + 1]);
}

// Sum of the residuals of the nodes below, as its own share of each.
template <class Real>
SULCUS_INLINE Four<Real> restricted(const LevelView<Real>& levels, std::int64_t node, const Real* below) {
  return levels.up_share[node] *
         sum_listed(below, levels.down_nodes, levels.down_start[node], levels.down_start[node + 1]);
}

template <class Real>
void restrict_nodes(const LevelView<Real>& levels, std::int64_t first_node, std::int64_t last_node) {
  for (std::int64_t node = first_node; node < last_node; ++node)
    store(levels.residual + 4 * node, restricted(levels, node, levels.residual));
}

template <class Real>
void climb(const LevelView<Real>& levels, Real* upper) {
  const std::int64_t first = levels.first_node[levels.shared_levels];
  const std::int64_t total = levels.first_node[levels.levels];
  Real* corrections = upper + 4 * total;
  for (std::int64_t node = first; node < total; ++node) {
    const Real* below = node < levels.first_node[levels.shared_levels + 1] ? levels.residual : upper;
    store(upper + 4 * node, restricted(levels, node, below));
  }
  for (std::int64_t node = total - 1; node >= first; --node) {
    store(corrections + 4 * node, corrected(levels, node, upper + 4 * node, corrections));
  }
}

template <class Real>
void correct_nodes(const LevelView<Real>& levels, const Real* above, std::int64_t first_node,
                   std::int64_t last_node) {
  for (std::int64_t node = first_node; node < last_node; ++node)
    store(levels.correction + 4 * node, corrected(levels, node, levels.residual + 4 * node, above));
}

template <class Real>
void correct(const LevelView<Real>& levels, const Real* above, std::int64_t first_block,
             std::int64_t last_block) {
  using F = Four<Real>;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    const std::int64_t end = (block + 1) * nodes_per_sum < levels.first_node[1] ? (block + 1) * nodes_per_sum
                                                                                : levels.first_node[1];
    F sum{};
    for (std::int64_t node = block * nodes_per_sum; node < end; ++node) {
      const Real* residual = levels.residual + 4 * node;
      const F e = corrected(levels, node, residual, above);
      store(levels.correction + 4 * node, e);
      sum += e * load<F>(residual) * levels.up_count[node];
    }
    levels.sums[block] =
        static_cast<double>(sum[0]) + static_cast<double>(sum[1]) + static_cast<double>(sum[2]);
  }
}

// Columns of W D^-1 / share for the symmetric block xx xy xz yy yz zz; nothing for a node without stiffness.
template <class Real>
SULCUS_INLINE void store_inverse(const Real* d, Real scale, Real* to) {
  using F = Four<Real>;
  const Real a = d[0], b = d[1], c = d[2], e = d[3], f = d[4], i = d[5];
  const Real ca = e * i - f * f, cb = c * f - b * i, cc = b * f - c * e;
  const Real trace = a + e + i;
  const Real determinant = a * ca + b * cb + c * cc;
  if (!(trace > Real(0))) {
    for (int k = 0; k < 3; ++k) store(to + 4 * k, F{});
    return;
  }
  if (!(determinant > Real(1e-4) * trace * trace * trace / Real(27))) {  // nearly singular: as if isotropic
    for (int k = 0; k < 3; ++k) {
      F column{};
      column[k] = scale / trace;
      store(to + 4 * k, column);
    }
    return;
  }
  const Real s = scale / determinant;
  store(to, F{ca * s, cb * s, cc * s, Real(0)});
  store(to + 4, F{cb * s, (a * i - c * c) * s, (b * c - a * f) * s, Real(0)});
  store(to + 8, F{cc * s, (b * c - a * f) * s, (a * e - b * b) * s, Real(0)});
}

template <class Real>
void share_slots(const RowMatrix<Real>& a, const LevelView<Real>& levels, std::int64_t first_chunk,
                 std::int64_t last_chunk) {
  using V = Lanes<Real>;
  for (std::int64_t chunk = first_chunk; chunk < last_chunk; ++chunk) {
    for (int l = 0; l < rows; l += lane_count<Real>) {
      const auto wanted = __builtin_convertvector(
          load<typename Vector<float, lane_count<Real>>::Type>(levels.slot_share + chunk * rows + l), V);
      for (int i = 0; i < 3; ++i) {
        const auto moves = load<V>(a.inverse + (chunk * 9 + 4 * i) * rows + l) != Real(0);
        store(levels.share + (chunk * 3 + i) * rows + l, moves ? wanted : V{});
      }
    }
  }
}

// Q K Q^T for the symmetric K of all corners of a cell at once.
template <class Real>
void turn_corners(const LevelView<Real>& levels, std::int64_t cell) {
  using V = typename Vector<Real, 8>::Type;
  V k[6];
  for (int j = 0; j < 6; ++j)
    k[j] = __builtin_convertvector(
        load<typename Vector<float, 8>::Type>(levels.stiffness + 48 * cell + 8 * j), V);
  const V block[3][3] = {{k[0], k[1], k[2]}, {k[1], k[3], k[4]}, {k[2], k[4], k[5]}};
  const Real* q = levels.turns + 12 * cell;  // columns, padded to four
  V turned[8] = {};
  int number = 0;
  for (int i = 0; i < 3; ++i) {
    V half[3];
    for (int l = 0; l < 3; ++l)
      half[l] = q[i] * block[0][l] + q[4 + i] * block[1][l] + q[8 + i] * block[2][l];
    for (int j = i; j < 3; ++j) turned[number++] = half[0] * q[j] + half[1] * q[4 + j] + half[2] * q[8 + j];
  }
  transpose_groups(turned[0], turned[1], turned[2], turned[3]);
  transpose_groups(turned[4], turned[5], turned[6], turned[7]);
  Real* to = levels.turned + 64 * cell;
  for (int c = 0; c < 4; ++c) {
    Real numbers[8];
    for (int part = 0; part < 2; ++part) {  // number c of a group belongs to corner c, or 4 + c
      store(numbers, turned[4 * part + c]);
      std::memcpy(to + 8 * c + 4 * part, numbers, 4 * sizeof(Real));
      std::memcpy(to + 8 * (4 + c) + 4 * part, numbers + 4, 4 * sizeof(Real));
    }
  }
}

template <class Real>
void level_blocks(const LevelView<Real>& levels, std::int64_t first_node, std::int64_t last_node) {
  using F = Four<Real>;
  for (std::int64_t node = first_node; node < last_node; ++node) {
    const Real* added = levels.added + 8 * node;
    const Real mass = static_cast<Real>(levels.mass[node]);
    F low = load<F>(added) + F{mass, Real(0), Real(0), mass};
    F high = load<F>(added + 4) + F{Real(0), mass, Real(0), Real(0)};
    for (std::int32_t k = levels.corner_start[node]; k < levels.corner_start[node + 1]; ++k) {
      const Real* corner = levels.turned + 8 * static_cast<std::int64_t>(levels.corners[k]);
      low += load<F>(corner);
      high += load<F>(corner + 4);
    }
    const Real d[6] = {low[0], low[1], low[2], low[3], high[0], high[1]};
    store_inverse(d, static_cast<Real>(levels.weight[node]) * levels.up_count[node],
                  levels.inverse + 12 * node);
  }
}

}  // namespace

template <class Real>
SolverKernels<Real> solver_table() {
  return {multiply<Real>,       advance<Real>,          direct<Real>,      advance_packing<Real>,
          restrict_slots<Real>, restrict_nodes<Real>,   climb<Real>,       correct_nodes<Real>,
          correct<Real>,        direct_corrected<Real>, share_slots<Real>, turn_corners<Real>,
          level_blocks<Real>};
}
template SolverKernels<float> solver_table<float>();
template SolverKernels<double> solver_table<double>();

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
