#include "engine/fem/sparsity.h"

#include <algorithm>

namespace sulcus {
namespace {

struct EdgeUse {
  std::int32_t low, high, item, place;  // place: tet*6 + edge of the tetrahedron
};

constexpr int corner_pairs[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

void collect_edges(const EmbeddingMesh& mesh, Sparsity& s) {
  std::vector<EdgeUse> uses;
  uses.reserve(mesh.tets.size() * 6);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    for (int k = 0; k < 6; ++k) {
      int a = corner_pairs[k][0], b = corner_pairs[k][1];
      if (mesh.tets[e][a] > mesh.tets[e][b]) std::swap(a, b);
      const auto element = static_cast<std::int32_t>(e);
      uses.push_back({mesh.tets[e][a], mesh.tets[e][b], element * 16 + a * 4 + b, element * 6 + k});
    }
  }
  std::sort(uses.begin(), uses.end(), [](const EdgeUse& a, const EdgeUse& b) {
    if (a.low != b.low) return a.low < b.low;
    if (a.high != b.high) return a.high < b.high;
    return a.item < b.item;
  });
  s.tet_edges.resize(mesh.tets.size() * 6);
  for (const EdgeUse& use : uses) {
    if (s.edges.empty() || s.edges.back()[0] != use.low || s.edges.back()[1] != use.high) {
      s.edges.push_back({use.low, use.high});
      s.edge_start.push_back(static_cast<std::int32_t>(s.edge_items.size()));
    }
    s.edge_items.push_back(use.item);
    s.tet_edges[static_cast<std::size_t>(use.place)] = static_cast<std::int32_t>(s.edges.size()) - 1;
  }
  s.edge_start.push_back(static_cast<std::int32_t>(s.edge_items.size()));
}

void put_edges_in_lanes(std::size_t tets, Sparsity& s) {
  constexpr std::size_t lanes = Sparsity::chunk_rows, window = Sparsity::window_edges;
  const auto nothing = static_cast<std::int32_t>((tets + 15) / 16 * 16 * 16);
  const std::size_t edges = s.edges.size();
  const auto items = [&](std::int32_t edge) {
    const auto e = static_cast<std::size_t>(edge);
    return e < edges ? std::span(s.edge_items)
                           .subspan(static_cast<std::size_t>(s.edge_start[e]),
                                    static_cast<std::size_t>(s.edge_start[e + 1] - s.edge_start[e]))
                     : std::span<std::int32_t>();
  };
  s.lane_edges.resize((edges + window - 1) / window * window);
  for (std::size_t e = 0; e < s.lane_edges.size(); ++e)
    s.lane_edges[e] = static_cast<std::int32_t>(std::min(e, edges));
  for (auto first = s.lane_edges.begin(); first != s.lane_edges.end(); first += window) {
    std::stable_sort(first, first + window,
                     [&](std::int32_t a, std::int32_t b) { return items(a).size() > items(b).size(); });
  }
  s.lane_start.push_back(0);
  for (std::size_t group = 0; group < s.lane_edges.size(); group += lanes) {
    const std::size_t rows = items(s.lane_edges[group]).size();
    for (std::size_t k = 0; k < rows; ++k) {
      for (std::size_t l = 0; l < lanes; ++l) {
        const auto own = items(s.lane_edges[group + l]);
        s.lane_items.push_back(k < own.size() ? own[k] : nothing);
      }
    }
    s.lane_start.push_back(s.lane_start.back() + static_cast<std::int32_t>(rows));
  }
}

}  // namespace

Sparsity build_sparsity(const EmbeddingMesh& mesh) {
  Sparsity s;
  collect_edges(mesh, s);
  put_edges_in_lanes(mesh.tets.size(), s);
  s.nodes = static_cast<std::int64_t>(mesh.rest_positions.size());
  if (s.nodes < 1024) s.window_rows = 64;
  const auto nodes = static_cast<std::size_t>(s.nodes);

  // neighbours of each node, ascending by node
  struct Neighbour {
    std::int32_t node, block;
  };
  std::vector<std::int32_t> start(nodes + 1, 0);
  for (const auto& edge : s.edges) {
    ++start[static_cast<std::size_t>(edge[0]) + 1];
    ++start[static_cast<std::size_t>(edge[1]) + 1];
  }
  for (std::size_t i = 0; i < nodes; ++i) start[i + 1] += start[i];
  std::vector<Neighbour> neighbours(s.edges.size() * 2);
  std::vector<std::int32_t> next(start.begin(), start.end() - 1);
  const auto add = [&](std::int32_t node, Neighbour neighbour) {
    neighbours[static_cast<std::size_t>(next[static_cast<std::size_t>(node)]++)] = neighbour;
  };
  for (std::size_t e = 0; e < s.edges.size(); ++e) {  // rows with smaller neighbours first: edges are sorted
    add(s.edges[e][1], {s.edges[e][0], static_cast<std::int32_t>(e) * 2 + 1});
  }
  for (std::size_t e = 0; e < s.edges.size(); ++e) {
    add(s.edges[e][0], {s.edges[e][1], static_cast<std::int32_t>(e) * 2});
  }

  constexpr std::int64_t rows = Sparsity::chunk_rows;
  s.chunks = (s.nodes + rows - 1) / rows;
  s.node_of_slot.assign(static_cast<std::size_t>(s.chunks * rows), -1);
  s.slot_of_node.resize(nodes);
  const auto length = [&](std::int32_t node) {
    return start[static_cast<std::size_t>(node) + 1] - start[static_cast<std::size_t>(node)];
  };
  for (std::int64_t first = 0; first < s.nodes; first += s.window_rows) {
    const std::int64_t last = std::min<std::int64_t>(first + s.window_rows, s.nodes);
    std::vector<std::int32_t> window;
    for (std::int64_t node = first; node < last; ++node) window.push_back(static_cast<std::int32_t>(node));
    std::stable_sort(window.begin(), window.end(),
                     [&](std::int32_t a, std::int32_t b) { return length(a) > length(b); });
    for (std::size_t k = 0; k < window.size(); ++k) {
      const auto slot = static_cast<std::size_t>(first) + k;
      s.node_of_slot[slot] = window[k];
      s.slot_of_node[static_cast<std::size_t>(window[k])] = static_cast<std::int32_t>(slot);
    }
  }

  s.place_of_block.resize(2 * s.edges.size());
  s.chunk_start.push_back(0);
  for (std::int64_t chunk = 0; chunk < s.chunks; ++chunk) {
    std::int32_t longest = 0;
    for (std::int64_t l = 0; l < rows; ++l) {
      const std::int32_t node = s.node_of_slot[static_cast<std::size_t>(chunk * rows + l)];
      if (node >= 0) longest = std::max(longest, length(node));
    }
    for (std::int32_t k = 0; k < longest; ++k) {
      for (std::int64_t l = 0; l < rows; ++l) {
        const std::int32_t node = s.node_of_slot[static_cast<std::size_t>(chunk * rows + l)];
        const bool present = node >= 0 && k < length(node);
        const Neighbour neighbour =
            present ? neighbours[static_cast<std::size_t>(start[static_cast<std::size_t>(node)] + k)]
                    : Neighbour{-1, -1};
        // padding reads its own slot and multiplies it by zero
        s.column.push_back(present ? s.slot_of_node[static_cast<std::size_t>(neighbour.node)]
                                   : static_cast<std::int32_t>(chunk * rows + l));
        if (present)
          s.place_of_block[static_cast<std::size_t>(neighbour.block)] =
              static_cast<std::int32_t>(s.block.size());
        s.block.push_back(neighbour.block);
      }
    }
    s.chunk_start.push_back(s.chunk_start.back() + longest);
  }
  return s;
}

}  // namespace sulcus
