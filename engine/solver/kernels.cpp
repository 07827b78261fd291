// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/solver/kernels.h"

#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

constexpr int rows = 16;

// Sum of 16 running sums by a fixed tree.
template <class Real>
SULCUS_INLINE double tree_sum(const Real* sums) {
  double s[rows];
  for (int l = 0; l < rows; ++l) s[l] = static_cast<double>(sums[l]);
  for (int width = rows / 2; width > 0; width /= 2) {
    for (int l = 0; l < width; ++l) s[l] += s[l + width];
  }
  return s[0];
}

SULCUS_INLINE std::int64_t last_chunk(std::int64_t block, std::int64_t chunks) {
  const std::int64_t last = (block + 1) * chunks_per_block;
  return last < chunks ? last : chunks;
}

template <class Real, int count>
struct Vector {
  typedef Real Type __attribute__((vector_size(count * sizeof(Real))));
};

// The packed entries of slots column[0], column[4], column[8], ..., one behind the other: count numbers.
template <class Real, int count>
SULCUS_INLINE typename Vector<Real, count>::Type packed_entries(const Real* packed,
                                                                const std::int32_t* column) {
  if constexpr (count == 4) {
    return load<Four<Real>>(packed + 4 * static_cast<std::int64_t>(column[0]));
  } else {
    const auto low = packed_entries<Real, count / 2>(packed, column);
    const auto high = packed_entries<Real, count / 2>(packed, column + count / 2);
    if constexpr (count == 8) {
      return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
    } else {
      return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
  }
}

// x, y and z of the slots column[0 .. lanes): one load a slot, then 4x4 transposes within groups of four
// lanes.
template <class Real>
SULCUS_INLINE void gather(const Real* packed, const std::int32_t* column, Lanes<Real>& x, Lanes<Real>& y,
                          Lanes<Real>& z) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  if constexpr (n < 4) {
    for (int k = 0; k < n; ++k) {
      const Real* from = packed + 4 * static_cast<std::int64_t>(column[k]);
      x[k] = from[0];
      y[k] = from[1];
      z[k] = from[2];
    }
  } else {
    const V a = packed_entries<Real, n>(packed, column), b = packed_entries<Real, n>(packed, column + 1);
    const V c = packed_entries<Real, n>(packed, column + 2), d = packed_entries<Real, n>(packed, column + 3);
    if constexpr (n == 4) {
      const V ab = __builtin_shufflevector(a, b, 0, 4, 1, 5), cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
      const V ab_z = __builtin_shufflevector(a, b, 2, 6, 3, 7),
              cd_z = __builtin_shufflevector(c, d, 2, 6, 3, 7);
      x = __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
      y = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
      z = __builtin_shufflevector(ab_z, cd_z, 0, 1, 4, 5);
    } else if constexpr (n == 8) {
      const V ab = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
      const V cd = __builtin_shufflevector(c, d, 0, 8, 1, 9, 4, 12, 5, 13);
      const V ab_z = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
      const V cd_z = __builtin_shufflevector(c, d, 2, 10, 3, 11, 6, 14, 7, 15);
      x = __builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13);
      y = __builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15);
      z = __builtin_shufflevector(ab_z, cd_z, 0, 1, 8, 9, 4, 5, 12, 13);
    } else {
      const V ab = __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
      const V cd = __builtin_shufflevector(c, d, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
      const V ab_z =
          __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
      const V cd_z =
          __builtin_shufflevector(c, d, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
      x = __builtin_shufflevector(ab, cd, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
      y = __builtin_shufflevector(ab, cd, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
      z = __builtin_shufflevector(ab_z, cd_z, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
    }
  }
}

template <class Real>
void multiply(const RowMatrix<Real>& a, const Real* p, const Real* packed, Real* q, double* sums,
              std::int64_t first_block, std::int64_t last_block) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    alignas(64) Real running[rows] = {};
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
          gather<Real>(packed, column, x0, x1, x2);
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
        store(running + l, load<V>(running + l) + (px * y[0] + py * y[1] + pz * y[2]));
      }
    }
    sums[block] = tree_sum(running);
  }
}

template <class Real>
void advance(const RowMatrix<Real>& a, Real alpha, const Real* p, const Real* q, Real* x, Real* r, Real* z,
             double* sums, std::int64_t first_block, std::int64_t last_block) {
  using V = Lanes<Real>;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    alignas(64) Real running[rows] = {};
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
        V sum{};
        for (int i = 0; i < 3; ++i) {
          const Real* d = inverse + 3 * i * rows + l;
          const V out = load<V>(d) * residual[0] + load<V>(d + rows) * residual[1] +
                        load<V>(d + 2 * rows) * residual[2];
          store(z + at + i * rows, out);
          sum += residual[i] * out;
        }
        store(running + l, load<V>(running + l) + sum);
      }
    }
    sums[block] = tree_sum(running);
  }
}

template <class Real>
void direct(const RowMatrix<Real>& a, Real beta, const Real* z, Real* p, Real* packed,
            std::int64_t first_block, std::int64_t last_block) {
  using F = Four<Real>;
  if (first_block >= last_block) return;
  for (std::int64_t chunk = first_block * chunks_per_block; chunk < last_chunk(last_block - 1, a.chunks);
       ++chunk) {
    for (int l = 0; l < rows; l += 4) {
      const std::int64_t at = chunk * 3 * rows + l;
      F d[4] = {};
      for (int i = 0; i < 3; ++i) {
        d[i] = load<F>(z + at + i * rows) + beta * load<F>(p + at + i * rows);
        store(p + at + i * rows, d[i]);
      }
      transpose<Real>(d[0], d[1], d[2], d[3]);
      for (int k = 0; k < 4; ++k) store(packed + 4 * (chunk * rows + l + k), d[k]);
    }
  }
}

}  // namespace

template <class Real>
SolverKernels<Real> solver_table() {
  return {multiply<Real>, advance<Real>, direct<Real>};
}
template SolverKernels<float> solver_table<float>();
template SolverKernels<double> solver_table<double>();

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
