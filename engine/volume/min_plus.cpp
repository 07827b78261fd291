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
  constexpr int width = sizeof(Lanes) / sizeof(float);
  float numbers[width];
  std::memcpy(numbers, &largest, sizeof largest);
  for (int left = width / 2; left > 0; left /= 2) {
    for (int lane = 0; lane < left; ++lane)
      numbers[lane] = numbers[lane] < numbers[lane + left] ? numbers[lane + left] : numbers[lane];
  }
  const float limit = numbers[0];
  while (r < count && squares[r] < limit) ++r;
  while (r > 0 && !(squares[r - 1] < limit)) --r;
  return r;
}

// best[k] = min(best[k], half + squares) for the `rows` rows from n on over the half rows of a range, from
// `first` before the first of them or behind the last one to before `reach` rows away from them.
template <int rows, class Lanes>
[[gnu::always_inline]] inline void search_range(
    Lanes (&best)[rows][min_plus_lanes * sizeof(float) / sizeof(Lanes)], int n, const Range& range,
    const float* half, std::ptrdiff_t stride, const float* squares, int first, int reach) {
  const int low = std::max(range.low, n - reach + 1), high = std::min(range.high, n + rows - 1 + reach);
  for (int m = std::min(range.high, n - first); m >= low; --m) {
    for (int k = 0; k < rows; ++k) take(best[k], half + m * stride, squares[n + k - m]);
  }
  for (int m = std::max(low, n + 1); m <= std::min(high, n + rows - 1); ++m) {
    for (int k = 0; k < rows; ++k)
      take(best[k], half + m * stride, squares[m <= n + k ? n + k - m : m - n - k - 1]);
  }
  for (int m = std::max(range.low, n + rows + first); m <= high; ++m) {
    for (int k = 0; k < rows; ++k) take(best[k], half + m * stride, squares[m - n - k - 1]);
  }
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

// What is known of a row: the half rows that its minima came from, and how far away nothing can be nearer.
struct Known {
  Range range;
  int reach;
};

// The half row of a column's minimum never moves down as the row moves up. So a few rows far apart look for
// the number of that half row, then some between them only where the two around them found it, and the rows
// between those look, two at a time, for the minimum alone. (Rounding cannot spoil that: from row to row the
// order of two half rows changes by at least two squared spacings, far more than an error of a sum of
// squares.) And from row to row a distance grows by a spacing at most.
template <class Lanes, class Ints>
[[gnu::always_inline]] inline void run(float* whole, const float* half, std::ptrdiff_t stride, int count,
                                       const float* squares, const int* first) {
  constexpr int far_apart = 68, apart = 17, rounding = 1;
  constexpr int vectors = min_plus_lanes * sizeof(float) / sizeof(Lanes);
  const int last = count - first[count - 1];  // half rows behind it are infinite
  const auto find = [&](int n, const Range& range, int reach) __attribute__((always_inline)) {
    Lanes best[vectors];
    reach = std::min(reach + rounding, count);
    Known known{search_numbered<Lanes, Ints>(
                    best, n, {std::max(range.low, n - reach + 1), std::min(range.high, n + reach)}, half,
                    stride, squares),
                0};
    known.reach = reach_of(best, count, squares, std::min(reach, count - 1));
    take(best, whole + n * stride, 0.0F);
    std::memcpy(whole + n * stride, best, sizeof best);
    return known;
  };
  int reach = count;  // of the last row
  const auto fill = [&]<int rows>(int n, const Range& range) __attribute__((always_inline)) {
    Lanes best[rows][vectors];
    int nearest = first[n];
    for (int k = 0; k < rows; ++k) {
      std::memcpy(best[k], whole + (n + k) * stride, sizeof best[k]);
      nearest = std::min(nearest, first[n + k]);
    }
    search_range<rows>(best, n, range, half, stride, squares, nearest,
                       std::min(reach + rows + rounding, count));
    for (int k = 0; k < rows; ++k) std::memcpy(whole + (n + k) * stride, best[k], sizeof best[k]);
    reach = reach_of(best[rows - 1], count, squares, reach);
  };
  Known before = find(0, {first[0], last}, count);
  for (int n = 0; n < count - 1;) {
    const int end = std::min(n + far_apart, count - 1);
    const Known behind = find(end, {before.range.low, last}, before.reach + end - n);
    while (n < end) {
      const int next = std::min(n + apart, end);
      const Known here =
          next < end ? find(next, {before.range.low, behind.range.high}, before.reach + next - n) : behind;
      const Range between{before.range.low, here.range.high};
      reach = before.reach;
      for (++n; n + 1 < next; n += 2) fill.template operator()<2>(n, between);
      if (n < next) fill.template operator()<1>(n, between);
      n = next;
      before = here;
    }
  }
}

[[gnu::always_inline]] inline void take_rows(const float* whole, float* half, std::ptrdiff_t stride,
                                             int count, int width) {
  for (int m = 0; m <= count; ++m) {
    const float* before = whole + std::max(m - 1, 0) * stride;
    const float* after = whole + std::min(m, count - 1) * stride;
    float* to = half + m * stride;
    for (int c = 0; c < width; ++c) to[c] = std::min(to[c], std::min(before[c], after[c]));
  }
}

#if defined(__x86_64__)
[[gnu::target("avx2")]] void take_rows_avx2(const float* whole, float* half, std::ptrdiff_t stride, int count,
                                            int width) {
  take_rows(whole, half, stride, count, width);
}

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

void take_neighbours(const float* whole, float* half, std::ptrdiff_t stride, int count, int width) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return take_rows_avx2(whole, half, stride, count, width);
#endif
  take_rows(whole, half, stride, count, width);
}

void min_plus(float* whole, const float* half, std::ptrdiff_t stride, int count, const float* squares,
              const int* first) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f")) return run_avx512(whole, half, stride, count, squares, first);
  if (__builtin_cpu_supports("avx2")) return run_avx2(whole, half, stride, count, squares, first);
#endif
  run<Lanes4, Ints4>(whole, half, stride, count, squares, first);
}

}  // namespace sulcus
