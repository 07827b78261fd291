#include "tools/bench/bodies.h"

#include <cstdio>

#include "engine/fem/test_meshes.h"
#include "engine/mesh/spl_atlas.h"
#include "engine/numerics/error.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {
namespace {

// Middle of all voxel faces between the labels of a pair on the left side (+x).
PressPlace left_fissure(const LabelMap& map, const SeparationPairs& pairs) {
  const double middle = map.to_world(0.5 * Vec3(map.size[0] - 1, map.size[1] - 1, map.size[2] - 1))[0];
  Vec3 sum = Vec3::Zero();
  double count = 0;
  for (int k = 0; k + 1 < map.size[2]; ++k) {
    for (int j = 0; j + 1 < map.size[1]; ++j) {
      for (int i = 0; i + 1 < map.size[0]; ++i) {
        const std::int32_t own = map.labels[map.index(i, j, k)];
        if (own == 0) continue;
        for (const Index3& next : {Index3{i + 1, j, k}, Index3{i, j + 1, k}, Index3{i, j, k + 1}}) {
          const std::int32_t other = map.labels[map.index(next[0], next[1], next[2])];
          if (other == 0 || other == own || !pairs.contains(own, other)) continue;
          const Vec3 at = map.to_world(0.5 * Vec3(i + next[0], j + next[1], k + next[2]));
          if (at[0] < middle) continue;
          sum += at;
          ++count;
        }
      }
    }
  }
  return {count > 0 ? Vec3(sum / count) : sum, -Vec3::UnitZ()};
}

BenchMesh brain(const std::string& name, const LabelMap& map, const SeparationPairs& pairs,
                const EmbeddingOptions& options) {
  return {name, build_embedding(map, pairs, options), left_fissure(map, pairs)};
}

}  // namespace

std::optional<BenchMesh> bench_mesh(const std::string& name) {
  int nx = 0, ny = 0, nz = 0;
  double size_mm = 0;
  if (std::sscanf(name.c_str(), "cubes_%dx%dx%d", &nx, &ny, &nz) == 3 && nx > 0 && ny > 0 && nz > 0) {
    return BenchMesh{
        name, box_mesh(nx, ny, nz, 0.005), {0.005 * Vec3(0.5 * nx, 0.5 * ny, nz), -Vec3::UnitZ()}};
  }
  if (std::sscanf(name.c_str(), "jhu189_%lfmm", &size_mm) == 1) {
    try {
      const Scenario scenario = load_scenario(SULCUS_SOURCE_DIR "/scenarios/brain_sylvian_retraction.json",
                                              {"/mesh/size_mm=" + std::to_string(size_mm)});
      return brain(name, load_label_map(scenario), scenario.scene.pairs, scenario.scene.embedding);
    } catch (const InputError&) {
      return std::nullopt;
    }
  }
  if (std::sscanf(name.c_str(), "spl_%lfmm", &size_mm) == 1) {
    const auto map = read_spl_brain();
    if (!map) return std::nullopt;
    EmbeddingOptions options;
    options.size_m = 1e-3 * size_mm;
    options.min_island_cells = 10;
    return brain(name, *map, read_thesis_pairs("Sylvian fissure"), options);
  }
  throw InputError("body: found \"" + name +
                   "\", expected cubes_10x10x11, jhu189_10mm, spl_10mm or the like");
}

}  // namespace sulcus
