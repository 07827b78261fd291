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

constexpr std::uint8_t all_neighbours = 63;
constexpr float sign[2] = {1, -1};

// describe() of a voxel that has all six neighbours.
BandVoxel describe_inner(std::size_t voxel, const std::uint8_t* links, const std::ptrdiff_t (&step)[3]) {
  unsigned flipped = 0;
  const unsigned here = links[voxel];
  for (int a = 0; a < 3; ++a) {
    const unsigned low = links[voxel - step[a]], high = links[voxel + step[a]];
    const unsigned low_face = ((low | here) >> 3) & ~(low >> a) & 1;  // labelled is bit 3
    const unsigned high_face = ((high | here) >> 3) & ~(here >> a) & 1;
    flipped |= (low_face | high_face << 1) << 2 * a;
  }
  return {static_cast<std::int32_t>(voxel), all_neighbours, static_cast<std::uint8_t>(flipped), 0};
}

BandVoxel describe(const LabelMap& map, const VoxelLinks& links, const Index3& at) {
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

// Counts first and fills then: memory that grows would cost more than the search.
LargeVector<BandVoxel> find_band(const LabelMap& map, const VoxelLinks& links,
                                 std::span<const float> distance) {
  const auto limit = static_cast<float>(2 * std::max({map.spacing[0], map.spacing[1], map.spacing[2]}));  // m
  const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(map.size[0]) * map.size[1];
  const std::ptrdiff_t step[3] = {1, map.size[0], plane};
  std::vector<std::ptrdiff_t> first(static_cast<std::size_t>(map.size[2]) + 1, 0);  // of each plane
#pragma omp parallel for schedule(static)
  for (int k = 0; k < map.size[2]; ++k) {
    const float* voxel = distance.data() + k * plane;
    int count = 0;
    for (std::ptrdiff_t v = 0; v < plane; ++v) count += voxel[v] < limit;
    first[k + 1] = count;
  }
  for (int k = 0; k < map.size[2]; ++k) first[k + 1] += first[k];
  LargeVector<BandVoxel> band(static_cast<std::size_t>(first.back()));
#pragma omp parallel for schedule(static)
  for (int k = 0; k < map.size[2]; ++k) {
    BandVoxel* next = band.data() + first[k];
    for (int j = 0; j < map.size[1]; ++j) {
      const std::size_t first_voxel = map.index(0, j, k);
      const float* row = distance.data() + first_voxel;
      const bool inner = j > 0 && j + 1 < map.size[1] && k > 0 && k + 1 < map.size[2];
      for (int i = 0; i < map.size[0]; ++i) {
        if (!(row[i] < limit)) continue;
        *next++ = inner && i > 0 && i + 1 < map.size[0]
                      ? describe_inner(first_voxel + static_cast<std::size_t>(i), links.data(), step)
                      : describe(map, links, {i, j, k});
      }
    }
  }
  return band;
}

}  // namespace

void smooth_near_boundary(const LabelMap& map, const VoxelLinks& links, std::span<float> distance) {
  const std::ptrdiff_t step[3] = {1, map.size[0], static_cast<std::ptrdiff_t>(map.size[0]) * map.size[1]};
  const LargeVector<BandVoxel> band = find_band(map, links, distance);
  LargeVector<float> next(band.size());
  const auto count = static_cast<std::ptrdiff_t>(band.size());
  for (const float factor : {0.125F, 0.125F, -0.14F, -0.14F}) {
#pragma omp parallel
    {
#pragma omp for schedule(static)
      for (std::ptrdiff_t n = 0; n < count; ++n) {
        const BandVoxel& v = band[n];
        const float* here = distance.data() + v.voxel;
        float sum = 0;                      // m, of the differences to the neighbours
        if (v.present == all_neighbours) {  // the same, without a branch
          for (int b = 0; b < 6; ++b) {
            const float other = here[b & 1 ? step[b >> 1] : -step[b >> 1]];
            sum += sign[v.flipped >> b & 1] * other - *here;
          }
          next[n] = std::max(0.0F, *here + factor * sum);
          continue;
        }
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
      for (std::ptrdiff_t n = 0; n < count; ++n) distance[band[n].voxel] = next[n];
    }
  }
}

}  // namespace sulcus
