// For tests: numbers in a range from a seeded generator, the same with every standard library.
#pragma once

#include <random>

namespace sulcus {

inline double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
}

}  // namespace sulcus
