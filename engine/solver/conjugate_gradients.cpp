#include "engine/solver/conjugate_gradients.h"

#include <omp.h>

#include <algorithm>
#include <cmath>

#include "engine/numerics/team.h"

namespace sulcus {

namespace isa_sse2 {
template <class Real>
SolverKernels<Real> solver_table();
}
namespace isa_avx2 {
template <class Real>
SolverKernels<Real> solver_table();
}
namespace isa_avx512 {
template <class Real>
SolverKernels<Real> solver_table();
}

template <class Real>
SolverKernels<Real> solver_kernels(Isa isa) {
  return compiled_for(isa, isa_sse2::solver_table<Real>, isa_avx2::solver_table<Real>,
                      isa_avx512::solver_table<Real>)();
}

namespace {

// Shares the blocks out by what a product with their rows costs; a row's vectors cost as much as five
// entries.
std::vector<std::int64_t> share_blocks(const Sparsity& sparsity, std::int64_t blocks, int threads) {
  const auto cost = [&](std::int64_t chunk) {
    return 5 * chunk + sparsity.chunk_start[static_cast<std::size_t>(chunk)];
  };
  std::vector<std::int64_t> first(1, 0);
  for (int thread = 1; thread < threads; ++thread) {
    const std::int64_t goal = cost(sparsity.chunks) * thread / threads;
    std::int64_t block = first.back();
    while (block < blocks && 2 * goal > cost(block * chunks_per_block) +
                                            cost(std::min((block + 1) * chunks_per_block, sparsity.chunks)))
      ++block;
    first.push_back(block);
  }
  first.push_back(blocks);
  return first;
}

}  // namespace

template <class Real>
SolverWorkspace<Real> make_solver_workspace(const Sparsity& sparsity, Isa isa, int threads) {
  SolverWorkspace<Real> workspace;
  const auto size = static_cast<std::size_t>(sparsity.chunks) * 48;
  for (auto* vector : {&workspace.b, &workspace.x, &workspace.r, &workspace.z, &workspace.p, &workspace.q}) {
    vector->assign(size, Real(0));
  }
  workspace.packed.assign(static_cast<std::size_t>(sparsity.chunks) * 64, Real(0));
  const auto blocks = static_cast<std::size_t>((sparsity.chunks + chunks_per_block - 1) / chunks_per_block);
  workspace.pq.assign(blocks, 0.0);
  workspace.rz.assign(blocks, 0.0);
  workspace.first_block = share_blocks(sparsity, static_cast<std::int64_t>(blocks), threads);
  workspace.kernels = solver_kernels<Real>(isa);
  workspace.threads = threads;
  return workspace;
}

template <class Real>
void use_multigrid(const Multigrid& multigrid, std::int64_t chunks, SolverWorkspace<Real>& workspace) {
  if (multigrid.levels == 0) return;
  workspace.multigrid = &multigrid;
  workspace.levels = make_multigrid_workspace<Real>(multigrid, chunks, workspace.threads);
}

namespace {

template <class Real>
Range own_blocks(const SolverWorkspace<Real>& workspace, int thread) {
  const auto t = static_cast<std::size_t>(thread);
  return {workspace.first_block[t], workspace.first_block[t + 1]};
}

template <class Real>
Range nodes_of(const LevelView<Real>& levels, std::int64_t level, int thread, int threads) {
  const std::int64_t first = levels.first_node[level];
  const Range part = share(levels.first_node[level + 1] - first, thread, threads);
  return {first + part.first, first + part.last};
}

double ordered_sum(const std::vector<double>& sums) {
  double sum = 0;
  for (double s : sums) sum += s;
  return sum;
}

// a . b over a block's chunks: 16 running sums, added up in order.
template <class Real>
double block_product(const Real* a, const Real* b, std::int64_t block, std::int64_t chunks) {
  double sums[16] = {};
  const std::int64_t end = std::min((block + 1) * chunks_per_block, chunks) * 48;
  for (std::int64_t i = block * chunks_per_block * 48; i < end; i += 16) {
    for (int l = 0; l < 16; ++l) sums[l] += static_cast<double>(a[i + l]) * static_cast<double>(b[i + l]);
  }
  double sum = 0;
  for (double s : sums) sum += s;
  return sum;
}

// y = C^-1 B^T p; returns p . B y.
template <class Real>
double border_product(const ToolBorder<Real>& border, const Real* p, std::array<double, 6>& y) {
  std::array<double, 6> t{};
  for (const auto& row : border.rows) {
    for (std::size_t i = 0; i < 3; ++i) {
      const double pi = static_cast<double>(p[row.offset + static_cast<std::int64_t>(16 * i)]);
      for (std::size_t k = 0; k < 6; ++k) t[k] += static_cast<double>(row.b[6 * i + k]) * pi;
    }
  }
  double product = 0;
  for (std::size_t i = 0; i < 6; ++i) {
    y[i] = 0;
    for (std::size_t k = 0; k < 6; ++k) y[i] += border.inverse[6 * i + k] * t[k];
    product += y[i] * t[i];
  }
  return product;
}

template <class Real>
void subtract_border(const ToolBorder<Real>& border, const std::array<double, 6>& y, Range chunks, Real* q) {
  for (const auto& row : border.rows) {
    if (row.chunk < chunks.first || row.chunk >= chunks.last) continue;
    for (std::size_t i = 0; i < 3; ++i) {
      double sum = 0;
      for (std::size_t k = 0; k < 6; ++k) sum += static_cast<double>(row.b[6 * i + k]) * y[k];
      q[row.offset + static_cast<std::int64_t>(16 * i)] -= static_cast<Real>(sum);
    }
  }
}

// Takes the part along their normals out of the rows that slide.
template <class Real>
void project(const std::vector<SlidingRow>& sliding, Range chunks, Real* v) {
  for (const SlidingRow& row : sliding) {
    if (row.chunk < chunks.first || row.chunk >= chunks.last) continue;
    Real* at = v + row.offset;
    const double along = row.normal[0] * static_cast<double>(at[0]) +
                         row.normal[1] * static_cast<double>(at[16]) +
                         row.normal[2] * static_cast<double>(at[32]);
    for (int i = 0; i < 3; ++i) at[16 * i] -= static_cast<Real>(along * row.normal[i]);
  }
}

}  // namespace

template <class Real>
SolveResult conjugate_gradients(const RowMatrix<Real>& matrix, const std::vector<ToolBorder<Real>>& borders,
                                double tolerance, double floor, int max_iterations,
                                SolverWorkspace<Real>& workspace) {
  SolveResult result;
  const auto& kernels = workspace.kernels;
  Real* x = workspace.x.data();
  Real* r = workspace.r.data();
  Real* z = workspace.z.data();
  Real* p = workspace.p.data();
  Real* q = workspace.q.data();
  Real* packed = workspace.packed.data();
  SpinBarrier barrier(workspace.threads);
  const bool with_levels = workspace.multigrid != nullptr;
  LevelView<Real> levels;
  if (with_levels) levels = level_view(*workspace.multigrid, workspace.levels);
  const auto sums = static_cast<std::int64_t>(workspace.levels.sums.size());

#pragma omp parallel num_threads(workspace.threads)
  {
    const int thread = omp_get_thread_num();
    const Range own_sums = share(sums, thread, workspace.threads);
    const Range own = own_blocks(workspace, thread);
    const Range own_chunks{own.first * chunks_per_block, own.last * chunks_per_block};
    const std::int64_t first = own_chunks.first * 48;
    const std::int64_t last = std::min(own_chunks.last, matrix.chunks) * 48;
    // x += alpha p, r -= alpha q, and what the preconditioner makes of r; returns r . z when all have
    const auto advance = [&](Real alpha) {
      if (!with_levels) {
        kernels.advance(matrix, alpha, p, q, x, r, z, workspace.rz.data(), own.first, own.last);
      } else {
        kernels.advance_packing(matrix, levels, alpha, p, q, x, r, z, packed, workspace.rz.data(), own.first,
                                own.last);
        barrier.wait();
        kernels.restrict_slots(levels, packed, own_sums.first * nodes_per_sum,
                               std::min(own_sums.last * nodes_per_sum, levels.first_node[1]));
        barrier.wait();
        for (std::int64_t level = 1; level < levels.shared_levels; ++level) {
          const Range nodes = nodes_of(levels, level, thread, workspace.threads);
          kernels.restrict_nodes(levels, nodes.first, nodes.last);
          barrier.wait();
        }
        Real* upper = workspace.levels.upper[static_cast<std::size_t>(thread)].data();
        kernels.climb(levels, upper);
        const Real* above = upper + 4 * levels.first_node[levels.levels];
        for (std::int64_t level = levels.shared_levels - 1; level > 0; --level) {
          const Range nodes = nodes_of(levels, level, thread, workspace.threads);
          kernels.correct_nodes(levels, above, nodes.first, nodes.last);
          above = levels.correction;
          barrier.wait();
        }
        kernels.correct(levels, above, own_sums.first, own_sums.last);
      }
      barrier.wait();
      return ordered_sum(workspace.rz) + ordered_sum(workspace.levels.sums);
    };
    // p = z + beta p, for the next product
    const auto direct = [&](Real beta) {
      if (with_levels) {
        kernels.direct_corrected(matrix, levels, beta, z, p, packed, own.first, own.last);
      } else {
        kernels.direct(matrix, beta, z, p, packed, own.first, own.last);
      }
      barrier.wait();
    };
    double rz = workspace.rz_at_end, start = workspace.size_of_start;
    // q = A p for p as `direct` left it; returns p . A p
    const auto multiply = [&] {
      std::array<double, 6> y;
      double border_term = 0;
      kernels.multiply(matrix, p, packed, q, workspace.pq.data(), own.first, own.last);
      for (const auto& border : borders) {
        border_term += border_product(border, p, y);
        subtract_border(border, y, own_chunks, q);
      }
      project(workspace.sliding, own_chunks, q);
      barrier.wait();
      return ordered_sum(workspace.pq) - border_term;
    };
    // Goes along a part: all the way, or as far as leaves the least energy error, so that it cannot grow.
    const auto add_to_start = [&](const Real* part, bool whole) {
      kernels.direct(matrix, Real(0), part, p, packed, own.first, own.last);
      barrier.wait();
      const double pq = multiply();
      double alpha = 1;
      if (!whole) {
        for (std::int64_t block = own.first; block < own.last; ++block)
          workspace.rz[static_cast<std::size_t>(block)] = block_product(r, p, block, matrix.chunks);
        barrier.wait();
        alpha = ordered_sum(workspace.rz) / pq;
        barrier.wait();  // all have read what advance writes
      }
      if (std::isfinite(alpha)) rz = advance(static_cast<Real>(alpha));
    };
    if (workspace.start != Start::pause) {
      for (std::int64_t i = first; i < last; ++i) {
        x[i] = p[i] = q[i] = Real(0);
        r[i] = workspace.b[static_cast<std::size_t>(i)];
      }
      project(workspace.sliding, own_chunks, r);
      rz = advance(Real(0));
      if (!workspace.prescribed.empty()) add_to_start(workspace.prescribed.data(), true);
      start = std::sqrt(rz);
      const bool whole = workspace.start == Start::whole_guess;
      if (whole || workspace.start == Start::guess) add_to_start(workspace.guess.data(), whole);
      direct(Real(0));
    }

    const double goal = std::fmax(tolerance * start, floor);
    int iteration = 0;
    bool broken = !std::isfinite(rz);
    while (!broken && std::sqrt(rz) > goal && iteration < max_iterations) {
      const double pq = multiply();
      if (!(pq > 0) || !std::isfinite(pq)) {
        broken = true;
        break;
      }
      const double alpha = rz / pq;
      const double rz_new = advance(static_cast<Real>(alpha));
      ++iteration;
      if (!std::isfinite(rz_new)) {
        broken = true;
        break;
      }
      direct(static_cast<Real>(rz_new / rz));
      rz = rz_new;
    }
    barrier.wait();  // all have read where a pause began
    if (thread == 0) {
      workspace.size_of_start = start;
      workspace.rz_at_end = rz;
      result.iterations = iteration;
      result.residual = start > 0 ? std::sqrt(rz) / start : 0;
      result.converged = !broken && std::sqrt(rz) <= goal;
      result.broken = broken;
    }
  }
  if (!workspace.sliding.empty()) find_residual(matrix, borders, workspace);
  return result;
}

template <class Real>
void find_residual(const RowMatrix<Real>& matrix, const std::vector<ToolBorder<Real>>& borders,
                   SolverWorkspace<Real>& workspace) {
  const auto& kernels = workspace.kernels;
  SpinBarrier barrier(workspace.threads);
#pragma omp parallel num_threads(workspace.threads)
  {
    const Range own = own_blocks(workspace, omp_get_thread_num());
    const Range own_chunks{own.first * chunks_per_block,
                           std::min(own.last * chunks_per_block, matrix.chunks)};
    Real *p = workspace.p.data(), *q = workspace.q.data();
    kernels.direct(matrix, Real(0), workspace.x.data(), p, workspace.packed.data(), own.first, own.last);
    barrier.wait();
    kernels.multiply(matrix, p, workspace.packed.data(), q, workspace.pq.data(), own.first, own.last);
    std::array<double, 6> y;
    for (const auto& border : borders) {
      border_product(border, p, y);
      subtract_border(border, y, own_chunks, q);
    }
    for (auto i = static_cast<std::size_t>(own_chunks.first * 48);
         i < static_cast<std::size_t>(own_chunks.last * 48); ++i) {
      workspace.r[i] = workspace.b[i] - q[i];
    }
  }
}

#define SULCUS_INSTANTIATE(Real)                                                                            \
  template SolverKernels<Real> solver_kernels<Real>(Isa);                                                   \
  template SolverWorkspace<Real> make_solver_workspace<Real>(const Sparsity&, Isa, int);                    \
  template void use_multigrid<Real>(const Multigrid&, std::int64_t, SolverWorkspace<Real>&);                \
  template SolveResult conjugate_gradients<Real>(const RowMatrix<Real>&,                                    \
                                                 const std::vector<ToolBorder<Real>>&, double, double, int, \
                                                 SolverWorkspace<Real>&);                                   \
  template void find_residual<Real>(const RowMatrix<Real>&, const std::vector<ToolBorder<Real>>&,           \
                                    SolverWorkspace<Real>&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
