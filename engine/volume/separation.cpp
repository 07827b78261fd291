#include "engine/volume/separation.h"

#include <algorithm>
#include <string>

#include "engine/numerics/error.h"

namespace sulcus {

bool SeparationPairs::contains(std::int32_t a, std::int32_t b) const {
  return std::binary_search(pairs.begin(), pairs.end(), std::pair(std::min(a, b), std::max(a, b)));
}

SeparationPairs make_separation_pairs(std::vector<std::pair<std::int32_t, std::int32_t>> pairs) {
  for (auto& [a, b] : pairs) {
    const std::string name = "separation pair {" + std::to_string(a) + ", " + std::to_string(b) + "}: ";
    if (a == b) throw InputError(name + "the labels are equal; a pair needs two different labels");
    if (a == 0 || b == 0) throw InputError(name + "label 0 is empty space; give two labels other than 0");
    if (a > b) std::swap(a, b);
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return {std::move(pairs)};
}

}  // namespace sulcus
