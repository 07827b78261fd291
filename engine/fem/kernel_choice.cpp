#include <cstring>

#include "engine/fem/kernels.h"
#include "engine/fem/rotation.h"

namespace sulcus {

namespace isa_sse2 {
template <class Real>
FemKernels<Real> table();
}
namespace isa_avx2 {
template <class Real>
FemKernels<Real> table();
}
namespace isa_avx512 {
template <class Real>
FemKernels<Real> table();
}

template <class Real>
FemKernels<Real> fem_kernels(Isa isa) {
  return compiled_for(isa, isa_sse2::table<Real>, isa_avx2::table<Real>, isa_avx512::table<Real>)();
}
template FemKernels<float> fem_kernels<float>(Isa);
template FemKernels<double> fem_kernels<double>(Isa);

void detail::polar_rotation_fallback(const double* f, double* q) {
  Mat3 matrix;
  for (int i = 0; i < 9; ++i) matrix(i / 3, i % 3) = f[i];
  const Quaternion r = polar_rotation(matrix, {q[0], q[1], q[2], q[3]});
  q[0] = r.s;
  q[1] = r.x;
  q[2] = r.y;
  q[3] = r.z;
}

}  // namespace sulcus
