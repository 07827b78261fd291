// The tables are ours: paths through CIELAB of linearly rising lightness, cut into 16 steps of equal Delta E.
#include <algorithm>
#include <cmath>

#include "verify/picture.h"

namespace sulcus {
namespace {

constexpr int table_size = 17;

constexpr std::array<Colour, table_size> sea_table{{{45, 28, 76},
                                                    {50, 52, 109},
                                                    {43, 76, 140},
                                                    {17, 92, 149},
                                                    {4, 106, 148},
                                                    {3, 120, 147},
                                                    {4, 136, 147},
                                                    {4, 151, 146},
                                                    {6, 166, 142},
                                                    {26, 178, 134},
                                                    {60, 189, 123},
                                                    {93, 200, 112},
                                                    {123, 211, 100},
                                                    {152, 220, 88},
                                                    {182, 228, 75},
                                                    {211, 234, 62},
                                                    {241, 239, 50}}};

constexpr std::array<Colour, table_size> ember_table{{{19, 14, 33},
                                                      {39, 24, 61},
                                                      {66, 31, 87},
                                                      {98, 32, 108},
                                                      {134, 26, 112},
                                                      {163, 17, 106},
                                                      {186, 16, 96},
                                                      {205, 28, 84},
                                                      {220, 46, 71},
                                                      {236, 70, 59},
                                                      {252, 100, 55},
                                                      {255, 132, 68},
                                                      {255, 160, 87},
                                                      {255, 188, 108},
                                                      {255, 215, 138},
                                                      {255, 234, 177},
                                                      {255, 247, 215}}};

}  // namespace

Colour colour_of(ColourMap map, double share) {
  if (std::isnan(share)) return {128, 128, 128};
  const auto& table = map == ColourMap::sea ? sea_table : ember_table;
  const double place = std::clamp(share, 0.0, 1.0) * (table_size - 1);
  const int below = std::min(static_cast<int>(place), table_size - 2);
  const double rest = place - below;
  Colour colour;
  for (std::size_t c = 0; c < 3; ++c) {
    const double low = table[static_cast<std::size_t>(below)][c];
    const double high = table[static_cast<std::size_t>(below) + 1][c];
    colour[c] = static_cast<std::uint8_t>(low + (high - low) * rest + 0.5);
  }
  return colour;
}

}  // namespace sulcus
