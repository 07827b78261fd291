// A first guess for the increments of a step from those of the two steps before: the combination of them
// whose energy error is least, if the matrix of their steps were that of this one (Fischer, Comput. Methods
// Appl. Mech. Engrg. 163 (1998), who multiplies them with the new matrix instead; what each step's own matrix
// made of its increments is known without a product: its right-hand side). docs/decisions/0007 says what that
// saves.
#pragma once

#include "engine/scene/system.h"

namespace sulcus {

// Numbers that State::past_increments and past_impulses hold each; 0 in scenes that do not ask for them.
std::size_t past_size(const Scene& scene);

// Partial sums that a guess needs, in blocks of nodes; each of five numbers.
std::size_t past_blocks(const Scene& scene);

// solver.guess from the state's past and solver.b, which holds the right-hand side; zero at nodes that do not
// move. Returns whether there is any past to guess from. Same bits for any number of threads. Cost: a pass
// over five vectors and one over two.
template <class Real>
bool guess_from_past(const Scene& scene, const State& state, Workspace& workspace,
                     SolverWorkspace<Real>& solver);

// Keeps the step's increments and right-hand side in place of those of two steps ago. After the solve, before
// state.step counts on.
template <class Real>
void keep_for_guess(const Scene& scene, const Workspace& workspace, const SolverWorkspace<Real>& solver,
                    State& state);

}  // namespace sulcus
