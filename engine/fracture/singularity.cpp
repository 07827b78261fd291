#include "engine/fracture/singularity.h"

#include <algorithm>
#include <cassert>

namespace sulcus {
namespace {

std::size_t at(std::int32_t number) {
  return static_cast<std::size_t>(number);
}

std::int32_t root(std::vector<std::int32_t>& parent, std::int32_t node) {
  while (parent[at(node)] != node) node = parent[at(node)] = parent[at(parent[at(node)])];
  return node;
}

// Pieces of the star whose elements are scratch.members: elements hang together that share a node other than
// a and b.
bool weaker_pieces(const MeshStars& mesh, std::int32_t a, std::int32_t b, StarScratch& scratch,
                   std::vector<std::int32_t>& weaker) {
  auto& parent = scratch.parent;
  std::int32_t own[4];
  const auto others = [&](std::int32_t element) {
    int count = 0;
    for (std::int32_t node : mesh.tets[at(element)]) {
      if (node != a && node != b) own[count++] = node;
    }
    return count;
  };
  int sets = 0;
  for (std::int32_t element : scratch.members) {
    const int count = others(element);
    for (int c = 0; c < count; ++c) {
      if (parent[at(own[c])] >= 0) continue;
      parent[at(own[c])] = own[c];
      scratch.count[at(own[c])] = 0;
      ++sets;
    }
    for (int c = 1; c < count; ++c) {
      const std::int32_t p = root(parent, own[0]), q = root(parent, own[c]);
      if (p == q) continue;
      parent[at(std::max(p, q))] = std::min(p, q);
      --sets;
    }
  }
  if (sets > 1) {
    for (std::int32_t element : scratch.members) {
      others(element);
      const std::int32_t set = root(parent, own[0]);
      if (scratch.count[at(set)]++ == 0) scratch.first[at(set)] = element;
    }
    std::int32_t strongest = -1;
    for (std::int32_t element : scratch.members) {
      others(element);
      const std::int32_t set = root(parent, own[0]);
      if (strongest < 0 || scratch.count[at(set)] > scratch.count[at(strongest)] ||
          (scratch.count[at(set)] == scratch.count[at(strongest)] &&
           scratch.first[at(set)] < scratch.first[at(strongest)])) {
        strongest = set;
      }
    }
    for (std::int32_t element : scratch.members) {
      others(element);
      if (root(parent, own[0]) != strongest) weaker.push_back(element);
    }
  }
  for (std::int32_t element : scratch.members) {
    for (std::int32_t node : mesh.tets[at(element)]) parent[at(node)] = -1;
  }
  return sets > 1;
}

void gather_star(const MeshStars& mesh, std::span<const std::uint8_t> alive, std::int32_t a, std::int32_t b,
                 std::vector<std::int32_t>& members) {
  members.clear();
  for (std::int32_t i = mesh.start[at(a)]; i < mesh.start[at(a) + 1]; ++i) {
    const std::int32_t element = mesh.incident[at(i)] / 4;
    if (!alive[at(element)]) continue;
    const auto& tet = mesh.tets[at(element)];
    if (b < 0 || tet[0] == b || tet[1] == b || tet[2] == b || tet[3] == b) members.push_back(element);
  }
}

constexpr int edge_corners[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

std::int64_t edge_key(std::int32_t a, std::int32_t b) {
  return (static_cast<std::int64_t>(std::min(a, b)) << 32) | std::max(a, b);
}
std::int32_t low_node(std::int64_t key) {
  return static_cast<std::int32_t>(key >> 32);
}
std::int32_t high_node(std::int64_t key) {
  return static_cast<std::int32_t>(key & 0xffffffff);
}

template <class Number>
void sort_unique(std::vector<Number>& numbers) {
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
}

// Nodes and edges of the elements, each once, ascending.
void list_candidates(const MeshStars& mesh, std::span<const std::int32_t> elements, StarScratch& scratch) {
  scratch.nodes.clear();
  scratch.edges.clear();
  for (std::int32_t element : elements) {
    const auto& tet = mesh.tets[at(element)];
    scratch.nodes.insert(scratch.nodes.end(), tet.begin(), tet.end());
    for (const auto& corners : edge_corners) {
      scratch.edges.push_back(edge_key(tet[at(corners[0])], tet[at(corners[1])]));
    }
  }
  sort_unique(scratch.nodes);
  sort_unique(scratch.edges);
}

}  // namespace

StarScratch make_star_scratch(const MeshStars& mesh) {
  StarScratch scratch;
  const std::size_t nodes = mesh.start.size() - 1;
  scratch.parent.assign(nodes, -1);
  scratch.count.assign(nodes, 0);
  scratch.first.assign(nodes, 0);
  std::int32_t largest = 0;
  for (std::size_t n = 0; n < nodes; ++n) largest = std::max(largest, mesh.start[n + 1] - mesh.start[n]);
  scratch.members.reserve(at(largest));
  scratch.nodes.reserve(4 * mesh.tets.size());
  scratch.edges.reserve(6 * mesh.tets.size());
  scratch.victims.reserve(10 *
                          mesh.tets.size());  // an element may be the victim of each of its nodes and edges
  scratch.recent.reserve(mesh.tets.size());
  return scratch;
}

bool weaker_pieces_at_node(const MeshStars& mesh, std::span<const std::uint8_t> alive, std::int32_t node,
                           StarScratch& scratch, std::vector<std::int32_t>& weaker) {
  gather_star(mesh, alive, node, -1, scratch.members);
  return weaker_pieces(mesh, node, -1, scratch, weaker);
}

bool weaker_pieces_at_edge(const MeshStars& mesh, std::span<const std::uint8_t> alive, std::int32_t a,
                           std::int32_t b, StarScratch& scratch, std::vector<std::int32_t>& weaker) {
  gather_star(mesh, alive, a, b, scratch.members);
  return weaker_pieces(mesh, a, b, scratch, weaker);
}

int remove_singularities(const MeshStars& mesh, std::span<std::uint8_t> alive,
                         std::vector<std::int32_t>& removed, StarScratch& scratch) {
  assert(alive.size() == mesh.tets.size());
  int passes = 0;
  scratch.recent.assign(removed.begin(), removed.end());
  while (!scratch.recent.empty()) {
    list_candidates(mesh, scratch.recent, scratch);
    scratch.victims.clear();
    for (std::int32_t node : scratch.nodes)
      weaker_pieces_at_node(mesh, alive, node, scratch, scratch.victims);
    for (std::int64_t edge : scratch.edges) {
      weaker_pieces_at_edge(mesh, alive, low_node(edge), high_node(edge), scratch, scratch.victims);
    }
    sort_unique(scratch.victims);
    for (std::int32_t element : scratch.victims) alive[at(element)] = 0;
    removed.insert(removed.end(), scratch.victims.begin(), scratch.victims.end());
    scratch.recent.assign(scratch.victims.begin(), scratch.victims.end());
    passes += !scratch.victims.empty();
  }
  return passes;
}

Singularities find_singularities(const MeshStars& mesh, std::span<const std::uint8_t> alive) {
  Singularities found;
  StarScratch scratch = make_star_scratch(mesh);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (alive[t]) scratch.recent.push_back(static_cast<std::int32_t>(t));
  }
  list_candidates(mesh, scratch.recent, scratch);
  for (std::int32_t node : scratch.nodes) {
    if (weaker_pieces_at_node(mesh, alive, node, scratch, scratch.victims)) found.vertices.push_back(node);
    scratch.victims.clear();
  }
  for (std::int64_t edge : scratch.edges) {
    if (weaker_pieces_at_edge(mesh, alive, low_node(edge), high_node(edge), scratch, scratch.victims)) {
      found.edges.push_back({low_node(edge), high_node(edge)});
    }
    scratch.victims.clear();
  }
  return found;
}

}  // namespace sulcus
