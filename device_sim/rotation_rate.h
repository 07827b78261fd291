// Between the time derivative of a rotation vector and the angular velocity: omega = J(r) r', with
// exp(r(t)) the rotation and J the left Jacobian of the exponential.
#pragma once

#include "engine/numerics/types.h"

namespace sulcus {

Vec3 angular_velocity_of(const Vec3& rotation, const Vec3& rotation_rate);  // J r'
Vec3 rotation_rate_of(const Vec3& rotation, const Vec3& angular_velocity);  // J^-1 omega, |r| <= pi

}  // namespace sulcus
