// Assembly and solver on the cubes that others are compared on (5 tetrahedra a cube, 5 mm): microseconds a
// call.
//
//   build/release/engine/solver/solver_bench --benchmark_filter=Iteration
//
// Arguments: number of the mesh, threads. Counters: tets; for solves also iterations and the error that is
// left, |dv - dv*| / |dv*| against double precision to 1e-10, for no speed means anything without it.
#include <benchmark/benchmark.h>

#include <cmath>

#include "engine/fem/assembly.h"
#include "engine/fem/test_meshes.h"
#include "engine/solver/conjugate_gradients.h"

namespace sulcus {
namespace {

constexpr int cells[5][3] = {{10, 10, 11}, {12, 14, 17}, {14, 14, 20}, {24, 24, 24}, {27, 59, 10}};
constexpr StepCoefficients step{1.0 / 30, {0, 0.1}};

// A twisted, bent block, bottom held: the state that the figures of the field are measured in.
template <class Real>
struct Case {
  EmbeddingMesh mesh;
  ElementData elements;
  Sparsity sparsity;
  SystemMatrix<Real> system;
  SolverWorkspace<Real> solver;
  std::vector<double> positions, velocities, rotations;
  std::vector<std::uint8_t> free_node;

  Case(int number, int threads)
      : mesh(box_mesh(cells[number][0], cells[number][1], cells[number][2], 0.005)) {
    const Material material{1000, 0.45, 1000};
    elements = build_elements(mesh, std::span(&material, 1), std::vector<std::int32_t>(mesh.tets.size(), 0));
    sparsity = build_sparsity(mesh);
    system = make_system_matrix<Real>(elements, sparsity, widest_isa(), threads);
    solver = make_solver_workspace<Real>(sparsity, widest_isa(), threads);
    const double height = cells[number][2] * 0.005;
    for (const Vec3& x : mesh.rest_positions) {
      const double angle = 0.8 * x[2] / height;
      const double c = std::cos(angle), s = std::sin(angle);
      positions.insert(positions.end(),
                       {c * x[0] - s * x[1] + 0.1 * x[2] * x[2] / height, s * x[0] + c * x[1], x[2]});
      free_node.push_back(x[2] > 1e-6);
    }
    velocities.assign(positions.size(), 0.0);
    rotations.assign(4 * mesh.tets.size(), 0.0);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) rotations[4 * t] = 1;
    assemble();
    std::vector<double> forces(positions.size());
    elastic_forces<Real>(elements, system, forces);
    for (std::size_t n = 0; n < free_node.size(); ++n) {
      const auto slot = static_cast<std::size_t>(sparsity.slot_of_node[n]);
      for (std::size_t d = 0; d < 3; ++d) {
        solver.b[(slot / 16 * 3 + d) * 16 + slot % 16] = static_cast<Real>(-step.step_s * forces[3 * n + d]);
      }
    }
  }

  void assemble() {
    assemble_elements<Real>(elements, sparsity, step, mesh.rest_positions, positions, velocities, {},
                            rotations, system);
    finish_rows<Real>(sparsity, free_node, system);
  }

  SolveResult solve(double tolerance, int most) {
    const RowMatrix<Real> matrix{sparsity.chunks,      sparsity.chunk_start.data(), sparsity.column.data(),
                                 system.values.data(), system.diagonal.data(),      system.inverse.data()};
    return conjugate_gradients(matrix, {}, tolerance, 0.0, most, solver);
  }
};

template <class Real>
void Assembly(benchmark::State& state) {
  Case<Real> c(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  for (auto _ : state) c.assemble();
  state.counters["tets"] = static_cast<double>(c.mesh.tets.size());
}

template <class Real>
void Iteration(benchmark::State& state) {  // twenty of them
  Case<Real> c(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  for (auto _ : state) benchmark::DoNotOptimize(c.solve(1e-30, 20));
  state.counters["tets"] = static_cast<double>(c.mesh.tets.size());
}

template <class Real>
void Solve(benchmark::State& state) {
  const int number = static_cast<int>(state.range(0));
  Case<Real> c(number, static_cast<int>(state.range(1)));
  SolveResult result;
  for (auto _ : state) result = c.solve(1e-3, 2000);
  Case<double> reference(number, 2);
  reference.solve(1e-10, 5000);
  double error = 0, size = 0;
  for (std::size_t i = 0; i < c.solver.x.size(); ++i) {
    const double difference = static_cast<double>(c.solver.x[i]) - reference.solver.x[i];
    error += difference * difference;
    size += reference.solver.x[i] * reference.solver.x[i];
  }
  state.counters["tets"] = static_cast<double>(c.mesh.tets.size());
  state.counters["iterations"] = result.iterations;
  state.counters["error"] = std::sqrt(error / size);
}

void sizes(benchmark::internal::Benchmark* b) {
  b->Unit(benchmark::kMicrosecond)->UseRealTime();
  for (int mesh = 0; mesh < 5; ++mesh) {
    for (int threads : {1, 2}) b->Args({mesh, threads});
  }
}

BENCHMARK_TEMPLATE(Assembly, float)->Apply(sizes);
BENCHMARK_TEMPLATE(Assembly, double)->Apply(sizes);
BENCHMARK_TEMPLATE(Iteration, float)->Apply(sizes);
BENCHMARK_TEMPLATE(Iteration, double)->Apply(sizes);
BENCHMARK_TEMPLATE(Solve, float)->Apply(sizes);

}  // namespace
}  // namespace sulcus
