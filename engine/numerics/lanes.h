// Vectors of the compiler's own (gcc and clang vector extensions), as wide as the instruction set that the
// file is compiled for. Only for kernel files, which are compiled once for each instruction set: they set
// SULCUS_ISA_NAMESPACE and include no templates of other libraries, so that no wide instruction leaks
// elsewhere.
#pragma once

#include <cstring>

#ifndef SULCUS_ISA_NAMESPACE
#error "lanes.h belongs in kernel files that are compiled for one instruction set"
#endif

namespace sulcus::SULCUS_ISA_NAMESPACE {

#if defined(__AVX512F__)
inline constexpr int register_bytes = 64;
#elif defined(__AVX2__)
inline constexpr int register_bytes = 32;
#else
inline constexpr int register_bytes = 16;
#endif

template <class Real>
struct LaneTypes;
template <>
struct LaneTypes<float> {
  typedef float Lanes __attribute__((vector_size(register_bytes)));
  typedef float Four __attribute__((vector_size(16)));
};
template <>
struct LaneTypes<double> {
  typedef double Lanes __attribute__((vector_size(register_bytes)));
  typedef double Four __attribute__((vector_size(32)));
};
template <class Real>
using Lanes = typename LaneTypes<Real>::Lanes;  // one register
template <class Real>
using Four = typename LaneTypes<Real>::Four;  // four numbers
template <class Real>
inline constexpr int lane_count = register_bytes / static_cast<int>(sizeof(Real));

#define SULCUS_INLINE static inline __attribute__((always_inline))

template <class V, class Real>
SULCUS_INLINE V load(const Real* from) {
  V v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
template <class V, class Real>
SULCUS_INLINE void store(Real* to, const V& v) {
  std::memcpy(to, &v, sizeof v);
}

template <class Real>
SULCUS_INLINE void transpose(Four<Real>& a, Four<Real>& b, Four<Real>& c, Four<Real>& d) {
  const Four<Real> ab_low = __builtin_shufflevector(a, b, 0, 4, 1, 5);
  const Four<Real> ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
  const Four<Real> cd_low = __builtin_shufflevector(c, d, 0, 4, 1, 5);
  const Four<Real> cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  a = __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5);
  b = __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7);
  c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5);
  d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
}

template <class Real>
SULCUS_INLINE Lanes<Real> square_root(const Lanes<Real>& v) {
  constexpr int n = lane_count<Real>;
  alignas(register_bytes) Real numbers[n];
  store(numbers, v);
  for (int l = 0; l < n; ++l) {
    if constexpr (sizeof(Real) == 4) {
      numbers[l] = __builtin_sqrtf(numbers[l]);
    } else {
      numbers[l] = __builtin_sqrt(numbers[l]);
    }
  }
  return load<Lanes<Real>>(numbers);
}

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
