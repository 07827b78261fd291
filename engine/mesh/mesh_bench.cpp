// Meshing and distances of a 256^3 brain, one and two threads. Argument 1: threads; argument 2: H in mm, or
// for distances 0: voxel_faces, 1: smooth.
//
// Compare as ratios within one run. "check" counts what was made (cells, or the sum of distances in m), the
// same for any thread count: speed stands beside the result it gave.
#include <benchmark/benchmark.h>
#include <omp.h>

#include <cmath>

#include "engine/mesh/embedding.h"
#include "engine/mesh/spl_atlas.h"
#include "engine/mesh/surface.h"
#include "engine/volume/distance_field.h"
#include "engine/volume/voxel_links.h"

namespace sulcus {
namespace {

// The atlas, or where it is absent a ball with winding gaps of about the same share of voxels.
const LabelMap& brain() {
  static const LabelMap map = [] {
    if (auto atlas = read_spl_brain()) return *std::move(atlas);
    LabelMap ball;
    ball.size = {256, 256, 256};
    ball.labels.resize(std::size_t{256} * 256 * 256);
    for (int k = 0; k < 256; ++k) {
      for (int j = 0; j < 256; ++j) {
        for (int i = 0; i < 256; ++i) {
          const int x = i - 128, y = j - 128, z = k - 128, square = x * x + y * y + z * z;
          const bool gap = (x * x / 64 + y + z * z / 96) % 24 == 0;
          if (square < 75 * 75 && !gap)
            ball.labels[ball.index(i, j, k)] = 1 + (i / 20 + 7 * (j / 20) + 49 * (k / 20)) % 229;
        }
      }
    }
    return ball;
  }();
  return map;
}

const SeparationPairs& pairs() {
  static const SeparationPairs sylvian = read_thesis_pairs("Sylvian fissure");
  return sylvian;
}

void embedding(benchmark::State& state) {
  const LabelMap& map = brain();
  pairs();
  omp_set_num_threads(static_cast<int>(state.range(0)));
  std::size_t cells = 0;
  for (auto _ : state) {
    const EmbeddingMesh mesh =
        build_embedding(map, pairs(), {.size_m = 1e-3 * static_cast<double>(state.range(1))});
    cells = mesh.cell_position.size();
    benchmark::DoNotOptimize(mesh.tets.data());
  }
  state.counters["check"] = static_cast<double>(cells);
}
BENCHMARK(embedding)->ArgsProduct({{1, 2}, {10, 5, 2}})->Unit(benchmark::kMillisecond)->UseRealTime();

void voxel_links(benchmark::State& state) {
  const LabelMap& map = brain();
  omp_set_num_threads(static_cast<int>(state.range(0)));
  std::size_t sum = 0;
  for (auto _ : state) {
    const VoxelLinks links = build_voxel_links(map, pairs());
    benchmark::DoNotOptimize(links.data());
    sum = links[links.size() / 2];
  }
  state.counters["check"] = static_cast<double>(sum);
}
BENCHMARK(voxel_links)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

void distance_field(benchmark::State& state) {
  const LabelMap& map = brain();
  omp_set_num_threads(static_cast<int>(state.range(0)));
  double sum = 0;  // m
  for (auto _ : state) {
    const DistanceField field = build_distance_field(map, pairs(), static_cast<DistanceKind>(state.range(1)));
    benchmark::DoNotOptimize(field.distance.data());
    state.PauseTiming();
    sum = 0;
    for (const float distance : field.distance) sum += static_cast<double>(distance);
    state.ResumeTiming();
  }
  state.counters["check"] = sum;
}
BENCHMARK(distance_field)->ArgsProduct({{1, 2}, {0, 1}})->Unit(benchmark::kMillisecond)->UseRealTime();

void surface(benchmark::State& state) {
  const LabelMap& map = brain();
  omp_set_num_threads(static_cast<int>(state.range(0)));
  const EmbeddingMesh mesh = build_embedding(map, pairs(), {.size_m = 5e-3});
  std::size_t triangles = 0;
  for (auto _ : state) triangles = build_embedded_surface(map, pairs(), mesh, 15).triangles.size();
  state.counters["check"] = static_cast<double>(triangles);
}
BENCHMARK(surface)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace sulcus
