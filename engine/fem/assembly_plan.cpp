#include "engine/fem/assembly_plan.h"

#include <algorithm>
#include <limits>
namespace sulcus {
namespace {

constexpr std::int64_t nothing = std::numeric_limits<std::int64_t>::max();

// The tiles or windows [first, last] that something needs.
struct Need {
  std::int64_t first = nothing, last = -1;

  void add(std::int64_t number) {
    first = std::min(first, number);
    last = std::max(last, number);
  }
};

std::size_t at(std::int64_t number) {
  return static_cast<std::size_t>(number);
}

// Tiles that each window of edges needs.
std::vector<Need> tiles_of_edges(const Sparsity& sparsity) {
  std::vector<Need> needs(at(sparsity.edge_windows()));
  for (std::size_t e = 0; e < sparsity.edges.size(); ++e) {
    Need& need = needs[e / Sparsity::window_edges];
    for (const std::int32_t item : {sparsity.edge_start[e], sparsity.edge_start[e + 1] - 1})
      need.add(sparsity.edge_items[at(item)] / 16 / AssemblyPlan::tile_elements);
  }
  return needs;
}

// Tiles whose forces, and windows of edges whose blocks, each window of rows needs.
struct RowNeeds {
  std::vector<Need> tiles, edges;
};
RowNeeds needs_of_rows(const ElementData& elements, const Sparsity& sparsity) {
  const std::int64_t windows = (sparsity.nodes + sparsity.window_rows - 1) / sparsity.window_rows;
  RowNeeds needs{std::vector<Need>(at(windows)), std::vector<Need>(at(windows))};
  for (std::int64_t node = 0; node < sparsity.nodes; ++node) {
    for (std::int32_t k = elements.incident_start[at(node)]; k < elements.incident_start[at(node) + 1]; ++k)
      needs.tiles[at(node / sparsity.window_rows)].add(elements.incident[at(k)] / 4 /
                                                       AssemblyPlan::tile_elements);
  }
  for (std::size_t e = 0; e < sparsity.edges.size(); ++e) {
    for (const std::int32_t node : sparsity.edges[e])
      needs.edges[at(node / sparsity.window_rows)].add(static_cast<std::int64_t>(e) / Sparsity::window_edges);
  }
  return needs;
}

// For each number of tiles, how many of the first windows can be made: last[w] is the last tile that w waits
// for.
std::vector<std::int64_t> count_ready(const std::vector<std::int64_t>& last, std::int64_t tiles) {
  std::vector<std::int64_t> ready;
  std::int64_t next = 0;
  for (std::int64_t done = 0; done <= tiles; ++done) {
    while (next < static_cast<std::int64_t>(last.size()) && last[at(next)] < done) ++next;
    ready.push_back(next);
  }
  return ready;
}

// The first number that any of the windows from each on needs, [windows+1].
std::vector<std::int64_t> first_needed(const std::vector<Need>& needs) {
  std::vector<std::int64_t> first(needs.size() + 1, nothing);
  for (std::size_t w = needs.size(); w-- > 0;) first[w] = std::min(first[w + 1], needs[w].first);
  return first;
}

}  // namespace

AssemblyPlan plan_assembly(const ElementData& elements, const Sparsity& sparsity, int threads) {
  AssemblyPlan plan;
  constexpr std::int64_t tile_elements = AssemblyPlan::tile_elements, window_edges = Sparsity::window_edges;
  const std::int64_t tiles = (elements.count + tile_elements - 1) / tile_elements;
  const std::vector<Need> edge_tiles = tiles_of_edges(sparsity);
  const RowNeeds rows = needs_of_rows(elements, sparsity);

  std::vector<std::int64_t> last_tile, complete;  // of a window of edges; of all up to it
  for (const Need& need : edge_tiles) {
    last_tile.push_back(need.last);
    complete.push_back(std::max(need.last, complete.empty() ? -1 : complete.back()));
  }
  plan.ready_edges = count_ready(last_tile, tiles);
  last_tile.clear();
  for (std::size_t r = 0; r < rows.tiles.size(); ++r)
    last_tile.push_back(
        std::max(rows.tiles[r].last, rows.edges[r].last < 0 ? -1 : complete[at(rows.edges[r].last)]));
  plan.ready_rows = count_ready(last_tile, tiles);
  for (std::size_t r = 1; r < last_tile.size(); ++r) last_tile[r] = std::max(last_tile[r], last_tile[r - 1]);

  // What is still needed when a tile is made bounds the rings.
  const std::vector<std::int64_t> for_edges = first_needed(edge_tiles), for_rows = first_needed(rows.tiles),
                                  edges_for_rows = first_needed(rows.edges);
  for (std::int64_t t = 0; t < tiles; ++t) {
    const std::size_t edges_done = at(plan.ready_edges[at(t)]), rows_done = at(plan.ready_rows[at(t)]);
    const std::int64_t oldest = std::min({t, for_edges[edges_done], for_rows[rows_done]});
    plan.ring_tiles = std::max(plan.ring_tiles, t + 1 - oldest);
    const std::int64_t made = plan.ready_edges[at(t + 1)];
    plan.ring_windows = std::max(plan.ring_windows, made - std::min(made, edges_for_rows[rows_done]));
  }

  const auto place_of_element = [&](std::int64_t e) {
    return e / tile_elements % plan.ring_tiles * tile_elements + e % tile_elements;
  };
  const auto place_of_edge = [&](std::int64_t e) {
    return e / window_edges % plan.ring_windows * window_edges + e % window_edges;
  };
  plan.lane_corners.reserve(2 * sparsity.lane_items.size());
  plan.block.reserve(sparsity.block.size());
  plan.transposed.assign(sparsity.block.size() / 16, 0);
  plan.incident.reserve(elements.incident.size());
  for (std::size_t row = 0; row < sparsity.lane_items.size(); row += 16) {
    for (const bool second : {false, true}) {
      for (std::size_t l = 0; l < 16; ++l) {
        const std::int32_t item = sparsity.lane_items[row + l];
        const std::int64_t place = item / 16 < elements.count ? place_of_element(item / 16) : plan.elements();
        const std::int32_t corner = second ? item % 4 : item / 4 % 4;
        plan.lane_corners.push_back(static_cast<std::int32_t>(place * 16 + 4 * corner));
      }
    }
  }
  const auto edges = static_cast<std::int64_t>(sparsity.edges.size());
  for (const std::int32_t edge : sparsity.lane_edges)
    plan.lane_edges.push_back(static_cast<std::int32_t>(edge < edges ? place_of_edge(edge) : plan.edges()));
  for (std::size_t k = 0; k < sparsity.block.size(); ++k) {
    const std::int32_t block = sparsity.block[k];
    const std::int64_t place = block < 0 ? plan.edges() + 1 : place_of_edge(block / 2);
    plan.block.push_back(static_cast<std::int32_t>(12 * place));
    if (block >= 0 && block % 2 == 1)
      plan.transposed[k / 16] = static_cast<std::uint16_t>(plan.transposed[k / 16] | 1 << k % 16);
  }
  for (const std::int32_t corner : elements.incident)
    plan.incident.push_back(static_cast<std::int32_t>(place_of_element(corner / 4) * 4 + corner % 4));

  // Rows are shared out so that those in front of a border wait for as many tiles as are left behind it.
  // Backwards: a thread's own tiles end where the next one begins.
  const auto border = [&](int thread) {
    std::int64_t row = 0;
    const auto last = static_cast<std::int64_t>(rows.tiles.size());
    while (thread > 0 && row < last &&
           (thread == threads || (last_tile[at(row)] + for_rows[at(row)]) * threads < 2 * tiles * thread))
      ++row;
    return row;
  };
  plan.parts.resize(at(threads));
  std::int64_t next = tiles;
  for (int thread = threads - 1; thread >= 0; --thread) {
    AssemblyPlan::Part& part = plan.parts[at(thread)];
    const std::int64_t first_row = border(thread), last_row = border(thread + 1);
    Need tile, window;
    for (std::int64_t r = first_row; r < last_row; ++r) {
      tile.add(std::min(rows.tiles[at(r)].first, tiles));
      window.add(std::min(rows.edges[at(r)].first, sparsity.edge_windows()));
    }
    part.first_rows = first_row;
    part.last_rows = last_row;
    part.next = next;
    part.first_tile = thread == 0 ? 0 : std::min(next, tile.first);
    part.first_edges = thread == 0 ? 0 : std::min(window.first, sparsity.edge_windows());
    const auto done = std::lower_bound(plan.ready_rows.begin(), plan.ready_rows.end(), last_row);
    part.last_tile = std::max<std::int64_t>(next, first_row < last_row ? done - plan.ready_rows.begin() : 0);
    next = part.first_tile;
  }
  return plan;
}

}  // namespace sulcus
