// Rotations of as many elements at once as a register holds: warm Newton steps of the polar decomposition on
// the quaternion, in lanes, at most two or three. A lane whose step was short is done and stays as it is,
// whatever its neighbours in the register still need; one that they do not bring to a maximum goes to
// polar_rotation (Jacobi SVD). For kernel files only (engine/numerics/lanes.h).
#pragma once

#include <cstdint>

#include "engine/fem/kernels.h"
#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {

// Newton steps on the rotation. About its maximum tr(R^T F) is even, so each cubes the error: a third of the
// step's cube is left. A lane is done after a step below the limit; what is not after all goes to the
// fallback.
template <class Real>
inline constexpr int newton_steps = sizeof(Real) == 4 ? 2 : 3;
template <class Real>
inline constexpr Real largest_step = Real(0.25);  // rad^2, what goes further is left to the fallback
template <class Real>
inline constexpr Real short_step = sizeof(Real) == 4 ? Real(4e-6) : Real(1e-11);  // rad^2

template <class Real>
struct Rotation {
  Lanes<Real> r[9];
};

template <class Real>
SULCUS_INLINE Rotation<Real> matrix_of(const Lanes<Real>* q) {
  const Lanes<Real> s = q[0], x = q[1], y = q[2], z = q[3];
  const Lanes<Real> x2 = x + x, y2 = y + y, z2 = z + z;
  const Lanes<Real> xx = x * x2, yy = y * y2, zz = z * z2;
  const Lanes<Real> xy = x * y2, xz = x * z2, yz = y * z2, sx = s * x2, sy = s * y2, sz = s * z2;
  const Lanes<Real> one = Lanes<Real>{} + Real(1);
  return {{one - (yy + zz), xy - sz, xz + sy, xy + sz, one - (xx + zz), yz - sx, xz - sy, yz + sx,
           one - (xx + yy)}};
}

// 1 / sqrt(square) of what a step makes of a unit quaternion: its square is at most 1 + largest_step / 4. In
// single precision the series about 1 is exact there, and quicker than a root and a division.
template <class Real>
SULCUS_INLINE Lanes<Real> inverse_length(const Lanes<Real>& square) {
  if constexpr (sizeof(Real) == 4) {
    const Lanes<Real> t = square - Real(1);
    const Lanes<Real> series =
        Real(-1.0 / 2) +
        t * (Real(3.0 / 8) + t * (Real(-5.0 / 16) +
                                  t * (Real(35.0 / 128) + t * (Real(-63.0 / 256) + t * Real(231.0 / 1024)))));
    return Real(1) + t * series;
  } else {
    return Real(1) / square_root<Real>(square);
  }
}

// One Newton step of tr(R^T F) for the lanes that are not done. step: |delta|^2 of the last one in, of this
// one out; a huge number where the Hessian is not positive definite.
template <class Real, bool first>
SULCUS_INLINE void newton_step(const Lanes<Real>* f, Lanes<Real>* q, Lanes<Real>& step) {
  using V = Lanes<Real>;
  const Rotation<Real> rot = matrix_of<Real>(q);
  const V* r = rot.r;
  V m[9];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m[3 * i + j] = r[i] * f[j] + r[3 + i] * f[3 + j] + r[6 + i] * f[6 + j];
  }
  const V gx = m[7] - m[5], gy = m[2] - m[6], gz = m[3] - m[1];
  const V hxx = m[4] + m[8], hyy = m[0] + m[8], hzz = m[0] + m[4];
  const Real half = Real(0.5);
  const V hxy = -half * (m[1] + m[3]), hxz = -half * (m[2] + m[6]), hyz = -half * (m[5] + m[7]);
  const V axx = hyy * hzz - hyz * hyz, axy = hxz * hyz - hxy * hzz, axz = hxy * hyz - hxz * hyy;
  const V ayy = hxx * hzz - hxz * hxz, ayz = hxy * hxz - hxx * hyz, azz = hxx * hyy - hxy * hxy;
  const V det = hxx * axx + hxy * axy + hxz * axz;
  const V size = m[0] * m[0] + m[4] * m[4] + m[8] * m[8] + m[1] * m[1] + m[2] * m[2] + m[5] * m[5];
  const V zero{};
  const auto maximum =
      (hxx > zero) & (azz > Real(1e-4) * size) & (det * det > Real(1e-6) * size * size * size) & (det > zero);
  const V by_det = Real(1) / (maximum ? det : zero + Real(1));
  const V dx = (axx * gx + axy * gy + axz * gz) * by_det;
  const V dy = (axy * gx + ayy * gy + ayz * gz) * by_det;
  const V dz = (axz * gx + ayz * gy + azz * gz) * by_det;
  const V length = dx * dx + dy * dy + dz * dz;
  const auto good = maximum & (length < zero + largest_step<Real>);
  const V x = good ? half * dx : zero, y = good ? half * dy : zero, z = good ? half * dz : zero;
  const V s0 = q[0] - q[1] * x - q[2] * y - q[3] * z;
  const V x0 = q[1] + q[0] * x + q[2] * z - q[3] * y;
  const V y0 = q[2] + q[0] * y + q[3] * x - q[1] * z;
  const V z0 = q[3] + q[0] * z + q[1] * y - q[2] * x;
  const V scale = inverse_length<Real>(s0 * s0 + x0 * x0 + y0 * y0 + z0 * z0);
  const V turned[4] = {s0 * scale, x0 * scale, y0 * scale, z0 * scale};
  const V reached = good ? length : zero + Real(1e30);
  if constexpr (first) {
    for (int k = 0; k < 4; ++k) q[k] = turned[k];
    step = reached;
  } else {
    const auto done = step < zero + short_step<Real>;
    for (int k = 0; k < 4; ++k) q[k] = done ? q[k] : turned[k];
    step = done ? step : reached;
  }
}

// `count` numbers (4, 8 or 16) in double precision from memory, and back.
template <class Real, int count>
SULCUS_INLINE typename Vector<Real, count>::Type load_doubles(const double* from) {
  constexpr int at_once = register_bytes == 64 ? 8 : 4;
  if constexpr (count <= at_once) {
    return __builtin_convertvector(load<typename Vector<double, count>::Type>(from),
                                   typename Vector<Real, count>::Type);
  } else {
    const auto low = load_doubles<Real, count / 2>(from),
               high = load_doubles<Real, count / 2>(from + count / 2);
    if constexpr (count == 8) {
      return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
    } else {
      return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }
  }
}

template <int count, class V>
SULCUS_INLINE void store_doubles(const V& v, double* to) {
  constexpr int at_once = register_bytes == 64 ? 8 : 4;
  if constexpr (count <= at_once) {
    store(to, __builtin_convertvector(v, typename Vector<double, count>::Type));
  } else if constexpr (count == 8) {
    store_doubles<4>(__builtin_shufflevector(v, v, 0, 1, 2, 3), to);
    store_doubles<4>(__builtin_shufflevector(v, v, 4, 5, 6, 7), to + 4);
  } else {
    store_doubles<8>(__builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7), to);
    store_doubles<8>(__builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15), to + 8);
  }
}

// Number k of group l to place (lanes / 4) k + l, and back.
template <class V>
SULCUS_INLINE V groups_to_order(const V& v) {
  constexpr int n = sizeof(V) / sizeof(v[0]);
  if constexpr (n == 4) {
    return v;
  } else if constexpr (n == 8) {
    return __builtin_shufflevector(v, v, 0, 4, 1, 5, 2, 6, 3, 7);
  } else {
    return __builtin_shufflevector(v, v, 0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  }
}
template <class V>
SULCUS_INLINE V order_to_groups(const V& v) {
  constexpr int n = sizeof(V) / sizeof(v[0]);
  if constexpr (n == 8) {
    return __builtin_shufflevector(v, v, 0, 2, 4, 6, 1, 3, 5, 7);
  } else {
    return groups_to_order(v);
  }
}

// Quaternions of one register's elements: four doubles an element in memory, one component a vector here.
// count: elements that exist; the lanes behind them repeat the last one and are not stored.
template <class Real>
SULCUS_INLINE void load_quaternions(const double* from, int count, Lanes<Real>* q) {
  constexpr int n = lane_count<Real>;
  if constexpr (n >= 4) {
    if (count == n) {
      for (int k = 0; k < 4; ++k) q[k] = load_doubles<Real, n>(from + n * k);
      transpose_groups(q[0], q[1], q[2], q[3]);
      for (int k = 0; k < 4; ++k) q[k] = groups_to_order(q[k]);
      return;
    }
  }
  for (int l = 0; l < n; ++l) {
    const double* element = from + 4 * (l < count ? l : count - 1);
    for (int k = 0; k < 4; ++k) q[k][l] = static_cast<Real>(element[k]);
  }
}

template <class Real>
SULCUS_INLINE void store_quaternions(const Lanes<Real>* q, int count, double* to) {
  constexpr int n = lane_count<Real>;
  if constexpr (n >= 4) {
    if (count == n) {
      Lanes<Real> rows[4];
      for (int k = 0; k < 4; ++k) rows[k] = order_to_groups(q[k]);
      transpose_groups(rows[0], rows[1], rows[2], rows[3]);
      for (int k = 0; k < 4; ++k) store_doubles<n>(rows[k], to + n * k);
      return;
    }
  }
  for (int l = 0; l < count; ++l) {
    for (int k = 0; k < 4; ++k) to[4 * l + k] = static_cast<double>(q[k][l]);
  }
}

// One register's worth of elements on its way to its rotations.
template <class Real>
struct Turning {
  Lanes<Real> f[9];                     // deformation gradients, row major
  Lanes<Real> q[4];                     // result
  Lanes<Real> step;                     // |last step|^2 of each lane, rad^2
  int count = 0;                        // elements that exist
  double* rotations = nullptr;          // [4*count] warm start in, result out
  const std::uint8_t* alive = nullptr;  // [count] if some are removed: those keep what they have
};
inline constexpr int tile_registers = 4;  // enough to hide the latency of a Newton step behind the others'

// Some lanes did not converge, or are removed: the first through the fallback, from the rotation that they
// started with.
template <class Real>
__attribute__((noinline)) void finish_lanes(Turning<Real>& t) {
  for (int l = 0; l < t.count; ++l) {
    double* rotation = t.rotations + 4 * l;
    if (t.alive != nullptr && !t.alive[l]) {
      for (int k = 0; k < 4; ++k) t.q[k][l] = static_cast<Real>(rotation[k]);
      continue;
    }
    if (t.step[l] < short_step<Real>) {
      for (int k = 0; k < 4; ++k) rotation[k] = static_cast<double>(t.q[k][l]);
      continue;
    }
    double gradient[9];
    for (int k = 0; k < 9; ++k) gradient[k] = static_cast<double>(t.f[k][l]);
    detail::polar_rotation_fallback(gradient, rotation);
    for (int k = 0; k < 4; ++k) t.q[k][l] = static_cast<Real>(rotation[k]);
  }
}

// Rotations of up to tile_registers registers of elements, step by step in turns.
template <class Real>
SULCUS_INLINE void rotate(Turning<Real>* tile, int registers) {
  for (int r = 0; r < registers; ++r) load_quaternions<Real>(tile[r].rotations, tile[r].count, tile[r].q);
  const auto done = [](const Turning<Real>& t) {
    return all_lanes(t.step < Lanes<Real>{} + short_step<Real>);
  };
  for (int r = 0; r < registers; ++r) newton_step<Real, true>(tile[r].f, tile[r].q, tile[r].step);
  for (int i = 1; i < newton_steps<Real>; ++i) {
    for (int r = 0; r < registers; ++r) {
      if (!done(tile[r])) newton_step<Real, false>(tile[r].f, tile[r].q, tile[r].step);
    }
  }
  for (int r = 0; r < registers; ++r) {
    Turning<Real>& t = tile[r];
    if (t.alive == nullptr && done(t)) {
      store_quaternions<Real>(t.q, t.count, t.rotations);
    } else {
      finish_lanes<Real>(t);
    }
  }
}

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
