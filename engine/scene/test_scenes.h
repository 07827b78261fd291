// Scenes for the tests of this room: blocks through the real mesher.
#pragma once

#include "engine/fem/test_meshes.h"
#include "engine/scene/step.h"

namespace sulcus {

// cells[0] x cells[1] x cells[2] cubes, its corner at the origin; double precision, tight tolerance.
inline SceneDescription block_description(const Index3& cells, double edge_m) {
  SceneDescription d;
  d.map = box_map(cells[0], cells[1], cells[2], edge_m);
  d.embedding.size_m = edge_m;
  d.damping = {0, 0.05};
  d.step_s = 0.017;
  d.solver.precision = Precision::double_precision;
  d.solver.tolerance = 1e-9;
  return d;
}

inline Scene build(SceneDescription d) {
  EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
  return build_scene(std::move(d), std::move(mesh));
}

// Nodes whose rest position fulfils a condition, ascending.
template <class Condition>
std::vector<std::int32_t> nodes_where(const SceneDescription& d, Condition&& condition) {
  const EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
  std::vector<std::int32_t> nodes;
  for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
    if (condition(mesh.rest_positions[n])) nodes.push_back(static_cast<std::int32_t>(n));
  }
  return nodes;
}

// Soft tissue in cells of 20 mm, a spring under each node of its bottom.
inline SceneDescription block_on_springs(const Index3& cells, double step_s, double stiffness_N_m,
                                         double damping_N_s_m) {
  SceneDescription d = block_description(cells, 0.02);
  d.material.youngs_modulus_Pa = 2000;
  d.damping = {0, 0.1};
  d.step_s = step_s;
  for (const std::int32_t node : nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; }))
    d.springs.push_back({node, stiffness_N_m, damping_N_s_m});
  return d;
}

// A path from rest along `way` (m) with equal steps, then a halt.
inline PrescribedMotion straight_motion(std::vector<std::int32_t> nodes, const Vec3& way, int steps) {
  PrescribedMotion motion;
  motion.name = "pull";
  motion.nodes = std::move(nodes);
  for (int k = 0; k <= steps; ++k) motion.path.push_back({way * k / steps, {}});
  return motion;
}

}  // namespace sulcus
