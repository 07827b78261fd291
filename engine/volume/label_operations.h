// What a segmentation needs before it is meshed. Every operation works in place and returns the number of
// voxels it changed, so that a run can record what was done. Labels that do not occur are no error here:
// whether that is a mistake the caller knows.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/volume/label_map.h"
#include "engine/volume/separation.h"

namespace sulcus {

// Empties all voxels whose label is not / is in `labels`. Cost: one pass.
std::int64_t keep_labels(LabelMap& map, std::span<const std::int32_t> labels);
std::int64_t drop_labels(LabelMap& map, std::span<const std::int32_t> labels);

// Gives all voxels with a label in `from` the label `to`. Label 0 in `from` would fill empty space, `to` 0
// would drop: both throw InputError.
std::int64_t merge_labels(LabelMap& map, std::span<const std::int32_t> from, std::int32_t to);

// Fills enclosed voids: empty voxels that no path over faces of empty voxels leads to the image's border.
// Each takes the label of a labelled neighbour, layer by layer from the void's wall inwards, of several the
// one that most of the six neighbours have, the first in the order -i, +i, -j, +j, -k, +k at ties; so the
// result depends neither on the numbering of labels nor on the order of voxels. In an image one voxel thick
// the border along that axis does not count.
std::int64_t fill_voids(LabelMap& map);

// Empties pieces (6-connected, faces between pairs cut) of fewer than `minimum_voxels` voxels.
std::int64_t drop_small_pieces(LabelMap& map, const SeparationPairs& pairs, std::int64_t minimum_voxels);

// Cuts the image down to the box of its labelled voxels and `margin_voxels` (>= 0) around it, as far as the
// image reaches; voxels keep their world positions. Returns the number of voxels cut away. Throws InputError
// if no voxel is labelled.
std::int64_t crop_to_content(LabelMap& map, int margin_voxels);

}  // namespace sulcus
