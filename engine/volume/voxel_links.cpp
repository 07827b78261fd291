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

constexpr int block = 32;  // voxels looked at together

// Neighbours of a block of voxels at +i, +j, +k.
struct Neighbours {
  const std::int32_t *i, *j, *k;
};

// Links between equal labels, and in the upper four bits those between different labels, which the table has
// to confirm; without a branch.
[[gnu::always_inline]] inline void link_equal(const std::int32_t* here, const Neighbours& next,
                                              std::uint8_t* links) {
  const auto mask = [](bool condition) __attribute__((always_inline)) {
    return -static_cast<std::int32_t>(condition);
  };
  const auto link = [&](std::int32_t a, std::int32_t b, int bit) __attribute__((always_inline)) {
    const std::int32_t equal = mask(a == b);
    return mask(b != 0) & ((equal & bit) | (~equal & (bit << 4)));
  };
  std::int32_t wide[block];
  for (int n = 0; n < block; ++n) {
    wide[n] = mask(here[n] != 0) & (voxel_labelled | link(here[n], next.i[n], link_i) |
                                    link(here[n], next.j[n], link_j) | link(here[n], next.k[n], link_k));
  }
  for (int n = 0; n < block; ++n) links[n] = static_cast<std::uint8_t>(wide[n]);
}

void ask_table(const PairTable& table, const std::int32_t* here, const Neighbours& next,
               std::uint8_t* links) {
  for (int n = 0; n < block; n += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, links + n, 8);
    if (!(eight & 0x7070707070707070ULL)) continue;
    for (int m = n; m < n + 8; ++m) {
      const int ask = links[m] >> 4;
      int found = links[m] & 15;
      if (ask & link_i && !table.separated(here[m], next.i[m])) found |= link_i;
      if (ask & link_j && !table.separated(here[m], next.j[m])) found |= link_j;
      if (ask & link_k && !table.separated(here[m], next.k[m])) found |= link_k;
      links[m] = static_cast<std::uint8_t>(found);
    }
  }
}

[[gnu::always_inline]] inline bool all_empty(const std::int32_t* labels) {
  std::int32_t any = 0;
  for (int n = 0; n < block; ++n) any |= labels[n];
  return any == 0;
}

// The last voxels of a row, fewer than a block, one by one; `at_j` and `at_k` are null at the border.
void link_rest(const PairTable& table, const std::int32_t* row, const std::int32_t* at_j,
               const std::int32_t* at_k, int begin, int count, std::uint8_t* links) {
  const auto link = [&](std::int32_t a, std::int32_t b, int bit) {
    return b != 0 && (a == b || !table.separated(a, b)) ? bit : 0;
  };
  for (int i = begin; i < count; ++i) {
    if (row[i] == 0) {
      links[i] = 0;
      continue;
    }
    int found = voxel_labelled;
    if (i + 1 < count) found |= link(row[i], row[i + 1], link_i);
    if (at_j) found |= link(row[i], at_j[i], link_j);
    if (at_k) found |= link(row[i], at_k[i], link_k);
    links[i] = static_cast<std::uint8_t>(found);
  }
}

// Links of one row; `at_j` and `at_k` are the rows at j + 1 and k + 1, null at the border.
[[gnu::always_inline]] inline void link_row(const PairTable& table, const std::int32_t* row,
                                            const std::int32_t* at_j, const std::int32_t* at_k, int count,
                                            std::uint8_t* links) {
  static constexpr std::int32_t nothing[block] = {};
  int i = 0;
  for (; i + block < count; i += block) {  // the neighbour at +i exists for all
    if (all_empty(row + i)) {
      std::memset(links + i, 0, block);
      continue;
    }
    const Neighbours next{row + i + 1, at_j ? at_j + i : nothing, at_k ? at_k + i : nothing};
    link_equal(row + i, next, links + i);
    ask_table(table, row + i, next, links + i);
  }
  link_rest(table, row, at_j, at_k, i, count, links);
}

using LinkRow = decltype(link_row);

#if defined(__x86_64__)
[[gnu::target("avx2")]] void link_row_avx2(const PairTable& table, const std::int32_t* row,
                                           const std::int32_t* at_j, const std::int32_t* at_k, int count,
                                           std::uint8_t* links) {
  link_row(table, row, at_j, at_k, count, links);
}
#endif
void link_row_plain(const PairTable& table, const std::int32_t* row, const std::int32_t* at_j,
                    const std::int32_t* at_k, int count, std::uint8_t* links) {
  link_row(table, row, at_j, at_k, count, links);
}

// For the registers that the processor has.
LinkRow* fastest_link_row() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return link_row_avx2;
#endif
  return link_row_plain;
}

}  // namespace

VoxelLinks build_voxel_links(const LabelMap& map, const SeparationPairs& pairs) {
  const PairTable table(pairs);
  VoxelLinks links(map.voxel_count() + 8);
  std::fill(links.end() - 8, links.end(), std::uint8_t{0});
  LinkRow* const link = fastest_link_row();
  const int nx = map.size[0], ny = map.size[1], nz = map.size[2];
#pragma omp parallel for schedule(static)
  for (int k = 0; k < nz; ++k) {
    for (int j = 0; j < ny; ++j) {
      const std::int32_t* row = map.labels.data() + map.index(0, j, k);
      link(table, row, j + 1 < ny ? row + nx : nullptr,
           k + 1 < nz ? row + static_cast<std::size_t>(nx) * ny : nullptr, nx,
           links.data() + map.index(0, j, k));
    }
  }
  return links;
}

}  // namespace sulcus
