// The linear system of one step: matrix in sliced blocks, right-hand side, block-diagonal preconditioner.
#pragma once

#include <span>

#include "engine/fem/assembly_plan.h"
#include "engine/fem/elements.h"
#include "engine/fem/kernels.h"
#include "engine/fem/sparsity.h"
#include "engine/numerics/aligned.h"

namespace sulcus {

struct StepCoefficients {
  double step_s = 0;        // h
  RayleighDamping damping;  // of elements without their own (ElementData::beta_s, drag_kg_s)
};

// Buffers of one assembly; made once for a scene. Real: float or double.
template <class Real>
struct SystemMatrix {
  AlignedVector<Real> node_fields;                // ElementPass::node_fields
  AlignedVector<Real> ahead;                      // ElementPass::ahead
  AlignedVector<Real> node_terms;                 // RowPass::node_terms
  AlignedVector<Real> values, diagonal, inverse;  // RowPass
  std::vector<double> node_forces;                // [3*nodes] N, ForcePass::node_forces
  std::vector<double>
      energies;  // [blocks of 16 elements] J, elastic energy of x, if make_system_matrix was asked for it
  // A thread's own: rings of what the plan has places for, and rotations of the tiles that it makes for
  // itself.
  struct Rings {
    AlignedVector<Real> records, forces, blocks;
    AlignedVector<double> rotations;
  };
  std::vector<Rings> rings;  // [threads]
  AssemblyPlan plan;
  FemKernels<Real> kernels;
  int threads = 1;
};

template <class Real>
SystemMatrix<Real> make_system_matrix(const ElementData& elements, const Sparsity& sparsity, Isa isa,
                                      int threads, bool energies = false);

// The system for the state (x, v): rotations, the sliced matrix, its diagonal blocks D and their inverses
// (zero for held nodes: in the solver they neither move nor push), and node_forces, the elastic force that
// the deformation y = x + (h + beta) v puts on the nodes' restraint, f = K y - f0, summed in element order.
// rest: [nodes]; positions, velocities: [3*nodes]; free_node: [nodes]; rotations: [4*elements], updated.
// alive: [elements] or empty (all are). node_terms: the diagonal terms of mass, (1 + alpha h) M. Callers may
// add to them and, with add_edge_block, to the matrix; then close_rows.
template <class Real>
void assemble_elements(const ElementData& elements, const Sparsity& sparsity,
                       const StepCoefficients& coefficients, std::span<const Vec3> rest,
                       std::span<const double> positions, std::span<const double> velocities,
                       std::span<const std::uint8_t> alive, std::span<const std::uint8_t> free_node,
                       std::span<double> rotations, SystemMatrix<Real>& system);

// Adds a symmetric block to the matrix entries of the nodes of edge `edge`: block (a, b) with a < b, row
// major.
template <class Real>
void add_edge_block(const Sparsity& sparsity, std::int32_t edge, const Mat3& block,
                    SystemMatrix<Real>& system);

// Diagonal blocks, D = node_terms - sum of the row's other blocks, and their inverses once more: of all rows,
// or of some chunks of 16 (ascending).
template <class Real>
void close_rows(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                SystemMatrix<Real>& system);
template <class Real>
void close_rows(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                std::span<const std::int32_t> chunks, SystemMatrix<Real>& system);

}  // namespace sulcus
