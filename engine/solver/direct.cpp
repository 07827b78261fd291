#include "engine/solver/direct.h"

#include <suitesparse/cholmod.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double smallest_pivot = 1e-12;  // of the diagonal entry

// Place of entry d of a slot in a solver vector.
std::size_t entry_of(std::int32_t slot, std::size_t d) {
  const auto s = static_cast<std::size_t>(slot);
  return (s / 16 * 3 + d) * 16 + s % 16;
}

[[noreturn]] void no_memory(std::int64_t nodes) {
  throw EnvironmentError("direct solver: no memory for the factor of " + std::to_string(nodes) +
                         " nodes; use conjugate gradients, or a larger mesh size");
}

}  // namespace

struct DirectSolver::Impl {
  const Sparsity& sparsity;
  cholmod_common common{};
  cholmod_sparse* lower = nullptr;  // lower triangle by columns; unknowns in the order of the nodes
  cholmod_factor* factor = nullptr;
  std::vector<std::int32_t> first_edge;  // [nodes+1] edges are sorted by their first node
  std::vector<std::uint8_t> free_entry;  // [3*nodes]

  explicit Impl(const Sparsity& s) : sparsity(s) {
    cholmod_start(&common);
    common.print = 0;
    common.supernodal = CHOLMOD_SUPERNODAL;
    common.quick_return_if_not_posdef = 1;
    const auto nodes = static_cast<std::size_t>(sparsity.nodes);
    first_edge.assign(nodes + 1, 0);
    for (const auto& edge : sparsity.edges) ++first_edge[static_cast<std::size_t>(edge[0]) + 1];
    for (std::size_t n = 0; n < nodes; ++n) first_edge[n + 1] += first_edge[n];
    free_entry.assign(3 * nodes, 1);
    make_pattern();
  }
  ~Impl() {
    cholmod_free_factor(&factor, &common);
    cholmod_free_sparse(&lower, &common);
    cholmod_finish(&common);
  }

  // Place of entry (row 3 a + i, column 3 a + c) in column 3 a + c, i >= c; of the edge's block (3 b + i, 3 a
  // + c).
  std::size_t diagonal_place(std::int32_t a, int i, int c) const {
    return static_cast<std::size_t>(static_cast<const int*>(lower->p)[3 * a + c] + i - c);
  }
  std::size_t edge_place(std::size_t edge, int i, int c) const {
    const std::int32_t a = sparsity.edges[edge][0];
    const auto rank = static_cast<int>(edge) - first_edge[static_cast<std::size_t>(a)];
    return diagonal_place(a, 3, c) + static_cast<std::size_t>(3 * rank + i);
  }

  void make_pattern() {
    const auto size = static_cast<std::size_t>(3 * sparsity.nodes);
    const std::size_t entries = 6 * static_cast<std::size_t>(sparsity.nodes) + 9 * sparsity.edges.size();
    lower = cholmod_allocate_sparse(size, size, entries, 1, 1, -1, CHOLMOD_REAL, &common);
    if (lower == nullptr) no_memory(sparsity.nodes);
    int* start = static_cast<int*>(lower->p);
    int* row = static_cast<int*>(lower->i);
    int at = 0;
    for (int a = 0; a < static_cast<int>(sparsity.nodes); ++a) {
      for (int c = 0; c < 3; ++c) {
        start[3 * a + c] = at;
        for (int i = c; i < 3; ++i) row[at++] = 3 * a + i;
        for (auto e = static_cast<std::size_t>(first_edge[static_cast<std::size_t>(a)]);
             e < static_cast<std::size_t>(first_edge[static_cast<std::size_t>(a) + 1]); ++e) {
          for (int i = 0; i < 3; ++i) row[at++] = 3 * sparsity.edges[e][1] + i;
        }
      }
    }
    start[size] = at;
    std::fill_n(static_cast<double*>(lower->x), entries, 0.0);
    factor = cholmod_analyze(lower, &common);
    if (factor == nullptr) no_memory(sparsity.nodes);
  }

  // Fills the lower triangle; rows and columns of held entries become those of the unit matrix.
  void fill(const RowMatrix<double>& matrix) {
    double* x = static_cast<double*>(lower->x);
    for (std::int64_t slot = 0; slot < matrix.chunks * 16; ++slot) {
      const std::int32_t node = sparsity.node_of_slot[static_cast<std::size_t>(slot)];
      if (node < 0) continue;
      for (int i = 0; i < 3; ++i) {
        free_entry[static_cast<std::size_t>(3 * node + i)] =
            matrix.inverse[slot / 16 * 144 + 64 * i + slot % 16] != 0;
      }
    }
    const auto is_free = [&](std::int32_t node, int i) {
      return free_entry[static_cast<std::size_t>(3 * node + i)] != 0;
    };
    for (std::int64_t slot = 0; slot < matrix.chunks * 16; ++slot) {
      const std::int64_t chunk = slot / 16, lane = slot % 16;
      const std::int32_t node = sparsity.node_of_slot[static_cast<std::size_t>(slot)];
      if (node < 0) continue;
      for (int c = 0; c < 3; ++c) {
        for (int i = c; i < 3; ++i) {
          const bool both = is_free(node, i) && is_free(node, c);
          x[diagonal_place(node, i, c)] =
              both ? matrix.diagonal[chunk * 144 + 16 * (3 * i + c) + lane] : (i == c ? 1.0 : 0.0);
        }
      }
      for (std::int64_t e = matrix.chunk_start[chunk]; e < matrix.chunk_start[chunk + 1]; ++e) {
        const std::int32_t block = sparsity.block[static_cast<std::size_t>(e * 16 + lane)];
        if (block < 0) continue;  // padding
        const auto edge = static_cast<std::size_t>(block / 2);
        const std::int32_t other = sparsity.edges[edge][0];
        if (other == node) continue;  // upper triangle
        for (int i = 0; i < 3; ++i) {
          for (int c = 0; c < 3; ++c) {
            const bool both = is_free(node, i) && is_free(other, c);
            x[edge_place(edge, i, c)] = both ? matrix.values[e * 144 + 16 * (3 * i + c) + lane] : 0.0;
          }
        }
      }
    }
  }

  // Node of the first pivot that is as good as zero; -1: none.
  std::int32_t vanished_pivot() const {
    const int* super = static_cast<const int*>(factor->super);
    const int* pi = static_cast<const int*>(factor->pi);
    const int* px = static_cast<const int*>(factor->px);
    const int* permutation = static_cast<const int*>(factor->Perm);
    const double* values = static_cast<const double*>(factor->x);
    const double* original = static_cast<const double*>(lower->x);
    for (std::size_t s = 0; s < factor->nsuper; ++s) {
      const int rows = pi[s + 1] - pi[s];
      for (int j = 0; j < super[s + 1] - super[s]; ++j) {
        const double pivot = values[px[s] + j + j * rows];
        const int unknown = permutation[super[s] + j];
        const double diagonal = original[diagonal_place(unknown / 3, unknown % 3, unknown % 3)];
        if (!(pivot * pivot > smallest_pivot * diagonal)) return unknown / 3;
      }
    }
    return -1;
  }

  // A^-1 columns of the right-hand side [3*nodes, k], free part.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& right) {
    cholmod_dense b{};
    b.nrow = b.d = static_cast<std::size_t>(right.rows());
    b.ncol = static_cast<std::size_t>(right.cols());
    b.nzmax = static_cast<std::size_t>(right.size());
    b.x = const_cast<double*>(right.data());
    b.xtype = CHOLMOD_REAL;
    b.dtype = CHOLMOD_DOUBLE;
    cholmod_dense* x = cholmod_solve(CHOLMOD_A, factor, &b, &common);
    if (x == nullptr) no_memory(sparsity.nodes);
    Eigen::MatrixXd result =
        Eigen::Map<Eigen::MatrixXd>(static_cast<double*>(x->x), right.rows(), right.cols());
    cholmod_free_dense(&x, &common);
    return result;
  }

  // The tools' columns B [3*nodes, 6*tools], and C^-1 [6*tools, 6*tools].
  struct Borders {
    Eigen::MatrixXd b, inverse;
  };
  Borders dense(const std::vector<ToolBorder<double>>& borders) const {
    const auto tools = static_cast<Eigen::Index>(borders.size());
    Borders all{Eigen::MatrixXd::Zero(3 * sparsity.nodes, 6 * tools),
                Eigen::MatrixXd::Zero(6 * tools, 6 * tools)};
    for (Eigen::Index t = 0; t < tools; ++t) {
      const ToolBorder<double>& border = borders[static_cast<std::size_t>(t)];
      for (const auto& row : border.rows) {
        const std::int64_t slot = row.chunk * 16 + row.offset % 16;
        const std::int32_t node = sparsity.node_of_slot[static_cast<std::size_t>(slot)];
        for (int k = 0; k < 18; ++k)
          all.b(3 * node + k / 6, 6 * t + k % 6) = row.b[static_cast<std::size_t>(k)];
      }
      for (int k = 0; k < 36; ++k)
        all.inverse(6 * t + k / 6, 6 * t + k % 6) = border.inverse[static_cast<std::size_t>(k)];
    }
    return all;
  }

  Eigen::MatrixXd without_held(Eigen::MatrixXd m) const {
    if (m.cols() == 0) return m;  // without tools it has no data, of which there are no rows
    for (Eigen::Index i = 0; i < m.rows(); ++i) {
      if (!free_entry[static_cast<std::size_t>(i)]) m.row(i).setZero();
    }
    return m;
  }

  // r = b - (A - B C^-1 B^T) x; returns |r| in the norm of the diagonal blocks.
  double residual(const RowMatrix<double>& matrix, const Borders& borders, SolverWorkspace<double>& w) const {
    const auto blocks = static_cast<std::int64_t>(w.rz.size());
    std::fill(w.p.begin(), w.p.end(), 0.0);
    w.kernels.direct(matrix, 0.0, w.x.data(), w.p.data(), w.packed.data(), 0, blocks);
    w.kernels.multiply(matrix, w.p.data(), w.packed.data(), w.q.data(), w.pq.data(), 0, blocks);
    if (borders.b.cols() > 0) {
      const Eigen::VectorXd tools = borders.b * (borders.inverse * (borders.b.transpose() * gathered(w.x)));
      for (std::int32_t n = 0; n < sparsity.nodes; ++n) {
        for (std::size_t d = 0; d < 3; ++d)
          w.q[entry(n, d)] -= tools[static_cast<Eigen::Index>(3 * static_cast<std::size_t>(n) + d)];
      }
    }
    w.r = w.b;
    std::fill(w.p.begin(), w.p.end(), 0.0);
    AlignedVector<double> unmoved = w.x;
    w.kernels.advance(matrix, 1.0, w.p.data(), w.q.data(), unmoved.data(), w.r.data(), w.z.data(),
                      w.rz.data(), 0, blocks);
    double sum = 0;
    for (double s : w.rz) sum += s;
    return std::sqrt(sum);
  }

  std::size_t entry(std::int32_t node, std::size_t d) const {
    return entry_of(sparsity.slot_of_node[static_cast<std::size_t>(node)], d);
  }
  Eigen::VectorXd gathered(const AlignedVector<double>& vector) const {
    Eigen::VectorXd out(3 * sparsity.nodes);
    for (std::int32_t n = 0; n < sparsity.nodes; ++n) {
      for (std::size_t d = 0; d < 3; ++d)
        out[static_cast<Eigen::Index>(3 * static_cast<std::size_t>(n) + d)] = vector[entry(n, d)];
    }
    return out;
  }
};

DirectSolver::DirectSolver(const Sparsity& sparsity) : impl_(std::make_unique<Impl>(sparsity)) {}
DirectSolver::~DirectSolver() = default;

std::int32_t DirectSolver::factor(const RowMatrix<double>& matrix) {
  impl_->fill(matrix);
  cholmod_factorize(impl_->lower, impl_->factor, &impl_->common);
  if (impl_->common.status == CHOLMOD_OUT_OF_MEMORY || impl_->common.status == CHOLMOD_TOO_LARGE)
    no_memory(impl_->sparsity.nodes);
  if (impl_->factor->minor < impl_->factor->n)
    return static_cast<const int*>(impl_->factor->Perm)[impl_->factor->minor] / 3;
  return impl_->vanished_pivot();
}

SolveResult DirectSolver::solve(const RowMatrix<double>& matrix,
                                const std::vector<ToolBorder<double>>& borders,
                                SolverWorkspace<double>& workspace) {
  SolveResult result;
  const Impl::Borders tools = impl_->dense(borders);
  const Eigen::MatrixXd b = impl_->without_held(tools.b);
  Eigen::MatrixXd solved_b;
  Eigen::LLT<Eigen::MatrixXd> small;  // C - B^T A^-1 B
  if (b.cols() > 0) {
    solved_b = impl_->solve(b);
    small.compute(tools.inverse.inverse() - b.transpose() * solved_b);
    result.broken = small.info() != Eigen::Success;
    if (result.broken) return result;
  }
  std::fill(workspace.x.begin(), workspace.x.end(), 0.0);
  if (!workspace.prescribed.empty()) workspace.x = workspace.prescribed;
  const double start = impl_->residual(matrix, tools, workspace);
  double left = start;
  for (int pass = 0; pass < 2; ++pass) {
    Eigen::VectorXd change = impl_->solve(impl_->without_held(impl_->gathered(workspace.r)));
    if (b.cols() > 0) change += solved_b * small.solve(b.transpose() * change);
    for (std::int32_t n = 0; n < impl_->sparsity.nodes; ++n) {
      for (std::size_t d = 0; d < 3; ++d)
        workspace.x[impl_->entry(n, d)] +=
            change[static_cast<Eigen::Index>(3 * static_cast<std::size_t>(n) + d)];
    }
    left = impl_->residual(matrix, tools, workspace);
  }
  result.residual = start > 0 ? left / start : 0;
  result.broken = !std::isfinite(left);
  result.converged = !result.broken;
  return result;
}

}  // namespace sulcus
