#include "engine/mesh/coarsening.h"

#include <algorithm>
#include <numeric>

#include "engine/mesh/superimpose.h"

namespace sulcus {
namespace {

using Link = std::array<std::int32_t, 2>;

std::size_t at(std::int32_t number) {
  return static_cast<std::size_t>(number);
}

// The finer level, whichever it is.
struct Finer {
  const Index3& grid_size;
  const std::vector<Index3>& cell_position;
  const std::vector<std::array<std::int32_t, 8>>& cell_nodes;
  const std::vector<Link>& cell_links;
  std::int64_t node_count;
};

Index3 block_of(const Index3& cell) {
  return {cell[0] / 2, cell[1] / 2, cell[2] / 2};
}

// For each cell the first cell of its piece within its block.
std::vector<std::int32_t> pieces_in_blocks(const Finer& finer) {
  std::vector<std::int32_t> first(finer.cell_position.size());
  std::iota(first.begin(), first.end(), 0);
  const auto root = [&](std::int32_t c) {
    while (first[at(c)] != c) c = first[at(c)] = first[at(first[at(c)])];
    return c;
  };
  for (const auto& [a, b] : finer.cell_links) {
    if (block_of(finer.cell_position[at(a)]) != block_of(finer.cell_position[at(b)])) continue;
    const std::int32_t x = root(a), y = root(b);
    first[at(std::max(x, y))] = std::min(x, y);
  }
  for (std::int32_t& c : first) c = root(c);
  return first;
}

void make_cells(const Finer& finer, CoarseLevel& level, CellCopies& copies) {
  for (std::size_t a = 0; a < 3; ++a) level.grid_size[a] = (finer.grid_size[a] + 1) / 2;
  const std::vector<std::int32_t> first = pieces_in_blocks(finer);
  const auto place = [&](std::int32_t cell) {
    const Index3 block = block_of(finer.cell_position[at(cell)]);
    return (static_cast<std::int64_t>(block[2]) * level.grid_size[1] + block[1]) * level.grid_size[0] + block[0];
  };
  std::vector<std::int32_t> firsts;
  for (std::size_t c = 0; c < first.size(); ++c) {
    if (at(first[c]) == c) firsts.push_back(first[c]);
  }
  std::stable_sort(firsts.begin(), firsts.end(),
                   [&](std::int32_t a, std::int32_t b) { return place(a) < place(b); });
  std::vector<std::int32_t> number(first.size(), -1);
  const std::int64_t places =
      static_cast<std::int64_t>(level.grid_size[0]) * level.grid_size[1] * level.grid_size[2];
  copies.first_copy.assign(static_cast<std::size_t>(places) + 1, 0);
  for (std::size_t k = 0; k < firsts.size(); ++k) {
    number[at(firsts[k])] = static_cast<std::int32_t>(k);
    level.cell_position.push_back(block_of(finer.cell_position[at(firsts[k])]));
    ++copies.first_copy[static_cast<std::size_t>(place(firsts[k])) + 1];
  }
  std::partial_sum(copies.first_copy.begin(), copies.first_copy.end(), copies.first_copy.begin());
  copies.position = level.cell_position;
  for (std::int32_t c : first) level.parent.push_back(number[at(c)]);
  for (const auto& [a, b] : finer.cell_links) {
    const std::int32_t x = level.parent[at(a)], y = level.parent[at(b)];
    if (x != y) level.cell_links.push_back({std::min(x, y), std::max(x, y)});
  }
  std::sort(level.cell_links.begin(), level.cell_links.end());
  level.cell_links.erase(std::unique(level.cell_links.begin(), level.cell_links.end()), level.cell_links.end());
}

void make_interpolation(const Finer& finer, CoarseLevel& level) {
  const auto nodes = static_cast<std::size_t>(finer.node_count);
  std::vector<std::int32_t> owner(nodes, -1);  // cell * 8 + corner
  for (std::size_t c = finer.cell_nodes.size(); c-- > 0;) {
    for (std::size_t corner = 0; corner < 8; ++corner) {
      owner[at(finer.cell_nodes[c][corner])] = static_cast<std::int32_t>(8 * c + corner);
    }
  }
  level.start.assign(1, 0);
  for (std::int32_t own : owner) {
    if (own >= 0) {
      const Index3& cell = finer.cell_position[at(own / 8)];
      const auto& coarse = level.cell_nodes[at(level.parent[at(own / 8)])];
      int low[3], high[3];  // corners of the coarse cell along each axis
      for (int a = 0; a < 3; ++a) {
        const int half = cell[static_cast<std::size_t>(a)] % 2 + (own >> a & 1);  // 0, 1, 2 half edges
        low[a] = half == 2;
        high[a] = half != 0;
      }
      for (int k = low[2]; k <= high[2]; ++k) {
        for (int j = low[1]; j <= high[1]; ++j) {
          for (int i = low[0]; i <= high[0]; ++i) {
            level.among.push_back(coarse[static_cast<std::size_t>(i + 2 * j + 4 * k)]);
          }
        }
      }
    }
    level.start.push_back(static_cast<std::int32_t>(level.among.size()));
  }
}

CoarseLevel coarsen(const Finer& finer) {
  CoarseLevel level;
  CellCopies copies;
  make_cells(finer, level, copies);
  NodeCopies nodes = make_nodes(level.grid_size, copies, level.cell_links, true);
  level.cell_nodes = std::move(nodes.cell_nodes);
  level.node_count = static_cast<std::int64_t>(nodes.position.size());
  make_interpolation(finer, level);
  return level;
}

}  // namespace

std::vector<CoarseLevel> build_coarse_levels(const EmbeddingMesh& mesh, std::int64_t enough_nodes) {
  std::vector<CoarseLevel> levels;
  auto count = static_cast<std::int64_t>(mesh.rest_positions.size());
  while (count > enough_nodes) {
    const Finer finer =
        levels.empty()
            ? Finer{mesh.grid_size, mesh.cell_position, mesh.cell_nodes, mesh.cell_links, count}
            : Finer{levels.back().grid_size, levels.back().cell_position, levels.back().cell_nodes,
                    levels.back().cell_links, count};
    CoarseLevel level = coarsen(finer);
    if (level.node_count >= count) break;
    count = level.node_count;
    levels.push_back(std::move(level));
  }
  return levels;
}

}  // namespace sulcus
