// Takes the staircase out of distances to voxel faces near the boundary.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/volume/label_map.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

// Replaces distances below 2 voxels (of the largest spacing) by values smoothed over the six face neighbours:
// two steps of diffusion, two of the same the other way round (factors as a Taubin filter), so that what
// changes from voxel to voxel goes and slow changes stay. A neighbour across a boundary face counts negative:
// every side sees its own signed distance, also at a pair, and a flat boundary stays where it is, exactly.
// Values stay >= 0. links: as build_voxel_links gives them. distance: [voxels], m. Deterministic for any
// thread count.
void smooth_near_boundary(const LabelMap& map, const VoxelLinks& links, std::span<float> distance);

}  // namespace sulcus
