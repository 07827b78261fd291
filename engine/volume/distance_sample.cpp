#include <algorithm>
#include <cmath>
#include <cstring>

#include "engine/volume/distance_field.h"

namespace sulcus {

namespace {

constexpr int box_limit = 8192;  // voxels searched for a way from `home`, so that nothing is allocated

struct Corner8 {
  Index3 low;             // the first of them
  std::int32_t label[8];  // 0 outside the image
  std::size_t voxel[8];   // number in the map; 0 outside the image
  bool whole;             // all 8 are in the image

  Index3 at(int c) const { return {low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2)}; }
};

bool inside_image(const LabelMap& map, const Index3& at, int beyond = 0) {
  for (int a = 0; a < 3; ++a) {
    if (at[a] < 0 || at[a] + beyond >= map.size[a]) return false;
  }
  return true;
}

Index3 voxel_at(const LabelMap& map, std::size_t index) {
  const auto nx = static_cast<std::uint32_t>(map.size[0]), ny = static_cast<std::uint32_t>(map.size[1]);
  const auto voxel = static_cast<std::uint32_t>(index), row = voxel / nx, plane = row / ny;
  return {static_cast<int>(voxel - row * nx), static_cast<int>(row - plane * ny), static_cast<int>(plane)};
}

Corner8 corners_around(const LabelMap& map, const Index3& low) {
  Corner8 corners;
  corners.low = low;
  corners.whole = inside_image(map, low, 1);
  const std::size_t row = static_cast<std::size_t>(map.size[0]),
                    plane = row * static_cast<std::size_t>(map.size[1]);
  const std::size_t first = corners.whole ? map.index(low[0], low[1], low[2]) : 0;
  for (int c = 0; c < 8; ++c) {
    if (corners.whole) {
      corners.voxel[c] = first + (c & 1 ? 1 : 0) + (c & 2 ? row : 0) + (c & 4 ? plane : 0);
      corners.label[c] = map.labels[corners.voxel[c]];
      continue;
    }
    const Index3 at = corners.at(c);
    const bool inside = inside_image(map, at);
    corners.voxel[c] = inside ? map.index(at[0], at[1], at[2]) : 0;
    corners.label[c] = inside ? map.labels[corners.voxel[c]] : 0;
  }
  return corners;
}

// Which of the 8 a voxel is, or -1.
int corner_of(const Corner8& corners, const Index3& voxel) {
  int corner = 0;
  for (int a = 0; a < 3; ++a) {
    const int beyond = voxel[a] - corners.low[a];
    if (beyond < 0 || beyond > 1) return -1;
    corner |= beyond << a;
  }
  return corner;
}

// Those of `open`, of the 8 as bits, that connect with `start` over faces.
unsigned reach_within(unsigned open, int start) {
  unsigned reached = 1U << start, before = 0;
  while (reached != before) {
    before = reached;
    reached |= (reached & 0x55) << 1 | (reached & 0xaa) >> 1;
    reached |= (reached & 0x33) << 2 | (reached & 0xcc) >> 2;
    reached |= (reached & 0x0f) << 4 | (reached & 0xf0) >> 4;
    reached &= open;
  }
  return reached;
}

// Those of the 8 that connect with `start` within the 8, as bits.
unsigned reach(const Corner8& corners, const SeparationPairs& pairs, int start) {
  const std::int32_t own = corners.label[start];
  unsigned same = 0, others = 0;  // labelled as the start, and labelled otherwise
  for (int c = 0; c < 8; ++c) {
    same |= static_cast<unsigned>(corners.label[c] == own) << c;
    others |= static_cast<unsigned>(corners.label[c] != 0) << c;
  }
  if ((others & ~same) == 0) return reach_within(same, start);
  unsigned reached = 1U << start, front = reached;
  while (front) {
    const int c = __builtin_ctz(front);
    front &= front - 1;
    for (int bit = 1; bit < 8; bit <<= 1) {
      const int other = c ^ bit;
      if (!(reached >> other & 1U) && pairs.connected(corners.label[c], corners.label[other])) {
        reached |= 1U << other;
        front |= 1U << other;
      }
    }
  }
  return reached;
}

// Those of the 8 that connect with `home` within the smallest box of voxels that holds both, as bits.
unsigned reach_from(const LabelMap& map, const SeparationPairs& pairs, const Corner8& corners,
                    const Index3& home) {
  Index3 low, size;
  std::int64_t voxels = 1;
  for (int a = 0; a < 3; ++a) {
    low[a] = std::clamp(std::min(corners.low[a], home[a]), 0, map.size[a] - 1);
    size[a] = std::clamp(std::max(corners.low[a] + 1, home[a]), 0, map.size[a] - 1) - low[a] + 1;
    voxels *= size[a];
    if (voxels > box_limit) return 0;
  }
  bool seen[box_limit];
  std::memset(seen, 0, static_cast<std::size_t>(voxels));
  std::uint16_t queue[box_limit];
  const auto number = [&](const Index3& at) {
    return (at[0] - low[0]) + size[0] * ((at[1] - low[1]) + size[1] * (at[2] - low[2]));
  };
  int end = 0;
  queue[end++] = static_cast<std::uint16_t>(number(home));
  seen[number(home)] = true;
  for (int begin = 0; begin < end; ++begin) {
    const int n = queue[begin];
    const Index3 at{low[0] + n % size[0], low[1] + n / size[0] % size[1], low[2] + n / (size[0] * size[1])};
    const std::int32_t label = map.labels[map.index(at[0], at[1], at[2])];
    for (int a = 0; a < 3; ++a) {
      for (int step = -1; step <= 1; step += 2) {
        Index3 next = at;
        next[a] += step;
        if (next[a] < low[a] || next[a] >= low[a] + size[a] || seen[number(next)]) continue;
        if (!pairs.connected(label, map.labels[map.index(next[0], next[1], next[2])])) continue;
        seen[number(next)] = true;
        queue[end++] = static_cast<std::uint16_t>(number(next));
      }
    }
  }
  unsigned reached = 0;
  for (int c = 0; c < 8; ++c) {
    if (corners.label[c] != 0 && seen[number(corners.at(c))]) reached |= 1U << c;
  }
  return reached;
}

// Distance [m] at a voxel centre, continued beyond the image: from the face of a labelled border voxel, else
// as if the nearest boundary lay straight behind the border.
double distance_at(const LabelMap& map, const DistanceField& field, const Index3& at) {
  Index3 inside;
  for (int a = 0; a < 3; ++a) inside[a] = std::clamp(at[a], 0, map.size[a] - 1);
  const std::size_t voxel = map.index(inside[0], inside[1], inside[2]);
  const double distance = field.distance[voxel];
  if (inside == at) return distance;
  const bool labelled = map.labels[voxel] != 0;
  double square = labelled ? 0.0 : distance * distance;
  for (int a = 0; a < 3; ++a) {
    const double offset = std::abs(at[a] - inside[a]);
    const double beyond = (labelled ? std::max(offset - 0.5, 0.0) : offset) * map.spacing[a];
    square += beyond * beyond;
  }
  return std::sqrt(square);
}

}  // namespace

DistanceSample sample_distance(const LabelMap& map, const SeparationPairs& pairs, const DistanceField& field,
                               const Vec3& point_voxel, const Index3& home) {
  Index3 low;
  double t[3];  // position between the two centres along each axis
  for (int a = 0; a < 3; ++a) {
    const double place = std::clamp(point_voxel[a], -1e9, 1e9);
    low[a] = static_cast<int>(place);
    if (low[a] > place) --low[a];
    t[a] = point_voxel[a] - low[a];
  }
  const Corner8 corners = corners_around(map, low);

  // The voxel of the 8 that stands for `home`: itself, else the nearest connected one, the lowest at ties.
  int start = corner_of(corners, home);
  if (start < 0) {
    const unsigned reached = reach_from(map, pairs, corners, home);
    double nearest = 1e30;  // m^2
    for (int c = 0; c < 8; ++c) {
      if (!(reached >> c & 1U)) continue;
      double square = 0;
      for (int a = 0; a < 3; ++a) {
        const double offset = (corners.at(c)[a] - point_voxel[a]) * map.spacing[a];
        square += offset * offset;
      }
      if (square < nearest) {
        nearest = square;
        start = c;
      }
    }
  }
  const unsigned inside = start >= 0 ? reach(corners, pairs, start) : 0U;

  DistanceSample sample;
  double value[8];  // m
  for (int c = 0; c < 8; ++c) {
    const double size = corners.whole ? static_cast<double>(field.distance[corners.voxel[c]])
                                      : distance_at(map, field, corners.at(c));
    value[c] = inside >> c & 1U ? -size : size;
  }
  // along i, then j, then k; slopes in m a voxel
  const auto between = [](double a, double b, double part) { return a + part * (b - a); };
  double along[4], step[4];
  for (int c = 0; c < 4; ++c) {
    step[c] = value[2 * c + 1] - value[2 * c];
    along[c] = value[2 * c] + t[0] * step[c];
  }
  const double low_k = between(along[0], along[1], t[1]), high_k = between(along[2], along[3], t[1]);
  sample.distance = between(low_k, high_k, t[2]);
  const double slope[3] = {between(between(step[0], step[1], t[1]), between(step[2], step[3], t[1]), t[2]),
                           between(along[1] - along[0], along[3] - along[2], t[2]), high_k - low_k};
  for (int a = 0; a < 3; ++a) {
    for (int r = 0; r < 3; ++r) sample.gradient[r] += map.direction(r, a) * (slope[a] / map.spacing[a]);
  }
  return sample;
}

DistanceSample sample_distance(const LabelMap& map, const SeparationPairs& pairs, const DistanceField& field,
                               const Vec3& point_voxel, std::size_t home) {
  return sample_distance(map, pairs, field, point_voxel, voxel_at(map, home));
}

}  // namespace sulcus
