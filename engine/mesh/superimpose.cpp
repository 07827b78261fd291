#include "engine/mesh/superimpose.h"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <span>

#include "engine/volume/large_array.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

using Link = std::array<std::int32_t, 2>;

// Voxels [begin, end) of a grid cell.
struct Box {
  Index3 begin, end;
};

Box cell_box(const LabelMap& map, const Index3& voxels_per_cell, const Index3& cell) {
  Box box;
  for (int a = 0; a < 3; ++a) {
    box.begin[a] = cell[a] * voxels_per_cell[a];
    box.end[a] = std::min(box.begin[a] + voxels_per_cell[a], map.size[a]);
  }
  return box;
}

// Union by the smaller number, so that a root is the first of its set.
std::int32_t find_root(std::int32_t* parent, std::int32_t n) {
  while (parent[n] != n) n = parent[n] = parent[parent[n]];
  return n;
}

void unite(std::int32_t* parent, std::int32_t a, std::int32_t b) {
  a = find_root(parent, a);
  b = find_root(parent, b);
  if (a < b) parent[b] = a;
  if (b < a) parent[a] = b;
}

// The label that most of `labels` have, the first to occur at ties.
std::int32_t most_frequent(const std::vector<std::int32_t>& labels, std::vector<Link>& counts) {
  counts.clear();  // label, count; a cell holds few labels, and neighbours are mostly equal
  std::size_t at = 0;
  for (const std::int32_t label : labels) {
    if (counts.empty() || counts[at][0] != label) {
      for (at = 0; at < counts.size() && counts[at][0] != label;) ++at;
      if (at == counts.size()) counts.push_back({label, 0});
    }
    ++counts[at][1];
  }
  return std::max_element(counts.begin(), counts.end(),
                          [](const Link& a, const Link& b) { return a[1] < b[1]; })
      ->front();
}

// The copies of one layer of grid cells; copies are numbered from 0 in the layer until all layers are known.
struct CellLayer {
  std::vector<std::int32_t> count;  // [grid cells of the layer]
  std::vector<Index3> position;
  std::vector<std::int32_t> voxels, label;
};

// Finds the pieces of one grid cell after another; scratch of one thread.
class CellSplitter {
 public:
  CellSplitter(const LabelMap& map, const VoxelLinks& links, bool superimpose,
               std::span<std::int32_t> copy_of_voxel)
      : map_(map), links_(links), superimpose_(superimpose), copy_of_voxel_(copy_of_voxel) {}

  void split(const Box& box, const Index3& cell, CellLayer& layer) {
    const auto first = static_cast<std::int32_t>(layer.position.size());
    int pieces = 0;
    switch (kind(box)) {
      case Kind::empty:
        break;
      case Kind::whole:
        pieces = take_whole(box, first);
        break;
      case Kind::mixed:
        pieces = superimpose_ ? grow(box, first) : take_labelled(box, first);
        break;
    }
    layer.count.push_back(pieces);
    for (int p = 0; p < pieces; ++p) {
      layer.position.push_back(cell);
      layer.voxels.push_back(static_cast<std::int32_t>(labels_[p].size()));
      layer.label.push_back(most_frequent(labels_[p], counts_));
    }
  }

 private:
  enum class Kind { empty, whole, mixed };

  // Whether all voxels are empty, or all are labelled and linked with their neighbours in the cell.
  Kind kind(const Box& box) const {
    constexpr std::uint64_t every = 0x0101010101010101ULL;
    const int nx = box.end[0] - box.begin[0];
    std::uint64_t any = 0, all = ~std::uint64_t{0};
    for (int k = box.begin[2]; k < box.end[2]; ++k) {
      for (int j = box.begin[1]; j < box.end[1]; ++j) {
        const int border = (k + 1 == box.end[2] ? link_k : 0) | (j + 1 == box.end[1] ? link_j : 0);
        const std::uint8_t* row = links_.data() + map_.index(box.begin[0], j, k);
        for (int i = 0; i < nx; i += 8) {  // 8 voxels of the row, those of the next cell masked
          std::uint64_t eight = 0;
          std::memcpy(&eight, row + i, 8);
          const int left = nx - i;
          const std::uint64_t mask = left < 8 ? (std::uint64_t{1} << 8 * left) - 1 : ~std::uint64_t{0};
          const std::uint64_t last = left <= 8 ? std::uint64_t{link_i} << 8 * (left - 1) : 0;
          any |= eight & mask;
          all &= eight | ~mask | last | every * static_cast<std::uint64_t>(border);
        }
      }
      if (any != 0 && (all & every * 15) != every * 15) return Kind::mixed;
    }
    return any != 0 ? Kind::whole : Kind::empty;
  }

  int take_whole(const Box& box, std::int32_t copy) {
    start_pieces(1);
    for (int k = box.begin[2]; k < box.end[2]; ++k) {
      for (int j = box.begin[1]; j < box.end[1]; ++j) {
        const std::size_t row = map_.index(0, j, k);
        std::fill_n(copy_of_voxel_.data() + row + box.begin[0], box.end[0] - box.begin[0], copy);
        const std::int32_t* labels = map_.labels.data() + row;
        labels_[0].insert(labels_[0].end(), labels + box.begin[0], labels + box.end[0]);
      }
    }
    return 1;
  }

  int take_labelled(const Box& box, std::int32_t copy) {
    start_pieces(1);
    for (int k = box.begin[2]; k < box.end[2]; ++k) {
      for (int j = box.begin[1]; j < box.end[1]; ++j) {
        for (std::size_t v = map_.index(box.begin[0], j, k); v < map_.index(box.end[0], j, k); ++v) {
          if (!(links_[v] & voxel_labelled)) continue;
          copy_of_voxel_[v] = copy;
          labels_[0].push_back(map_.labels[v]);
        }
      }
    }
    return 1;
  }

  // The pieces of a cell in two runs over its voxels: the first hands on tentative numbers along the links
  // and notes which are the same piece, the second numbers the pieces by their first voxel.
  int grow(const Box& box, std::int32_t first_copy) {
    const int nx = box.end[0] - box.begin[0], ny = box.end[1] - box.begin[1], nz = box.end[2] - box.begin[2];
    tentative_.resize(static_cast<std::size_t>(nx) * ny * nz);
    parent_.clear();
    std::int32_t* number = tentative_.data();
    for (int k = 0; k < nz; ++k) {
      for (int j = 0; j < ny; ++j) {
        const std::size_t at = map_.index(box.begin[0], box.begin[1] + j, box.begin[2] + k);
        const std::uint8_t* row = links_.data() + at;
        const std::uint8_t* row_j = j > 0 ? row - map_.size[0] : nullptr;
        const std::uint8_t* row_k =
            k > 0 ? row - static_cast<std::ptrdiff_t>(map_.size[0]) * map_.size[1] : nullptr;
        for (int i = 0; i < nx; ++i, ++number) {
          if (!(row[i] & voxel_labelled)) continue;
          std::int32_t here = -1;
          if (i > 0 && row[i - 1] & link_i) here = join(here, number[-1]);
          if (row_j && row_j[i] & link_j) here = join(here, number[-nx]);
          if (row_k && row_k[i] & link_k) here = join(here, number[-nx * ny]);
          if (here < 0) {
            here = static_cast<std::int32_t>(parent_.size());
            parent_.push_back(here);
          }
          *number = here;
        }
      }
    }
    // The root of a piece is its smallest number, which its first voxel has.
    int pieces = 0;
    piece_.resize(parent_.size());
    for (std::size_t n = 0; n < parent_.size(); ++n) {
      const std::int32_t root = find_root(parent_.data(), static_cast<std::int32_t>(n));
      piece_[n] = root == static_cast<std::int32_t>(n) ? pieces++ : piece_[root];
    }
    start_pieces(pieces);
    number = tentative_.data();
    for (int k = 0; k < nz; ++k) {
      for (int j = 0; j < ny; ++j) {
        const std::size_t at = map_.index(box.begin[0], box.begin[1] + j, box.begin[2] + k);
        for (int i = 0; i < nx; ++i, ++number) {
          if (!(links_[at + i] & voxel_labelled)) continue;
          const std::int32_t piece = piece_[*number];
          copy_of_voxel_[at + i] = first_copy + piece;
          labels_[piece].push_back(map_.labels[at + i]);
        }
      }
    }
    return pieces;
  }

  // The number of a voxel that is linked with one of number `other`; -1: it has none yet.
  std::int32_t join(std::int32_t here, std::int32_t other) {
    if (here < 0 || here == other) return other;
    unite(parent_.data(), here, other);
    return here;
  }

  void start_pieces(int pieces) {
    if (labels_.size() < static_cast<std::size_t>(pieces)) labels_.resize(pieces);
    for (int p = 0; p < pieces; ++p) labels_[p].clear();
  }

  const LabelMap& map_;
  const VoxelLinks& links_;
  bool superimpose_;
  std::span<std::int32_t> copy_of_voxel_;
  std::vector<std::int32_t> tentative_, parent_, piece_;
  std::vector<std::vector<std::int32_t>> labels_;  // of each piece, in voxel order
  std::vector<Link> counts_;
};

// Adds to the numbers of the box' voxels that have one.
void add_to_voxels(const LabelMap& map, const Box& box, std::int32_t add, std::int32_t* copy_of_voxel) {
  for (int k = box.begin[2]; k < box.end[2]; ++k) {
    for (int j = box.begin[1]; j < box.end[1]; ++j) {
      std::int32_t* voxel = copy_of_voxel + map.index(box.begin[0], j, k);
      for (int n = 0; n < box.end[0] - box.begin[0]; ++n) voxel[n] += voxel[n] >= 0 ? add : 0;
    }
  }
}

}  // namespace

CellCopies make_cell_copies(const LabelMap& map, const VoxelLinks& links, const Index3& grid,
                            const Index3& voxels_per_cell, bool superimpose) {
  CellCopies copies;
  copies.copy_of_voxel.resize(map.voxel_count());
  std::vector<CellLayer> layers(static_cast<std::size_t>(grid[2]));
  const auto plane = static_cast<std::ptrdiff_t>(map.size[0]) * map.size[1];
#pragma omp parallel
  {
    CellSplitter splitter(map, links, superimpose, copies.copy_of_voxel);
#pragma omp for schedule(static, 1)
    for (int k = 0; k < grid[2]; ++k) {
      const Box layer = cell_box(map, voxels_per_cell, {0, 0, k});
      std::fill(copies.copy_of_voxel.begin() + plane * layer.begin[2],
                copies.copy_of_voxel.begin() + plane * layer.end[2], -1);
      for (int j = 0; j < grid[1]; ++j) {
        for (int i = 0; i < grid[0]; ++i) {
          splitter.split(cell_box(map, voxels_per_cell, {i, j, k}), {i, j, k}, layers[k]);
        }
      }
    }
  }
  // Layers in order; then their copies get their final numbers.
  std::vector<std::int32_t> offset;
  copies.first_copy.push_back(0);
  for (const CellLayer& layer : layers) {
    offset.push_back(copies.first_copy.back());
    for (const std::int32_t count : layer.count)
      copies.first_copy.push_back(copies.first_copy.back() + count);
    copies.position.insert(copies.position.end(), layer.position.begin(), layer.position.end());
    copies.voxels.insert(copies.voxels.end(), layer.voxels.begin(), layer.voxels.end());
    copies.label.insert(copies.label.end(), layer.label.begin(), layer.label.end());
  }
  const auto places = static_cast<std::ptrdiff_t>(grid[0]) * grid[1];
#pragma omp parallel for schedule(static, 1)
  for (int k = 0; k < grid[2]; ++k) {
    for (std::ptrdiff_t g = places * k; g < places * (k + 1); ++g) {
      if (copies.first_copy[g] == copies.first_copy[g + 1]) continue;
      const int i = static_cast<int>(g % grid[0]), j = static_cast<int>(g / grid[0] % grid[1]);
      add_to_voxels(map, cell_box(map, voxels_per_cell, {i, j, k}), offset[k], copies.copy_of_voxel.data());
    }
  }
  return copies;
}

namespace {

// Links between grid cell `cell` and its neighbour along `axis`, appended unsorted, several times if found
// so.
void links_to_neighbour(const LabelMap& map, const VoxelLinks& links, const Index3& voxels_per_cell,
                        const CellCopies& copies, const Index3& cell, int axis, bool single,
                        std::vector<Link>& found) {
  Box box = cell_box(map, voxels_per_cell, cell);
  box.begin[axis] = box.end[axis] - 1;
  const auto bit = static_cast<std::uint8_t>(1 << axis);
  const std::size_t step = axis == 0   ? 1
                           : axis == 1 ? static_cast<std::size_t>(map.size[0])
                                       : static_cast<std::size_t>(map.size[0]) * map.size[1];
  for (int k = box.begin[2]; k < box.end[2]; ++k) {
    for (int j = box.begin[1]; j < box.end[1]; ++j) {
      for (int i = box.begin[0]; i < box.end[0]; ++i) {
        const std::size_t voxel = map.index(i, j, k);
        if (!(links[voxel] & bit)) continue;
        const Link link{copies.copy_of_voxel[voxel], copies.copy_of_voxel[voxel + step]};
        if (found.empty() || found.back() != link) found.push_back(link);
        if (single) return;
      }
    }
  }
}

}  // namespace

std::vector<Link> make_cell_links(const LabelMap& map, const VoxelLinks& links, const Index3& grid,
                                  const Index3& voxels_per_cell, const CellCopies& copies, bool superimpose) {
  std::vector<std::vector<Link>> layers(static_cast<std::size_t>(grid[2]));
  const std::ptrdiff_t stride[3] = {1, grid[0], static_cast<std::ptrdiff_t>(grid[0]) * grid[1]};
#pragma omp parallel
  {
    std::vector<Link> found;
#pragma omp for schedule(static, 1)
    for (int k = 0; k < grid[2]; ++k) {
      for (int j = 0; j < grid[1]; ++j) {
        for (int i = 0; i < grid[0]; ++i) {
          const Index3 cell{i, j, k};
          const std::ptrdiff_t g = i + stride[1] * j + stride[2] * k;
          const std::int32_t first = copies.first_copy[g], count = copies.first_copy[g + 1] - first;
          if (count == 0) continue;
          found.clear();
          for (int axis = 0; axis < 3; ++axis) {
            if (cell[axis] + 1 == grid[axis]) continue;
            const std::int32_t other = copies.first_copy[g + stride[axis]];
            const std::int32_t others = copies.first_copy[g + stride[axis] + 1] - other;
            if (others == 0) continue;
            if (superimpose) {
              links_to_neighbour(map, links, voxels_per_cell, copies, cell, axis, count == 1 && others == 1,
                                 found);
            } else {
              found.push_back({first, other});
            }
          }
          std::sort(found.begin(), found.end());
          found.erase(std::unique(found.begin(), found.end()), found.end());
          layers[k].insert(layers[k].end(), found.begin(), found.end());
        }
      }
    }
  }
  std::vector<Link> all;
  for (const auto& layer : layers) all.insert(all.end(), layer.begin(), layer.end());
  return all;
}

NodeCopies make_nodes(const Index3& grid, const CellCopies& copies, const std::vector<Link>& cell_links,
                      bool superimpose) {
  const std::size_t cells = copies.position.size();
  NodeCopies nodes;
  nodes.cell_nodes = large_vector<std::array<std::int32_t, 8>>(cells, {});
  std::vector<std::int32_t> first_link(cells + 1, 0);  // links of copy a: first_link[a] .. [a + 1] - 1
  for (const Link& link : cell_links) ++first_link[link[0] + 1];
  std::partial_sum(first_link.begin(), first_link.end(), first_link.begin());

  // Layers of grid corners; nodes are numbered from 0 in a layer first.
  std::vector<std::vector<Index3>> layers(static_cast<std::size_t>(grid[2]) + 1);
#pragma omp parallel
  {
    std::vector<std::int32_t> around, parent, node;  // copies around a corner
    std::vector<std::uint8_t> corner;                // the corner's number in each of them
#pragma omp for schedule(static, 1)
    for (int k = 0; k <= grid[2]; ++k) {
      for (int j = 0; j <= grid[1]; ++j) {
        for (int i = 0; i <= grid[0]; ++i) {
          around.clear();
          corner.clear();
          for (int n = 0; n < 8; ++n) {  // grid cells in ascending order
            const Index3 cell{i - 1 + (n & 1), j - 1 + (n >> 1 & 1), k - 1 + (n >> 2)};
            if (cell[0] < 0 || cell[1] < 0 || cell[2] < 0) continue;
            if (cell[0] >= grid[0] || cell[1] >= grid[1] || cell[2] >= grid[2]) continue;
            const std::size_t g =
                static_cast<std::size_t>(cell[0]) +
                static_cast<std::size_t>(grid[0]) *
                    (static_cast<std::size_t>(cell[1]) + static_cast<std::size_t>(grid[1]) * cell[2]);
            for (std::int32_t copy = copies.first_copy[g]; copy < copies.first_copy[g + 1]; ++copy) {
              around.push_back(copy);
              corner.push_back(static_cast<std::uint8_t>(7 - n));
            }
          }
          parent.resize(around.size());
          std::iota(parent.begin(), parent.end(), 0);
          for (std::size_t a = 0; a < around.size(); ++a) {
            if (!superimpose) parent[a] = 0;
            for (std::int32_t l = first_link[around[a]]; superimpose && l < first_link[around[a] + 1]; ++l) {
              const auto other = std::lower_bound(around.begin() + static_cast<std::ptrdiff_t>(a),
                                                  around.end(), cell_links[l][1]);
              if (other == around.end() || *other != cell_links[l][1]) continue;
              unite(parent.data(), static_cast<std::int32_t>(a),
                    static_cast<std::int32_t>(other - around.begin()));
            }
          }
          node.resize(around.size());
          for (std::size_t a = 0; a < around.size(); ++a) {
            const std::int32_t root = find_root(parent.data(), static_cast<std::int32_t>(a));
            if (root == static_cast<std::int32_t>(a)) {
              node[a] = static_cast<std::int32_t>(layers[k].size());
              layers[k].push_back({i, j, k});
            }
            nodes.cell_nodes[around[a]][corner[a]] = node[root];
          }
        }
      }
    }
  }
  std::vector<std::int32_t> offset;
  for (const auto& layer : layers) {
    offset.push_back(static_cast<std::int32_t>(nodes.position.size()));
    nodes.position.insert(nodes.position.end(), layer.begin(), layer.end());
  }
#pragma omp parallel for schedule(static)
  for (std::size_t c = 0; c < cells; ++c) {
    for (int corner = 0; corner < 8; ++corner) {
      nodes.cell_nodes[c][corner] += offset[copies.position[c][2] + (corner >> 2)];
    }
  }
  return nodes;
}

}  // namespace sulcus
