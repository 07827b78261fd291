#include "engine/volume/min_plus.h"

#include <algorithm>
#include <cstring>

namespace sulcus {

namespace {

using Lanes4 = float __attribute__((vector_size(16)));
using Lanes8 = float __attribute__((vector_size(32)));
using Lanes16 = float __attribute__((vector_size(64)));

// best = min(best, row + add)
template <class Lanes, int vectors>
[[gnu::always_inline]] inline void take(Lanes (&best)[vectors], const float* row, float add) {
  constexpr int width = sizeof(Lanes) / sizeof(float);
  for (int v = 0; v < vectors; ++v) {
    Lanes other;
    std::memcpy(&other, row + v * width, sizeof other);
    other = other + add;
    best[v] = other < best[v] ? other : best[v];
  }
}

template <class Lanes, int vectors>
[[gnu::always_inline]] inline bool any_above(const Lanes (&best)[vectors], float limit) {
  Lanes4 largest = Lanes4{} + limit;
  for (int v = 0; v < vectors; ++v) {
    for (std::size_t part = 0; part < sizeof(Lanes) / sizeof(Lanes4); ++part) {
      Lanes4 four;
      std::memcpy(&four, reinterpret_cast<const char*>(&best[v]) + part * sizeof four, sizeof four);
      largest = largest < four ? four : largest;
    }
  }
  return largest[0] > limit || largest[1] > limit || largest[2] > limit || largest[3] > limit;
}

template <class Lanes>
[[gnu::always_inline]] inline void run(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                       const float* squares, const int* first) {
  constexpr int vectors = min_plus_lanes * sizeof(float) / sizeof(Lanes), together = 4;
  for (int n = 0; n < count; ++n) {
    float* at = whole + n * stride;
    Lanes best[vectors];
    std::memcpy(best, at, sizeof best);
    int r = first[n];
    const int both = std::min(n + 1, count - n);  // rows on both sides as far as this
    bool done = false;
    for (; r + together <= both && !done; r += together) {
      const float *low = half + (n - r) * stride, *high = half + (n + r + 1) * stride;
      for (int q = 0; q < together; ++q, low -= stride, high += stride) {
        take(best, low, squares[r + q]);
        take(best, high, squares[r + q]);
      }
      done = !any_above(best, squares[r + together]);
    }
    while (r < count && !done) {
      const int end = std::min(r + together, count);  // whether to stop is asked for several rows at once
      for (; r < end; ++r) {
        if (n - r >= 0) take(best, half + (n - r) * stride, squares[r]);
        if (n + r + 1 <= count) take(best, half + (n + r + 1) * stride, squares[r]);
      }
      done = !any_above(best, squares[end]);
    }
    std::memcpy(at, best, sizeof best);
  }
}

#if defined(__x86_64__)
[[gnu::target("avx512f")]] void run_avx512(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                           const float* squares, const int* first) {
  run<Lanes16>(whole, half, stride, count, squares, first);
}

[[gnu::target("avx2")]] void run_avx2(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                      const float* squares, const int* first) {
  run<Lanes8>(whole, half, stride, count, squares, first);
}
#endif

}  // namespace

void min_plus(float* whole, const float* half, std::ptrdiff_t stride, int count, const float* squares,
              const int* first) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f")) return run_avx512(whole, half, stride, count, squares, first);
  if (__builtin_cpu_supports("avx2")) return run_avx2(whole, half, stride, count, squares, first);
#endif
  run<Lanes4>(whole, half, stride, count, squares, first);
}

}  // namespace sulcus
