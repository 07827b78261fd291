#include "engine/volume/label_map.h"

#include <cmath>
#include <limits>
#include <string>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

std::string text(const Index3& size) {
  return std::to_string(size[0]) + " x " + std::to_string(size[1]) + " x " + std::to_string(size[2]);
}

bool orthonormal(const Mat3& direction) {
  for (int a = 0; a < 3; ++a) {
    for (int b = 0; b < 3; ++b) {
      double product = 0;
      for (int r = 0; r < 3; ++r) product += direction(r, a) * direction(r, b);
      if (!(std::abs(product - (a == b ? 1.0 : 0.0)) <= 1e-4)) return false;
    }
  }
  return true;
}

}  // namespace

std::size_t check_geometry(const Index3& size, const Vec3& spacing, const Vec3& origin,
                           const Mat3& direction) {
  std::size_t voxels = 1;
  for (int a = 0; a < 3; ++a) {
    if (size[a] < 1)
      throw InputError("image: the size is " + text(size) + "; every side needs at least one voxel");
    voxels *= static_cast<std::size_t>(size[a]);
    if (voxels > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
      throw InputError("image: " + text(size) +
                       " voxels exceed the limit of 2147483647; crop or coarsen the image");
    }
    if (!(spacing[a] >= 1e-6 && spacing[a] <= 1.0)) {
      throw InputError("image: the spacing along axis " + std::to_string(a) + " is " +
                       std::to_string(spacing[a] * 1e3) + " mm; it must lie between 0.001 and 1000 mm");
    }
    if (!std::isfinite(origin[a])) {
      throw InputError("image: the origin is not finite; correct the image's header");
    }
  }
  if (!orthonormal(direction)) {
    throw InputError(
        "image: the direction matrix is not orthonormal; resample the image to perpendicular axes");
  }
  return voxels;
}

void check_label_map(const LabelMap& map) {
  if (map.labels.size() != check_geometry(map.size, map.spacing, map.origin, map.direction)) {
    throw InputError("label map: " + std::to_string(map.labels.size()) + " labels for " + text(map.size) +
                     " voxels; the image is truncated or its size is wrong");
  }
}

}  // namespace sulcus
