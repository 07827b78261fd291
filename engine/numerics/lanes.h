// Vectors of the compiler's own (gcc and clang vector extensions), as wide as the instruction set that the
// file is compiled for. Only for kernel files, which are compiled once for each instruction set: they set
// SULCUS_ISA_NAMESPACE and include no templates of other libraries, so that no wide instruction leaks
// elsewhere.
#pragma once

#include <immintrin.h>

#include <cstdint>
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

template <class Real, int count>
struct Vector {
  typedef Real Type __attribute__((vector_size(count * sizeof(Real))));
};

// 4x4 transposes within each group of four lanes: afterwards a holds entry 0 of the four vectors' groups, b
// entry 1, and so on. V: 4, 8 or 16 lanes.
template <class V>
SULCUS_INLINE void transpose_groups(V& a, V& b, V& c, V& d) {
  constexpr int n = sizeof(V) / sizeof(a[0]);
  static_assert(n == 4 || n == 8 || n == 16);
  V ab, ab_high, cd, cd_high;
  if constexpr (n == 4) {
    ab = __builtin_shufflevector(a, b, 0, 4, 1, 5);
    ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
    cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
    cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    a = __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
    b = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
    c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5);
    d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
  } else if constexpr (n == 8) {
    ab = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
    ab_high = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
    cd = __builtin_shufflevector(c, d, 0, 8, 1, 9, 4, 12, 5, 13);
    cd_high = __builtin_shufflevector(c, d, 2, 10, 3, 11, 6, 14, 7, 15);
    a = __builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13);
    b = __builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15);
    c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 8, 9, 4, 5, 12, 13);
    d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 10, 11, 6, 7, 14, 15);
  } else {
    ab = __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
    ab_high = __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
    cd = __builtin_shufflevector(c, d, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
    cd_high = __builtin_shufflevector(c, d, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
    a = __builtin_shufflevector(ab, cd, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
    b = __builtin_shufflevector(ab, cd, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
    c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
    d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
  }
}

// Four numbers each of the places index[0], index[4], index[8], ..., one behind the other: count numbers.
template <class Real, int count>
SULCUS_INLINE typename Vector<Real, count>::Type load_groups(const Real* from, int stride,
                                                             const std::int32_t* index) {
  if constexpr (count == 4) {
    return load<Four<Real>>(from + stride * static_cast<std::int64_t>(index[0]));
  } else {
    const auto low = load_groups<Real, count / 2>(from, stride, index);
    const auto high = load_groups<Real, count / 2>(from, stride, index + count / 2);
    using Both = typename Vector<Real, count>::Type;
    // said in so many words, since compilers make shuffles of registers of what an insertion from memory does
#if defined(__AVX512F__)
    if constexpr (sizeof(Both) == 64)
      return (Both)_mm512_maskz_insertf64x4(0xff, _mm512_castpd256_pd512((__m256d)low), (__m256d)high, 1);
#endif
#if defined(__AVX2__)
    if constexpr (sizeof(Both) == 32)
      return (Both)_mm256_insertf128_ps(_mm256_castps128_ps256((__m128)low), (__m128)high, 1);
#endif
    Both both;
    std::memcpy(&both, &low, sizeof low);
    std::memcpy(reinterpret_cast<char*>(&both) + sizeof low, &high, sizeof high);
    return both;
  }
}

// The four numbers at from + stride * index[lane] for every lane: one load a lane, then transposes.
template <class Real>
SULCUS_INLINE void gather(const Real* from, int stride, const std::int32_t* index, Lanes<Real>& x,
                          Lanes<Real>& y, Lanes<Real>& z, Lanes<Real>& w) {
  constexpr int n = lane_count<Real>;
  if constexpr (n < 4) {
    const Real* a = from + stride * static_cast<std::int64_t>(index[0]);
    const Real* b = from + stride * static_cast<std::int64_t>(index[1]);
    x = Lanes<Real>{a[0], b[0]};
    y = Lanes<Real>{a[1], b[1]};
    z = Lanes<Real>{a[2], b[2]};
    w = Lanes<Real>{a[3], b[3]};
  } else {
    x = load_groups<Real, n>(from, stride, index);
    y = load_groups<Real, n>(from, stride, index + 1);
    z = load_groups<Real, n>(from, stride, index + 2);
    w = load_groups<Real, n>(from, stride, index + 3);
    transpose_groups(x, y, z, w);
  }
}

// The first three of them; reads four.
template <class Real>
SULCUS_INLINE void gather(const Real* from, int stride, const std::int32_t* index, Lanes<Real>& x,
                          Lanes<Real>& y, Lanes<Real>& z) {
  Lanes<Real> fourth;
  gather<Real>(from, stride, index, x, y, z, fourth);
}

// Groups of four lanes: the one from lane l on to place(l).
template <class Real, class Place>
SULCUS_INLINE void store_groups(const Lanes<Real>& v, const Place& place) {
  constexpr int n = lane_count<Real>;
  if constexpr (n == 4) {
    store(place(0), v);
  } else if constexpr (sizeof(Real) == 4) {
#if defined(__AVX512F__)
    const __m256 low = (__m256)__builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7);
    const __m256 high = (__m256)_mm512_maskz_extractf64x4_pd(0xff, (__m512d)v, 1);
    _mm_storeu_ps(place(0), _mm256_castps256_ps128(low));
    _mm_storeu_ps(place(4), _mm256_extractf128_ps(low, 1));
    _mm_storeu_ps(place(8), _mm256_castps256_ps128(high));
    _mm_storeu_ps(place(12), _mm256_extractf128_ps(high, 1));
#elif defined(__AVX2__)
    _mm_storeu_ps(place(0), _mm256_castps256_ps128((__m256)v));
    _mm_storeu_ps(place(4), _mm256_extractf128_ps((__m256)v, 1));
#endif
  } else {
    store(place(0), __builtin_shufflevector(v, v, 0, 1, 2, 3));
    store(place(4), __builtin_shufflevector(v, v, 4, 5, 6, 7));
  }
}

// Four vectors into four neighbouring numbers of each lane: lane l to place(l).
template <class Real, class Place>
SULCUS_INLINE void scatter(Lanes<Real> a, Lanes<Real> b, Lanes<Real> c, Lanes<Real> d, const Place& place) {
  constexpr int n = lane_count<Real>;
  if constexpr (n < 4) {
    for (int l = 0; l < n; ++l) {
      Real* to = place(l);
      to[0] = a[l];
      to[1] = b[l];
      to[2] = c[l];
      to[3] = d[l];
    }
  } else {
    transpose_groups(a, b, c, d);
    store_groups<Real>(a, [&](int l) { return place(l); });
    store_groups<Real>(b, [&](int l) { return place(l + 1); });
    store_groups<Real>(c, [&](int l) { return place(l + 2); });
    store_groups<Real>(d, [&](int l) { return place(l + 3); });
  }
}

// Correctly rounded in every lane (IEEE 754), so each instruction set gives the bits of the plain square
// root; compilers do not find the vector instruction by themselves.
template <class Real>
SULCUS_INLINE Lanes<Real> square_root(const Lanes<Real>& v) {
  if constexpr (sizeof(Real) == 4) {
#if defined(__AVX512F__)
    return (Lanes<Real>)_mm512_maskz_sqrt_ps(0xffff, (__m512)v);
#elif defined(__AVX2__)
    return (Lanes<Real>)_mm256_sqrt_ps((__m256)v);
#else
    return (Lanes<Real>)_mm_sqrt_ps((__m128)v);
#endif
  } else {
#if defined(__AVX512F__)
    return (Lanes<Real>)_mm512_maskz_sqrt_pd(0xff, (__m512d)v);
#elif defined(__AVX2__)
    return (Lanes<Real>)_mm256_sqrt_pd((__m256d)v);
#else
    return (Lanes<Real>)_mm_sqrt_pd((__m128d)v);
#endif
  }
}

// Whether a comparison of two Lanes holds in every lane.
template <class Mask>
SULCUS_INLINE bool all_lanes(const Mask& mask) {
  std::int64_t words[sizeof(Mask) / 8];
  std::memcpy(words, &mask, sizeof mask);
  std::int64_t all = -1;
  for (const std::int64_t word : words) all &= word;
  return all == -1;
}

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
