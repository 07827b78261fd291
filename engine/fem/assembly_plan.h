// In which order an assembly goes through the mesh, and where what it makes on the way stands. Elements are
// done in tiles of their numbers, behind them the edges and then the rows of nodes that need no more
// elements. What lies between (records and forces of elements, blocks of edges) is read again soon and then
// never more, so it stands in rings that stay in the cache: an element's place is taken again by a later one.
//
// Each thread goes its own way: it makes whole windows of rows and all that they need, so the elements and
// edges at the border between two threads are made by both.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/fem/elements.h"
#include "engine/fem/sparsity.h"

namespace sulcus {

struct AssemblyPlan {
  static constexpr std::int64_t tile_elements = 128;

  // With the tiles below t done, the first ready_edges[t] windows of edges (Sparsity::window_edges) and the
  // first ready_rows[t] windows of rows (Sparsity::window_rows) can be made. [tiles+1], ascending
  std::vector<std::int64_t> ready_edges, ready_rows;

  std::int64_t ring_tiles = 0, ring_windows = 0;  // how many of each the rings hold
  std::int64_t elements() const { return ring_tiles * tile_elements; }
  std::int64_t edges() const { return ring_windows * Sparsity::window_edges; }

  // The lists of Sparsity and ElementData with places in the rings for numbers; padding: one behind the last
  // place.
  std::vector<std::int32_t> lane_edges, incident;
  // Those that the hot loops gather by hold the place of the first number: of the records of corners a and b,
  // [rows of lane_items][2][16], and of the blocks of entries; padding: zeros behind the last place.
  std::vector<std::int32_t> lane_corners, block;
  std::vector<std::uint16_t> transposed;  // [entries] bit l: row l takes the block transposed

  // What a thread does. Tiles from `next` on are the next threads', whose rotations it must not write.
  struct Part {
    std::int64_t first_tile = 0, last_tile = 0, next = 0;
    std::int64_t first_edges = 0, first_rows = 0, last_rows = 0;  // windows
  };
  std::vector<Part> parts;  // [threads]
};

// Cost: a few passes over the lists; once for a scene.
AssemblyPlan plan_assembly(const ElementData& elements, const Sparsity& sparsity, int threads);

}  // namespace sulcus
