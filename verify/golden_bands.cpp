#include "verify/golden_bands.h"

#include <fstream>
#include <nlohmann/json.hpp>

namespace sulcus {

std::vector<GoldenBand> golden_bands(const std::filesystem::path& dir) {
  std::ifstream file(dir / "golden.json");
  const auto golden = nlohmann::json::parse(file, nullptr, false);
  std::vector<GoldenBand> bands;
  try {
    const auto steps = golden.at("steps_kept").get<std::vector<std::int64_t>>();
    for (const auto& [name, entry] : golden.at("series").items()) {
      GoldenBand band{name, entry.at("components").get<std::size_t>(), steps,
                      entry.at("values").get<std::vector<double>>(), entry.at("tolerance").get<double>()};
      if (band.components > 0 && band.values.size() == steps.size() * band.components)
        bands.push_back(std::move(band));
    }
  } catch (const nlohmann::json::exception&) {
    return {};
  }
  return bands;
}

}  // namespace sulcus
