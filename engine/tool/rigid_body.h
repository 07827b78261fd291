// A rigid tool: its surface in body axes, its inertia, and its motion.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/numerics/quaternion.h"
#include "engine/numerics/types.h"

namespace sulcus {

// A closed triangle mesh in body axes; the origin is the centre of mass.
struct ToolSurface {
  std::vector<Vec3> vertices;                          // [vertices], m
  std::vector<std::array<std::int32_t, 3>> triangles;  // [triangles], counter-clockwise from outside
};

struct RigidBody {
  double mass_kg = 0.1;                          // kg, > 0
  Mat3 inertia_kg_m2 = Mat3::Identity() * 5e-4;  // kg m^2, body axes, symmetric positive definite
};

struct RigidBodyState {
  Vec3 position = Vec3::Zero();          // m, centre of mass
  Quaternion orientation;                // unit, body -> world
  Vec3 linear_momentum = Vec3::Zero();   // kg m/s
  Vec3 angular_momentum = Vec3::Zero();  // kg m^2/s, world axes, about the centre of mass
};

// World inertia R I_b R^T, linear velocity P/m and angular velocity R I_b^-1 R^T L.
Mat3 world_inertia(const RigidBody& body, const Quaternion& orientation);
Vec3 linear_velocity(const RigidBody& body, const RigidBodyState& state);
Vec3 angular_velocity(const RigidBody& body, const RigidBodyState& state);

}  // namespace sulcus
