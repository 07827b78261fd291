// The finite-element core and its solver: microseconds a call, as a share of what the machine can do, beside
// the error. Bodies: the cubes that others are compared on (5 tetrahedra a cube of 5 mm) and the brain of
// brain_sylvian_retraction at 15, 10 and 5 mm (left out where its image is not installed).
//
//   build/release/tools/engine_bench --benchmark_filter='24x24|jhu'
//
// Names: kernel<precision>/body/threads. best_us: the shortest of the calls (others may use the machine);
// share: of the least time that the measured bandwidth or rate (`label`) allows; error: |single - double| /
// |double| of the kernel's result, for rotations the largest difference from an SVD, for solves |dv - dv*| /
// |dv*| against double precision to 1e-10; MB of a solve: matrix and vectors, without the body. With
// --without_limits the machine is not measured and no share is given.
#include <benchmark/benchmark.h>
#include <malloc.h>
#include <omp.h>

#include <Eigen/SVD>
#include <chrono>
#include <cstdio>
#include <random>

#include "engine/fem/rotation.h"
#include "engine/fem/stress.h"
#include "engine/numerics/error.h"
#include "engine/numerics/team.h"
#include "engine/numerics/test_random.h"
#include "tools/bench/bodies.h"
#include "tools/bench/limits.h"

namespace sulcus {
namespace free_order_sse2 {
template <class Real>
SolverKernels<Real> solver_table();
}
namespace free_order_avx2 {
template <class Real>
SolverKernels<Real> solver_table();
}
namespace free_order_avx512 {
template <class Real>
SolverKernels<Real> solver_table();
}

namespace {

MachineLimits machine[3];  // [threads]; zero: not measured

// In use from the heap, bytes.
double heap_bytes() {
  const struct mallinfo2 info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd);
}

// Runs `call` as often as the benchmark asks for, and reports the best time.
template <class Call>
void measure(benchmark::State& state, int threads, const Demand& demand, const Call& call) {
  double best = 1e9;
  for (auto _ : state) {
    const auto start = std::chrono::steady_clock::now();
    call();
    const double time = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    state.SetIterationTime(time);
    best = std::min(best, time);
  }
  const Bound bound = shortest_time(machine[threads], threads, demand);
  state.counters["best_us"] = 1e6 * best;
  state.counters["share"] = bound.seconds / best;
  state.SetLabel(bound.by);
}

template <class Real>
Demand demand(double bytes, double operations) {
  return {bytes, operations, sizeof(Real) == 8};
}

// Operations, counted in the source: gradients and forces of an element, one Newton step, a block's
// contribution.
constexpr double element_operations = 410, newton_operations = 190, contribution_operations = 48;
template <class Real>
constexpr int newton_steps = sizeof(Real) == 4 ? 2 : 3;

template <class Real>
Demand assembly_demand(const PressedBody& body) {
  const double tets = static_cast<double>(body.mesh.tets.size()), reals = sizeof(Real);
  const double nodes = static_cast<double>(body.positions.size() / 3);
  const double edges = static_cast<double>(body.sparsity.edges.size());
  const double entries = static_cast<double>(body.sparsity.column.size());
  // in: rest data, nodes, rotations, lists; out: rotations, matrix, diagonal and inverse, forces
  const double bytes = tets * (12 * reals + 16 + 64 + 24 + 16) + edges * 4 +
                       nodes * (48 + 24 + 24 + 18 * reals) + entries * (4 + 9 * reals);
  return demand<Real>(bytes, tets * (element_operations + newton_steps<Real> * newton_operations +
                                     6 * contribution_operations));
}

template <class Real>
Demand product_demand(const PressedBody& body) {
  const double entries = static_cast<double>(body.sparsity.column.size());
  const double slots = static_cast<double>(body.sparsity.node_of_slot.size());
  return demand<Real>(entries * (9 * sizeof(Real) + 4) + slots * (9 + 3 + 4 + 3) * sizeof(Real),
                      18 * (entries + slots));
}

template <class Real>
Demand iteration_demand(const PressedBody& body) {
  Demand all = product_demand<Real>(body);
  const double slots = static_cast<double>(body.sparsity.node_of_slot.size());
  all.bytes +=
      slots * (9 + 7 * 3 + 3 * 3 + 4) * sizeof(Real);  // inverse; advance: p q x r z x r; direct: z p packed
  all.operations += slots * (18 + 12 + 6);
  return all;
}

// Gradients of the body's elements and rotations two degrees off, as the warm start of a step is.
template <class Real>
struct RotationCase {
  std::vector<Mat3> gradients;
  AlignedVector<Real> lanes, matrices;
  std::vector<double> start;

  explicit RotationCase(const PressedBody& body) {
    std::mt19937_64 random(7);
    const std::size_t count = body.mesh.tets.size() / 16 * 16;
    lanes.resize(9 * count);
    matrices.resize(9 * count);
    for (std::size_t e = 0; e < count; ++e) {
      Mat3 f = deformation_gradient(body.elements, body.mesh.rest_positions, body.positions,
                                    static_cast<std::int64_t>(e));
      for (int k = 0; k < 9; ++k) {
        f(k / 3, k % 3) = static_cast<Real>(f(k / 3, k % 3) + uniform(random, -0.05, 0.05));
        lanes[(e / 16 * 9 + static_cast<std::size_t>(k)) * 16 + e % 16] = static_cast<Real>(f(k / 3, k % 3));
      }
      gradients.push_back(f);
      const double x = uniform(random, -1, 1), y = uniform(random, -1, 1), z = uniform(random, -1, 1);
      const Quaternion q = polar_rotation(f, {}) * quaternion_from_rotation_vector(0.02 * Vec3(x, y, z));
      start.insert(start.end(), {q.s, q.x, q.y, q.z});
    }
  }

  double error() const {
    double worst = 0;
    for (std::size_t e = 0; e < gradients.size(); e += 7) {
      const Eigen::JacobiSVD<Mat3> svd(gradients[e], Eigen::ComputeFullU | Eigen::ComputeFullV);
      const Mat3 r = svd.matrixU() * svd.matrixV().transpose();
      for (int k = 0; k < 9; ++k) {
        const double found = matrices[(e / 16 * 9 + static_cast<std::size_t>(k)) * 16 + e % 16];
        worst = std::max(worst, std::abs(found - r(k / 3, k % 3)));
      }
    }
    return worst;
  }
};

template <class Real>
void rotations(benchmark::State& state, const PressedBody& body) {
  RotationCase<Real> c(body);
  const auto kernels = bench_kernels<Real>(widest_isa());
  const auto count = static_cast<std::int64_t>(c.gradients.size());
  const double elements = static_cast<double>(count);
  std::vector<double> q = c.start;
  kernels.rotate(c.lanes.data(), count, q.data(), c.matrices.data());
  state.counters["error"] = c.error();
  measure(
      state, 1,
      demand<Real>(elements * (18 * sizeof(Real) + 64), elements * newton_steps<Real> * newton_operations),
      [&] { kernels.rotate(c.lanes.data(), count, q.data(), c.matrices.data()); });
  state.counters["ns_element"] = 1e3 * state.counters["best_us"] / elements;
}

template <class Real>
void assembly(benchmark::State& state, const PressedBody& body, int threads) {
  BodySystem<Real> c(body, threads);
  const BodySystem<double> exact(body, 2);
  state.counters["error"] = relative_difference(c.system.values, exact.system.values);
  measure(state, threads, assembly_demand<Real>(body), [&] { c.assemble(); });
}

// What a repeated solve does anew, of all rows.
template <class Real>
void closing(benchmark::State& state, const PressedBody& body, int threads) {
  BodySystem<Real> c(body, threads);
  measure(state, threads, {}, [&] { close_rows<Real>(body.sparsity, body.free_node, c.system); });
}

// Every thread does `work(first_block, last_block)` `rounds` times, as the solver does; the barrier is part
// of it.
template <class Real, class Work>
void on_blocks(const BodySystem<Real>& c, int threads, int rounds, const Work& work) {
  SpinBarrier barrier(threads);
#pragma omp parallel num_threads(threads)
  {
    const auto thread = static_cast<std::size_t>(omp_get_thread_num());
    const Range own{c.solver.first_block[thread], c.solver.first_block[thread + 1]};
    for (int round = 0; round < rounds; ++round) {
      work(own, barrier);
      barrier.wait();
    }
  }
}

constexpr int rounds = 20;  // products or iterations a call

template <class Real>
void fill(BodySystem<Real>& c) {
  for (std::size_t i = 0; i < c.solver.p.size(); ++i) {
    c.solver.p[i] = c.solver.z[i] = static_cast<Real>(1e-3 * static_cast<double>(i % 97));
  }
  c.solver.kernels.direct(c.matrix(), Real(0), c.solver.z.data(), c.solver.p.data(), c.solver.packed.data(),
                          0, static_cast<std::int64_t>(c.solver.rz.size()));
}

template <class Real>
void multiply_once(BodySystem<Real>& c, Range own) {
  c.solver.kernels.multiply(c.matrix(), c.solver.p.data(), c.solver.packed.data(), c.solver.q.data(),
                            c.solver.pq.data(), own.first, own.last);
}

template <class Real>
void product(benchmark::State& state, const PressedBody& body, int threads) {
  BodySystem<Real> c(body, threads);
  BodySystem<double> exact(body, 1);
  fill(c);
  fill(exact);
  multiply_once(exact, {0, static_cast<std::int64_t>(exact.solver.rz.size())});
  Demand needed = product_demand<Real>(body);
  const double bytes = needed.bytes;
  measure(state, threads, needed,
          [&] { on_blocks(c, threads, rounds, [&](Range own, SpinBarrier&) { multiply_once(c, own); }); });
  state.counters["best_us"] = state.counters["best_us"] / rounds;
  state.counters["share"] = state.counters["share"] * rounds;
  state.counters["GB_s"] = 1e-3 * bytes / state.counters["best_us"];
  state.counters["error"] = relative_difference(c.solver.q, exact.solver.q);
}

double sum_of(const std::vector<double>& sums) {
  double sum = 0;
  for (double s : sums) sum += s;
  return sum;
}

template <class Real>
SolverKernels<Real> free_order_kernels() {
  if (widest_isa() == Isa::avx512) return free_order_avx512::solver_table<Real>();
  return widest_isa() == Isa::avx2 ? free_order_avx2::solver_table<Real>()
                                   : free_order_sse2::solver_table<Real>();
}

// The three kernels of an iteration with fixed coefficients, and the same with sums in whatever order is
// quickest: one a thread, in registers. The two take turns within one call, so that a disturbance meets both.
template <class Real>
void iteration(benchmark::State& state, const PressedBody& body, int threads) {
  BodySystem<Real> c(body, threads);
  fill(c);
  const SolverKernels<Real> fixed = c.solver.kernels, free = free_order_kernels<Real>();
  const RowMatrix<Real> matrix = c.matrix();
  const auto run = [&](const SolverKernels<Real>& kernels) {
    const auto start = std::chrono::steady_clock::now();
    on_blocks(c, threads, rounds, [&](Range own, SpinBarrier& barrier) {
      auto& s = c.solver;
      kernels.multiply(matrix, s.p.data(), s.packed.data(), s.q.data(), s.pq.data(), own.first, own.last);
      barrier.wait();
      const double small = 1e-30 * sum_of(s.pq);
      kernels.advance(matrix, static_cast<Real>(small), s.p.data(), s.q.data(), s.x.data(), s.r.data(),
                      s.z.data(), s.rz.data(), own.first, own.last);
      barrier.wait();
      const double one = 1 + 1e-30 * sum_of(s.rz);
      kernels.direct(matrix, static_cast<Real>(one), s.z.data(), s.p.data(), s.packed.data(), own.first,
                     own.last);
    });
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  double best_free = 1e9, best_fixed = 1e9;
  for (auto _ : state) {
    best_free = std::min(best_free, run(free));
    const double time = run(fixed);
    best_fixed = std::min(best_fixed, time);
    state.SetIterationTime(time);
  }
  const Bound bound = shortest_time(machine[threads], threads, iteration_demand<Real>(body));
  state.counters["best_us"] = 1e6 * best_fixed / rounds;
  state.counters["share"] = bound.seconds * rounds / best_fixed;
  state.counters["free_order_us"] = 1e6 * best_free / rounds;
  state.counters["determinism_%"] = 100 * (best_fixed / best_free - 1);
  state.SetLabel(bound.by);
}

template <class Real>
void solve(benchmark::State& state, const PressedBody& body, int threads) {
  const double before = heap_bytes();
  BodySystem<Real> c(body, threads);
  state.counters["MB"] = 1e-6 * (heap_bytes() - before);
  state.counters["tets"] = static_cast<double>(body.mesh.tets.size());
  SolveResult result;
  Demand needed = iteration_demand<Real>(body);
  result = conjugate_gradients(c.matrix(), {}, 1e-3, 0.0, 2000, c.solver);
  needed.bytes *= 1;
  measure(state, threads, needed,
          [&] { result = conjugate_gradients(c.matrix(), {}, 1e-3, 0.0, 2000, c.solver); });
  BodySystem<double> reference(body, 2);
  conjugate_gradients(reference.matrix(), {}, 1e-10, 0.0, 5000, reference.solver);
  state.counters["share"] = state.counters["share"] * result.iterations;
  state.counters["iterations"] = result.iterations;
  state.counters["error"] = relative_difference(c.solver.x, reference.solver.x);
}

// Made when a benchmark that was asked for first needs it.
struct LazyBody {
  std::string name;
  std::unique_ptr<PressedBody> made;

  const PressedBody* get() {
    if (!made) {
      if (auto mesh = bench_mesh(name))
        made = std::make_unique<PressedBody>(make_body(name, std::move(mesh->mesh)));
    }
    return made.get();
  }
};

template <class Function>
void add(const std::string& kernel, LazyBody& body, int threads, const Function& function) {
  benchmark::RegisterBenchmark((kernel + "/" + body.name + "/" + std::to_string(threads)).c_str(),
                               [&body, function](benchmark::State& state) {
                                 if (const PressedBody* made = body.get()) {
                                   function(state, *made);
                                 } else {
                                   state.SkipWithError("its image is absent");
                                 }
                               })
      ->UseManualTime()
      ->Unit(benchmark::kMicrosecond);
}

template <class Real>
void add_kernels(LazyBody& lazy, const std::string& precision) {
  using benchmark::State;
  add("rotations<" + precision + ">", lazy, 1,
      [](State& s, const PressedBody& body) { rotations<Real>(s, body); });
  for (int threads : {1, 2}) {
    add("assembly<" + precision + ">", lazy, threads,
        [threads](State& s, const PressedBody& body) { assembly<Real>(s, body, threads); });
    add("closing<" + precision + ">", lazy, threads,
        [threads](State& s, const PressedBody& body) { closing<Real>(s, body, threads); });
    add("product<" + precision + ">", lazy, threads,
        [threads](State& s, const PressedBody& body) { product<Real>(s, body, threads); });
    add("iteration<" + precision + ">", lazy, threads,
        [threads](State& s, const PressedBody& body) { iteration<Real>(s, body, threads); });
    add("solve<" + precision + ">", lazy, threads,
        [threads](State& s, const PressedBody& body) { solve<Real>(s, body, threads); });
  }
}

constexpr const char* body_names[] = {"cubes_5x5x8",    "cubes_10x10x11", "cubes_12x14x17", "cubes_14x14x20",
                                      "cubes_24x24x24", "cubes_27x59x10", "cubes_40x50x50", "jhu189_15mm",
                                      "jhu189_10mm",    "jhu189_5mm"};

void print_limits() {
  for (int threads : {1, 2}) {
    machine[threads] = measure_limits(threads);
    const MachineLimits& m = machine[threads];
    std::fprintf(
        stderr,
        "%d thread%s, %s: read %.0f GB/s L2 (%lld KB a core), %.0f L3, %.0f DRAM; %.0f Gflop/s single, %.0f "
        "double\n",
        threads, threads > 1 ? "s" : "", isa_name(widest_isa()), 1e-9 * m.l2_B_s,
        static_cast<long long>(m.l2_bytes >> 10), 1e-9 * m.l3_B_s, 1e-9 * m.dram_B_s, 1e-9 * m.single_flop_s,
        1e-9 * m.double_flop_s);
  }
}

}  // namespace
}  // namespace sulcus

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  const bool limits = argc < 2 || std::string(argv[1]) != "--without_limits";
  if (limits && benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  if (limits) sulcus::print_limits();
  std::vector<sulcus::LazyBody> bodies(std::size(sulcus::body_names));
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    bodies[b].name = sulcus::body_names[b];
    sulcus::add_kernels<float>(bodies[b], "single");
    sulcus::add_kernels<double>(bodies[b], "double");
  }
  benchmark::RunSpecifiedBenchmarks();
}
