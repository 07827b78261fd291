// The part of the elastic tangent that the warped stiffness R K0 R^T leaves out: how the forces turn with the
// elements' rotations. With it the matrix is the Hessian of the elastic energy, which need not be positive
// definite (compressed elements); for static problems, never for a step.
#pragma once

#include "engine/fem/assembly.h"

namespace sulcus {

// Adds scale * (Hessian - warped stiffness) to the matrix, before close_rows and after assemble_elements at
// the same positions and with the rotations that it left. For an element with F = R S, stress T = 2 mu (S -
// I) + lambda tr(S - I) I and gradients g_a of the shape functions the block of corners a, b is
//   V/2 R [g_a]x^T C [g_b]x R^T,  C = (tr(T) I - T) (tr(S) I - S)^-1.
// Elements without such a C (inverted or nearly flat) and those of Law::linear get nothing. Cost: one pass
// over the elements, one thread; about ten times that of assemble_elements.
void add_geometric_stiffness(const ElementData& elements, const Sparsity& sparsity,
                             std::span<const Vec3> rest, std::span<const double> positions,
                             std::span<const std::uint8_t> alive, std::span<const double> rotations,
                             double scale, SystemMatrix<double>& system);

}  // namespace sulcus
