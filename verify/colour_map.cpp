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

constexpr std::array<Colour, table_size> ember_table{{{37, 62, 114},
                                                      {72, 69, 136},
                                                      {106, 73, 152},
                                                      {141, 73, 159},
                                                      {171, 70, 155},
                                                      {196, 66, 146},
                                                      {217, 64, 135},
                                                      {233, 66, 122},
                                                      {246, 74, 108},
                                                      {254, 94, 100},
                                                      {255, 119, 101},
                                                      {255, 143, 106},
                                                      {255, 167, 116},
                                                      {255, 191, 130},
                                                      {255, 216, 153},
                                                      {255, 233, 187},
                                                      {255, 246, 221}}};

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
