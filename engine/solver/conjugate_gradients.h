// Preconditioned conjugate gradients in fixed order: the same bits for any number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/fem/sparsity.h"
#include "engine/numerics/aligned.h"
#include "engine/numerics/types.h"
#include "engine/solver/kernels.h"
#include "engine/solver/multigrid.h"

namespace sulcus {

enum class Precision { single_precision, double_precision };
enum class Preconditioner { block_jacobi, multigrid, automatic };  // automatic: multigrid_pays

// Where the search for the velocities at the end of a step begins: at those of its start; at tissue that
// stands still, for comparison; at what the changes in the last two steps let expect (scene/past.h).
enum class FirstGuess { velocity, rest, past };

struct SolverSettings {
  Preconditioner preconditioner = Preconditioner::block_jacobi;
  Precision precision = Precision::single_precision;
  double tolerance =
      1e-3;  // of |r| / |b| in the norm of the preconditioner, |r|^2 = r . D^-1 r; b: right-hand side
  int max_iterations = 1000;
  FirstGuess first_guess = FirstGuess::velocity;
  double velocity_floor_m_s =
      1e-8;  // m/s; |r| below this times the root of the tissue's mass is converged in any case
};

// One rigid tool eliminated from the bordered system [A B; B^T C] (equations.md 4): the solver works with
// A - B C^-1 B^T. Rows of B are non-zero at the nodes in contact only.
template <class Real>
struct ToolBorder {
  struct Row {
    std::int64_t chunk = 0;    // of the node's slot
    std::int64_t offset = 0;   // of the node's entry 0 in a solver vector
    std::array<Real, 18> b{};  // 3x6, row major
  };
  std::vector<Row> rows;             // ascending by offset
  std::array<double, 36> inverse{};  // C^-1, row major
};

// Where a solve begins. rest: at x = 0. guess: as far along SolverWorkspace::guess as leaves the least energy
// error. whole_guess: all the way, for comparison. pause: where the call before ended, as if that had gone
// on; matrix, borders and right-hand side must be those of that call.
enum class Start { rest, guess, whole_guess, pause };

// A node whose inverse diagonal block leaves it two directions, across those of the axes: rounding would let
// its residual along the normal, a force of constraint, into the other two, so the search does without that
// part of it.
struct SlidingRow {
  std::int64_t chunk = 0, offset = 0;  // as in ToolBorder::Row
  Vec3 normal = Vec3::UnitX();         // unit
};

template <class Real>
struct SolverWorkspace {
  AlignedVector<Real> b, x, r, z, p, q;  // solver vectors, 48 entries a chunk
  AlignedVector<Real> packed;            // p once more, four numbers a slot
  // Start of x. `prescribed` (empty, or as b): what x shall be at held nodes, zero elsewhere. `guess` (empty,
  // or as b): where the search begins at free nodes, zero at held ones; used if `start` says so.
  AlignedVector<Real> prescribed, guess;
  Start start = Start::rest;
  double size_of_start = 0, rz_at_end = 0;  // |b|, and r . z as the last call left it: for a pause
  std::vector<SlidingRow> sliding;
  std::vector<double> pq, rz;  // one sum a block
  SolverKernels<Real> kernels;
  int threads = 1;
  std::vector<std::int64_t> first_block;  // [threads+1] of each thread, so that all have as much to multiply
  // The preconditioner is the multigrid if it has levels (then `levels` must be set up for the matrix), else
  // the inverse diagonal blocks.
  const Multigrid* multigrid = nullptr;
  MultigridWorkspace<Real> levels;
};

struct SolveResult {
  int iterations = 0;
  double residual = 0;     // |r| / |b| reached; 0 if b is below the floor
  bool converged = false;  // by tolerance or floor
  bool broken =
      false;  // the matrix was not positive definite, or a number not finite: x is the last good one
};

template <class Real>
SolverWorkspace<Real> make_solver_workspace(const Sparsity& sparsity, Isa isa, int threads);

// Makes the multigrid (none, or without levels: block-Jacobi) the preconditioner of the workspace. It must
// outlive the workspace.
template <class Real>
void use_multigrid(const Multigrid& multigrid, std::int64_t chunks, SolverWorkspace<Real>& workspace);

// Solves for workspace.x from workspace.b, starting at workspace.prescribed and as far along workspace.guess
// as leaves the least energy error, so that no guess makes that larger. |b| is that of the free nodes after
// the prescribed values have gone to the right-hand side, so a guess does not change the goal. At held nodes
// workspace.r ends as b - A x: the impulse that holds them, with the opposite sign. floor: smallest |r| that
// counts (norm as above). Cost of an iteration: one product with the matrix, one pass over five vectors, with
// the multigrid about half of that once more; of prescribed values or a guess one such iteration each.
template <class Real>
SolveResult conjugate_gradients(const RowMatrix<Real>& matrix, const std::vector<ToolBorder<Real>>& borders,
                                double tolerance, double floor, int max_iterations,
                                SolverWorkspace<Real>& workspace);

// workspace.r = b - A x, from workspace.b and x; p, q and packed are scratch. Cost: one product with the
// matrix.
template <class Real>
void find_residual(const RowMatrix<Real>& matrix, const std::vector<ToolBorder<Real>>& borders,
                   SolverWorkspace<Real>& workspace);

}  // namespace sulcus
