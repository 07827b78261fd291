#include "engine/volume/min_plus.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>

namespace sulcus {

namespace {

using Lanes4 = float __attribute__((vector_size(16)));
using Lanes8 = float __attribute__((vector_size(32)));
using Lanes16 = float __attribute__((vector_size(64)));
using Ints4 = std::int32_t __attribute__((vector_size(16)));
using Ints8 = std::int32_t __attribute__((vector_size(32)));
using Ints16 = std::int32_t __attribute__((vector_size(64)));

constexpr float infinite = std::numeric_limits<float>::infinity();

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

// The half rows from which the columns' minima can come.
struct Range {
  int low, high;
};

// The same, with the row number of each minimum.
template <class Lanes, class Ints, int vectors>
[[gnu::always_inline]] inline void take_numbered(Lanes (&best)[vectors], Ints (&number)[vectors],
                                                 const float* row, float add, int n) {
  constexpr int width = sizeof(Lanes) / sizeof(float);
  for (int v = 0; v < vectors; ++v) {
    Lanes other;
    std::memcpy(&other, row + v * width, sizeof other);
    other = other + add;
    const Ints nearer = other < best[v];
    best[v] = nearer ? other : best[v];
    number[v] = nearer ? Ints{} + n : number[v];
  }
}

// The smallest r from `r` on with squares[r] >= all of best; or the largest r, down from `r`, before which
// that does not hold.
template <class Lanes, int vectors>
[[gnu::always_inline]] inline int reach_of(const Lanes (&best)[vectors], int count, const float* squares,
                                           int r) {
  Lanes largest = best[0];
  for (int v = 1; v < vectors; ++v) largest = largest < best[v] ? best[v] : largest;
  float limit = 0;
  for (std::size_t lane = 0; lane < sizeof(Lanes) / sizeof(float); ++lane)
    limit = limit < largest[lane] ? largest[lane] : limit;
  while (r < count && squares[r] < limit) ++r;
  while (r > 0 && !(squares[r - 1] < limit)) --r;
  return r;
}

// best = min(best, half + squares) for row n over the half rows of a range, from `first` to before `reach`
// rows away.
template <class Lanes>
[[gnu::always_inline]] inline void search_range(Lanes (&best)[min_plus_lanes * sizeof(float) / sizeof(Lanes)],
                                                int n, const Range& range, const float* half,
                                                std::ptrdiff_t stride, const float* squares, int first,
                                                int reach) {
  const int low = std::max(range.low, n - reach + 1), high = std::min(range.high, n + reach);
  for (int m = std::min(range.high, n - first); m >= low; --m) take(best, half + m * stride, squares[n - m]);
  for (int m = std::max(range.low, n + 1 + first); m <= high; ++m)
    take(best, half + m * stride, squares[m - n - 1]);
}

// best = min over the half rows of a range of half + squares for row n; returns the rows that came from.
template <class Lanes, class Ints>
[[gnu::always_inline]] inline Range search_numbered(
    Lanes (&best)[min_plus_lanes * sizeof(float) / sizeof(Lanes)], int n, const Range& range,
    const float* half, std::ptrdiff_t stride, const float* squares) {
  constexpr int vectors = min_plus_lanes * sizeof(float) / sizeof(Lanes), width = sizeof(Lanes) / 4;
  Ints number[vectors];
  for (int v = 0; v < vectors; ++v) {
    best[v] = Lanes{} + infinite;
    number[v] = Ints{} + range.low;  // where there is no minimum, any row will do
  }
  for (int m = range.low; m <= range.high; ++m)
    take_numbered(best, number, half + m * stride, squares[m <= n ? n - m : m - n - 1], m);
  Range found{range.high, range.low};
  for (int v = 0; v < vectors; ++v) {
    for (int lane = 0; lane < width; ++lane) {
      found.low = std::min(found.low, number[v][lane]);
      found.high = std::max(found.high, number[v][lane]);
    }
  }
  return found;
}

// The half row of a column's minimum never moves down as the row moves up. So every sixteenth row looks for
// the number of that half row, and those between only look where the two around them found it. (Rounding
// cannot spoil that: from row to row the order of two half rows changes by at least two squared spacings, far
// more than an error of a sum of squares.) And from row to row a distance grows by a spacing at most.
template <class Lanes, class Ints>
[[gnu::always_inline]] inline void run(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                       const float* squares, const int* first) {
  constexpr int apart = 16, rounding = 1;
  Lanes best[min_plus_lanes * sizeof(float) / sizeof(Lanes)];
  Range before{first[0], count - first[count - 1]};  // half rows before and behind are infinite
  const int last = before.high;
  int reach = count, half_reach = count;  // of the last row: nothing from there on can be nearer
  const auto fill = [&](int begin, int end, const Range& range) {
    for (int n = begin; n < end; ++n) {
      std::memcpy(best, whole + n * stride, sizeof best);
      search_range(best, n, range, half, stride, squares, first[n], std::min(reach + 1 + rounding, count));
      std::memcpy(whole + n * stride, best, sizeof best);
      reach = reach_of(best, count, squares, reach);
    }
  };
  for (int n = 0; n < count; n += apart) {
    const int around = std::min(half_reach + apart + rounding, count);
    const Range here = search_numbered<Lanes, Ints>(
        best, n, {std::max(before.low, n - around + 1), std::min(last, n + around)}, half, stride, squares);
    half_reach = reach_of(best, count, squares, std::min(half_reach, count - 1));
    take(best, whole + n * stride, 0.0F);
    std::memcpy(whole + n * stride, best, sizeof best);
    if (n > 0) fill(n - apart + 1, n, {before.low, here.high});
    std::memcpy(best, whole + n * stride, sizeof best);
    reach = reach_of(best, count, squares, reach);
    before = here;
  }
  fill((count - 1) / apart * apart + 1, count, {before.low, last});
}

#if defined(__x86_64__)
[[gnu::target("avx512f")]] void run_avx512(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                           const float* squares, const int* first) {
  run<Lanes16, Ints16>(whole, half, stride, count, squares, first);
}

[[gnu::target("avx2")]] void run_avx2(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                      const float* squares, const int* first) {
  run<Lanes8, Ints8>(whole, half, stride, count, squares, first);
}
#endif

}  // namespace

void min_plus(float* whole, const float* half, std::ptrdiff_t stride, int count, const float* squares,
              const int* first) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f")) return run_avx512(whole, half, stride, count, squares, first);
  if (__builtin_cpu_supports("avx2")) return run_avx2(whole, half, stride, count, squares, first);
#endif
  run<Lanes4, Ints4>(whole, half, stride, count, squares, first);
}

}  // namespace sulcus
