// What the machine can do, measured in the benchmark's own process: a kernel's time means something only
// beside it.
#pragma once

#include <cstdint>

#include "engine/numerics/isa.h"
#include "tools/bench/bench_kernels.h"

namespace sulcus {

template <class Real>
BenchKernels<Real> bench_kernels(Isa isa);

struct MachineLimits {
  std::int64_t l2_bytes = 0, l3_bytes = 0;      // of one core; of all
  double l2_B_s = 0, l3_B_s = 0, dram_B_s = 0;  // B/s, read, `threads` threads
  double single_flop_s = 0, double_flop_s = 0;  // 1/s, without fused multiply-add
};
MachineLimits measure_limits(int threads);

// Shortest time [s] for reading `bytes` that stay in the caches between calls, and for `operations`.
struct Demand {
  double bytes = 0, operations = 0;
  bool double_precision = false;
};
struct Bound {
  double seconds = 0;
  const char* by = "";  // "L2", "L3", "DRAM" or "rate"; nothing without limits
};
Bound shortest_time(const MachineLimits& limits, int threads, const Demand& demand);

}  // namespace sulcus
