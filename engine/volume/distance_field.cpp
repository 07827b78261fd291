#include "engine/volume/distance_field.h"

#include <algorithm>
#include <cstring>

#include "engine/volume/distance_smoothing.h"
#include "engine/volume/distance_transform.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

LargeVector<float> distance_to_border(const LabelMap& map) {
  LargeVector<float> distance(map.voxel_count());
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        const Index3 at{i, j, k};
        double nearest = 1e30;  // m
        for (int a = 0; a < 3; ++a) {
          nearest = std::min(nearest, (std::min(at[a], map.size[a] - 1 - at[a]) + 0.5) * map.spacing[a]);
        }
        distance[map.index(i, j, k)] = static_cast<float>(nearest);
      }
    }
  }
  return distance;
}

}  // namespace

DistanceField build_distance_field(const LabelMap& map, const SeparationPairs& pairs, DistanceKind kind) {
  check_label_map(map);
  const VoxelLinks links = build_voxel_links(map, pairs);
  // no voxel is labelled: the first byte is zero, and each equals the next
  const bool empty = links[0] == 0 && std::memcmp(links.data(), links.data() + 1, links.size() - 1) == 0;
  if (empty) return {distance_to_border(map)};
  DistanceField field{face_distance(map.size, map.spacing, links)};
  if (kind == DistanceKind::smooth) smooth_near_boundary(map, links, field.distance);
  return field;
}

}  // namespace sulcus
