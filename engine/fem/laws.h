// Material laws in lanes. For kernel files only (engine/numerics/lanes.h).
//
// A law turns the deformation gradients of an element into a Response, and that is all that the rest of the
// engine learns of it: element_pass (kernels.cpp) makes nodal forces and records of it; edge blocks, matrix,
// preconditioner and solver know nothing but those. A matrix made of responses is symmetric positive
// semidefinite whatever the law, as long as lambda and mu are not negative; the force may be exact while the
// matrix is an approximation of its derivative, as it is for the corotated law.
//
// To add a law:
//   - a value of the enumeration Law (elements.h) and its parameters in Material; build_elements puts V times
//     two moduli into the rest data, further parameters into an array of their own, [padded elements], empty
//     where no element has the law;
//   - a function here that returns a Response, and one for the energy; element_pass calls them for the
//     registers that hold an element of the law and takes its lanes by mask, as it does for plain linear
//     elements;
//   - what an element must remember from step to step (the strain history of a viscoelastic law) is one more
//     array of State beside the rotations, which are the memory of the corotated law.
// Neo-Hookean, energy V [mu/2 (|F|^2 - 3) - mu log J + lambda/2 log^2 J]: stress mu (F - F^-T) + lambda log J
// F^-T, frame F^-T, moduli lambda and max(mu, mu - lambda log J). Viscoelastic with n relaxation times:
// stress of the corotated law plus the remembered stresses, moduli times the sum of their instantaneous
// shares.
#pragma once

#include "engine/fem/rotation_lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {

template <class Real>
struct Response {
  Lanes<Real> stress[9];  // V times the first Piola-Kirchhoff stress P (N m), row major: corner a feels P g_a
  Lanes<Real> frame[9];   // A: gradients of the shape functions in the world, h_a = A g_a
  Lanes<Real> lambda,
      mu;  // V times moduli (N m), >= 0: K_ab = lambda h_a h_b^T + mu (h_b h_a^T + (h_a . h_b) I)
};

// r^T times a gradient, row major.
template <class Real>
SULCUS_INLINE void turn_back(const Rotation<Real>& rotation, const Lanes<Real>* gradient, Lanes<Real>* m) {
  const Lanes<Real>* r = rotation.r;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j)
      m[3 * i + j] = r[i] * gradient[j] + r[3 + i] * gradient[3 + j] + r[6 + i] * gradient[6 + j];
  }
}

// Energy V [mu |S - I|^2 + lambda/2 tr^2(S - I)] with the symmetric part S of R^T F. f: row major F.
template <class Real>
SULCUS_INLINE Lanes<Real> corotated_energy(const Rotation<Real>& rotation, const Lanes<Real>* f,
                                           const Lanes<Real>& lambda, const Lanes<Real>& mu) {
  using V = Lanes<Real>;
  V m[9];
  turn_back<Real>(rotation, f, m);
  const V exx = m[0] - Real(1), eyy = m[4] - Real(1), ezz = m[8] - Real(1), trace = exx + eyy + ezz;
  const V xy = m[1] + m[3], xz = m[2] + m[6], yz = m[5] + m[7];
  return mu * (exx * exx + eyy * eyy + ezz * ezz + Real(0.5) * (xy * xy + xz * xz + yz * yz)) +
         Real(0.5) * lambda * trace * trace;
}

// Linear elasticity in the frame of the rotation r of x: e = sym(r^T y) - I, P = r (lambda tr(e) I + 2 mu e)
// (equations.md 2.1). With r = I it is plain linear elasticity. y: gradient of the positions that the force
// is wanted at.
template <class Real>
SULCUS_INLINE Response<Real> corotated_law(const Rotation<Real>& rotation, const Lanes<Real>* y,
                                           const Lanes<Real>& lambda, const Lanes<Real>& mu) {
  using V = Lanes<Real>;
  const V* r = rotation.r;
  V m[9];
  turn_back<Real>(rotation, y, m);
  const V exx = m[0] - Real(1), eyy = m[4] - Real(1), ezz = m[8] - Real(1);
  const V pressure = lambda * (exx + eyy + ezz);
  const V mu2 = mu + mu;
  const V sxx = pressure + mu2 * exx, syy = pressure + mu2 * eyy, szz = pressure + mu2 * ezz;
  const V sxy = mu * (m[1] + m[3]), sxz = mu * (m[2] + m[6]), syz = mu * (m[5] + m[7]);
  Response<Real> response;
  for (int i = 0; i < 3; ++i) {
    V* p = response.stress + 3 * i;
    p[0] = r[3 * i] * sxx + r[3 * i + 1] * sxy + r[3 * i + 2] * sxz;
    p[1] = r[3 * i] * sxy + r[3 * i + 1] * syy + r[3 * i + 2] * syz;
    p[2] = r[3 * i] * sxz + r[3 * i + 1] * syz + r[3 * i + 2] * szz;
  }
  for (int k = 0; k < 9; ++k) response.frame[k] = r[k];
  response.lambda = lambda;
  response.mu = mu;
  return response;
}

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
