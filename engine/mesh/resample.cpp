#include "engine/mesh/resample.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

namespace sulcus {

namespace {

constexpr int slab_planes = 4;    // planes of the wanted image that one thread fills together
constexpr double inside = -1e-9;  // smallest barycentric coordinate of a point that counts as inside

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
    image_.same_geometry = same_geometry_;
    image_.tet.assign(voxels, -1);
    image_.voxel.assign(voxels, background_voxel);
    image_.moved.assign(voxels, {0, 0, 0});
    sort_into_slabs();
    const auto slabs = static_cast<std::ptrdiff_t>(slab_first_.size()) - 1;
#pragma omp parallel for schedule(static, 1)
    for (std::ptrdiff_t s = 0; s < slabs; ++s) {
      const int begin = static_cast<int>(s) * slab_planes,
                end = std::min(begin + slab_planes, wanted_.size[2]);
      for (std::int64_t n = slab_first_[s]; n < slab_first_[s + 1]; ++n) fill(slab_tets_[n], begin, end);
      find_gaps(begin, end);
    }
    for (const std::int32_t voxel : image_.voxel) {
      image_.background_voxels += voxel == background_voxel;
      image_.gap_voxels += voxel == gap_voxel;
      image_.folded_voxels += voxel == folded_voxel;
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

  std::size_t index(const Index3& at) const {
    return static_cast<std::size_t>(at[0]) +
           static_cast<std::size_t>(wanted_.size[0]) *
               (static_cast<std::size_t>(at[1]) + static_cast<std::size_t>(wanted_.size[1]) * at[2]);
  }

  void claim(const Index3& at, std::int32_t tet, const std::array<double, 4>& w) {
    const std::size_t n = index(at);
    if (image_.voxel[n] == folded_voxel) return;
    const std::int32_t cell = tet / mesh_.tets_per_cell;
    Vec3 displacement = Vec3::Zero();  // m; without any, the tissue's source is exactly the point itself
    for (int v = 0; v < 4; ++v) {
      const std::int32_t node = mesh_.tets[tet][v];
      displacement += w[v] * (position(node) - mesh_.rest_positions[node]);
    }
    const Vec3 source =
        map_point(at) - (map_.direction.transpose() * displacement).cwiseQuotient(map_.spacing);
    // The cell spans whole voxels: a point on its border belongs to the voxel on the cell's side.
    Index3 nearest;
    for (int a = 0; a < 3; ++a) {
      const int first = mesh_.cell_position[cell][a] * mesh_.voxels_per_cell[a];
      nearest[a] = std::clamp(static_cast<int>(std::lround(std::clamp(source[a], -1e8, 1e8))), first,
                              first + mesh_.voxels_per_cell[a] - 1);
      if (nearest[a] >= map_.size[a]) return;
    }
    const std::size_t voxel = map_.index(nearest[0], nearest[1], nearest[2]);
    if (mesh_.cell_of_voxel[voxel] != cell) return;
    const Vec3 moved = (wanted_.direction.transpose() * displacement).cwiseQuotient(wanted_.spacing);
    auto& known = image_.moved[n];
    if (image_.voxel[n] >= 0) {  // shared faces claim twice, for neighbouring points of the same tissue
      double farthest = 0;       // voxels
      for (int a = 0; a < 3; ++a)
        farthest = std::max(farthest, std::abs(moved[a] - static_cast<double>(known[a])));
      if (farthest > 1e-3) {
        image_.voxel[n] = folded_voxel;
        image_.tet[n] = -1;
        known = {0, 0, 0};
      }
      return;
    }
    image_.tet[n] = tet;
    image_.voxel[n] = static_cast<std::int32_t>(voxel);
    for (int a = 0; a < 3; ++a) known[a] = static_cast<float>(moved[a]);
  }

  // Voxels without tissue where the map at rest has some.
  void find_gaps(int k_begin, int k_end) {
    for (int k = k_begin; k < k_end; ++k) {
      for (int j = 0; j < wanted_.size[1]; ++j) {
        for (int i = 0; i < wanted_.size[0]; ++i) {
          std::int32_t& voxel = image_.voxel[index({i, j, k})];
          if (voxel == background_voxel && owned_at_rest({i, j, k})) voxel = gap_voxel;
        }
      }
    }
  }

  bool owned_at_rest(const Index3& at) const {
    const Vec3 point = map_point(at);
    Index3 nearest;
    for (int a = 0; a < 3; ++a) {
      nearest[a] = static_cast<int>(std::lround(std::clamp(point[a], -1e8, 1e8)));
      if (nearest[a] < 0 || nearest[a] >= map_.size[a]) return false;
    }
    return mesh_.cell_of_voxel[map_.index(nearest[0], nearest[1], nearest[2])] >= 0;
  }

  // A wanted voxel's centre in voxel coordinates of the map.
  Vec3 map_point(const Index3& at) const {
    const Vec3 point(at[0], at[1], at[2]);
    if (same_geometry_) return point;
    return map_.to_voxel(wanted_.origin + wanted_.direction * wanted_.spacing.cwiseProduct(point));
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

// The value at a point given in voxel coordinates.
template <class T>
T trilinear(const ImageGeometry& image, std::span<const T> values, const std::array<double, 3>& point) {
  std::size_t low[3], high[3];
  double t[3];
  for (int a = 0; a < 3; ++a) {
    const double p = std::clamp(point[a], 0.0, image.size[a] - 1.0);
    low[a] = static_cast<std::size_t>(p);
    high[a] = std::min(low[a] + 1, static_cast<std::size_t>(image.size[a]) - 1);
    t[a] = p - static_cast<double>(low[a]);
  }
  const auto value = [&](std::size_t i, std::size_t j, std::size_t k) {
    return values[i + static_cast<std::size_t>(image.size[0]) *
                          (j + static_cast<std::size_t>(image.size[1]) * k)];
  };
  if (t[0] == 0 && t[1] == 0 && t[2] == 0) return value(low[0], low[1], low[2]);
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    double weight = 1;
    for (int a = 0; a < 3; ++a) weight *= c >> a & 1 ? t[a] : 1 - t[a];
    if (weight == 0) continue;
    sum += weight * static_cast<double>(value(c & 1 ? high[0] : low[0], c >> 1 & 1 ? high[1] : low[1],
                                              c >> 2 ? high[2] : low[2]));
  }
  if constexpr (std::is_integral_v<T>) {
    // what is a mean of values of T is one, but for rounding at the ends of 64-bit types
    sum = std::round(sum);
    if (sum >= static_cast<double>(std::numeric_limits<T>::max())) return std::numeric_limits<T>::max();
    if (sum <= static_cast<double>(std::numeric_limits<T>::min())) return std::numeric_limits<T>::min();
  }
  return static_cast<T>(sum);
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

template <class T>
std::vector<T> resample_image(const ImageGeometry& wanted, std::span<const T> values,
                              const TissueImage& tissue, Interpolation interpolation, T fill) {
  std::vector<T> result(tissue.voxel.size());
  const std::size_t nx = wanted.size[0], ny = wanted.size[1];
  const auto count = static_cast<std::ptrdiff_t>(result.size());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t v = 0; v < count; ++v) {
    const auto n = static_cast<std::size_t>(v);
    const std::int32_t voxel = tissue.voxel[n];
    if (voxel < 0) {
      result[n] = voxel == background_voxel ? values[n] : fill;
      continue;
    }
    const bool nearest = interpolation == Interpolation::nearest;
    if (nearest && tissue.same_geometry) {
      result[n] = values[static_cast<std::size_t>(voxel)];
      continue;
    }
    const std::size_t at[3] = {n % nx, n / nx % ny, n / (nx * ny)};
    std::array<double, 3> source;
    for (int a = 0; a < 3; ++a) {
      source[a] = static_cast<double>(at[a]) - static_cast<double>(tissue.moved[n][a]);
      if (nearest) source[a] = std::round(source[a]);
    }
    result[n] = trilinear(wanted, values, source);
  }
  return result;
}

#define SULCUS_RESAMPLE(T)                                                                                \
  template std::vector<T> resample_image<T>(const ImageGeometry&, std::span<const T>, const TissueImage&, \
                                            Interpolation, T);
SULCUS_RESAMPLE(std::int8_t)
SULCUS_RESAMPLE(std::uint8_t)
SULCUS_RESAMPLE(std::int16_t)
SULCUS_RESAMPLE(std::uint16_t)
SULCUS_RESAMPLE(std::int32_t)
SULCUS_RESAMPLE(std::uint32_t)
SULCUS_RESAMPLE(std::int64_t)
SULCUS_RESAMPLE(std::uint64_t)
SULCUS_RESAMPLE(float)
SULCUS_RESAMPLE(double)
#undef SULCUS_RESAMPLE

std::vector<float> resample_tet_values(std::span<const float> values, const TissueImage& tissue, float fill) {
  std::vector<float> result(tissue.tet.size());
  for (std::size_t v = 0; v < result.size(); ++v)
    result[v] = tissue.tet[v] < 0 ? fill : values[tissue.tet[v]];
  return result;
}

}  // namespace sulcus
