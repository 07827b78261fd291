// `sulcus diff A B`: where two recordings part first, and by how much their values differ in the end.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/rerun.h"
#include "tools/sulcus/support.h"
#include "verify/fingerprint.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

fs::path recording_in(const fs::path& path) {
  return fs::is_directory(path) ? path / "run.h5" : path;
}

// The arrays of both where they part, made again by this program. Says so if it cannot make them.
std::string differing_numbers(const RunData& a, const RunData& b, const std::string& place_a,
                              const std::string& place_b, int threads, std::int64_t done, std::size_t leaf) {
  Rerun first(a, place_a, threads, true), second(b, place_b, threads, true);
  for (std::int64_t n = 0; n < done; ++n) {
    first.step();
    second.step();
  }
  for (const auto& [run, again, place] :
       {std::tuple(&a, &first, place_a), std::tuple(&b, &second, place_b)}) {
    if (!differing_leaves(recorded_tree_row(*run, done), again->row()).empty()) {
      return "this program does not give " + place +
             " again, so the numbers cannot be told; `sulcus replay " + place +
             " --lockstep OTHER` with the build that recorded it can";
    }
  }
  return describe_difference(tree_leaf_names()[leaf], first.array(leaf), second.array(leaf));
}

// Values side by side: the series that differ, the largest relative difference first.
void print_series(const RunData& a, const RunData& b) {
  struct Row {
    std::string name, unit;
    double difference, peak, step;
  };
  std::vector<Row> rows;
  for (const auto& [name, series] : a.series) {
    const Series* other = b.find(name);
    if (other == nullptr || name.starts_with("stage/") || name.starts_with("session/")) continue;
    Row row{name, series.unit, 0, 0, 0};
    for (std::size_t i = 0; i < std::min(series.values.size(), other->values.size()); ++i) {
      const double difference = std::abs(series.values[i] - other->values[i]);
      row.peak = std::max(row.peak, std::abs(series.values[i]));
      if (!(difference <= row.difference)) {
        row.difference = difference;
        row.step = static_cast<double>(i / static_cast<std::size_t>(series.components));
      }
    }
    if (row.difference != 0) rows.push_back(row);
  }
  std::sort(rows.begin(), rows.end(),
            [](const Row& x, const Row& y) { return x.difference * y.peak > y.difference * x.peak; });
  if (!rows.empty())
    std::printf("\n%-36s %14s %14s %10s %8s\n", "series", "difference", "peak", "relative", "step");
  for (const Row& row : rows) {
    std::printf("%-36s %14.4g %14.4g %10.2g %8.0f %s\n", row.name.c_str(), row.difference, row.peak,
                row.difference / row.peak, row.step, row.unit.c_str());
  }
}

}  // namespace

int diff_command(const DiffOptions& options) {
  const std::string place_a = recording_in(options.a).string(), place_b = recording_in(options.b).string();
  const RunData a = read_run(place_a), b = read_run(place_b);
  for (const auto& [what, x, y] : {std::tuple("nodes", a.header.node_count(), b.header.node_count()),
                                   std::tuple("tetrahedra", a.header.tet_count(), b.header.tet_count()),
                                   std::tuple("tools", a.header.tool_count(), b.header.tool_count())}) {
    if (x == y) continue;
    std::printf("DIFFERS from the start: %lld %s against %lld\n", static_cast<long long>(x), what,
                static_cast<long long>(y));
    return 1;
  }
  const std::int64_t common = std::min(a.steps, b.steps);
  for (std::int64_t done = 0; done <= common; ++done) {
    const auto differing = differing_leaves(recorded_tree_row(a, done), recorded_tree_row(b, done));
    if (differing.empty()) continue;
    std::printf("%s\n", describe_leaves(differing, done, common).c_str());
    std::printf("%s\n", differing_numbers(a, b, place_a, place_b, threads_or_all(options.threads), done,
                                          differing.front())
                            .c_str());
    print_series(a, b);
    return 1;
  }
  if (a.steps != b.steps) {
    std::printf("DIFFERS in length: the same for %lld steps, but %lld steps against %lld\n",
                static_cast<long long>(common), static_cast<long long>(a.steps),
                static_cast<long long>(b.steps));
    return 1;
  }
  std::printf("SAME  %lld steps, fingerprint %s\n", static_cast<long long>(common),
              hex16(a.fingerprint()).c_str());
  return 0;
}

}  // namespace sulcus
