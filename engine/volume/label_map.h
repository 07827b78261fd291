// A label map: a segmented image, one integer label a voxel, 0 = empty.
// Voxel (i,j,k) has its centre at origin + direction * (spacing o (i,j,k)) in world coordinates.
#pragma once

#include <cstddef>
#include <vector>

#include "engine/numerics/types.h"

namespace sulcus {

struct LabelMap {
  Index3 size{0, 0, 0};                 // voxels along i, j, k
  Vec3 spacing = Vec3::Constant(1e-3);  // m, > 0
  Vec3 origin = Vec3::Zero();           // m, world position of the centre of voxel (0,0,0)
  Mat3 direction = Mat3::Identity();    // orthonormal; column a = world direction of voxel axis a
  std::vector<std::int32_t> labels;     // [size[0]*size[1]*size[2]], i fastest; 0 = empty

  std::size_t voxel_count() const { return labels.size(); }
  std::size_t index(int i, int j, int k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(size[0]) *
               (static_cast<std::size_t>(j) +
                static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(k));
  }

  // World position [m] of a point given in voxel coordinates (voxel centres at whole numbers), and back.
  Vec3 to_world(const Vec3& voxel) const { return origin + direction * spacing.cwiseProduct(voxel); }
  Vec3 to_voxel(const Vec3& world) const {
    return (direction.transpose() * (world - origin)).cwiseQuotient(spacing);
  }
};

// Throws InputError unless every side has a voxel, the voxels number at most 2^31-1 and as many as labels,
// the spacing lies between 0.001 and 1000 mm, the origin is finite and the direction orthonormal (to 1e-4).
void check_label_map(const LabelMap& map);

// The same for the geometry alone; returns the number of voxels.
std::size_t check_geometry(const Index3& size, const Vec3& spacing, const Vec3& origin,
                           const Mat3& direction);

}  // namespace sulcus
