// The inner kernel of the distance transform. In a header of its own because it is compiled for several
// register widths and chosen at run time; minima and sums of the same numbers give the same bits in all of
// them.
#pragma once

#include <vector>

namespace sulcus {

inline constexpr int min_plus_lanes = 32;  // columns that go through a pass together

// For `count` rows of min_plus_lanes columns, a column at a time:
//   out[n] = min(whole[n], min over m of half[m] + squares[r]), r = n - m for m <= n, m - n - 1 for m > n
// half: count + 1 rows, row m lies between the whole rows m - 1 and m; squares[r] = ((r + 1/2) spacing)^2,
// ascending. first[n]: the smallest r at which a row of `half` has finite numbers (at least count: none has).
// whole and out may be the same. Cost: stops at the first r with squares[r] >= out[n] in all columns.
void min_plus(const float* whole, const float* half, int count, const float* squares, const int* first,
              float* out);

}  // namespace sulcus
