#include "engine/volume/label_operations.h"

#include <algorithm>
#include <array>

#include "engine/numerics/error.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {

namespace {

// Membership in a set of labels; neighbours are mostly equal, so the last answer is kept.
class LabelSet {
 public:
  explicit LabelSet(std::span<const std::int32_t> labels) : sorted_(labels.begin(), labels.end()) {
    std::sort(sorted_.begin(), sorted_.end());
  }

  bool has(std::int32_t label) {
    if (label != last_label_) {
      last_label_ = label;
      last_answer_ = std::binary_search(sorted_.begin(), sorted_.end(), label);
    }
    return last_answer_;
  }

 private:
  std::vector<std::int32_t> sorted_;
  std::int32_t last_label_ = 0;
  bool last_answer_ = false;  // of label 0: no operation asks for it
};

// Gives label `to` to the labelled voxels for which `wanted` holds.
template <class Wanted>
std::int64_t relabel(LabelMap& map, std::int32_t to, Wanted wanted) {
  std::int64_t changed = 0;
  for (std::int32_t& label : map.labels) {
    if (label == 0 || label == to || !wanted(label)) continue;
    label = to;
    ++changed;
  }
  return changed;
}

struct Neighbours {
  std::array<std::size_t, 6> voxel;
  int count = 0;
};

Neighbours face_neighbours(const LabelMap& map, std::size_t voxel) {
  const auto nx = static_cast<std::size_t>(map.size[0]), ny = static_cast<std::size_t>(map.size[1]);
  const std::size_t at[3] = {voxel % nx, voxel / nx % ny, voxel / (nx * ny)}, step[3] = {1, nx, nx * ny};
  Neighbours result;
  for (int a = 0; a < 3; ++a) {
    if (at[a] > 0) result.voxel[result.count++] = voxel - step[a];
    if (at[a] + 1 < static_cast<std::size_t>(map.size[a])) result.voxel[result.count++] = voxel + step[a];
  }
  return result;
}

bool on_border(const LabelMap& map, std::size_t voxel) {
  const auto nx = static_cast<std::size_t>(map.size[0]), ny = static_cast<std::size_t>(map.size[1]);
  const std::size_t at[3] = {voxel % nx, voxel / nx % ny, voxel / (nx * ny)};
  for (int a = 0; a < 3; ++a) {
    if (map.size[a] > 1 && (at[a] == 0 || at[a] + 1 == static_cast<std::size_t>(map.size[a]))) return true;
  }
  return false;
}

// Empty voxels that the border cannot be reached from.
std::vector<std::size_t> enclosed_voxels(const LabelMap& map) {
  std::vector<std::uint8_t> open(map.voxel_count(), 0);
  std::vector<std::size_t> front;
  const auto visit = [&](std::size_t voxel) {
    if (map.labels[voxel] != 0 || open[voxel]) return;
    open[voxel] = 1;
    front.push_back(voxel);
  };
  for (std::size_t v = 0; v < map.voxel_count(); ++v) {
    if (map.labels[v] == 0 && on_border(map, v)) visit(v);
  }
  while (!front.empty()) {
    const std::size_t voxel = front.back();
    front.pop_back();
    const Neighbours around = face_neighbours(map, voxel);
    for (int n = 0; n < around.count; ++n) visit(around.voxel[n]);
  }
  std::vector<std::size_t> enclosed;
  for (std::size_t v = 0; v < map.voxel_count(); ++v) {
    if (map.labels[v] == 0 && !open[v]) enclosed.push_back(v);
  }
  return enclosed;
}

// The label that most neighbours have, the first at ties; 0 if all are empty.
std::int32_t label_around(const LabelMap& map, std::size_t voxel) {
  const Neighbours around = face_neighbours(map, voxel);
  std::int32_t best = 0;
  int best_count = 0;
  for (int n = 0; n < around.count; ++n) {
    const std::int32_t label = map.labels[around.voxel[n]];
    int count = 0;
    for (int m = 0; m < around.count; ++m) count += map.labels[around.voxel[m]] == label;
    if (label != 0 && count > best_count) {
      best = label;
      best_count = count;
    }
  }
  return best;
}

}  // namespace

std::int64_t keep_labels(LabelMap& map, std::span<const std::int32_t> labels) {
  LabelSet set(labels);
  return relabel(map, 0, [&](std::int32_t label) { return !set.has(label); });
}

std::int64_t drop_labels(LabelMap& map, std::span<const std::int32_t> labels) {
  LabelSet set(labels);
  return relabel(map, 0, [&](std::int32_t label) { return set.has(label); });
}

std::int64_t merge_labels(LabelMap& map, std::span<const std::int32_t> from, std::int32_t to) {
  if (to == 0)
    throw InputError("merging labels: the target is 0, empty space; give a label, or drop the labels");
  if (std::find(from.begin(), from.end(), 0) != from.end()) {
    throw InputError(
        "merging labels: the list holds 0, empty space; give labels other than 0, or fill voids");
  }
  LabelSet set(from);
  return relabel(map, to, [&](std::int32_t label) { return set.has(label); });
}

std::int64_t fill_voids(LabelMap& map) {
  std::vector<std::size_t> left = enclosed_voxels(map);
  const auto found = static_cast<std::int64_t>(left.size());
  std::vector<std::int32_t> labels;
  while (!left.empty()) {
    labels.clear();
    for (const std::size_t voxel : left) labels.push_back(label_around(map, voxel));
    std::size_t rest = 0;
    for (std::size_t n = 0; n < left.size(); ++n) {
      map.labels[left[n]] = labels[n];
      if (labels[n] == 0) left[rest++] = left[n];
    }
    if (rest == left.size()) return found - static_cast<std::int64_t>(rest);  // an image without any label
    left.resize(rest);
  }
  return found;
}

std::int64_t drop_small_pieces(LabelMap& map, const SeparationPairs& pairs, std::int64_t minimum_voxels) {
  const VoxelLinks links = build_voxel_links(map, pairs);
  const std::size_t step[3] = {1, static_cast<std::size_t>(map.size[0]),
                               static_cast<std::size_t>(map.size[0]) * map.size[1]};
  std::vector<std::uint8_t> seen(map.voxel_count(), 0);
  std::vector<std::size_t> piece;
  std::int64_t changed = 0;
  for (std::size_t start = 0; start < map.voxel_count(); ++start) {
    if (seen[start] || !(links[start] & voxel_labelled)) continue;
    piece.assign(1, start);
    seen[start] = 1;
    const auto visit = [&](std::size_t voxel) {
      if (seen[voxel]) return;
      seen[voxel] = 1;
      piece.push_back(voxel);
    };
    for (std::size_t n = 0; n < piece.size(); ++n) {
      const std::size_t voxel = piece[n];
      for (int a = 0; a < 3; ++a) {
        if (links[voxel] >> a & 1) visit(voxel + step[a]);
        if (voxel >= step[a] && links[voxel - step[a]] >> a & 1) visit(voxel - step[a]);
      }
    }
    if (static_cast<std::int64_t>(piece.size()) >= minimum_voxels) continue;
    for (const std::size_t voxel : piece) map.labels[voxel] = 0;
    changed += static_cast<std::int64_t>(piece.size());
  }
  return changed;
}

std::int64_t crop_to_content(LabelMap& map, int margin_voxels) {
  Index3 low = map.size, high{-1, -1, -1};
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        if (map.labels[map.index(i, j, k)] == 0) continue;
        const Index3 at{i, j, k};
        for (int a = 0; a < 3; ++a) {
          low[a] = std::min(low[a], at[a]);
          high[a] = std::max(high[a], at[a]);
        }
      }
    }
  }
  if (high[0] < 0)
    throw InputError("cropping to content: no voxel is labelled; give an image with a label other than 0");

  LabelMap cropped = map;
  for (int a = 0; a < 3; ++a) {
    low[a] = std::max(low[a] - std::min(margin_voxels, low[a]), 0);
    high[a] += std::min(margin_voxels, map.size[a] - 1 - high[a]);
    cropped.size[a] = high[a] - low[a] + 1;
  }
  cropped.origin = map.to_world(Vec3(low[0], low[1], low[2]));
  cropped.labels.clear();
  for (int k = low[2]; k <= high[2]; ++k) {
    for (int j = low[1]; j <= high[1]; ++j) {
      const std::int32_t* row = map.labels.data() + map.index(0, j, k);
      cropped.labels.insert(cropped.labels.end(), row + low[0], row + high[0] + 1);
    }
  }
  const auto cut = static_cast<std::int64_t>(map.voxel_count() - cropped.voxel_count());
  map = std::move(cropped);
  return cut;
}

}  // namespace sulcus
