// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/solver/kernels.h"

#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

constexpr int rows = 16;

#define SULCUS_MEMBER inline __attribute__((always_inline))

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

#ifndef SULCUS_FREE_ORDER
// 16 running sums, one sum a block.
template <class Real>
struct RunningSum {
  alignas(64) Real running[rows] = {};

  SULCUS_MEMBER void add(int l, const Lanes<Real>& v) {
    store(running + l, load<Lanes<Real>>(running + l) + v);
  }
  SULCUS_MEMBER void end_block(double* sum) {
    *sum = tree_sum(running);
    for (Real& r : running) r = 0;
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

template <class Real>
void advance(const RowMatrix<Real>& a, Real alpha, const Real* p, const Real* q, Real* x, Real* r, Real* z,
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
      }
    }
    sum.end_block(sums + block);
  }
  if (first_block < last_block) sum.end(sums + first_block);
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
      transpose_groups(d[0], d[1], d[2], d[3]);
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
