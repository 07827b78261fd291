// Images through the deformation (thesis 2.6): for every voxel of a wanted image the place in the source
// image whose tissue lies there now.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

struct ImageGeometry {
  Index3 size{0, 0, 0};                 // voxels along i, j, k
  Vec3 spacing = Vec3::Constant(1e-3);  // m
  Vec3 origin = Vec3::Zero();           // m, world position of the centre of voxel (0,0,0)
  Mat3 direction = Mat3::Identity();    // orthonormal
};

ImageGeometry geometry_of(const LabelMap& map);

// What TissueImage::voxel says where no tissue lies.
inline constexpr std::int32_t background_voxel = -1;  // none lay here at rest either
inline constexpr std::int32_t gap_voxel = -2;     // what lay here has moved away, or its element was removed
inline constexpr std::int32_t folded_voxel = -3;  // tissue of several places lies here

// [wanted voxels], i fastest, each array. Tissue of a tetrahedron is what the voxels owned by its cell hold,
// so of superimposed copies each brings its own voxels only.
struct TissueImage {
  std::vector<std::int32_t> tet;            // tetrahedron whose tissue lies there; -1: none
  std::vector<std::int32_t> voxel;          // source voxel (index in the map), or one of the above
  std::vector<std::array<float, 3>> moved;  // how far the tissue has come, in wanted voxels; 0 without tissue
  bool same_geometry = false;               // source voxels are voxels of the wanted image, too
  std::int64_t background_voxels = 0, gap_voxels = 0, folded_voxels = 0;
};

// node_positions: [3*nodes], xyz interleaved, m; tetrahedra with positions that are not finite or without
// volume hold nothing. alive: [tets] or empty = all. At rest nothing has moved, exactly, and no voxel is a
// gap or folded, in any wanted geometry. Deterministic for any thread count. Cost: in proportion to the
// voxels that the bounding boxes of the deformed tetrahedra cover. Throws InputError if the wanted geometry
// is no image.
TissueImage locate_tissue(const LabelMap& map, const EmbeddingMesh& mesh,
                          std::span<const double> node_positions, std::span<const std::uint8_t> alive,
                          const ImageGeometry& wanted);

// The map with the voxels emptied that lie in removed elements: each voxel's centre in the element, at rest,
// of the cell that owns it. alive: [tets].
LabelMap without_torn_voxels(const LabelMap& map, const EmbeddingMesh& mesh,
                             std::span<const std::uint8_t> alive);

// An image of the wanted geometry carried along by the tissue: at each voxel the value where its tissue came
// from, of the nearest voxel (labels are never mixed) or trilinear between voxel centres (clamped at the
// image's border; the 8 voxels are taken as they stood at rest, whole-number types rounded). The background
// stays as it is; gaps and folded voxels get `fill`. At rest the result is the image, exactly. values:
// [wanted voxels]. T: any integer type up to 64 bits, float, double.
enum class Interpolation { nearest, linear };
template <class T>
std::vector<T> resample_image(const ImageGeometry& wanted, std::span<const T> values,
                              const TissueImage& tissue, Interpolation interpolation, T fill);

// Values of the tetrahedra, such as stress; `fill` where no tissue lies. values: [tets].
std::vector<float> resample_tet_values(std::span<const float> values, const TissueImage& tissue, float fill);

}  // namespace sulcus
