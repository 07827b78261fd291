// Which face neighbours belong together, one byte a voxel: all that meshing, distances and surfaces ask of
// labels and pairs, looked up once.
#pragma once

#include <cstdint>

#include "engine/volume/label_map.h"
#include "engine/volume/large_array.h"
#include "engine/volume/separation.h"

namespace sulcus {

inline constexpr std::uint8_t link_i = 1;          // connected with the neighbour at i + 1
inline constexpr std::uint8_t link_j = 2;          // ... at j + 1
inline constexpr std::uint8_t link_k = 4;          // ... at k + 1
inline constexpr std::uint8_t voxel_labelled = 8;  // not empty
inline constexpr std::uint8_t links_all = link_i | link_j | link_k;

using VoxelLinks = LargeVector<std::uint8_t>;

// [voxels + 8], as the label map is ordered, then 8 bytes 0 so that 8 bytes can be read from every voxel on;
// voxels at the far border have no link across it.
// Cost: one pass over the labels.
VoxelLinks build_voxel_links(const LabelMap& map, const SeparationPairs& pairs);

}  // namespace sulcus
