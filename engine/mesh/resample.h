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

// [wanted voxels], i fastest, each array. Tissue of a tetrahedron is what the voxels owned by its cell hold,
// so of superimposed copies each brings its own voxels only.
struct TissueImage {
  std::vector<std::int32_t> tet;             // tetrahedron that lies there; -1: no tissue
  std::vector<std::int32_t> voxel;           // source voxel (index) of the tissue; -1: no tissue
  std::vector<std::array<float, 3>> source;  // source point, voxel coordinates; 0 where no tissue is
  std::int64_t empty_voxels = 0;             // voxels without tissue, those that follow included
  std::int64_t folded_voxels = 0;            // ... because tissue of several source voxels lies there
  std::int64_t gap_voxels = 0;               // ... where the mesh lies but its tissue went with another copy
};

// node_positions: [3*nodes], xyz interleaved, m; tetrahedra with positions that are not finite or without
// volume hold nothing. alive: [tets] or empty = all. At rest, wanted in the source's geometry, every owned
// voxel's source is the voxel itself, exactly. Deterministic for any thread count. Cost: in proportion to the
// voxels that the bounding boxes of the deformed tetrahedra cover. Throws InputError if the wanted geometry
// is no image.
TissueImage locate_tissue(const LabelMap& map, const EmbeddingMesh& mesh,
                          std::span<const double> node_positions, std::span<const std::uint8_t> alive,
                          const ImageGeometry& wanted);

// The map with the voxels emptied that lie in removed elements: each voxel's centre in the element, at rest,
// of the cell that owns it. alive: [tets].
LabelMap without_torn_voxels(const LabelMap& map, const EmbeddingMesh& mesh,
                             std::span<const std::uint8_t> alive);

// Labels of the wanted image: those of the source voxels, never mixed.
std::vector<std::int32_t> resample_labels(const LabelMap& map, const TissueImage& tissue, std::int32_t fill);

// Grey values: nearest source voxel, or trilinear between source voxel centres (clamped at the image's
// border; the 8 voxels are taken as they stood at rest). grey: [source voxels].
enum class Interpolation { nearest, linear };
std::vector<float> resample_grey(const LabelMap& map, std::span<const float> grey, const TissueImage& tissue,
                                 Interpolation interpolation, float fill);

// Values of the tetrahedra, such as stress. values: [tets].
std::vector<float> resample_tet_values(std::span<const float> values, const TissueImage& tissue, float fill);

}  // namespace sulcus
