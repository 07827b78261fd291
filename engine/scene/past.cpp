#include "engine/scene/past.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace sulcus {
namespace {

constexpr std::int64_t block_nodes = 256;  // of one partial sum

// Products of the newer (n) and the older (o) increments with right-hand sides.
struct Products {
  double nn = 0, oo = 0, on = 0;  // x_n . b_n, x_o . b_o, x_o . b_n
  double n = 0, o = 0;            // with that of this step
};

// The weights of both that leave the least energy error.
std::array<double, 2> best_weights(const Products& p) {
  // two increments that point nearly the same way are not told apart by less than this of their length
  constexpr double blur = 1e-3;
  const double size_n = 1 / std::sqrt(p.nn), size_o = p.oo > 0 ? 1 / std::sqrt(p.oo) : 0;
  const double cosine = p.on * size_n * size_o, n = p.n * size_n, o = p.o * size_o;
  const double determinant = (1 + blur) * (1 + blur) - cosine * cosine;
  if (!(determinant > 0) || size_o == 0) return {p.n / p.nn, 0};
  return {((1 + blur) * n - cosine * o) / determinant * size_n,
          ((1 + blur) * o - cosine * n) / determinant * size_o};
}

}  // namespace

std::size_t past_size(const Scene& scene) {
  return scene.settings.solver.first_guess == FirstGuess::past ? 6 * scene.mesh.rest_positions.size() : 0;
}

std::size_t past_blocks(const Scene& scene) {
  return static_cast<std::size_t>((scene.node_count() + block_nodes - 1) / block_nodes);
}

template <class Real>
bool guess_from_past(const Scene& scene, const State& state, Workspace& workspace,
                     SolverWorkspace<Real>& solver) {
  const std::int64_t nodes = scene.node_count();
  const auto numbers = static_cast<std::size_t>(3 * nodes);
  const std::size_t older = state.step % 2 == 0 ? 0 : numbers, newer = numbers - older;
  const double *x_n = &state.past_increments[newer], *x_o = &state.past_increments[older];
  const double *b_n = &state.past_impulses[newer], *b_o = &state.past_impulses[older];
  auto& sums = workspace.past_products;
  const auto blocks = static_cast<std::int64_t>(sums.size() / 5);
#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t block = 0; block < blocks; ++block) {
    Products p;
    for (std::int64_t node = block * block_nodes; node < std::min((block + 1) * block_nodes, nodes); ++node) {
      const std::size_t entry = solver_entry(scene, static_cast<std::int32_t>(node), 0);
      for (std::size_t d = 0; d < 3; ++d) {
        const std::size_t i = 3 * static_cast<std::size_t>(node) + d;
        const double b = static_cast<double>(solver.b[entry + 16 * d]);
        p.nn += x_n[i] * b_n[i];
        p.oo += x_o[i] * b_o[i];
        p.on += x_o[i] * b_n[i];
        p.n += x_n[i] * b;
        p.o += x_o[i] * b;
      }
    }
    double* to = &sums[static_cast<std::size_t>(5 * block)];
    to[0] = p.nn, to[1] = p.oo, to[2] = p.on, to[3] = p.n, to[4] = p.o;
  }
  Products all;
  for (std::size_t k = 0; k < sums.size(); k += 5) {
    all.nn += sums[k], all.oo += sums[k + 1], all.on += sums[k + 2];
    all.n += sums[k + 3], all.o += sums[k + 4];
  }
  if (!(all.nn > 0)) return false;
  const std::array<double, 2> weights = best_weights(all);
  const double n = weights[0], o = weights[1];
  const std::span<const std::uint8_t> free_node = free_nodes(scene, workspace.view);
#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t node = 0; node < nodes; ++node) {
    const std::size_t entry = solver_entry(scene, static_cast<std::int32_t>(node), 0);
    const bool moves = free_node[static_cast<std::size_t>(node)] != 0;
    for (std::size_t d = 0; d < 3; ++d) {
      const std::size_t i = 3 * static_cast<std::size_t>(node) + d;
      solver.guess[entry + 16 * d] = moves ? static_cast<Real>(n * x_n[i] + o * x_o[i]) : Real(0);
    }
  }
  return true;
}

template <class Real>
void keep_for_guess(const Scene& scene, const Workspace& workspace, const SolverWorkspace<Real>& solver,
                    State& state) {
  const std::int64_t nodes = scene.node_count();
  const std::size_t place = state.step % 2 == 0 ? 0 : static_cast<std::size_t>(3 * nodes);
#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t node = 0; node < nodes; ++node) {
    const std::size_t entry = solver_entry(scene, static_cast<std::int32_t>(node), 0);
    for (std::size_t d = 0; d < 3; ++d) {
      const std::size_t i = 3 * static_cast<std::size_t>(node) + d;
      state.past_increments[place + i] = workspace.increments[i];
      state.past_impulses[place + i] = static_cast<double>(solver.b[entry + 16 * d]);
    }
  }
}

#define SULCUS_INSTANTIATE(Real)                                                                       \
  template bool guess_from_past<Real>(const Scene&, const State&, Workspace&, SolverWorkspace<Real>&); \
  template void keep_for_guess<Real>(const Scene&, const Workspace&, const SolverWorkspace<Real>&, State&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
