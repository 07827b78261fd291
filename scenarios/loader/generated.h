// Label maps that need no file: simple bodies of voxels, centred on the world's origin (where nothing else is
// said), axes along the world's. All sizes in metres; the number of voxels along an axis is the size divided
// by the voxel size, rounded to nearest.
#pragma once

#include <string>
#include <vector>

#include "engine/volume/label_map.h"

namespace sulcus {

// The cylinder of thesis 2.7.3 and 5.3.5, axis along x. The back half y < 0 is segment 1; the front half is
// cut at z = 0 into segment 2 (z > 0) and segment 3 (z < 0), which touch along a plane: separation pair {2,
// 3}.
struct CylinderThreeSegments {
  double diameter_m = 0.076;   // m
  double length_m = 0.020;     // m, along x
  double voxel_size_m = 1e-3;  // m
  double gap_m = 0;            // m, the voxels of segment 2 with 0 < z < gap are empty ...
  double gap_from_y_m = 0;     // m, ... where y > gap_from_y_m; 0 = the whole front half
};

// A block of one segment.
struct BoxSegment {
  Vec3 size_m = Vec3::Constant(0.05);  // m
  double voxel_size_m = 1e-3;          // m
  std::int32_t label = 1;
};

// A ball of one segment.
struct SphereSegment {
  double diameter_m = 0.05;    // m
  double voxel_size_m = 1e-3;  // m
  std::int32_t label = 1;
};

// Balls that melt into each other, for bodies as round and as knobbly as an animal. Not centred: positions
// are the world's; voxel borders lie at whole multiples of the voxel size.
struct BallsSegment {
  struct Ball {
    Vec3 centre_m = Vec3::Zero();  // m
    double radius_m = 0;           // m
  };
  std::vector<Ball> balls;
  double blend_m = 0;          // m: two balls whose surfaces are nearer than this are joined by a fillet
  double voxel_size_m = 1e-3;  // m
  std::int32_t label = 1;
};

// A drawing one voxel thick, for scenes in a plane: each character is a voxel, '.' empty, '1' to '9' a label.
// The first row is at the top (largest y), x runs along a row; shorter rows are filled up with empty voxels.
struct DrawnSegments {
  std::vector<std::string> rows;
  double voxel_size_m = 1e-3;  // m, along x and y
  double thickness_m = 1e-3;   // m, of the voxel along z
};

// A voxel belongs to the body if its centre does; the extent of the map is the
// body's bounding box, without a margin. Throws InputError for sizes that are not positive and finite, for a
// body thinner than a voxel and for more than max_generated_voxels.
LabelMap generate(const CylinderThreeSegments& shape);
LabelMap generate(const BoxSegment& shape);
LabelMap generate(const SphereSegment& shape);
LabelMap generate(const BallsSegment& shape);
LabelMap generate(const DrawnSegments& drawing);  // throws InputError also for other characters

inline constexpr std::int64_t max_generated_voxels = std::int64_t{1} << 28;

}  // namespace sulcus
