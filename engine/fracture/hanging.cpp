#include "engine/fracture/hanging.h"

namespace sulcus {

std::vector<std::int32_t> hanging_elements(std::span<const std::array<std::int32_t, 4>> tets,
                                           const FaceNeighbours& faces, std::span<const std::uint8_t> alive,
                                           std::span<const std::uint8_t> held) {
  const auto at = [](std::int32_t number) { return static_cast<std::size_t>(number); };
  enum : std::uint8_t { unknown, firm, hanging };
  std::vector<std::uint8_t> state(tets.size(), unknown), firm_node(held.size(), 0);
  std::vector<std::int32_t> reached;
  const auto reach = [&](std::size_t t, std::uint8_t as) {
    if (!alive[t] || state[t] != unknown) return;
    state[t] = as;
    reached.push_back(static_cast<std::int32_t>(t));
  };
  const auto spread = [&](std::uint8_t as) {  // through faces
    for (std::size_t r = 0; r < reached.size(); ++r) {
      for (std::int32_t own = 4 * reached[r]; own < 4 * reached[r] + 4; ++own) {
        for (const std::int32_t start : {own, faces.across[at(own)]}) {
          if (start < 0) continue;
          std::int32_t face = start;
          do {
            reach(at(face / 4), as);
            face = faces.beside[at(face)];
          } while (face != start);
        }
      }
    }
  };
  for (std::size_t t = 0; t < tets.size(); ++t) {
    for (const std::int32_t node : tets[t]) {
      if (held[at(node)]) reach(t, firm);
    }
  }
  spread(firm);
  for (const std::int32_t element : reached) {
    for (const std::int32_t node : tets[at(element)]) firm_node[at(node)] = 1;
  }
  // what touches the firm part, then what touches that
  std::vector<std::int32_t> found;
  for (bool grown = true; grown;) {
    reached.clear();
    for (std::size_t t = 0; t < tets.size(); ++t) {
      for (const std::int32_t node : tets[t]) {
        if (firm_node[at(node)]) reach(t, hanging);
      }
    }
    spread(hanging);
    for (const std::int32_t element : reached) {
      for (const std::int32_t node : tets[at(element)]) firm_node[at(node)] = 1;
    }
    grown = !reached.empty();
  }
  for (std::size_t t = 0; t < tets.size(); ++t) {
    if (state[t] == hanging) found.push_back(static_cast<std::int32_t>(t));
  }
  return found;
}

}  // namespace sulcus
