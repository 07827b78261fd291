#include "engine/device/servo.h"

#include <algorithm>
#include <cmath>

#include "engine/numerics/elementary.h"

namespace sulcus {
namespace {

constexpr double two_pi = 6.283185307179586;

Vec3 bounded(const Vec3& v, double limit) {
  const double norm = std::sqrt(v.squaredNorm());
  return norm > limit ? Vec3(v * (limit / norm)) : v;
}

bool finite(const Quaternion& q) {
  return std::isfinite(q.s + q.x + q.y + q.z);
}

bool renders(const CouplingSnapshot& c, const DeviceSample& sample, const ServoSettings& settings) {
  return c.valid && sample.time_s - c.time_s <= settings.max_age_s && sample.interval_s >= 0 &&
         std::isfinite(sample.interval_s) && sample.position.allFinite() && finite(sample.orientation) &&
         c.tool_position.allFinite() && finite(c.tool_orientation) && c.tool_linear_velocity.allFinite() &&
         c.tool_angular_velocity.allFinite();
}

}  // namespace

DeviceCommand render(const CouplingSnapshot& coupling, const DeviceSample& sample,
                     const ServoSettings& settings, ServoState& state) {
  DeviceCommand command;
  command.expiry_s = sample.time_s + settings.command_life_s;
  if (!renders(coupling, sample, settings)) {
    state = ServoState();
    return command;
  }

  // The tool, carried on from the engine's last step within the bounds.
  const double ahead_s = std::clamp(sample.time_s - coupling.time_s, 0.0, settings.max_extrapolation_s);
  const Vec3 position =
      coupling.tool_position + bounded(ahead_s * coupling.tool_linear_velocity, settings.max_extrapolation_m);
  const Vec3 turn = bounded(ahead_s * coupling.tool_angular_velocity, settings.max_extrapolation_rad);
  const Quaternion orientation = quaternion_from_rotation_vector(turn) * coupling.tool_orientation;

  // Spring and damper on the hand.
  Vec3 force = coupling.stiffness_N_m * (position - sample.position);
  Vec3 torque =
      coupling.rotational_stiffness_N_m_rad * rotation_vector(orientation * conjugate(sample.orientation));
  if (sample.linear_velocity_valid && sample.linear_velocity.allFinite()) {
    force += coupling.damping_N_s_m * (coupling.tool_linear_velocity - sample.linear_velocity);
  }
  if (sample.angular_velocity_valid && sample.angular_velocity.allFinite()) {
    torque +=
        coupling.rotational_damping_N_m_s_rad * (coupling.tool_angular_velocity - sample.angular_velocity);
  }

  // Output filter with the measured interval.
  const double alpha =
      settings.filter_Hz > 0 ? 1 - det_exp(-two_pi * settings.filter_Hz * sample.interval_s) : 1.0;
  state.force += alpha * (force - state.force);
  state.torque += alpha * (torque - state.torque);
  command.force = state.force;
  command.torque = state.torque;
  return command;
}

}  // namespace sulcus
