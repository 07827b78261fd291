// Cost of tearing on a block of 19,600 elements: the stress criterion where nothing, and where some, elements
// are near their threshold, and the removal of hinges after 33 elements have torn (the peak of thesis
// Fig. 3.17). Counters: elements whose exact stress was computed; elements removed; the error of the
// criterion is zero, since the bound only spares the exact stress where it cannot decide.
#include <benchmark/benchmark.h>

#include "engine/fracture/fracture.h"
#include "engine/fracture/test_zoo.h"

namespace sulcus {
namespace {

struct Block {
  EmbeddingMesh mesh = box_mesh(14, 20, 14, 0.00625);
  NodeStars around = build_node_stars(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
  Material material;
  ElementData elements;
  FractureData data;
  std::vector<std::uint8_t> alive = std::vector<std::uint8_t>(mesh.tets.size(), 1);
  std::vector<double> positions = flat_positions(mesh);

  explicit Block(double threshold_Pa, double noise_m) {
    material.fracture_threshold_Pa = threshold_Pa;
    const std::vector<std::int32_t> of_tet(mesh.tets.size(), 0);
    elements = build_elements(mesh, std::span(&material, 1), of_tet);
    data = build_fracture_data(elements, std::span(&material, 1), of_tet);
    std::mt19937_64 random(4);
    for (double& x : positions) x += uniform(random, -noise_m, noise_m);
  }
  MeshStars stars() const { return {mesh.tets, around.start, around.incident}; }
};

// range(0): noise of the nodes, micrometres; range(1): threads
void criterion(benchmark::State& state) {
  Block block(1e5, 1e-6 * static_cast<double>(state.range(0)));
  block.data.worth_a_look.assign(block.data.worth_a_look.size(), 900.0F);
  FractureScratch scratch =
      make_fracture_scratch(block.elements, block.stars(), widest_isa(), static_cast<int>(state.range(1)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(tear(block.elements, block.data, {}, block.stars(), block.mesh.rest_positions,
                                  block.positions, block.alive, {}, scratch));
  }
  state.counters["exact stresses"] = static_cast<double>(scratch.close.size());
}
BENCHMARK(criterion)->ArgsProduct({{0, 300, 600}, {1, 2}})->Unit(benchmark::kMicrosecond)->UseRealTime();

void singularities_after_33(benchmark::State& state) {
  Block block(1e5, 0);
  std::mt19937_64 random(7);
  StarScratch scratch = make_star_scratch(block.stars());
  std::vector<std::int32_t> torn, removed;
  // a wall of tissue around the middle plane, torn somewhere
  for (std::int32_t t = 0; t < static_cast<std::int32_t>(block.mesh.tets.size()) && torn.size() < 33; ++t) {
    if (block.mesh.cell_position[static_cast<std::size_t>(t / 5)][0] == 7 && random() % 5 == 0)
      torn.push_back(t);
  }
  std::vector<std::uint8_t> alive;
  for (auto _ : state) {
    state.PauseTiming();
    alive = block.alive;
    for (std::int32_t t : torn) alive[static_cast<std::size_t>(t)] = 0;
    removed = torn;
    state.ResumeTiming();
    remove_singularities(block.stars(), alive, removed, scratch);
  }
  state.counters["removed"] = static_cast<double>(removed.size());
}
BENCHMARK(singularities_after_33)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace sulcus
