// Exact squared Euclidean distance of voxel centres to boundary faces, the inside of build_distance_field.
//
// From a voxel centre, the nearest point of a face is its middle, the middle of an edge or a corner: always a
// point of the grid at half the voxel size. So the transform runs over rows, then columns, then stacks, and
// in every pass only points at half positions (between two centres) or in the same row can be nearest
// (distance_transform.cpp).
#pragma once

#include <cstdint>
#include <vector>

#include "engine/numerics/types.h"
#include "engine/volume/large_array.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

// links: as build_voxel_links gives them, with at least one labelled voxel. Returns distances [voxels], m.
// Memory: 8 bytes a voxel, the result included.
LargeVector<float> face_distance(const Index3& size, const Vec3& spacing, const VoxelLinks& links);

}  // namespace sulcus
