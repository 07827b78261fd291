// What follows from which elements are present. Kept in the workspace, brought up to date from State::alive
// at the start of a step: a function of it, so that a workspace still holds nothing of the future. Private to
// this room.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/scene/scene.h"

namespace sulcus {

struct AliveView {
  std::vector<std::uint8_t> seen;       // [tets] the `alive` that the rest was made for; empty at first
  std::vector<std::uint8_t> free_node;  // [nodes] Scene::free_node, and 0 for nodes that no element holds
  std::vector<std::uint8_t>
      boundary;  // [nodes] 1 on the boundary of what is present; scenes with node contacts
};

// Cost: a comparison of all flags, and the stars of the elements that changed; everything the first time.
void update(const Scene& scene, std::span<const std::uint8_t> alive, AliveView& view);

// Whether no element that is present has the node.
bool is_orphan(const Scene& scene, std::span<const std::uint8_t> alive, std::int32_t node);

}  // namespace sulcus
