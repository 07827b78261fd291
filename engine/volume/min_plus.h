// The inner kernel of the distance transform. In a file of its own because it is compiled for several
// register widths and chosen at run time; minima and sums of the same numbers give the same bits in all of
// them.
#pragma once

#include <cstddef>

namespace sulcus {

inline constexpr int min_plus_lanes = 32;  // columns that go through a pass together

// half[m] = min(half[m], whole[m - 1], whole[m]) in `width` columns of `count` whole and count + 1 half rows,
// `stride` floats apart; half row m lies between the whole rows m - 1 and m.
void take_neighbours(const float* whole, float* half, std::ptrdiff_t stride, int count, int width);

// For min_plus_lanes columns of `count` rows, in place:
//   whole[n] = min(whole[n], min over m of half[m] + squares[r]), r = n - m for m <= n, m - n - 1 for m > n
// half: as take_neighbours leaves it; squares[r] = ((r + 1/2) spacing)^2, ascending, count + 2 of them. Rows
// stand `stride` floats apart. first[n]: the smallest r at which a row of `half` has finite numbers (count or
// more: none has). Cost: about 20 rows of `half` for each row, less near the boundary.
void min_plus(float* whole, const float* half, std::ptrdiff_t stride, int count, const float* squares,
              const int* first);

}  // namespace sulcus
