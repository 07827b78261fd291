#include "engine/volume/min_plus.h"

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace sulcus {

namespace {

using Lanes4 = float __attribute__((vector_size(16)));
using Lanes8 = float __attribute__((vector_size(32)));
using Lanes16 = float __attribute__((vector_size(64)));

template <class Lanes>
[[gnu::always_inline]] inline Lanes load(const float* from) {
  Lanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

template <class Lanes>
[[gnu::always_inline]] inline void run(const float* whole, const float* half, int count, const float* squares,
                                       const int* first, float* out) {
  constexpr int width = sizeof(Lanes) / sizeof(float), vectors = min_plus_lanes / width;
  for (int n = 0; n < count; ++n) {
    Lanes best[vectors];
    for (int v = 0; v < vectors; ++v) best[v] = load<Lanes>(whole + n * min_plus_lanes + v * width);
    for (int r = first[n]; r < count; ++r) {
      const Lanes add = Lanes{} + squares[r];
      if (n - r >= 0) {
        const float* row = half + static_cast<std::ptrdiff_t>(n - r) * min_plus_lanes;
        for (int v = 0; v < vectors; ++v) {
          const Lanes other = load<Lanes>(row + v * width) + add;
          best[v] = other < best[v] ? other : best[v];
        }
      }
      if (n + r + 1 <= count) {
        const float* row = half + static_cast<std::ptrdiff_t>(n + r + 1) * min_plus_lanes;
        for (int v = 0; v < vectors; ++v) {
          const Lanes other = load<Lanes>(row + v * width) + add;
          best[v] = other < best[v] ? other : best[v];
        }
      }
      // The largest of all columns decides whether a farther row can still be nearer.
      Lanes largest = best[0];
      for (int v = 1; v < vectors; ++v) largest = largest < best[v] ? best[v] : largest;
      const auto above = largest > squares[r + 1];
      bool go_on = false;
      std::uint64_t words[sizeof(Lanes) / 8];
      std::memcpy(words, &above, sizeof words);
      for (const std::uint64_t word : words) go_on |= word != 0;
      if (!go_on) break;
    }
    for (int v = 0; v < vectors; ++v)
      std::memcpy(out + n * min_plus_lanes + v * width, &best[v], sizeof(Lanes));
  }
}

#if defined(__x86_64__)
[[gnu::target("avx512f,avx512vl,avx512dq,avx512bw")]] void run_avx512(const float* whole, const float* half,
                                                                      int count, const float* squares,
                                                                      const int* first, float* out) {
  run<Lanes16>(whole, half, count, squares, first, out);
}

[[gnu::target("avx2")]] void run_avx2(const float* whole, const float* half, int count, const float* squares,
                                      const int* first, float* out) {
  run<Lanes8>(whole, half, count, squares, first, out);
}
#endif

}  // namespace

void min_plus(const float* whole, const float* half, int count, const float* squares, const int* first,
              float* out) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512vl")) return run_avx512(whole, half, count, squares, first, out);
  if (__builtin_cpu_supports("avx2")) return run_avx2(whole, half, count, squares, first, out);
#endif
  run<Lanes4>(whole, half, count, squares, first, out);
}

}  // namespace sulcus
