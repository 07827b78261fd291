// Basic types of the engine. SI units everywhere inside the engine (m, kg, s, N, Pa, rad).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>

namespace sulcus {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
using Index3 = std::array<int, 3>;  // i, j, k; i runs fastest in memory

// Entry `node` of an array [3*nodes], xyz interleaved.
inline Vec3 node_vector(std::span<const double> values, std::int32_t node) {
  const auto n = static_cast<std::size_t>(node);
  return {values[3 * n], values[3 * n + 1], values[3 * n + 2]};
}

}  // namespace sulcus
