// The linear system of one step: matrix in sliced blocks, right-hand side, block-diagonal preconditioner.
#pragma once

#include <span>

#include "engine/fem/elements.h"
#include "engine/fem/kernels.h"
#include "engine/fem/sparsity.h"
#include "engine/numerics/aligned.h"

namespace sulcus {

struct StepCoefficients {
  double step_s = 0;        // h
  RayleighDamping damping;  // of elements without their own (ElementData::beta_s, drag_kg_s)
};

// Elements in tiles of their numbers, so that edges can be summed while their elements are in the cache.
// In windows of edges (Sparsity::window_edges): those below ready[t] need no element of tile t or behind it,
// those from begin[t] on none before tile t.
struct ElementTiles {
  static constexpr std::int64_t elements = 512;  // of a tile
  std::vector<std::int64_t> ready, begin;        // [tiles+1], ascending
};
ElementTiles find_tiles(const Sparsity& sparsity, std::int64_t elements);

// Buffers of one assembly; made once for a scene. Real: float or double.
template <class Real>
struct SystemMatrix {
  AlignedVector<Real> node_fields;                // ElementPass::node_fields
  AlignedVector<Real> records;                    // ElementPass::records
  AlignedVector<Real> forces;                     // ElementPass::forces
  AlignedVector<Real> ahead;                      // ElementPass::ahead
  AlignedVector<Real> blocks;                     // EdgePass::blocks
  AlignedVector<Real> node_terms;                 // RowPass::node_terms
  AlignedVector<Real> values, diagonal, inverse;  // RowPass
  ElementTiles tiles;
  FemKernels<Real> kernels;
  int threads = 1;
};

template <class Real>
SystemMatrix<Real> make_system_matrix(const ElementData& elements, const Sparsity& sparsity, Isa isa,
                                      int threads);

// Rotations, element forces and edge blocks for the state (x, v). rest: [nodes]; positions, velocities:
// [3*nodes]; rotations: [4*elements], updated. alive: [elements] or empty (all are). Afterwards node_terms
// holds the diagonal terms of mass, (1 + alpha h) M; callers may add to them and to blocks.
template <class Real>
void assemble_elements(const ElementData& elements, const Sparsity& sparsity,
                       const StepCoefficients& coefficients, std::span<const Vec3> rest,
                       std::span<const double> positions, std::span<const double> velocities,
                       std::span<const std::uint8_t> alive, std::span<double> rotations,
                       SystemMatrix<Real>& system);

// Adds a symmetric block to the matrix entry of the nodes of edge `edge`: block (a, b) with a < b, row major.
template <class Real>
void add_edge_block(SystemMatrix<Real>& system, std::int32_t edge, const Mat3& block);

// Writes the sliced matrix, the diagonal blocks D = node_terms - sum of the row's other blocks, and their
// inverses (zero for held nodes: in the solver they neither move nor push). free_node: [nodes].
template <class Real>
void finish_rows(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                 SystemMatrix<Real>& system);

// Elastic force on each node [3*nodes], N: sum of the element forces of the last assemble_elements, in
// element order; that is the force the deformation y = x + (h + beta) v puts on the nodes' restraint, f = K y
// - f0.
template <class Real>
void elastic_forces(const ElementData& elements, const SystemMatrix<Real>& system, std::span<double> forces);

}  // namespace sulcus
