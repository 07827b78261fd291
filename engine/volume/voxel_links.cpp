#include "engine/volume/voxel_links.h"

#include <algorithm>
#include <cstring>

namespace sulcus {

namespace {

// Pairs as a bit table over the labels that occur in them; constant time a question for ordinary label
// numbers.
class PairTable {
 public:
  explicit PairTable(const SeparationPairs& pairs) {
    for (const auto& [a, b] : pairs.pairs) labels_.insert(labels_.end(), {a, b});
    std::sort(labels_.begin(), labels_.end());
    labels_.erase(std::unique(labels_.begin(), labels_.end()), labels_.end());
    if (labels_.empty()) return;
    first_ = labels_.front();
    const std::int64_t range = std::int64_t{labels_.back()} - first_ + 1;
    if (range <= 1 << 20) {
      number_.assign(static_cast<std::size_t>(range), -1);
      for (std::size_t n = 0; n < labels_.size(); ++n) {
        number_[static_cast<std::size_t>(std::int64_t{labels_[n]} - first_)] = static_cast<std::int32_t>(n);
      }
    }
    separated_.assign(labels_.size() * labels_.size(), false);
    for (const auto& [a, b] : pairs.pairs) {
      const auto x = static_cast<std::size_t>(number(a)), y = static_cast<std::size_t>(number(b));
      separated_[x * labels_.size() + y] = separated_[y * labels_.size() + x] = true;
    }
  }

  bool separated(std::int32_t a, std::int32_t b) const {
    const std::int32_t x = number(a), y = number(b);
    if (x < 0 || y < 0) return false;
    return separated_[static_cast<std::size_t>(x) * labels_.size() + static_cast<std::size_t>(y)];
  }

 private:
  std::int32_t number(std::int32_t label) const {
    if (!number_.empty()) {
      const std::int64_t offset = std::int64_t{label} - first_;
      if (offset < 0 || offset >= static_cast<std::int64_t>(number_.size())) return -1;
      return number_[static_cast<std::size_t>(offset)];
    }
    const auto found = std::lower_bound(labels_.begin(), labels_.end(), label);
    return found != labels_.end() && *found == label ? static_cast<std::int32_t>(found - labels_.begin())
                                                     : -1;
  }

  std::int64_t first_ = 0;
  std::vector<std::int32_t> labels_, number_;
  std::vector<bool> separated_;
};

// Links of one row; `at_j` and `at_k` are the rows at j + 1 and k + 1 (null at the border).
void link_row(const PairTable& table, const std::int32_t* row, const std::int32_t* at_j,
              const std::int32_t* at_k, int count, std::uint8_t* links) {
  // Equal labels first, without a branch; `ask` (bit b << 4) marks the neighbours that a pair could separate.
  const auto link = [](std::int32_t a, std::int32_t b, int bit) {
    const int both = (a != 0) & (b != 0), equal = a == b;
    return (both & equal) * bit | (both & (equal ^ 1)) * (bit << 4);
  };
  for (int i = 0; i < count; ++i) links[i] = row[i] != 0 ? voxel_labelled : 0;
  for (int i = 0; i + 1 < count; ++i) links[i] |= static_cast<std::uint8_t>(link(row[i], row[i + 1], link_i));
  if (at_j) {
    for (int i = 0; i < count; ++i) links[i] |= static_cast<std::uint8_t>(link(row[i], at_j[i], link_j));
  }
  if (at_k) {
    for (int i = 0; i < count; ++i) links[i] |= static_cast<std::uint8_t>(link(row[i], at_k[i], link_k));
  }
  // Then the table for the few neighbours that differ, eight voxels a look.
  for (int i = 0; i < count;) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, links + i, static_cast<std::size_t>(std::min(8, count - i)));
    const int end = std::min(i + 8, count);
    if (!(eight & 0x7070707070707070ULL)) {
      i = end;
      continue;
    }
    for (; i < end; ++i) {
      const int ask = links[i] >> 4;
      int found = links[i] & 15;
      if (ask & link_i && !table.separated(row[i], row[i + 1])) found |= link_i;
      if (ask & link_j && !table.separated(row[i], at_j[i])) found |= link_j;
      if (ask & link_k && !table.separated(row[i], at_k[i])) found |= link_k;
      links[i] = static_cast<std::uint8_t>(found);
    }
  }
}

}  // namespace

std::vector<std::uint8_t> build_voxel_links(const LabelMap& map, const SeparationPairs& pairs) {
  const PairTable table(pairs);
  std::vector<std::uint8_t> links(map.voxel_count());
  const int nx = map.size[0], ny = map.size[1], nz = map.size[2];
#pragma omp parallel for schedule(static)
  for (int k = 0; k < nz; ++k) {
    for (int j = 0; j < ny; ++j) {
      const std::int32_t* row = map.labels.data() + map.index(0, j, k);
      link_row(table, row, j + 1 < ny ? row + nx : nullptr,
               k + 1 < nz ? row + static_cast<std::size_t>(nx) * ny : nullptr, nx,
               links.data() + map.index(0, j, k));
    }
  }
  return links;
}

}  // namespace sulcus
