// Closed triangle surfaces for the tests of contact, centred on the origin.
#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "engine/tool/rigid_body.h"

namespace sulcus {

inline ToolSurface box_tool(const Vec3& size_m) {
  ToolSurface surface;
  for (int c = 0; c < 8; ++c) {
    surface.vertices.push_back(0.5 *
                               size_m.cwiseProduct(Vec3(c & 1 ? 1 : -1, c & 2 ? 1 : -1, c & 4 ? 1 : -1)));
  }
  constexpr int faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                               {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& f : faces) {
    surface.triangles.push_back({f[0], f[1], f[2]});
    surface.triangles.push_back({f[0], f[2], f[3]});
  }
  return surface;
}

// An octahedron whose faces are split and pushed out to the sphere.
inline ToolSurface sphere_tool(double radius_m, int splits = 4) {
  ToolSurface surface;
  for (int axis = 0; axis < 3; ++axis) {
    for (int side : {1, -1}) surface.vertices.push_back(radius_m * side * Vec3::Unit(axis));
  }
  for (int n = 0; n < 8; ++n) {
    const int x = n & 1, y = 2 + (n >> 1 & 1), z = 4 + (n >> 2 & 1);
    const bool even = ((n & 1) + (n >> 1 & 1) + (n >> 2 & 1)) % 2 == 0;
    surface.triangles.push_back(even ? std::array<std::int32_t, 3>{x, y, z}
                                     : std::array<std::int32_t, 3>{x, z, y});
  }
  for (int split = 0; split < splits; ++split) {
    ToolSurface finer;
    for (const auto& t : surface.triangles) {
      Vec3 p[6];
      for (std::size_t c = 0; c < 3; ++c) p[c] = surface.vertices[static_cast<std::size_t>(t[c])];
      for (int c = 0; c < 3; ++c) p[3 + c] = radius_m * (p[c] + p[(c + 1) % 3]).normalized();
      const auto first = static_cast<std::int32_t>(finer.vertices.size());
      finer.vertices.insert(finer.vertices.end(), p, p + 6);
      for (const auto& k : {std::array<int, 3>{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}})
        finer.triangles.push_back({first + k[0], first + k[1], first + k[2]});
    }
    surface = finer;
  }
  return surface;
}

}  // namespace sulcus
