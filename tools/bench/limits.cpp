#include "tools/bench/limits.h"

#include <omp.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <vector>

#include "engine/numerics/aligned.h"
#include "engine/numerics/team.h"

namespace sulcus {

#define SULCUS_DECLARE(name)        \
  namespace name {                  \
  template <class Real>             \
  BenchKernels<Real> bench_table(); \
  }
SULCUS_DECLARE(isa_sse2)
SULCUS_DECLARE(isa_avx2)
SULCUS_DECLARE(isa_avx512)
#undef SULCUS_DECLARE

template <class Real>
BenchKernels<Real> bench_kernels(Isa isa) {
  if (isa == Isa::avx512) return isa_avx512::bench_table<Real>();
  return isa == Isa::avx2 ? isa_avx2::bench_table<Real>() : isa_sse2::bench_table<Real>();
}
template BenchKernels<float> bench_kernels<float>(Isa);
template BenchKernels<double> bench_kernels<double>(Isa);

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Best time of one call of work(thread) by all threads at once.
template <class Work>
double best_time(int threads, int repetitions, const Work& work) {
  double best = 1e9;
  SpinBarrier barrier(threads);
#pragma omp parallel num_threads(threads)
  {
    const int thread = omp_get_thread_num();
    for (int r = 0; r < repetitions; ++r) {
      barrier.wait();
      const auto start = Clock::now();
      work(thread);
      barrier.wait();
      if (thread == 0) best = std::min(best, seconds_since(start));
    }
  }
  return best;
}

// B/s that all threads together read, each its own part of `bytes`, again and again.
double read_rate(std::int64_t bytes, int threads) {
  const auto kernels = bench_kernels<float>(widest_isa());
  const std::int64_t part = bytes / 4 / threads / 1024 * 1024;
  AlignedVector<float> data(static_cast<std::size_t>(part * threads), 1.0f);
  std::vector<double> sums(static_cast<std::size_t>(64 * threads));
  const auto calls = std::max<std::int64_t>(1, (32 << 20) / bytes);  // at least 32 MB a measurement
  const double time = best_time(threads, 25, [&](int thread) {
    for (std::int64_t c = 0; c < calls; ++c)
      sums[static_cast<std::size_t>(64 * thread)] += kernels.read(data.data() + part * thread, part);
  });
  return static_cast<double>(4 * part * threads * calls) / time;
}

template <class Real>
double arithmetic_rate(int threads) {
  const auto kernels = bench_kernels<Real>(widest_isa());
  std::vector<double> done(static_cast<std::size_t>(64 * threads));
  const double time = best_time(threads, 15, [&](int thread) {
    done[static_cast<std::size_t>(64 * thread)] = kernels.arithmetic(100000);
  });
  return threads * done[0] / time;
}

std::int64_t cache_size(int name, std::int64_t otherwise) {
  const long size = sysconf(name);
  return size > 0 ? size : otherwise;
}

}  // namespace

MachineLimits measure_limits(int threads) {
  MachineLimits limits;
  limits.l2_bytes = cache_size(_SC_LEVEL2_CACHE_SIZE, 512 << 10);
  // a virtual machine may name the sum over all core complexes of its host; one complex has no more than this
  limits.l3_bytes = std::min<std::int64_t>(cache_size(_SC_LEVEL3_CACHE_SIZE, 16 << 20), 32 << 20);
  limits.l2_B_s = read_rate(limits.l2_bytes / 2 * threads, threads);
  limits.l3_B_s = read_rate(std::min<std::int64_t>(8 << 20, limits.l3_bytes / 2), threads);
  limits.dram_B_s = read_rate(256 << 20, threads);
  limits.single_flop_s = arithmetic_rate<float>(threads);
  limits.double_flop_s = arithmetic_rate<double>(threads);
  return limits;
}

Bound shortest_time(const MachineLimits& limits, int threads, const Demand& demand) {
  if (limits.dram_B_s == 0) return {};
  const bool in_l2 = demand.bytes < static_cast<double>(limits.l2_bytes * threads);
  const bool in_l3 = demand.bytes < static_cast<double>(limits.l3_bytes);
  const double reading = demand.bytes / (in_l2 ? limits.l2_B_s : in_l3 ? limits.l3_B_s : limits.dram_B_s);
  const double computing =
      demand.operations / (demand.double_precision ? limits.double_flop_s : limits.single_flop_s);
  if (computing > reading) return {computing, "rate"};
  return {reading, in_l2 ? "L2" : in_l3 ? "L3" : "DRAM"};
}

}  // namespace sulcus
