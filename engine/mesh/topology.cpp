#include "engine/mesh/topology.h"

#include <algorithm>
#include <numeric>

#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

// Disjoint sets whose root is their smallest member.
class Sets {
 public:
  explicit Sets(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }

  std::int32_t root(std::int32_t n) {
    while (parent_[n] != n) n = parent_[n] = parent_[parent_[n]];
    return n;
  }

  void unite(std::int32_t a, std::int32_t b) {
    a = root(a);
    b = root(b);
    if (a < b) parent_[b] = a;
    if (b < a) parent_[a] = b;
  }

 private:
  std::vector<std::int32_t> parent_;
};

}  // namespace

Pieces voxel_pieces(const LabelMap& map, const SeparationPairs& pairs) {
  const VoxelLinks links = build_voxel_links(map, pairs);
  const auto count = static_cast<std::int32_t>(map.voxel_count());
  const std::int32_t row = map.size[0], plane = map.size[0] * map.size[1];
  Sets sets(map.voxel_count());
  for (std::int32_t v = 0; v < count; ++v) {
    if (links[v] & link_i) sets.unite(v, v + 1);
    if (links[v] & link_j) sets.unite(v, v + row);
    if (links[v] & link_k) sets.unite(v, v + plane);
  }
  Pieces pieces;
  pieces.piece.assign(map.voxel_count(), -1);
  for (std::int32_t v = 0; v < count; ++v) {
    if (!(links[v] & voxel_labelled)) continue;
    const std::int32_t root = sets.root(v);
    if (root == v) {
      pieces.piece[v] = static_cast<std::int32_t>(pieces.item_count.size());
      pieces.item_count.push_back(0);
    }
    pieces.piece[v] = pieces.piece[root];
    ++pieces.item_count[pieces.piece[v]];
  }
  return pieces;
}

NodeStars build_node_stars(std::span<const std::array<std::int32_t, 4>> tets, std::int64_t node_count) {
  NodeStars stars;
  stars.start.assign(static_cast<std::size_t>(node_count) + 1, 0);
  for (const auto& tet : tets) {
    for (std::int32_t node : tet) ++stars.start[static_cast<std::size_t>(node) + 1];
  }
  for (std::size_t n = 1; n < stars.start.size(); ++n) stars.start[n] += stars.start[n - 1];
  stars.incident.resize(4 * tets.size());
  std::vector<std::int32_t> next(stars.start.begin(), stars.start.end() - 1);
  for (std::size_t t = 0; t < tets.size(); ++t) {
    for (std::size_t corner = 0; corner < 4; ++corner) {
      std::int32_t& place = next[static_cast<std::size_t>(tets[t][corner])];
      stars.incident[static_cast<std::size_t>(place++)] = static_cast<std::int32_t>(4 * t + corner);
    }
  }
  return stars;
}

FaceNeighbours face_neighbours(std::span<const std::array<std::int32_t, 4>> tets) {
  struct Face {
    std::array<std::int32_t, 3> nodes;  // ascending
    bool flipped;  // seen from outside the nodes run the other way round: tells the sides apart
    std::int32_t name;
  };
  std::vector<Face> all;
  all.reserve(4 * tets.size());
  for (std::size_t t = 0; t < tets.size(); ++t) {
    for (std::size_t c = 0; c < 4; ++c) {
      const auto& o = face_corners[c];
      Face face{{tets[t][o[0]], tets[t][o[1]], tets[t][o[2]]}, false, static_cast<std::int32_t>(4 * t + c)};
      const auto order = [&](std::size_t i, std::size_t j) {
        if (face.nodes[i] < face.nodes[j]) return;
        std::swap(face.nodes[i], face.nodes[j]);
        face.flipped = !face.flipped;
      };
      order(0, 1);
      order(1, 2);
      order(0, 1);
      all.push_back(face);
    }
  }
  std::sort(all.begin(), all.end(), [](const Face& a, const Face& b) {
    if (a.nodes != b.nodes) return a.nodes < b.nodes;
    return a.flipped != b.flipped ? a.flipped < b.flipped : a.name < b.name;
  });
  FaceNeighbours faces;
  faces.across.assign(all.size(), -1);
  faces.beside.assign(all.size(), -1);
  for (std::size_t first = 0, last; first < all.size(); first = last) {
    std::size_t middle = first;  // where the other side begins
    for (last = first; last < all.size() && all[last].nodes == all[first].nodes; ++last) {
      if (!all[last].flipped) middle = last + 1;
    }
    for (std::size_t f = first; f < last; ++f) {
      const bool low = f < middle;
      const std::size_t begin = low ? first : middle, end = low ? middle : last, other = low ? middle : first;
      const auto name = static_cast<std::size_t>(all[f].name);
      faces.beside[name] = all[f + 1 < end ? f + 1 : begin].name;
      if (low ? middle < last : first < middle) faces.across[name] = all[other].name;
    }
  }
  return faces;
}

bool is_covered(const FaceNeighbours& faces, std::span<const std::uint8_t> alive, std::int32_t face) {
  const std::int32_t start = faces.across[static_cast<std::size_t>(face)];
  if (start < 0 || alive.empty()) return start >= 0;
  std::int32_t other = start;
  do {
    if (alive[static_cast<std::size_t>(other / 4)]) return true;
    other = faces.beside[static_cast<std::size_t>(other)];
  } while (other != start);
  return false;
}

Pieces mesh_pieces(std::span<const std::array<std::int32_t, 4>> tets, std::int64_t node_count,
                   std::span<const std::uint8_t> alive) {
  Sets sets(static_cast<std::size_t>(node_count));
  const auto skip = [&](std::size_t t) { return !alive.empty() && !alive[t]; };
  for (std::size_t t = 0; t < tets.size(); ++t) {
    if (skip(t)) continue;
    for (int v = 1; v < 4; ++v) sets.unite(tets[t][0], tets[t][v]);
  }
  Pieces pieces;
  pieces.piece.assign(tets.size(), -1);
  std::vector<std::int32_t> piece_of_root(static_cast<std::size_t>(node_count), -1);
  for (std::size_t t = 0; t < tets.size(); ++t) {
    if (skip(t)) continue;
    std::int32_t& piece = piece_of_root[sets.root(tets[t][0])];
    if (piece < 0) {
      piece = static_cast<std::int32_t>(pieces.item_count.size());
      pieces.item_count.push_back(0);
    }
    pieces.piece[t] = piece;
    ++pieces.item_count[piece];
  }
  return pieces;
}

}  // namespace sulcus
