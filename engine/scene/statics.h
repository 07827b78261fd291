// Static equilibrium: the state in which elastic forces, springs, gravity and loads balance at every free
// node while held nodes stay and moved ones are where their paths want them. Newton on the corotated elastic
// energy with a line search (equations.md 2.1: the elastic force is that energy's gradient).
//
// The matrix is the energy's Hessian (engine/fem/tangent.h); where that is not positive definite, the warped
// stiffness R K0 R^T, which always is, once the body is held.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "engine/scene/scene.h"
#include "engine/scene/state.h"

namespace sulcus {

// Solves as conjugate_gradients (without tools) or DirectSolver do; `broken` for a matrix that is not
// positive definite.
using LinearSolver = std::function<SolveResult(const RowMatrix<double>& matrix, double tolerance,
                                               SolverWorkspace<double>& workspace)>;

struct StaticSettings {
  double tolerance = 1e-8;       // largest unbalanced force at a free node, relative to the largest force
  int max_iterations = 200;      // of Newton, a load step
  double load_step_cells = 0.5;  // moved nodes go this far (in edges of a cell) in one load step, at most
  LinearSolver solver;           // none: conjugate gradients, block-Jacobi, double precision
};

struct StaticReport {
  bool converged = false;
  std::string problem;  // empty if converged: what stopped it, where, and the remedy
  int load_steps = 0;
  int iterations = 0;                 // of Newton, over all load steps
  int warped_iterations = 0;          // of these, with the warped stiffness
  int linear_iterations = 0;          // of the linear solver
  double balance = 0;                 // largest unbalanced force over the largest force
  double largest_force_N = 0;         // at any node: load, weight, spring or reaction
  double elastic_energy_J = 0;        // tissue and springs
  std::vector<double> balances;       // after each iteration of the last load step, the start first
  std::vector<Vec3> motion_forces;    // [motions] N, that the nodes of the path exert on the tissue
  Vec3 support_force = Vec3::Zero();  // N, of the fixed nodes on the tissue, sum
};

// Brings state.positions and rotations to the equilibrium for the places of the paths at state.step;
// velocities become zero. Starts from the given positions. Elements that are removed stay so; none tear.
// Throws InputError for a scene with tools, and for pieces of the mesh that can move freely (pieces.h).
// Memory: one system matrix in double precision. Not for the hot loop.
StaticReport solve_static(const Scene& scene, const StaticSettings& settings, State& state, int threads);

}  // namespace sulcus
