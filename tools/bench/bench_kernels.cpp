// Compiled once for each instruction set; see CMakeLists.txt.
#include "tools/bench/bench_kernels.h"

#include <utility>

#include "engine/fem/rotation_lanes.h"
#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

template <class Real>
double read(const Real* from, std::int64_t count) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  V sums[8] = {};
  for (std::int64_t i = 0; i < count; i += 8 * n) {
    for (int k = 0; k < 8; ++k) sums[k] += load<V>(from + i + k * n);
  }
  V all{};
  for (const V& sum : sums) all += sum;
  return static_cast<double>(all[0]);
}

// One multiplication and one addition of twelve registers each; written out, so that they stay in registers.
template <class V, std::size_t... k>
SULCUS_INLINE void operate(V* products, V* sums, const V& factor, const V& term, std::index_sequence<k...>) {
  ((products[k] *= factor, sums[k] += term), ...);
}

template <class Real>
double arithmetic(std::int64_t rounds) {
  using V = Lanes<Real>;
  constexpr int chains = sizeof(V) == 64 ? 12 : 6;
  Real one = Real(1), small = Real(1e-6);
  asm volatile("" : "+x"(one), "+x"(small));  // unknown to the compiler
  const V factor = V{} + one, term = V{} + small;
  V products[chains], sums[chains];
  for (int k = 0; k < chains; ++k) products[k] = sums[k] = factor;
  for (std::int64_t round = 0; round < rounds; ++round)
    operate(products, sums, factor, term, std::make_index_sequence<chains>());
  V all{};
  for (int k = 0; k < chains; ++k) all += products[k] + sums[k];
  volatile Real sink = all[0];
  (void)sink;
  return static_cast<double>(rounds) * 2 * chains * lane_count<Real>;
}

template <class Real>
void rotate_all(const Real* gradients, std::int64_t count, double* rotations, Real* matrices) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  Turning<Real> tile[tile_registers];
  for (std::int64_t first = 0; first < count; first += tile_registers * n) {
    const std::int64_t left = (count - first) / n;
    const int registers = left < tile_registers ? static_cast<int>(left) : tile_registers;
    for (int r = 0; r < registers; ++r) {
      const std::int64_t e = first + r * n;
      for (int k = 0; k < 9; ++k) tile[r].f[k] = load<V>(gradients + (e / 16 * 9 + k) * 16 + e % 16);
      tile[r].count = n;
      tile[r].rotations = rotations + 4 * e;
    }
    rotate(tile, registers);
    for (int r = 0; r < registers; ++r) {
      const std::int64_t e = first + r * n;
      const Rotation<Real> matrix = matrix_of<Real>(tile[r].q);
      for (int k = 0; k < 9; ++k) store(matrices + (e / 16 * 9 + k) * 16 + e % 16, matrix.r[k]);
    }
  }
}

}  // namespace

template <class Real>
BenchKernels<Real> bench_table() {
  return {read<Real>, arithmetic<Real>, rotate_all<Real>};
}
template BenchKernels<float> bench_table<float>();
template BenchKernels<double> bench_table<double>();

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
