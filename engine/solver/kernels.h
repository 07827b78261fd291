// The hot loops of conjugate gradients, compiled once for each instruction set. Vectors and matrix are in the
// slots of engine/fem/sparsity.h. Sums over vectors are kept one for each block of 16 chunks (256 rows),
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

inline constexpr std::int64_t chunks_per_block = 16;

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
};

template <class Real>
SolverKernels<Real> solver_kernels(Isa isa);

}  // namespace sulcus
