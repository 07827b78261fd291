// Preconditioned conjugate gradients in fixed order: the same bits for any number of threads.
#pragma once

#include <cstdint>

namespace sulcus {

enum class Precision { single_precision, double_precision };
enum class Preconditioner { block_jacobi };

struct SolverSettings {
  Preconditioner preconditioner = Preconditioner::block_jacobi;
  Precision precision = Precision::single_precision;
  double tolerance = 1e-3;   // of |r| / |b| in the norm of the preconditioner, b: right-hand side of the increment
  int max_iterations = 1000;
};

}  // namespace sulcus
