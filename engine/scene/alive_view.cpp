#include "engine/scene/alive_view.h"

#include <algorithm>

namespace sulcus {

bool is_orphan(const Scene& scene, std::span<const std::uint8_t> alive, std::int32_t node) {
  const auto n = static_cast<std::size_t>(node);
  for (std::int32_t i = scene.elements.incident_start[n]; i < scene.elements.incident_start[n + 1]; ++i) {
    const auto tet = static_cast<std::size_t>(scene.elements.incident[static_cast<std::size_t>(i)] / 4);
    if (alive[tet]) return false;
  }
  return true;
}

void update(const Scene& scene, std::span<const std::uint8_t> alive, AliveView& view) {
  const auto refresh = [&](std::int32_t node) {
    const auto n = static_cast<std::size_t>(node);
    view.free_node[n] = scene.free_node[n] && !is_orphan(scene, alive, node);
    if (!view.boundary.empty()) view.boundary[n] = on_boundary(scene.boundary_mesh(), alive, node);
  };
  if (view.seen.empty()) {
    view.seen.assign(alive.begin(), alive.end());
    view.free_node.assign(scene.free_node.size(), 0);
    if (!scene.faces.across.empty()) {  // scenes with tools and contact by nodes
      view.boundary.assign(scene.free_node.size(), 0);
    }
    for (std::int64_t n = 0; n < scene.node_count(); ++n) refresh(static_cast<std::int32_t>(n));
    return;
  }
  if (std::equal(alive.begin(), alive.end(), view.seen.begin())) return;
  for (std::size_t t = 0; t < alive.size(); ++t) {
    if (alive[t] == view.seen[t]) continue;
    view.seen[t] = alive[t];
    for (std::int32_t node : scene.mesh.tets[t]) refresh(node);
  }
}

}  // namespace sulcus
