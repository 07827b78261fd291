// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/fem/kernels.h"

#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

// Newton steps on the rotation: each squares the error; what is left above the limit goes to the fallback.
template <class Real>
inline constexpr int newton_steps = sizeof(Real) == 4 ? 2 : 3;
template <class Real>
inline constexpr Real last_step_limit = sizeof(Real) == 4 ? Real(4e-6) : Real(1e-11);  // rad^2

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

// One Newton step of tr(R^T F); returns |delta|^2, or a huge number where the Hessian is not positive
// definite.
template <class Real>
SULCUS_INLINE Lanes<Real> newton_step(const Lanes<Real>* f, Lanes<Real>* q) {
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
  const V safe_det = maximum ? det : zero + Real(1);
  const V dx = (axx * gx + axy * gy + axz * gz) / safe_det;
  const V dy = (axy * gx + ayy * gy + ayz * gz) / safe_det;
  const V dz = (axz * gx + ayz * gy + azz * gz) / safe_det;
  const V step = dx * dx + dy * dy + dz * dz;
  const auto good = maximum & (step < zero + Real(0.25));
  const V x = good ? half * dx : zero, y = good ? half * dy : zero, z = good ? half * dz : zero;
  const V s0 = q[0] - q[1] * x - q[2] * y - q[3] * z;
  const V x0 = q[1] + q[0] * x + q[2] * z - q[3] * y;
  const V y0 = q[2] + q[0] * y + q[3] * x - q[1] * z;
  const V z0 = q[3] + q[0] * z + q[1] * y - q[2] * x;
  const V length = square_root<Real>(s0 * s0 + x0 * x0 + y0 * y0 + z0 * z0);
  const V scale = Real(1) / length;
  q[0] = s0 * scale;
  q[1] = x0 * scale;
  q[2] = y0 * scale;
  q[3] = z0 * scale;
  return good ? step : zero + Real(1e30);
}

// Gradients of the two displacement fields over the element, plus the identity: F = I + sum_a d_a g_a^T.
template <class Real>
SULCUS_INLINE void gradients(const ElementPass<Real>& pass, const std::int32_t* nodes, const Lanes<Real>* g,
                             Lanes<Real>* f, Lanes<Real>* y) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  alignas(64) Real corner[4][8][n];
  for (int c = 0; c < 4; ++c) {
    if constexpr (n >= 4) {
      for (int l = 0; l < n; l += 4) {
        const Real* from[4];
        for (int k = 0; k < 4; ++k)
          from[k] = pass.node_fields + 8 * static_cast<std::int64_t>(nodes[16 * c + l + k]);
        for (int half = 0; half < 8; half += 4) {
          Four<Real> a = load<Four<Real>>(from[0] + half), b = load<Four<Real>>(from[1] + half);
          Four<Real> d = load<Four<Real>>(from[2] + half), e = load<Four<Real>>(from[3] + half);
          transpose<Real>(a, b, d, e);
          store(&corner[c][half][l], a);
          store(&corner[c][half + 1][l], b);
          store(&corner[c][half + 2][l], d);
        }
      }
    } else {
      for (int l = 0; l < n; ++l) {
        const Real* from = pass.node_fields + 8 * static_cast<std::int64_t>(nodes[16 * c + l]);
        for (int k = 0; k < 8; ++k) corner[c][k][l] = from[k];
      }
    }
  }
  for (int i = 0; i < 3; ++i) {
    const V d0 = load<V>(corner[0][i]), y0 = load<V>(corner[0][4 + i]);
    const V d1 = load<V>(corner[1][i]) - d0, y1 = load<V>(corner[1][4 + i]) - y0;
    const V d2 = load<V>(corner[2][i]) - d0, y2 = load<V>(corner[2][4 + i]) - y0;
    const V d3 = load<V>(corner[3][i]) - d0, y3 = load<V>(corner[3][4 + i]) - y0;
    for (int j = 0; j < 3; ++j) {
      const V identity = V{} + (i == j ? Real(1) : Real(0));
      f[3 * i + j] = identity + (d1 * g[j] + d2 * g[3 + j] + d3 * g[6 + j]);
      y[3 * i + j] = identity + (y1 * g[j] + y2 * g[3 + j] + y3 * g[6 + j]);
    }
  }
}

// Writes 16 numbers an element for the lanes of one register.
template <class Real>
SULCUS_INLINE void store_rows(const Lanes<Real>* columns, Real* rows) {
  constexpr int n = lane_count<Real>;
  if constexpr (n >= 4) {
    alignas(64) Real numbers[16][n];
    for (int k = 0; k < 16; ++k) store(numbers[k], columns[k]);
    for (int l = 0; l < n; l += 4) {
      for (int k = 0; k < 16; k += 4) {
        Four<Real> a = load<Four<Real>>(&numbers[k][l]), b = load<Four<Real>>(&numbers[k + 1][l]);
        Four<Real> c = load<Four<Real>>(&numbers[k + 2][l]), d = load<Four<Real>>(&numbers[k + 3][l]);
        transpose<Real>(a, b, c, d);
        store(rows + 16 * l + k, a);
        store(rows + 16 * (l + 1) + k, b);
        store(rows + 16 * (l + 2) + k, c);
        store(rows + 16 * (l + 3) + k, d);
      }
    }
  } else {
    for (int k = 0; k < 16; ++k) {
      for (int l = 0; l < n; ++l) rows[16 * l + k] = columns[k][l];
    }
  }
}

template <class Real>
void element_pass(const ElementPass<Real>& pass, std::int64_t first_block, std::int64_t last_block) {
  using V = Lanes<Real>;
  constexpr int n = lane_count<Real>;
  for (std::int64_t block = first_block; block < last_block; ++block) {
    for (int part = 0; part < 16; part += n) {
      const std::int64_t first = block * 16 + part;
      if (first >= pass.count && part > 0) break;
      const int valid = pass.count - first < n ? static_cast<int>(pass.count - first) : n;
      const Real* rest = pass.rest + block * 12 * 16 + part;
      V g[9];
      for (int k = 0; k < 9; ++k) g[k] = load<V>(rest + 16 * k);
      V lambda = load<V>(rest + 16 * 9), mu = load<V>(rest + 16 * 10);
      if (pass.alive != nullptr) {
        for (int l = 0; l < valid; ++l) {
          lambda[l] = pass.alive[first + l] ? lambda[l] : Real(0);
          mu[l] = pass.alive[first + l] ? mu[l] : Real(0);
        }
      }

      V f[9], y[9];
      gradients<Real>(pass, pass.nodes + block * 4 * 16 + part, g, f, y);

      V q[4] = {};
      for (int l = 0; l < n; ++l) {
        const double* from = pass.rotations + 4 * (first + (l < valid ? l : valid - 1));
        for (int k = 0; k < 4; ++k) q[k][l] = static_cast<Real>(from[k]);
      }
      V step{};
      for (int i = 0; i < newton_steps<Real>; ++i) step = newton_step<Real>(f, q);
      for (int l = 0; l < valid; ++l) {
        double* to = pass.rotations + 4 * (first + l);
        if (pass.alive != nullptr && !pass.alive[first + l]) {  // removed: no stiffness, so any unit quaternion
          for (int k = 0; k < 4; ++k) q[k][l] = static_cast<Real>(to[k]);
        } else if (step[l] < last_step_limit<Real>) {
          for (int k = 0; k < 4; ++k) to[k] = static_cast<double>(q[k][l]);
        } else {
          double fallback_f[9];
          for (int k = 0; k < 9; ++k) fallback_f[k] = static_cast<double>(f[k][l]);
          detail::polar_rotation_fallback(fallback_f, to);
          for (int k = 0; k < 4; ++k) q[k][l] = static_cast<Real>(to[k]);
        }
      }
      const Rotation<Real> rot = matrix_of<Real>(q);
      const V* r = rot.r;

      // S = lambda tr(e) I + 2 mu e with e = sym(R^T Y) - I, times V; P = R S
      V m[9];
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) m[3 * i + j] = r[i] * y[j] + r[3 + i] * y[3 + j] + r[6 + i] * y[6 + j];
      }
      const V exx = m[0] - Real(1), eyy = m[4] - Real(1), ezz = m[8] - Real(1);
      const V pressure = lambda * (exx + eyy + ezz);
      const V mu2 = mu + mu;
      const V sxx = pressure + mu2 * exx, syy = pressure + mu2 * eyy, szz = pressure + mu2 * ezz;
      const V sxy = mu * (m[1] + m[3]), sxz = mu * (m[2] + m[6]), syz = mu * (m[5] + m[7]);
      V p[9];
      for (int i = 0; i < 3; ++i) {
        p[3 * i] = r[3 * i] * sxx + r[3 * i + 1] * sxy + r[3 * i + 2] * sxz;
        p[3 * i + 1] = r[3 * i] * sxy + r[3 * i + 1] * syy + r[3 * i + 2] * syz;
        p[3 * i + 2] = r[3 * i] * sxz + r[3 * i + 1] * syz + r[3 * i + 2] * szz;
      }

      V record[16] = {}, force[16] = {};
      for (int a = 1; a < 4; ++a) {
        const V* ga = g + 3 * (a - 1);
        for (int i = 0; i < 3; ++i) {
          record[4 * a + i] = r[3 * i] * ga[0] + r[3 * i + 1] * ga[1] + r[3 * i + 2] * ga[2];
          force[4 * a + i] = p[3 * i] * ga[0] + p[3 * i + 1] * ga[1] + p[3 * i + 2] * ga[2];
        }
      }
      for (int i = 0; i < 3; ++i) {
        record[i] = -(record[4 + i] + record[8 + i] + record[12 + i]);
        force[i] = -(force[4 + i] + force[8 + i] + force[12 + i]);
      }
      record[3] = lambda;
      record[7] = mu;
      store_rows<Real>(record, pass.records + 16 * first);
      store_rows<Real>(force, pass.forces + 16 * first);
    }
  }
}

template <class Real>
void edge_pass(const EdgePass<Real>& pass, std::int64_t first_edge, std::int64_t last_edge) {
  using F = Four<Real>;
  for (std::int64_t edge = first_edge; edge < last_edge; ++edge) {
    F row0{}, row1{}, row2{};
    Real trace = 0;
    for (std::int32_t k = pass.edge_start[edge]; k < pass.edge_start[edge + 1]; ++k) {
      const std::int32_t item = pass.edge_items[k];
      const Real* record = pass.records + static_cast<std::int64_t>(item >> 4) * 16;
      const Real lambda = record[3], mu = record[7];
      const F ha = load<F>(record + (item >> 2 & 3) * 4), hb = load<F>(record + (item & 3) * 4);
      const F la = lambda * ha, mb = mu * hb;
      row0 += la[0] * hb + mb[0] * ha;
      row1 += la[1] * hb + mb[1] * ha;
      row2 += la[2] * hb + mb[2] * ha;
      trace += ha[0] * mb[0] + ha[1] * mb[1] + ha[2] * mb[2];
    }
    row0[0] += trace;
    row1[1] += trace;
    row2[2] += trace;
    store(pass.blocks + 12 * edge, pass.scale * row0);
    store(pass.blocks + 12 * edge + 4, pass.scale * row1);
    store(pass.blocks + 12 * edge + 8, pass.scale * row2);
  }
}

// Inverse of the symmetric 3x3 blocks of 16 lanes, by cofactors.
template <class Real>
SULCUS_INLINE void invert_blocks(const Real* d, Real* inverse) {
  using V = Lanes<Real>;
  for (int l = 0; l < 16; l += lane_count<Real>) {
    const V a = load<V>(d + l), b = load<V>(d + 16 + l), c = load<V>(d + 32 + l);
    const V e = load<V>(d + 64 + l), f = load<V>(d + 80 + l), i = load<V>(d + 128 + l);
    const V ca = e * i - f * f, cb = c * f - b * i, cc = b * f - c * e;
    const V det = a * ca + b * cb + c * cc;
    const V scale = Real(1) / det;
    const V ce = (a * i - c * c) * scale, cf = (b * c - a * f) * scale, ci = (a * e - b * b) * scale;
    const V entries[9] = {ca * scale, cb * scale, cc * scale, cb * scale, ce, cf, cc * scale, cf, ci};
    for (int k = 0; k < 9; ++k) store(inverse + 16 * k + l, entries[k]);
  }
}

template <class Real>
void row_pass(const RowPass<Real>& pass, std::int64_t first_chunk, std::int64_t last_chunk) {
  using V = Lanes<Real>;
  static constexpr int straight[9] = {0, 1, 2, 4, 5, 6, 8, 9, 10};
  static constexpr int transposed[9] = {0, 4, 8, 1, 5, 9, 2, 6, 10};
  for (std::int64_t chunk = first_chunk; chunk < last_chunk; ++chunk) {
    const std::int32_t* nodes = pass.node_of_slot + 16 * chunk;
    Real* diagonal = pass.diagonal + 9 * 16 * chunk;
    for (int l = 0; l < 16; ++l) {
      for (int k = 0; k < 9; ++k) {
        diagonal[16 * k + l] = nodes[l] >= 0 ? pass.node_terms[16 * static_cast<std::int64_t>(nodes[l]) + k]
                                             : (k % 4 == 0 ? Real(1) : Real(0));
      }
    }
    for (std::int64_t entry = pass.chunk_start[chunk]; entry < pass.chunk_start[chunk + 1]; ++entry) {
      Real* values = pass.values + 9 * 16 * entry;
      const std::int32_t* block = pass.block + 16 * entry;
      for (int l = 0; l < 16; ++l) {
        if (block[l] >= 0) {
          const Real* from = pass.blocks + 12 * static_cast<std::int64_t>(block[l] >> 1);
          const int* order = block[l] & 1 ? transposed : straight;
          for (int k = 0; k < 9; ++k) values[16 * k + l] = from[order[k]];
        } else {
          for (int k = 0; k < 9; ++k) values[16 * k + l] = Real(0);
        }
      }
      for (int k = 0; k < 9 * 16; k += lane_count<Real>) {
        store(diagonal + k, load<V>(diagonal + k) - load<V>(values + k));
      }
    }
    Real* inverse = pass.inverse + 9 * 16 * chunk;
    invert_blocks(diagonal, inverse);
    for (int l = 0; l < 16; ++l) {
      if (nodes[l] >= 0 && pass.free_node[nodes[l]]) continue;
      for (int k = 0; k < 9; ++k) inverse[16 * k + l] = Real(0);
    }
  }
}

}  // namespace

template <class Real>
FemKernels<Real> table() {
  return {element_pass<Real>, edge_pass<Real>, row_pass<Real>};
}
template FemKernels<float> table<float>();
template FemKernels<double> table<double>();

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
