// Additive multigrid preconditioner on the embedding grid and its coarser copies (mesh/coarsening.h):
//
//   z = D^-1 r + sum over levels l of P_l W_l D_l^-1 P_l^T r
//
// P_l interpolates trilinearly from level l to the mesh, D_l are the diagonal blocks of P_l^T A P_l: those of
// the cells at rest, turned by each cell's mean rotation, plus masses, springs and contacts. W_l is a weight
// a node, smaller where the functions of its neighbours do nearly the same as its own. No level needs a
// matrix, the sum is symmetric positive definite whatever the weights, and held nodes are left out exactly.
// docs/decisions/0005 says why this form and what was measured. Bramble, Pasciak, Xu, Math. Comp. 55 (1990).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/fem/assembly.h"
#include "engine/mesh/coarsening.h"
#include "engine/solver/kernels.h"

namespace sulcus {

// What does not change during a run. Coarse nodes and cells of all levels are numbered in one row, level by
// level; slots are those of the solver's vectors. Lists are [count + 1] starts into a common array.
struct Multigrid {
  std::int64_t levels = 0;
  std::int64_t shared_levels = 0;        // so many are large enough to be shared out to threads
  std::vector<std::int64_t> first_node;  // [levels+1]
  std::vector<std::int64_t> first_cell;  // [levels+1]
  // between the mesh and level 0
  std::vector<SlotGroup> slot_groups;  // [blocks of chunks]
  std::vector<std::int32_t>
      slot_order;  // the slots of each block by the number of coarse nodes that they follow
  std::vector<std::int32_t> slot_nodes;              // those nodes, in that order; a slot follows their mean
  std::vector<float> slot_share;                     // [slots] 1 / number of them; 0: padding
  std::vector<std::int32_t> node_start, node_slots;  // the slots that follow a coarse node of level 0
  // between levels
  std::vector<std::int32_t> up_start, up_nodes;      // of each coarse node: those of the next level
  std::vector<std::int32_t> down_start, down_nodes;  // of each coarse node: those that follow it
  // diagonal blocks at rest
  std::vector<std::int32_t> corner_start, corners;  // of each coarse node: cell * 8 + corner
  std::vector<float> stiffness;  // [cells][6][8 corners] (beta h + h^2) K_aa: xx xy xz yy yz zz, N s^2/m
  std::vector<float> mass;       // [nodes] kg, (1 + alpha h) M_aa and springs
  std::vector<float> weight;     // [nodes] W
  // mean rotations
  std::vector<std::int32_t> child_start, children;  // of each cell: tetrahedra (level 0) or cells
  // what a cell loses with its tetrahedra; empty where nothing tears
  std::int64_t tets_per_cell = 0;
  std::vector<float> tet_weight, cell_weight;  // [tets], [cells] mu V, and its sum over the tetrahedra below
  // the way up from a cell of the mesh
  std::vector<std::int32_t> parent;                     // [cells of the mesh, then cells]; -1: top level
  std::vector<std::array<std::int32_t, 8>> cell_nodes;  // [cells]
  std::vector<Index3> cell_position;                    // [cells]
};

// How far a disturbance travels in a step, in edges of a cell (the shortest of its three):
// sqrt((beta h + h^2) M / rho) with M = lambda + 2 mu or mu, where that is furthest, and rho the body's mean
// density.
struct Reach {
  double pressure = 0, shear = 0;
  double cell_kg = 0;  // kg, rho times the cube of that edge
};
// Cost: a pass over the elements.
Reach reach_of_step(const EmbeddingMesh& mesh, const ElementData& elements, const StepCoefficients& step);

// Whether multigrid takes a step to an error of 1e-3 in less time than block-Jacobi; what
// Preconditioner::automatic goes by. Block-Jacobi carries a disturbance one cell further in each iteration,
// so multigrid pays where a step's reach is long; contacts that are stiffer than a cell, of which the levels
// know only the diagonal blocks, move that bound (docs/decisions/0005 has rule and measurement). contact_kg:
// the largest factor of n n^T that a contact adds to the matrix, h (b + h k); 0 without. Never for a single
// layer.
bool multigrid_pays(const EmbeddingMesh& mesh, const Reach& reach, double contact_kg);

// Levels whose cells are larger than a disturbance travels in a step are left out (docs/decisions/0005).
// node_weights: [nodes] kg, what the matrix holds of masses and springs on the diagonal of each node.
// free_node: [nodes]. tears: whether elements may be removed. Empty (no levels) where the mesh is too small
// for a coarser one. Cost: for each tetrahedron and level 8 small products, once for a scene.
Multigrid build_multigrid(const EmbeddingMesh& mesh, const ElementData& elements, const Sparsity& sparsity,
                          const StepCoefficients& coefficients, std::span<const double> node_weights,
                          std::span<const std::uint8_t> free_node, bool tears = false);

// What changes at each step, and scratch memory.
template <class Real>
struct MultigridWorkspace {
  AlignedVector<Real> share;     // [48*chunks] 1 / number of coarse nodes that the slot follows; 0: held
  AlignedVector<Real> turns;     // [12*cells] columns of the mean rotations, padded to four
  AlignedVector<Real> turned;    // [cells][8 corners][8] the cells' stiffness, turned: xx xy xz yy yz zz 0 0
  AlignedVector<Real> added;     // [8*nodes] contacts, likewise
  AlignedVector<Real> inverse;   // [12*nodes] columns of W D^-1 / share, padded to four
  AlignedVector<Real> residual;  // [4*nodes of shared levels] share * P^T r
  AlignedVector<Real> correction;  // [4*nodes of shared levels]
  // of the levels above: each thread works through them by itself, which is quicker than to wait
  std::vector<AlignedVector<Real>> upper;  // [threads][8*nodes]: residuals, then corrections
  std::vector<double> sums;                // one a block of 64 nodes of level 0
  std::vector<Real> quaternions;           // [4*cells]
  std::vector<Real> torn;                  // [cells] mu V of what is gone
  std::vector<Real> up_share, up_count;    // [nodes] 1 / number and number of nodes of the next level, or 1
};

template <class Real>
MultigridWorkspace<Real> make_multigrid_workspace(const Multigrid& multigrid, std::int64_t chunks,
                                                  int threads);

template <class Real>
LevelView<Real> level_view(const Multigrid& multigrid, MultigridWorkspace<Real>& workspace);

// Forgets the contacts of the last step.
template <class Real>
void clear_contacts(MultigridWorkspace<Real>& workspace);

// Adds a symmetric block [kg] at the point of a tetrahedron that `weights` names to every level; whether a
// node there is held is not looked at: that only makes the correction smaller.
template <class Real>
void add_contact(const Multigrid& multigrid, const EmbeddingMesh& mesh, std::int32_t tet,
                 const std::array<double, 4>& weights, const Mat3& block,
                 MultigridWorkspace<Real>& workspace);

// Mean rotations, diagonal blocks and their inverses of all levels; which slots are held follows from the
// matrix. rotations: [4*tets] of the step. alive: [tets], of a multigrid that tears, or empty (all are); a
// cell is as stiff as the share of it that is alive, by mu V. Cost: about two iterations of conjugate
// gradients.
template <class Real>
void set_up_multigrid(const Multigrid& multigrid, const RowMatrix<Real>& matrix,
                      std::span<const double> rotations, std::span<const std::uint8_t> alive,
                      const SolverKernels<Real>& kernels, int threads, MultigridWorkspace<Real>& workspace);

}  // namespace sulcus
