// The golden values of a scenario with their tolerances, for charts.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace sulcus {

struct GoldenBand {
  std::string series;
  std::size_t components = 1;
  std::vector<std::int64_t> steps;  // whose values are kept
  std::vector<double> values;       // [steps*components]
  double tolerance = 0;             // in the unit of the series
};

// Of dir/golden.json; none if it is missing or cannot be read (compare_golden says why).
std::vector<GoldenBand> golden_bands(const std::filesystem::path& dir);

}  // namespace sulcus
