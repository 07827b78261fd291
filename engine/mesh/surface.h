// The surface of the labelled voxels as triangles that ride on the tetrahedra (thesis 2.6): the outer
// boundary and both banks of every fissure that the pairs open, one surface a side, so that the picture opens
// where the mesh does.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

struct EmbeddedSurface {
  std::vector<std::array<std::int32_t, 3>>
      triangles;                               // [triangles] vertex numbers, counter-clockwise from outside
  std::vector<std::int32_t> triangle_label;    // [triangles] label of the voxel behind the triangle
  std::vector<std::uint8_t> triangle_on_pair;  // [triangles] 1 where the face is a separation pair's
  std::vector<Vec3> rest_positions;            // [vertices], m, world
  std::vector<std::int32_t> tet;               // [vertices] tetrahedron that carries the vertex
  std::vector<std::array<float, 4>> weights;   // [vertices] barycentric coordinates (may extrapolate)
};

// Boundary faces of the labelled voxels, vertices smoothed within half a voxel (smoothing_passes, 0 =
// blocky). alive: [tets] or empty = all; vertices ride on elements that are present where their cell has any.
EmbeddedSurface build_embedded_surface(const LabelMap& map, const SeparationPairs& pairs,
                                       const EmbeddingMesh& mesh, int smoothing_passes,
                                       std::span<const std::uint8_t> alive = {});

// World positions [3*vertices] of the surface for given node positions [3*nodes], both xyz interleaved, m.
std::vector<double> deform_surface(const EmbeddedSurface& surface, const EmbeddingMesh& mesh,
                                   const std::vector<double>& node_positions);

}  // namespace sulcus
