// The hot loops of the assembly, compiled once for each instruction set (engine/numerics/isa.h). Raw arrays
// only; the callers are in fem/assembly.cpp. Real is float or double.
//
// Symmetric system of one backward Euler step, increments dv of the velocities (equations.md 2.3):
//   A dv = b,  A = (1 + alpha h) M + (beta h + h^2) K,  b = h (-f_elastic(x + (h + beta) v) - alpha M v +
//   f_ext)
// With h_a = R g_a (g_a: gradient of shape function a in the rest shape) the block of corners a, b is
//   K_ab = V [lambda h_a h_b^T + mu (h_b h_a^T + (h_a . h_b) I)].
// A record carries sqrt(V mu) h_a and lambda / mu, so that nothing else of the element is needed for it.
// Where elements have a beta of their own, their records are made of lambda and mu times (h + beta_e) / (h +
// beta). What other material laws must give: engine/fem/laws.h.
#pragma once

#include <cstdint>

#include "engine/numerics/isa.h"

namespace sulcus {

template <class Real>
struct ElementPass {
  std::int64_t count = 0;               // elements
  const std::int32_t* nodes = nullptr;  // ElementData::nodes
  const Real* rest = nullptr;           // ElementData::rest_*
  const Real* node_fields =
      nullptr;  // [8*nodes] displacement (m) of x and of x + (h + beta) v, each padded to 4
  const std::uint8_t* alive = nullptr;   // [elements]; nullptr: all are
  const std::uint8_t* linear = nullptr;  // [elements] 1: plain linear elasticity; nullptr: all are corotated
  const Real* ahead =
      nullptr;  // [elements rounded up to blocks] (h + beta_e) / (h + beta); nullptr: all are 1
  // In the arrays below element e stands at place e - rotations_from, and e - records_from.
  std::int64_t rotations_from = 0, records_from = 0;
  double* rotations = nullptr;  // [4*places] in: warm start, out: rotation of x
  Real* records = nullptr;      // [16*places] sqrt(V mu) h_a | lambda / mu, a = 0..3
  Real* forces = nullptr;       // [12*places + 4] elastic force (N) on corners 0..3
  double* energies =
      nullptr;  // [blocks] J, elastic energy of x in each block of 16 elements; nullptr: not asked
};

template <class Real>
struct EdgePass {
  const std::int32_t* lane_edges = nullptr;  // AssemblyPlan::lane_*
  const std::int32_t* lane_start = nullptr;  // Sparsity::lane_start
  const std::int32_t* lane_corners = nullptr;
  const Real* records = nullptr;  // and 16 zeros behind the last
  Real scale = 0;                 // beta h + h^2
  Real* blocks =
      nullptr;  // [12*places + 24] block (a, b) of scale * K, row major, rows padded to 4; scratch, zeros
};

template <class Real>
struct RowPass {
  const std::int32_t* node_of_slot = nullptr;
  const std::int32_t* chunk_start = nullptr;
  const std::int32_t* block = nullptr;        // AssemblyPlan::block
  const std::uint16_t* transposed = nullptr;  // AssemblyPlan::transposed
  const Real* blocks = nullptr;               // EdgePass::blocks
  const Real* node_terms = nullptr;  // [16*nodes] added to the diagonal block (9, row major, last 7 unused)
  const std::uint8_t* free_node = nullptr;  // [nodes] 1: moves, 0: held
  Real* values = nullptr;                   // [entries*9*16] planes of 16 lanes
  Real* diagonal = nullptr;                 // [chunks*9*16]
  Real* inverse = nullptr;  // [chunks*9*16] inverse of the diagonal block; 0 for held nodes and padding
};

template <class Real>
struct ForcePass {
  const std::int32_t* incident_start = nullptr;  // ElementData::incident*
  const std::int32_t* incident = nullptr;        // AssemblyPlan::incident
  const Real* forces = nullptr;                  // ElementPass::forces
  double* node_forces = nullptr;                 // [3*nodes] sum over the node's elements, in their order
};

// Elastic energy, in double precision whatever the matrix has (engine/fem/stress.h).
struct EnergyPass {
  std::int64_t count = 0;                // elements
  const std::int32_t* nodes = nullptr;   // ElementData::nodes
  const double* rest = nullptr;          // ElementData::rest_double
  const double* positions = nullptr;     // [3*nodes]
  const double* rotations = nullptr;     // [4*elements]
  const std::uint8_t* alive = nullptr;   // [elements]; nullptr: all are
  const std::uint8_t* linear = nullptr;  // as in ElementPass
  double* sums = nullptr;  // [last - first] J of each block of 16 elements, added in their order
};

template <class Real>
struct FemKernels {
  void (*element_pass)(const ElementPass<Real>&, std::int64_t first_block, std::int64_t last_block) = nullptr;
  // Groups of 16 lanes.
  void (*edge_pass)(const EdgePass<Real>&, std::int64_t first_group, std::int64_t last_group) = nullptr;
  // Values of the rows from the blocks of their edges, and what close_rows does.
  void (*row_pass)(const RowPass<Real>&, std::int64_t first_chunk, std::int64_t last_chunk) = nullptr;
  // Diagonal blocks, node_terms minus the sum of the row's values, and their inverses.
  void (*close_rows)(const RowPass<Real>&, std::int64_t first_chunk, std::int64_t last_chunk) = nullptr;
  void (*force_pass)(const ForcePass<Real>&, std::int64_t first_node, std::int64_t last_node) = nullptr;
  void (*energy_pass)(const EnergyPass&, std::int64_t first_block, std::int64_t last_block) = nullptr;
};

template <class Real>
FemKernels<Real> fem_kernels(Isa isa);

namespace detail {
// Where the Newton steps of a kernel lane did not converge. f: row major 3x3, q: (s,x,y,z) in and out.
void polar_rotation_fallback(const double* f, double* q);
}  // namespace detail

}  // namespace sulcus
