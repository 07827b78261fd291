// Direct reference: supernodal Cholesky factorisation of the step's matrix by CHOLMOD, for static problems,
// tests and measured errors. Outside the path of fingerprints (its bits depend on the BLAS that is installed)
// and in a library of its own, sulcus_direct, because CHOLMOD's supernodal module is under the GPL
// (docs/licences.md).
#pragma once

#include <memory>
#include <vector>

#include "engine/solver/conjugate_gradients.h"

namespace sulcus {

// The unknowns are those of conjugate_gradients: entries with a zero on the diagonal of RowMatrix::inverse
// are held, all others free.
class DirectSolver {
 public:
  // Orders the unknowns and analyses the pattern, once for all matrices of the mesh. The sparsity must
  // outlive the solver.
  explicit DirectSolver(const Sparsity& sparsity);
  ~DirectSolver();
  DirectSolver(const DirectSolver&) = delete;
  DirectSolver& operator=(const DirectSolver&) = delete;

  // Factorises the free part; returns -1, or the node where the matrix turned out not to be positive definite
  // (a pivot below 1e-12 of its diagonal entry counts as zero). Throws EnvironmentError where memory does not
  // suffice. Cost (two cores of 2025): 0.1 s for 4,000 nodes, 1 to 2 s for 16,000, growing like nodes^2;
  // memory nodes^(4/3), 124 MB for 16,000.
  std::int32_t factor(const RowMatrix<double>& matrix);

  // Solves as conjugate_gradients does: workspace.x from workspace.b and workspace.prescribed, the residual
  // b - A x in workspace.r, tools eliminated; with one step of refinement. `matrix` is the one that was
  // factorised. Result: no iterations; the residual left; broken if the tools' part is not positive definite.
  SolveResult solve(const RowMatrix<double>& matrix, const std::vector<ToolBorder<double>>& borders,
                    SolverWorkspace<double>& workspace);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sulcus
