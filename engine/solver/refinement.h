// Small tolerances at the price of single precision: conjugate gradients in single precision again and again,
// each time for what the solution so far leaves of the right-hand side by the matrix in double precision. One
// solve in single precision can reach about 1e-5, and the rounding of its matrix and of its right-hand side
// costs more than that; this reaches what double precision does, with half of its traffic in every iteration.
#pragma once

#include <memory>

#include "engine/solver/conjugate_gradients.h"

namespace sulcus {

// Whether single precision is asked for and too little by itself.
inline bool is_refined(const SolverSettings& settings) {
  return settings.precision == Precision::single_precision && settings.tolerance < 1e-5;
}

// The system once more, in single precision.
struct Refinement {
  AlignedVector<float> values, diagonal, inverse;  // as in RowMatrix
  std::vector<ToolBorder<float>> borders;
  SolverWorkspace<float> solver;
};

std::unique_ptr<Refinement> make_refinement(const Sparsity& sparsity, Isa isa, int threads);

// Copies the matrix, rounded; valid until either changes. And what was copied last.
RowMatrix<float> round_matrix(const RowMatrix<double>& matrix, Refinement& refinement);
RowMatrix<float> rounded_matrix(const RowMatrix<double>& matrix, const Refinement& refinement);

// As conjugate_gradients, to which it comes down; round_matrix has been called for the matrix, and the levels
// of refinement.solver, if it has any, are set up for it. The norm is that of the preconditioner in single
// precision. Stops unconverged where rounding in double precision leaves nothing to win. Iterations are those
// of all solves.
SolveResult refined_conjugate_gradients(const RowMatrix<double>& matrix,
                                        const std::vector<ToolBorder<double>>& borders, double tolerance,
                                        double floor, int max_iterations, SolverWorkspace<double>& workspace,
                                        Refinement& refinement);

}  // namespace sulcus
