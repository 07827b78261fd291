#include "engine/mesh/resample.h"

#include <algorithm>
#include <cmath>

namespace sulcus {

namespace {

constexpr int slab_planes = 4;    // planes of the wanted image that one thread fills together
constexpr double inside = -1e-9;  // smallest barycentric coordinate of a point that counts as inside
constexpr std::int32_t none = -1, gap = -2, folded = -3;  // in TissueImage::voxel until all is counted

double triple(const Vec3& a, const Vec3& b, const Vec3& c) {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

// A deformed tetrahedron in voxel coordinates of the wanted image.
struct Deformed {
  std::array<Vec3, 4> corner;
  Vec3 edge[3];
  double volume = 0;                      // six times
  Index3 low{0, 0, 0}, high{-1, -1, -1};  // voxel centres in its box, within the image

  bool weights(const Vec3& point, std::array<double, 4>& w) const {
    const Vec3 p = point - corner[0];
    w[1] = triple(p, edge[1], edge[2]) / volume;
    w[2] = triple(edge[0], p, edge[2]) / volume;
    w[3] = triple(edge[0], edge[1], p) / volume;
    w[0] = 1 - w[1] - w[2] - w[3];
    return w[0] >= inside && w[1] >= inside && w[2] >= inside && w[3] >= inside;
  }
};

class TissueFinder {
 public:
  TissueFinder(const LabelMap& map, const EmbeddingMesh& mesh, std::span<const double> positions,
               std::span<const std::uint8_t> alive, const ImageGeometry& wanted)
      : map_(map), mesh_(mesh), positions_(positions), alive_(alive), wanted_(wanted) {
    const ImageGeometry source = geometry_of(map);
    same_geometry_ = source.size == wanted.size && source.spacing == wanted.spacing &&
                     source.origin == wanted.origin && source.direction == wanted.direction;
  }

  TissueImage find() {
    const std::size_t voxels = static_cast<std::size_t>(wanted_.size[0]) * wanted_.size[1] * wanted_.size[2];
    image_.tet.assign(voxels, -1);
    image_.voxel.assign(voxels, none);
    image_.source.assign(voxels, {0, 0, 0});
    sort_into_slabs();
    const auto slabs = static_cast<std::ptrdiff_t>(slab_first_.size()) - 1;
#pragma omp parallel for schedule(static, 1)
    for (std::ptrdiff_t s = 0; s < slabs; ++s) {
      const int begin = static_cast<int>(s) * slab_planes,
                end = std::min(begin + slab_planes, wanted_.size[2]);
      for (std::int64_t n = slab_first_[s]; n < slab_first_[s + 1]; ++n) fill(slab_tets_[n], begin, end);
    }
    for (std::size_t v = 0; v < voxels; ++v) {
      std::int32_t& voxel = image_.voxel[v];
      image_.folded_voxels += voxel == folded;
      image_.gap_voxels += voxel == gap;
      image_.empty_voxels += voxel < 0;
      voxel = std::max(voxel, -1);
    }
    return std::move(image_);
  }

 private:
  Vec3 to_wanted(const Vec3& world) const {
    return (wanted_.direction.transpose() * (world - wanted_.origin)).cwiseQuotient(wanted_.spacing);
  }

  Vec3 position(std::int32_t node) const {
    const double* p = positions_.data() + 3 * static_cast<std::size_t>(node);
    return {p[0], p[1], p[2]};
  }

  bool deform(std::int32_t tet, Deformed& d) const {
    if (!alive_.empty() && !alive_[tet]) return false;
    Vec3 low = Vec3::Constant(1e30), high = Vec3::Constant(-1e30);
    for (int v = 0; v < 4; ++v) {
      d.corner[v] = to_wanted(position(mesh_.tets[tet][v]));
      for (int a = 0; a < 3; ++a) {
        if (!std::isfinite(d.corner[v][a])) return false;
        low[a] = std::min(low[a], d.corner[v][a]);
        high[a] = std::max(high[a], d.corner[v][a]);
      }
    }
    for (int a = 0; a < 3; ++a) {
      d.low[a] = static_cast<int>(std::ceil(std::clamp(low[a] - 1e-6, 0.0, 1e9)));
      d.high[a] = static_cast<int>(std::floor(std::clamp(high[a] + 1e-6, -1.0, wanted_.size[a] - 1.0)));
      if (d.low[a] > d.high[a]) return false;
    }
    for (int e = 0; e < 3; ++e) d.edge[e] = d.corner[e + 1] - d.corner[0];
    d.volume = triple(d.edge[0], d.edge[1], d.edge[2]);
    return d.volume != 0;
  }

  // Tetrahedra of each slab in ascending order.
  void sort_into_slabs() {
    const int slabs = (wanted_.size[2] - 1) / slab_planes + 1;
    slab_first_.assign(static_cast<std::size_t>(slabs) + 1, 0);
    std::vector<std::int64_t> next;
    for (int round = 0; round < 2; ++round) {  // count, then fill
      Deformed d;
      for (std::int32_t t = 0; t < static_cast<std::int32_t>(mesh_.tets.size()); ++t) {
        if (!deform(t, d)) continue;
        for (int s = d.low[2] / slab_planes; s <= d.high[2] / slab_planes; ++s) {
          if (round == 0) {
            ++slab_first_[s + 1];
          } else {
            slab_tets_[next[s]++] = t;
          }
        }
      }
      if (round == 1) break;
      for (int s = 0; s < slabs; ++s) slab_first_[s + 1] += slab_first_[s];
      slab_tets_.resize(static_cast<std::size_t>(slab_first_.back()));
      next.assign(slab_first_.begin(), slab_first_.end() - 1);
    }
  }

  void fill(std::int32_t tet, int k_begin, int k_end) {
    Deformed d;
    deform(tet, d);
    std::array<double, 4> w{};
    for (int k = std::max(d.low[2], k_begin); k <= std::min(d.high[2], k_end - 1); ++k) {
      for (int j = d.low[1]; j <= d.high[1]; ++j) {
        for (int i = d.low[0]; i <= d.high[0]; ++i) {
          if (d.weights(Vec3(i, j, k), w)) claim({i, j, k}, tet, w);
        }
      }
    }
  }

  void claim(const Index3& at, std::int32_t tet, const std::array<double, 4>& w) {
    const std::size_t n =
        static_cast<std::size_t>(at[0]) +
        static_cast<std::size_t>(wanted_.size[0]) *
            (static_cast<std::size_t>(at[1]) + static_cast<std::size_t>(wanted_.size[1]) * at[2]);
    if (image_.voxel[n] == folded) return;
    const std::int32_t cell = tet / mesh_.tets_per_cell;
    const Vec3 source = source_point(at, tet, w);
    // The cell spans whole voxels: a point on its border belongs to the voxel on the cell's side.
    Index3 nearest;
    for (int a = 0; a < 3; ++a) {
      const int first = mesh_.cell_position[cell][a] * mesh_.voxels_per_cell[a];
      nearest[a] = std::clamp(static_cast<int>(std::lround(std::clamp(source[a], -1e8, 1e8))), first,
                              first + mesh_.voxels_per_cell[a] - 1);
      if (nearest[a] >= map_.size[a]) return;
    }
    const std::size_t voxel = map_.index(nearest[0], nearest[1], nearest[2]);
    const std::int32_t owner = mesh_.cell_of_voxel[voxel];
    if (owner != cell) {
      if (owner >= 0 && image_.voxel[n] == none) image_.voxel[n] = gap;
      return;
    }
    if (image_.voxel[n] >= 0) {  // shared faces claim twice, for neighbouring points of the same tissue
      const auto& other = image_.source[n];
      double farthest = 0;
      for (int a = 0; a < 3; ++a)
        farthest = std::max(farthest, std::abs(source[a] - static_cast<double>(other[a])));
      if (farthest > 1e-3) {
        image_.voxel[n] = folded;
        image_.tet[n] = -1;
        image_.source[n] = {0, 0, 0};
      }
      return;
    }
    image_.tet[n] = tet;
    image_.voxel[n] = static_cast<std::int32_t>(voxel);
    for (int a = 0; a < 3; ++a) image_.source[n][a] = static_cast<float>(source[a]);
  }

  // The wanted point less the displacement of its tissue: without displacement, exactly the point itself.
  Vec3 source_point(const Index3& at, std::int32_t tet, const std::array<double, 4>& w) const {
    Vec3 displacement = Vec3::Zero();  // m
    for (int v = 0; v < 4; ++v) {
      const std::int32_t node = mesh_.tets[tet][v];
      displacement += w[v] * (position(node) - mesh_.rest_positions[node]);
    }
    const Vec3 point(at[0], at[1], at[2]);
    const Vec3 start =
        same_geometry_
            ? point
            : map_.to_voxel(wanted_.origin + wanted_.direction * wanted_.spacing.cwiseProduct(point));
    return start - (map_.direction.transpose() * displacement).cwiseQuotient(map_.spacing);
  }

  const LabelMap& map_;
  const EmbeddingMesh& mesh_;
  std::span<const double> positions_;
  std::span<const std::uint8_t> alive_;
  const ImageGeometry& wanted_;
  bool same_geometry_ = false;
  TissueImage image_;
  std::vector<std::int64_t> slab_first_;  // [slabs + 1]
  std::vector<std::int32_t> slab_tets_;
};

float trilinear(const LabelMap& map, std::span<const float> grey, const std::array<float, 3>& point) {
  int low[3];
  double t[3];
  for (int a = 0; a < 3; ++a) {
    const double p = std::clamp(static_cast<double>(point[a]), 0.0, map.size[a] - 1.0);
    low[a] = std::min(static_cast<int>(p), std::max(map.size[a] - 2, 0));
    t[a] = p - low[a];
  }
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    double weight = 1;
    Index3 at;
    for (int a = 0; a < 3; ++a) {
      weight *= c >> a & 1 ? t[a] : 1 - t[a];
      at[a] = std::min(low[a] + (c >> a & 1), map.size[a] - 1);
    }
    if (weight != 0) sum += weight * static_cast<double>(grey[map.index(at[0], at[1], at[2])]);
  }
  return static_cast<float>(sum);
}

}  // namespace

ImageGeometry geometry_of(const LabelMap& map) {
  return {map.size, map.spacing, map.origin, map.direction};
}

TissueImage locate_tissue(const LabelMap& map, const EmbeddingMesh& mesh,
                          std::span<const double> node_positions, std::span<const std::uint8_t> alive,
                          const ImageGeometry& wanted) {
  check_geometry(wanted.size, wanted.spacing, wanted.origin, wanted.direction);
  return TissueFinder(map, mesh, node_positions, alive, wanted).find();
}

LabelMap without_torn_voxels(const LabelMap& map, const EmbeddingMesh& mesh,
                             std::span<const std::uint8_t> alive) {
  LabelMap left = map;
  const auto per_cell = static_cast<std::size_t>(mesh.tets_per_cell);
  std::vector<std::uint8_t> torn(mesh.cell_nodes.size(), 0);  // cells that have lost an element
  for (std::size_t t = 0; t < alive.size(); ++t) {
    if (!alive[t]) torn[t / per_cell] = 1;
  }
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        const std::size_t voxel = map.index(i, j, k);
        const std::int32_t cell = mesh.cell_of_voxel[voxel];
        if (cell < 0 || !torn[static_cast<std::size_t>(cell)]) continue;
        std::array<double, 4> weights;
        const std::int32_t tet = locate_tet_in_cell(mesh, cell, Vec3(i, j, k), weights);
        if (!alive[static_cast<std::size_t>(tet)]) left.labels[voxel] = 0;
      }
    }
  }
  return left;
}

std::vector<std::int32_t> resample_labels(const LabelMap& map, const TissueImage& tissue, std::int32_t fill) {
  std::vector<std::int32_t> labels(tissue.voxel.size());
  for (std::size_t v = 0; v < labels.size(); ++v) {
    labels[v] = tissue.voxel[v] < 0 ? fill : map.labels[tissue.voxel[v]];
  }
  return labels;
}

std::vector<float> resample_grey(const LabelMap& map, std::span<const float> grey, const TissueImage& tissue,
                                 Interpolation interpolation, float fill) {
  std::vector<float> values(tissue.voxel.size());
  const auto count = static_cast<std::ptrdiff_t>(values.size());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t v = 0; v < count; ++v) {
    if (tissue.voxel[v] < 0) {
      values[v] = fill;
    } else if (interpolation == Interpolation::nearest) {
      values[v] = grey[tissue.voxel[v]];
    } else {
      values[v] = trilinear(map, grey, tissue.source[v]);
    }
  }
  return values;
}

std::vector<float> resample_tet_values(std::span<const float> values, const TissueImage& tissue, float fill) {
  std::vector<float> result(tissue.tet.size());
  for (std::size_t v = 0; v < result.size(); ++v)
    result[v] = tissue.tet[v] < 0 ? fill : values[tissue.tet[v]];
  return result;
}

}  // namespace sulcus
