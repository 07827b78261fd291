#include "engine/solver/refinement.h"

#include <algorithm>
#include <cmath>

namespace sulcus {
namespace {

constexpr double inner_tolerance = 1e-3;  // of one solve: well above its rounding
constexpr int most_solves = 8;

void round_numbers(const double* from, AlignedVector<float>& to, int threads) {
  const auto count = static_cast<std::int64_t>(to.size());
#pragma omp parallel for num_threads(threads) schedule(static)
  for (std::int64_t i = 0; i < count; ++i) to[static_cast<std::size_t>(i)] = static_cast<float>(from[i]);
}

void round_borders(const std::vector<ToolBorder<double>>& from, std::vector<ToolBorder<float>>& to) {
  to.resize(from.size());
  for (std::size_t t = 0; t < from.size(); ++t) {
    to[t].inverse = from[t].inverse;
    to[t].rows.resize(from[t].rows.size());
    for (std::size_t k = 0; k < from[t].rows.size(); ++k) {
      to[t].rows[k].chunk = from[t].rows[k].chunk;
      to[t].rows[k].offset = from[t].rows[k].offset;
      std::copy(from[t].rows[k].b.begin(), from[t].rows[k].b.end(), to[t].rows[k].b.begin());
    }
  }
}

}  // namespace

std::unique_ptr<Refinement> make_refinement(const Sparsity& sparsity, Isa isa, int threads) {
  auto refinement = std::make_unique<Refinement>();
  const auto chunks = static_cast<std::size_t>(sparsity.chunks);
  refinement->values.assign(9 * sparsity.block.size(), 0.0F);
  refinement->diagonal.assign(9 * 16 * chunks, 0.0F);
  refinement->inverse.assign(9 * 16 * chunks, 0.0F);
  refinement->solver = make_solver_workspace<float>(sparsity, isa, threads);
  return refinement;
}

RowMatrix<float> rounded_matrix(const RowMatrix<double>& matrix, const Refinement& refinement) {
  return {matrix.chunks,
          matrix.chunk_start,
          matrix.column,
          refinement.values.data(),
          refinement.diagonal.data(),
          refinement.inverse.data()};
}

RowMatrix<float> round_matrix(const RowMatrix<double>& matrix, Refinement& refinement) {
  const int threads = refinement.solver.threads;
  round_numbers(matrix.values, refinement.values, threads);
  round_numbers(matrix.diagonal, refinement.diagonal, threads);
  round_numbers(matrix.inverse, refinement.inverse, threads);
  return rounded_matrix(matrix, refinement);
}

SolveResult refined_conjugate_gradients(const RowMatrix<double>& matrix,
                                        const std::vector<ToolBorder<double>>& borders, double tolerance,
                                        double floor, int max_iterations, SolverWorkspace<double>& workspace,
                                        Refinement& refinement) {
  SolverWorkspace<float>& inner = refinement.solver;
  const RowMatrix<float> rounded = rounded_matrix(matrix, refinement);
  SolveResult all;
  double size = 0, goal = floor;  // |r|
  // what the solution so far leaves, solved for by at most so many iterations
  const auto correct = [&](int most) {
    find_residual(matrix, borders, workspace);
    round_numbers(workspace.r.data(), inner.b, inner.threads);
    const SolveResult result =
        conjugate_gradients(rounded, refinement.borders, inner_tolerance, goal, most, inner);
    size = inner.size_of_start;
    all.iterations += result.iterations;
    all.broken = all.broken || result.broken;
    return result.iterations > 0 && !result.broken;
  };
  if (workspace.start != Start::pause) {
    round_borders(borders, refinement.borders);
    inner.sliding = workspace.sliding;
    for (std::size_t i = 0; i < workspace.x.size(); ++i)
      workspace.x[i] = workspace.prescribed.empty() ? 0 : workspace.prescribed[i];
    correct(0);
    workspace.size_of_start = size;
    if (workspace.start == Start::guess || workspace.start == Start::whole_guess) {
      for (std::size_t i = 0; i < workspace.x.size(); ++i) workspace.x[i] += workspace.guess[i];
    }
  }
  goal = std::fmax(tolerance * workspace.size_of_start, floor);
  for (int solve = 0; correct(solve < most_solves ? max_iterations - all.iterations : 0); ++solve) {
    for (std::size_t i = 0; i < workspace.x.size(); ++i) workspace.x[i] += static_cast<double>(inner.x[i]);
  }
  all.residual = workspace.size_of_start > 0 ? size / workspace.size_of_start : 0;
  all.converged = !all.broken && size <= goal;
  return all;
}

}  // namespace sulcus
