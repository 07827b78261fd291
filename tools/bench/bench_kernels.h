// Kernels that only the benchmark has, compiled once for each instruction set as the engine's are.
#pragma once

#include <cstdint>

namespace sulcus {

template <class Real>
struct BenchKernels {
  // Reads `count` numbers (a multiple of 1024) once; returns something that depends on all of them.
  double (*read)(const Real* from, std::int64_t count) = nullptr;
  // Multiplications and additions of whole registers, half and half, independent of each other, not fused;
  // returns the number of operations on single numbers.
  double (*arithmetic)(std::int64_t rounds) = nullptr;
  // Rotations of deformation gradients alone, as element_pass does them. gradients: 9 components in blocks of
  // 16 elements; rotations: [4*count] warm start in, result out; matrices: as gradients. count: multiple
  // of 16.
  void (*rotate)(const Real* gradients, std::int64_t count, double* rotations, Real* matrices) = nullptr;
};

}  // namespace sulcus
