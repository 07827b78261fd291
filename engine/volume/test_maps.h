// Label maps for the tests of volume and mesh.
#pragma once

#include <random>

#include "engine/volume/label_map.h"
#include "engine/volume/separation.h"

namespace sulcus {

using Random = std::mt19937_64;  // raw output only: the same numbers everywhere

inline int random_below(Random& random, int limit) {
  return static_cast<int>(random() % static_cast<unsigned>(limit));
}

inline LabelMap empty_map(const Index3& size) {
  LabelMap map;
  map.size = size;
  map.labels.assign(static_cast<std::size_t>(size[0]) * size[1] * size[2], 0);
  return map;
}

// Labels 0 .. label_count at random, in grains of 1 to 3 voxels so that pieces and gaps of all sizes occur.
inline LabelMap random_map(Random& random, const Index3& size, int label_count) {
  LabelMap map = empty_map(size);
  const int grain = 1 + random_below(random, 3), empty_share = random_below(random, 4);
  std::vector<std::int32_t> grains(map.labels.size());
  for (auto& label : grains) {
    label = random_below(random, 4) < empty_share ? 0 : 1 + random_below(random, label_count);
  }
  for (int k = 0; k < size[2]; ++k) {
    for (int j = 0; j < size[1]; ++j) {
      for (int i = 0; i < size[0]; ++i)
        map.labels[map.index(i, j, k)] = grains[map.index(i / grain, j / grain, k / grain)];
    }
  }
  return map;
}

inline SeparationPairs random_pairs(Random& random, int label_count) {
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  if (label_count > 1) {
    for (int n = random_below(random, label_count + 1); n > 0; --n) {
      const int a = 1 + random_below(random, label_count), b = 1 + random_below(random, label_count);
      if (a != b) pairs.emplace_back(a, b);
    }
  }
  return make_separation_pairs(pairs);
}

}  // namespace sulcus
