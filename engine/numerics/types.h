// Basic types of the engine. SI units everywhere inside the engine (m, kg, s, N, Pa, rad).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

namespace sulcus {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
using Index3 = std::array<int, 3>;  // i, j, k; i runs fastest in memory

}  // namespace sulcus
