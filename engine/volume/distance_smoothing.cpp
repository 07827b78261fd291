#include "engine/volume/distance_smoothing.h"

#include <algorithm>

#include "engine/volume/large_array.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

// The neighbours of a band voxel: bit 2a (far side along axis a: 2a + 1) of `present` and `flipped`. An axis
// that leaves the image counts in neither and adds nothing, but for the image's border as the boundary of a
// labelled voxel, `mirrored`: there the distance continues with the opposite sign.
struct BandVoxel {
  std::int32_t voxel;
  std::uint8_t present, flipped, mirrored;
};

BandVoxel describe(const LabelMap& map, const std::vector<std::uint8_t>& links, const Index3& at) {
  const std::ptrdiff_t step[3] = {1, map.size[0], static_cast<std::ptrdiff_t>(map.size[0]) * map.size[1]};
  const std::size_t voxel = map.index(at[0], at[1], at[2]);
  BandVoxel band{static_cast<std::int32_t>(voxel), 0, 0, 0};
  const bool labelled = links[voxel] & voxel_labelled;
  for (int a = 0; a < 3; ++a) {
    const bool low = at[a] > 0, high = at[a] + 1 < map.size[a];
    if (!low && !high) continue;
    if ((!low || !high) && !labelled) continue;
    for (int side = 0; side < 2; ++side) {
      const auto bit = static_cast<std::uint8_t>(1 << (2 * a + side));
      if (!(side ? high : low)) {
        band.mirrored |= bit;
        continue;
      }
      const std::size_t other = side ? voxel + step[a] : voxel - step[a];
      const bool linked = links[side ? voxel : other] & (1 << a);
      const bool both_empty = !labelled && !(links[other] & voxel_labelled);
      band.present |= bit;
      if (!linked && !both_empty) band.flipped |= bit;
    }
  }
  return band;
}

struct Band {
  std::unique_ptr<BandVoxel[]> voxels;
  std::ptrdiff_t count = 0;
};

// Counts first and fills then: memory that grows would cost more than the search.
Band find_band(const LabelMap& map, const std::vector<std::uint8_t>& links,
               const std::vector<float>& distance) {
  const auto limit = static_cast<float>(2 * std::max({map.spacing[0], map.spacing[1], map.spacing[2]}));  // m
  const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(map.size[0]) * map.size[1];
  std::vector<std::ptrdiff_t> first(static_cast<std::size_t>(map.size[2]) + 1, 0);  // of each plane
#pragma omp parallel for schedule(static)
  for (int k = 0; k < map.size[2]; ++k) {
    const float* voxel = distance.data() + k * plane;
    int count = 0;
    for (std::ptrdiff_t v = 0; v < plane; ++v) count += voxel[v] < limit;
    first[k + 1] = count;
  }
  for (int k = 0; k < map.size[2]; ++k) first[k + 1] += first[k];
  Band band{large_scratch<BandVoxel>(static_cast<std::size_t>(first.back())), first.back()};
#pragma omp parallel for schedule(static)
  for (int k = 0; k < map.size[2]; ++k) {
    BandVoxel* next = band.voxels.get() + first[k];
    for (int j = 0; j < map.size[1]; ++j) {
      const float* row = distance.data() + map.index(0, j, k);
      for (int i = 0; i < map.size[0]; ++i) {
        if (row[i] < limit) *next++ = describe(map, links, {i, j, k});
      }
    }
  }
  return band;
}

}  // namespace

void smooth_near_boundary(const LabelMap& map, const std::vector<std::uint8_t>& links,
                          std::vector<float>& distance) {
  const std::ptrdiff_t step[3] = {1, map.size[0], static_cast<std::ptrdiff_t>(map.size[0]) * map.size[1]};
  const Band band = find_band(map, links, distance);
  const std::unique_ptr<float[]> next = large_scratch<float>(static_cast<std::size_t>(band.count));
  for (const float factor : {0.125F, 0.125F, -0.14F, -0.14F}) {
#pragma omp parallel
    {
#pragma omp for schedule(static)
      for (std::ptrdiff_t n = 0; n < band.count; ++n) {
        const BandVoxel& v = band.voxels[n];
        const float* here = distance.data() + v.voxel;
        float sum = 0;  // m, of the differences to the neighbours
        for (int b = 0; b < 6; ++b) {
          if (v.present >> b & 1) {
            const float other = here[b & 1 ? step[b >> 1] : -step[b >> 1]];
            sum += (v.flipped >> b & 1 ? -other : other) - *here;
          } else if (v.mirrored >> b & 1) {
            sum -= 2 * *here;
          }
        }
        next[n] = std::max(0.0F, *here + factor * sum);
      }
#pragma omp for schedule(static)
      for (std::ptrdiff_t n = 0; n < band.count; ++n) distance[band.voxels[n].voxel] = next[n];
    }
  }
}

}  // namespace sulcus
