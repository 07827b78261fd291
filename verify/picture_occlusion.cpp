// Hollows look dark because little light gets in: each place is compared with pairs of opposite places around
// it. In a plane the mean depth of a pair is the place's own, whatever the slope; in a hollow it is nearer to
// the eye.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "verify/picture_parts.h"

namespace sulcus::picture {
namespace {

constexpr int pair_count = 12, tile = 4, turns = tile * tile;
using Offsets = std::array<std::array<float, 2>, pair_count>;

// Offsets on a spiral in the unit circle, denser in the middle; the opposite one of each belongs to it. Each
// place of a tile has the spiral turned by another angle; a blur of the tile's size takes the pattern away
// again.
std::array<Offsets, turns> turned_spirals() {
  std::array<Offsets, turns> spirals{};
  for (int turn = 0; turn < turns; ++turn) {
    for (int i = 0; i < pair_count; ++i) {
      const double place = i + static_cast<double>(turn * 7 % turns) / turns;
      const double angle = i * std::numbers::pi * (3 - std::sqrt(5.0)) + std::numbers::pi * turn / turns;
      const double reach = 0.03 + 0.97 * (place / pair_count) * (place / pair_count);
      spirals[static_cast<std::size_t>(turn)][static_cast<std::size_t>(i)] = {
          static_cast<float>(reach * std::cos(angle)), static_cast<float>(reach * std::sin(angle))};
    }
  }
  return spirals;
}

// Depth at every `stride`-th sub-pixel.
struct Coarse {
  int width = 0, height = 0;
  std::vector<float> depth;

  float at(int x, int y) const {
    x = std::clamp(x, 0, width - 1);
    y = std::clamp(y, 0, height - 1);
    return depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  }
};

Coarse coarse_depth(const Raster& raster, int stride) {
  Coarse coarse;
  coarse.width = (raster.width + stride - 1) / stride;
  coarse.height = (raster.height + stride - 1) / stride;
  coarse.depth.resize(static_cast<std::size_t>(coarse.width) * static_cast<std::size_t>(coarse.height));
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      coarse.depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(coarse.width) +
                   static_cast<std::size_t>(x)] =
          raster.depth[static_cast<std::size_t>(y * stride) * static_cast<std::size_t>(raster.width) +
                       static_cast<std::size_t>(x * stride)];
    }
  }
  return coarse;
}

// Share of light that arrives at a place, 0.25 .. 1.
float openness(const Coarse& coarse, int x, int y, float radius_px_m, float radius_m,
               const Offsets& offsets) {
  const float here = coarse.at(x, y);
  if (!(here > 0)) return 1;
  const float radius_px = radius_px_m / here;
  float hidden = 0;
  for (const auto& offset : offsets) {
    const int dx = static_cast<int>(std::floor(offset[0] * radius_px + 0.5f));
    const int dy = static_cast<int>(std::floor(offset[1] * radius_px + 0.5f));
    float rise = 0;
    for (const float there : {coarse.at(x + dx, y + dy), coarse.at(x - dx, y - dy)}) {
      // Background and far things lie below; things far in front hide only as much as a near wall.
      rise += there > 0 ? std::clamp(here - there, -radius_m, radius_m) : -radius_m;
    }
    hidden += std::clamp(rise / radius_m, 0.0f, 1.0f);
  }
  const float share = std::min(1.0f, 1.6f * hidden / pair_count);
  return 1 - 0.75f * share;
}

// Mean over the tile around a place, of those places that are about as deep.
float blurred(const Coarse& coarse, const std::vector<float>& light, int x, int y, float radius_m) {
  const float here = coarse.at(x, y);
  float sum = 0, count = 0;
  for (int dy = -tile / 2; dy < tile / 2; ++dy) {
    for (int dx = -tile / 2; dx < tile / 2; ++dx) {
      const int px = std::clamp(x + dx, 0, coarse.width - 1), py = std::clamp(y + dy, 0, coarse.height - 1);
      const float there = coarse.at(px, py);
      if (!(there > 0) || std::abs(there - here) > 0.2f * radius_m) continue;
      sum += light[static_cast<std::size_t>(py) * static_cast<std::size_t>(coarse.width) +
                   static_cast<std::size_t>(px)];
      count += 1;
    }
  }
  return count > 0 ? sum / count : 1;
}

}  // namespace

void darken_hollows(Raster& raster, float tan_half_view, float radius_m) {
  if (!(radius_m > 0)) return;
  constexpr int stride = 2;
  const Coarse coarse = coarse_depth(raster, stride);
  const auto spirals = turned_spirals();
  const float radius_px_m = radius_m * static_cast<float>(coarse.height) / (2 * tan_half_view);
  const auto columns = static_cast<std::size_t>(coarse.width);
  std::vector<float> rough(coarse.depth.size()), light(coarse.depth.size());
#pragma omp parallel for schedule(static)
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      const auto& offsets = spirals[static_cast<std::size_t>(y % tile * tile + x % tile)];
      rough[static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x)] =
          openness(coarse, x, y, radius_px_m, radius_m, offsets);
    }
  }
#pragma omp parallel for schedule(static)
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      light[static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x)] =
          blurred(coarse, rough, x, y, radius_m);
    }
  }
#pragma omp parallel for schedule(static)
  for (int y = 0; y < raster.height; ++y) {
    for (int x = 0; x < raster.width; ++x) {
      const std::size_t p =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(raster.width) + static_cast<std::size_t>(x);
      if (!(raster.depth[p] > 0)) continue;
      const float l =
          light[static_cast<std::size_t>(y / stride) * columns + static_cast<std::size_t>(x / stride)];
      for (std::size_t c = 0; c < 3; ++c) {
        raster.rgba[4 * p + c] =
            static_cast<std::uint8_t>(static_cast<float>(raster.rgba[4 * p + c]) * l + 0.5f);
      }
    }
  }
}

}  // namespace sulcus::picture
