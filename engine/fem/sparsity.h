// Where the stiffness blocks go: the edges of the mesh, who contributes to them, and the sliced block storage
// (SELL) of the symmetric matrix: chunks of 16 rows, rows sorted by length within windows so that padding
// stays small (9 % on a brain of 10 mm cells with windows of 256 rows, 26 % with 64).
//
// Vectors of the linear solver use the same slots: entry d of slot s stands at [(s / 16 * 3 + d) * 16 + s %
// 16].
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

struct Sparsity {
  static constexpr int chunk_rows = 16;
  static constexpr int window_edges = 128;

  std::int64_t edge_windows() const { return static_cast<std::int64_t>(lane_edges.size()) / window_edges; }

  std::int64_t nodes = 0;
  std::int64_t window_rows = 256;          // 64 in small meshes, so that every thread has some
  std::int64_t chunks = 0;                 // slots = 16 * chunks >= nodes
  std::vector<std::int32_t> slot_of_node;  // [nodes]
  std::vector<std::int32_t> node_of_slot;  // [slots], -1 for padding

  std::vector<std::array<std::int32_t, 2>> edges;  // [edges] nodes a < b, sorted
  std::vector<std::int32_t> edge_start;            // [edges+1] into edge_items
  std::vector<std::int32_t> edge_items;            // element*16 + corner_a*4 + corner_b, ascending
  std::vector<std::int32_t> tet_edges;             // [6*tets], edges of corners 01 02 03 12 13 23

  // Edges in lanes: groups of 16, those with many items first within windows of 128, so that padding stays
  // small.
  std::vector<std::int32_t> lane_edges;  // [128*windows]; padding: the number of edges
  std::vector<std::int32_t> lane_start;  // [8*windows+1] in rows of 16 items
  std::vector<std::int32_t>
      lane_items;  // [16*rows]; padding: of the first element behind all, rounded up to 16

  std::vector<std::int32_t> chunk_start;  // [chunks+1] in columns of 16 entries
  std::vector<std::int32_t> column;       // [entries] slot of the neighbour
  std::vector<std::int32_t> block;        // [entries] edge*2 + (1: transposed); -1: padding
  // Where block b = edge*2 + (1: transposed) stands: [2*edges] entry*16 + lane; its number (i, j) is
  // values[9*16*entry + 16*(3*i + j) + lane].
  std::vector<std::int32_t> place_of_block;
};

Sparsity build_sparsity(const EmbeddingMesh& mesh);

}  // namespace sulcus
