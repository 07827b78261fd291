#include "engine/tool/rigid_body.h"

#include <Eigen/LU>

namespace sulcus {

Mat3 world_inertia(const RigidBody& body, const Quaternion& orientation) {
  const Mat3 r = rotation_matrix(orientation);
  return r * body.inertia_kg_m2 * r.transpose();
}

Vec3 linear_velocity(const RigidBody& body, const RigidBodyState& state) {
  return state.linear_momentum / body.mass_kg;
}

Vec3 angular_velocity(const RigidBody& body, const RigidBodyState& state) {
  const Mat3 r = rotation_matrix(state.orientation);
  return r * (body.inertia_kg_m2.inverse() * (r.transpose() * state.angular_momentum));
}

}  // namespace sulcus
