// The hot loops of conjugate gradients, compiled once for each instruction set. Vectors and matrix are in the
// slots of engine/fem/sparsity.h. Sums over vectors are kept one for each block of 8 chunks (128 rows),
// formed in the same order whatever the width of a register: 16 running sums, then a fixed tree in double
// precision.
#pragma once

#include <cstdint>

#include "engine/numerics/isa.h"

namespace sulcus {

template <class Real>
struct RowMatrix {
  std::int64_t chunks = 0;
  const std::int32_t* chunk_start = nullptr;
  const std::int32_t* column = nullptr;
  const Real* values = nullptr;
  const Real* diagonal = nullptr;
  const Real* inverse = nullptr;
};

inline constexpr std::int64_t chunks_per_block = 8;

// The slots of a block that follow 1, 2, 4 or 8 coarse nodes: first[k] .. first[k + 1] of the order of slots
// follow 2^k, which stand one behind the other from `nodes` on.
struct SlotGroup {
  std::int32_t first[5] = {}, nodes = 0;
};

// What the kernels see of a multigrid (multigrid.h) and of its workspace.
template <class Real>
struct LevelView {
  const std::int64_t* first_node = nullptr;
  std::int64_t levels = 0, shared_levels = 0;
  const SlotGroup* slot_groups = nullptr;
  const std::int32_t *slot_order = nullptr, *slot_nodes = nullptr;
  const std::int32_t *node_start = nullptr, *node_slots = nullptr;
  const std::int32_t *up_start = nullptr, *up_nodes = nullptr;
  const std::int32_t *down_start = nullptr, *down_nodes = nullptr;
  const std::int32_t *corner_start = nullptr, *corners = nullptr;
  const float *stiffness = nullptr, *mass = nullptr, *weight = nullptr;
  const Real *up_share = nullptr, *up_count = nullptr;
  const float* slot_share = nullptr;
  const Real *turns = nullptr, *added = nullptr;
  Real *share = nullptr, *turned = nullptr;
  Real *inverse = nullptr, *residual = nullptr, *correction = nullptr;
  double* sums = nullptr;
};

inline constexpr std::int64_t nodes_per_sum = 64;

// All work on whole blocks [first_block, last_block) and write one sum a block.
template <class Real>
struct SolverKernels {
  // q = A p; sums: p . q. packed: p once more, as `direct` leaves it: four numbers a slot (x, y, z, 0), so
  // that the entries of a neighbour are one load.
  void (*multiply)(const RowMatrix<Real>&, const Real* p, const Real* packed, Real* q, double* sums,
                   std::int64_t first_block, std::int64_t last_block) = nullptr;
  // x += alpha p; r -= alpha q; z = D^-1 r; sums: r . z
  void (*advance)(const RowMatrix<Real>&, Real alpha, const Real* p, const Real* q, Real* x, Real* r, Real* z,
                  double* sums, std::int64_t first_block, std::int64_t last_block) = nullptr;
  // p = z + beta p, and packed likewise
  void (*direct)(const RowMatrix<Real>&, Real beta, const Real* z, Real* p, Real* packed,
                 std::int64_t first_block, std::int64_t last_block) = nullptr;

  // Multigrid. advance, and packed = share * r, four numbers a slot
  void (*advance_packing)(const RowMatrix<Real>&, const LevelView<Real>&, Real alpha, const Real* p,
                          const Real* q, Real* x, Real* r, Real* z, Real* packed, double* sums,
                          std::int64_t first_block, std::int64_t last_block) = nullptr;
  // residual of the nodes of level 0
  void (*restrict_slots)(const LevelView<Real>&, const Real* packed, std::int64_t first_node,
                         std::int64_t last_node) = nullptr;
  // residual of nodes of a higher level from that of the level below
  void (*restrict_nodes)(const LevelView<Real>&, std::int64_t first_node, std::int64_t last_node) = nullptr;
  // residuals and corrections of the levels that are not shared, in memory of the thread's own [8*nodes]
  void (*climb)(const LevelView<Real>&, Real* upper) = nullptr;
  // correction of nodes above level 0 that threads share; above: corrections of the level above, by number
  void (*correct_nodes)(const LevelView<Real>&, const Real* above, std::int64_t first_node,
                        std::int64_t last_node) = nullptr;
  // correction of the nodes of level 0 [blocks of nodes_per_sum]; sums: residual . correction
  void (*correct)(const LevelView<Real>&, const Real* above, std::int64_t first_block,
                  std::int64_t last_block) = nullptr;
  // p = z + P correction + beta p, and packed likewise
  void (*direct_corrected)(const RowMatrix<Real>&, const LevelView<Real>&, Real beta, const Real* z, Real* p,
                           Real* packed, std::int64_t first_block, std::int64_t last_block) = nullptr;
  // share of each slot's entries: that of the slot where the matrix lets it move, else 0
  void (*share_slots)(const RowMatrix<Real>&, const LevelView<Real>&, std::int64_t first_chunk,
                      std::int64_t last_chunk) = nullptr;
  // stiffness of a cell's corners, turned
  void (*turn_corners)(const LevelView<Real>&, std::int64_t cell) = nullptr;
  // diagonal blocks of coarse nodes and their inverses
  void (*level_blocks)(const LevelView<Real>&, std::int64_t first_node, std::int64_t last_node) = nullptr;
};

template <class Real>
SolverKernels<Real> solver_kernels(Isa isa);

}  // namespace sulcus
