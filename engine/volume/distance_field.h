// Distance of every voxel centre to the boundary of its segment, in rest coordinates (thesis 5.3.2, without
// its half-voxel bias and one-sided at closed fissures: equations.md 7.12).
//
// The boundary is made of voxel faces: between a labelled and an empty voxel (or the outside of the image),
// and between two voxels whose labels form a separation pair. The distance [m] from the voxel's centre to the
// boundary is always positive (the sign is a matter of the side from which one looks: see sample_distance):
//   voxel_faces  the exact Euclidean distance to the nearest boundary face
//   smooth       the same, with the staircase of the faces taken out near the boundary
//   (distance_smoothing.h), so
//                closer to the body that was segmented: on the true surface of spheres 0.08 voxel mean and
//                0.44 largest error, where voxel_faces has 0.15 and 0.49 (docs/mesher.md has the whole table)
#pragma once

#include "engine/volume/label_map.h"
#include "engine/volume/large_array.h"
#include "engine/volume/separation.h"

namespace sulcus {

struct DistanceField {
  LargeVector<float> distance;  // [voxels], m, >= 0; as the label map is ordered
};

enum class DistanceKind { voxel_faces, smooth };

// Distance transform with anisotropic spacing. Deterministic for any thread count.
// A map without any labelled voxel gives distances to the image's border.
DistanceField build_distance_field(const LabelMap& map, const SeparationPairs& pairs,
                                   DistanceKind kind = DistanceKind::smooth);

// Signed distance and its gradient at a point, as seen from the segment of the voxel `home` (voxel index).
struct DistanceSample {
  double distance = 0;           // m; negative inside the segment, positive outside
  Vec3 gradient = Vec3::Zero();  // world axes, not normalised, points out of the segment; zero if undefined
};

// Trilinear interpolation over the 8 voxel centres around `point_voxel` (voxel coordinates). A voxel of these
// 8 counts as inside (-distance) if it can be reached from `home` within the 8 through connected faces, else
// as outside (+distance), so that the gradient does not vanish at a closed fissure. Precondition: `home` is a
// labelled voxel. If `home` is not one of the 8 voxels, the nearest labelled one of the 8 that the map
// connects with it takes its place; with none, the distance is positive.
DistanceSample sample_distance(const LabelMap& map, const SeparationPairs& pairs, const DistanceField& field,
                               const Vec3& point_voxel, std::size_t home);

// The same for a home that is known by its place: needs no division.
DistanceSample sample_distance(const LabelMap& map, const SeparationPairs& pairs, const DistanceField& field,
                               const Vec3& point_voxel, const Index3& home);

}  // namespace sulcus
