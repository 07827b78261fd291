// Energy, stress and inversion of the elements: what reports and pictures ask for, never the step itself.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/fem/elements.h"

namespace sulcus {

// Elastic energy [J]: sum of V [mu |S - I|^2 + lambda/2 tr^2(S - I)], S = R^T F (equations.md 2.1).
// positions: [3*nodes]; rotations: [4*elements], those of the polar decomposition at these positions; alive:
// [elements] or empty. weights: of the elements' energies, [elements or more] or empty. Summed in fixed
// blocks of elements: the same bits for any number of threads.
// held: the rotations are those of other positions; the energy is then the quadratic form that a step works
// with.
double elastic_energy(const ElementData& elements, std::span<const double> positions,
                      std::span<const double> rotations, std::span<const std::uint8_t> alive, int threads,
                      std::span<const double> weights = {}, bool held = false);

// Largest principal stress of each element [elements], Pa: 2 mu (s_1 - 1) + lambda (s_1 + s_2 + s_3 - 3) from
// the signed stretches s (equations.md 2.4); 0 for removed elements.
std::vector<double> largest_principal_stress(const ElementData& elements, std::span<const Vec3> rest,
                                             std::span<const double> positions,
                                             std::span<const std::uint8_t> alive);

// Elements with det F <= 0.
std::int64_t count_inverted_elements(const ElementData& elements, std::span<const Vec3> rest,
                                     std::span<const double> positions, std::span<const std::uint8_t> alive);

// Deformation gradient of one element.
Mat3 deformation_gradient(const ElementData& elements, std::span<const Vec3> rest,
                          std::span<const double> positions, std::int64_t element);

}  // namespace sulcus
