#include "engine/mesh/surface.h"

#include <algorithm>

#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

constexpr std::uint8_t no_vertex = 0xff;

// A voxel corner on the surface. Of its 8 voxels (numbered by their offsets, bit a along axis a), those
// connected within the 8 form a side; every side with a boundary face here has a vertex.
struct SurfaceCorner {
  Index3 at;                         // the corner stands at voxel coordinates at - 1/2
  std::int32_t first_vertex;         // its sides' vertices follow each other
  std::array<std::uint8_t, 8> side;  // side of each of the 8 voxels, no_vertex if it needs none
};

struct SurfaceVertex {
  std::int32_t corner;
  std::uint8_t side;
};

struct Quad {
  std::array<std::int32_t, 4> vertex;
  std::int32_t label;
  std::uint8_t on_pair;
};

class SurfaceBuilder {
 public:
  SurfaceBuilder(const LabelMap& map, const SeparationPairs& pairs, const EmbeddingMesh& mesh)
      : map_(map), mesh_(mesh), links_(build_voxel_links(map, pairs)) {
    for (std::size_t v = 0; v < map.voxel_count(); ++v) {
      if (mesh.cell_of_voxel[v] < 0) links_[v] = 0;
    }
    for (auto& plane : slot_) plane.resize(static_cast<std::size_t>(map.size[0] + 1) * (map.size[1] + 1));
  }

  void find_faces() {
    find_corners(0);
    for (int k = 0; k < map_.size[2]; ++k) {
      find_corners(k + 1);
      for (int j = 0; j < map_.size[1]; ++j) {
        for (int i = 0; i < map_.size[0]; ++i) {
          const std::size_t v = map_.index(i, j, k);
          if (links_[v] & voxel_labelled) add_faces({i, j, k}, v);
        }
      }
    }
  }

  // Taubin's two steps a pass over the quads' edges, each vertex kept within half a voxel of its corner along
  // every axis. Offsets from the corners, in voxels.
  void smooth(int passes) {
    const std::size_t count = vertices_.size();
    offset_.assign(count, {0, 0, 0});
    if (passes <= 0) return;
    std::vector<std::int32_t> first(count + 1, 0), neighbour(quads_.size() * 8);
    for (const Quad& quad : quads_) {
      for (const std::int32_t v : quad.vertex) first[v + 1] += 2;
    }
    for (std::size_t v = 0; v < count; ++v) first[v + 1] += first[v];
    std::vector<std::int32_t> next(first.begin(), first.end() - 1);
    for (const Quad& quad : quads_) {
      for (int e = 0; e < 4; ++e) {
        const std::int32_t a = quad.vertex[e], b = quad.vertex[(e + 1) % 4];
        neighbour[next[a]++] = b;
        neighbour[next[b]++] = a;
      }
    }
    std::vector<std::array<double, 3>> before(count);
    const auto vertices = static_cast<std::ptrdiff_t>(count);
    for (int step = 0; step < 2 * passes; ++step) {
      const double factor = step % 2 == 0 ? 0.5 : -0.53;
      before.swap(offset_);
#pragma omp parallel for schedule(static)
      for (std::ptrdiff_t v = 0; v < vertices; ++v) {
        const Index3& here = corners_[vertices_[v].corner].at;
        double sum[3] = {0, 0, 0};
        for (std::int32_t n = first[v]; n < first[v + 1]; ++n) {
          const std::int32_t other = neighbour[n];
          const Index3& there = corners_[vertices_[other].corner].at;
          for (int a = 0; a < 3; ++a) sum[a] += there[a] - here[a] + before[other][a];
        }
        for (int a = 0; a < 3; ++a) {
          const double mean = sum[a] / (first[v + 1] - first[v]);
          offset_[v][a] = std::clamp(before[v][a] + factor * (mean - before[v][a]), -0.5, 0.5);
        }
      }
    }
  }

  EmbeddedSurface embed(std::span<const std::uint8_t> alive) const {
    EmbeddedSurface surface;
    const auto count = static_cast<std::ptrdiff_t>(vertices_.size());
    surface.rest_positions.resize(vertices_.size());
    surface.tet.resize(vertices_.size());
    surface.weights.resize(vertices_.size());
#pragma omp parallel for schedule(static)
    for (std::ptrdiff_t v = 0; v < count; ++v) {
      const Vec3 point = position(static_cast<std::int32_t>(v));
      std::array<double, 4> weights{};
      surface.rest_positions[v] = map_.to_world(point);
      surface.tet[v] = locate_tet_in_cell(mesh_, mesh_.cell_of_voxel[anchor(v)], point, weights, alive);
      for (int n = 0; n < 4; ++n) surface.weights[v][n] = static_cast<float>(weights[n]);
    }
    surface.triangles.reserve(quads_.size() * 2);
    for (const Quad& quad : quads_) {
      const auto& [a, b, c, d] = quad.vertex;
      const bool ac = diagonal(a, c) <= diagonal(b, d);  // the shorter one
      const std::array<std::int32_t, 3> one = ac ? std::array{a, b, c} : std::array{a, b, d};
      const std::array<std::int32_t, 3> two = ac ? std::array{a, c, d} : std::array{b, c, d};
      for (const auto& triangle : {one, two}) {
        surface.triangles.push_back(triangle);
        surface.triangle_label.push_back(quad.label);
        surface.triangle_on_pair.push_back(quad.on_pair);
      }
    }
    return surface;
  }

 private:
  std::uint8_t links_at(int i, int j, int k) const {
    if (i < 0 || j < 0 || k < 0 || i >= map_.size[0] || j >= map_.size[1] || k >= map_.size[2]) return 0;
    return links_[map_.index(i, j, k)];
  }

  // Surface corners in the plane below voxel plane k, with their vertices.
  void find_corners(int k) {
    std::vector<std::int32_t>& slot = slot_[k & 1];
    for (int j = 0; j <= map_.size[1]; ++j) {
      for (int i = 0; i <= map_.size[0]; ++i) {
        std::uint8_t around[8], any = 0, all = 0xff;
        for (int n = 0; n < 8; ++n) {
          around[n] = links_at(i - 1 + (n & 1), j - 1 + (n >> 1 & 1), k - 1 + (n >> 2));
          any |= around[n];
          all &= around[n];
        }
        if (!(any & voxel_labelled) || (all & 15) == 15) continue;
        add_corner({i, j, k}, around, slot[static_cast<std::size_t>(j) * (map_.size[0] + 1) + i]);
      }
    }
  }

  void add_corner(const Index3& at, const std::uint8_t* around, std::int32_t& slot) {
    std::array<std::uint8_t, 8> root;
    for (std::uint8_t n = 0; n < 8; ++n) root[n] = n;
    bool open[8] = {};  // voxels with a boundary face at this corner
    for (int bit = 1; bit < 8; bit <<= 1) {
      for (int n = 0; n < 8; ++n) {
        if (n & bit) continue;
        const int m = n | bit;
        if (around[n] & bit) {  // link_i, link_j, link_k are 1, 2, 4
          const std::uint8_t from = std::max(root[n], root[m]), to = std::min(root[n], root[m]);
          for (std::uint8_t& r : root) r = r == from ? to : r;
        } else {
          open[n] |= around[n] != 0;
          open[m] |= around[m] != 0;
        }
      }
    }
    SurfaceCorner corner{at, static_cast<std::int32_t>(vertices_.size()), {}};
    corner.side.fill(no_vertex);
    std::uint8_t sides = 0;
    for (int side = 0; side < 8; ++side) {
      bool surface = false;
      for (int n = 0; n < 8; ++n) surface |= root[n] == side && open[n];
      if (!surface) continue;
      for (int n = 0; n < 8; ++n) {
        if (root[n] == side) corner.side[n] = sides;
      }
      vertices_.push_back({static_cast<std::int32_t>(corners_.size()), sides++});
    }
    if (sides == 0) return;
    slot = static_cast<std::int32_t>(corners_.size());
    corners_.push_back(corner);
  }

  // The quads of a voxel: its faces that no link crosses.
  void add_faces(const Index3& at, std::size_t voxel) {
    for (int axis = 0; axis < 3; ++axis) {
      for (int far = 0; far < 2; ++far) {
        Index3 low = at, other = at;
        other[axis] += far ? 1 : -1;
        if (!far) --low[axis];
        if (links_at(low[0], low[1], low[2]) & (1 << axis)) continue;
        const int b = (axis + 1) % 3, c = (axis + 2) % 3;
        Quad quad{{}, map_.labels[voxel], 0};
        for (int n = 0; n < 4; ++n) {
          Index3 offset{0, 0, 0};  // of the corner from the voxel's low corner
          offset[axis] = far;
          offset[b] = n == 1 || n == 2;
          offset[c] = n >= 2;
          const SurfaceCorner& corner =
              corners_[slot_[(at[2] + offset[2]) & 1]
                            [static_cast<std::size_t>(at[1] + offset[1]) * (map_.size[0] + 1) + at[0] +
                             offset[0]]];
          const int here = 7 - (offset[0] + 2 * offset[1] + 4 * offset[2]);
          quad.vertex[n] = corner.first_vertex + corner.side[here];
        }
        if ((far == 0) != mesh_.mirrored) std::swap(quad.vertex[1], quad.vertex[3]);
        const bool in_image = other[axis] >= 0 && other[axis] < map_.size[axis];
        quad.on_pair = in_image && map_.labels[map_.index(other[0], other[1], other[2])] != 0;
        quads_.push_back(quad);
      }
    }
  }

  Vec3 position(std::int32_t v) const {  // voxel coordinates
    const Index3& at = corners_[vertices_[v].corner].at;
    Vec3 point;
    for (int a = 0; a < 3; ++a) point[a] = at[a] - 0.5 + offset_[v][a];
    return point;
  }

  double diagonal(std::int32_t a, std::int32_t b) const {  // m^2
    const Vec3 edge = map_.spacing.cwiseProduct(position(a) - position(b));
    return edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2];
  }

  // The voxel of the vertex' side whose centre is nearest, the first at ties.
  std::size_t anchor(std::ptrdiff_t v) const {
    const SurfaceCorner& corner = corners_[vertices_[v].corner];
    double nearest = 1e30;  // voxels^2
    int best = 0;
    for (int n = 0; n < 8; ++n) {
      if (corner.side[n] != vertices_[v].side) continue;
      double square = 0;
      for (int a = 0; a < 3; ++a) {
        const double distance = (n >> a & 1) - 0.5 - offset_[v][a];
        square += distance * distance;
      }
      if (square < nearest) {
        nearest = square;
        best = n;
      }
    }
    const Index3& at = corner.at;
    return map_.index(at[0] - 1 + (best & 1), at[1] - 1 + (best >> 1 & 1), at[2] - 1 + (best >> 2));
  }

  const LabelMap& map_;
  const EmbeddingMesh& mesh_;
  VoxelLinks links_;
  std::array<std::vector<std::int32_t>, 2> slot_;  // corner number at the grid places of two planes
  std::vector<SurfaceCorner> corners_;
  std::vector<SurfaceVertex> vertices_;
  std::vector<Quad> quads_;
  std::vector<std::array<double, 3>> offset_;
};

}  // namespace

EmbeddedSurface build_embedded_surface(const LabelMap& map, const SeparationPairs& pairs,
                                       const EmbeddingMesh& mesh, int smoothing_passes,
                                       std::span<const std::uint8_t> alive) {
  SurfaceBuilder builder(map, pairs, mesh);
  builder.find_faces();
  builder.smooth(smoothing_passes);
  return builder.embed(alive);
}

std::vector<double> deform_surface(const EmbeddedSurface& surface, const EmbeddingMesh& mesh,
                                   const std::vector<double>& node_positions) {
  const auto count = static_cast<std::ptrdiff_t>(surface.tet.size());
  std::vector<double> positions(surface.tet.size() * 3);
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t v = 0; v < count; ++v) {
    const std::array<std::int32_t, 4>& nodes = mesh.tets[surface.tet[v]];
    for (int a = 0; a < 3; ++a) {
      double sum = 0;
      for (int n = 0; n < 4; ++n)
        sum += static_cast<double>(surface.weights[v][n]) *
               node_positions[3 * static_cast<std::size_t>(nodes[n]) + a];
      positions[3 * v + a] = sum;
    }
  }
  return positions;
}

}  // namespace sulcus
