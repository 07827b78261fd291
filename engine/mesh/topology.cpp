#include "engine/mesh/topology.h"

#include <algorithm>
#include <numeric>
#include <string>

#include "engine/numerics/error.h"
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
  const std::vector<std::uint8_t> links = build_voxel_links(map, pairs);
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

std::vector<std::array<std::int32_t, 4>> face_neighbours(std::span<const std::array<std::int32_t, 4>> tets) {
  struct Face {
    std::array<std::int32_t, 3> nodes;  // ascending
    std::int32_t tet_corner;            // tet*4 + opposite corner
  };
  std::vector<Face> faces;
  faces.reserve(4 * tets.size());
  for (std::size_t t = 0; t < tets.size(); ++t) {
    for (std::size_t c = 0; c < 4; ++c) {
      Face face{{tets[t][(c + 1) % 4], tets[t][(c + 2) % 4], tets[t][(c + 3) % 4]},
                static_cast<std::int32_t>(4 * t + c)};
      std::sort(face.nodes.begin(), face.nodes.end());
      faces.push_back(face);
    }
  }
  std::sort(faces.begin(), faces.end(), [](const Face& a, const Face& b) {
    return a.nodes != b.nodes ? a.nodes < b.nodes : a.tet_corner < b.tet_corner;
  });
  std::vector<std::array<std::int32_t, 4>> neighbours(tets.size(), {-1, -1, -1, -1});
  for (std::size_t f = 0; f + 1 < faces.size(); ++f) {
    if (faces[f].nodes != faces[f + 1].nodes) continue;
    if (f + 2 < faces.size() && faces[f + 2].nodes == faces[f].nodes) {
      throw InputError("mesh: a face is shared by more than two tetrahedra, one of them number " +
                       std::to_string(faces[f].tet_corner / 4));
    }
    const std::int32_t a = faces[f].tet_corner, b = faces[f + 1].tet_corner;
    neighbours[static_cast<std::size_t>(a / 4)][static_cast<std::size_t>(a % 4)] = b / 4;
    neighbours[static_cast<std::size_t>(b / 4)][static_cast<std::size_t>(b % 4)] = a / 4;
  }
  return neighbours;
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
