// Separation label pairs (thesis 2.4): two touching voxels whose labels form a pair are not connected, so
// that a closed fissure between two segments can open.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace sulcus {

struct SeparationPairs {
  // Each pair once, smaller label first, sorted; made so by make_separation_pairs.
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;

  // Whether labels a and b (any order) form a pair. Cost: a binary search.
  bool contains(std::int32_t a, std::int32_t b) const;

  // Whether two face-neighbouring voxels with labels a and b belong together: both non-empty, and no pair.
  bool connected(std::int32_t a, std::int32_t b) const {
    return a != 0 && b != 0 && (a == b || !contains(a, b));
  }
};

// Orders, sorts and removes duplicates. Throws InputError for a pair of equal labels or with label 0.
SeparationPairs make_separation_pairs(std::vector<std::pair<std::int32_t, std::int32_t>> pairs);

}  // namespace sulcus
