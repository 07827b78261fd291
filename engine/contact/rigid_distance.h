// Signed distance of a rigid tool in its body axes, on a regular grid (thesis 4.4).
#pragma once

#include <vector>

#include "engine/tool/rigid_body.h"
#include "engine/volume/label_map.h"

namespace sulcus {

struct RigidDistance {
  Vec3 origin = Vec3::Zero();     // m, body axes, of value (0, 0, 0)
  double spacing_m = 0;           // m
  Index3 size{0, 0, 0};           // values along x, y, z
  std::vector<float> distance_m;  // m, x fastest; negative inside
};

// Distance to the triangles of a closed surface, negative inside (by counting crossings). The grid covers the
// tool and two spacings more; spacing_m is coarsened until there are at most a million values. Exact at grid
// points next to the surface; further away the nearest triangle comes from the neighbours, which may miss the
// exact one by a fraction of the spacing. Deterministic. Throws InputError for a surface without triangles.
// Cost: about a microsecond a value.
RigidDistance build_rigid_distance(const ToolSurface& surface, double spacing_m);

// A spacing that resolves the tool's thinnest side by six values and its longest by 60 to 200.
double distance_spacing(const ToolSurface& surface);

// Trilinear interpolation at a point in body axes; outside of the grid a positive number. gradient (if not
// null): of the interpolation, not normalised, points out of the tool.
double sample(const RigidDistance& field, const Vec3& body_point, Vec3* gradient = nullptr);

}  // namespace sulcus
