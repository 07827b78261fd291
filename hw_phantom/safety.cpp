#include "hw_phantom/safety.h"

#include <algorithm>
#include <cmath>

namespace sulcus {
namespace {

constexpr double longest_change_s = 0.002;  // a late tick must not let the force jump

double length(const Vec3& v) {
  return std::sqrt(v.squaredNorm());
}

// 1 up to `from`, 0 from `to` on, straight between.
double fade(double value, double from, double to) {
  if (value <= from) return 1;
  if (value >= to) return 0;
  return (to - value) / (to - from);
}

double distance_outside(const SafetyLimits& limits, const Vec3& position) {
  return length((limits.workspace_min - position).cwiseMax(position - limits.workspace_max).cwiseMax(0.0));
}

bool finite(const SafetyInput& in) {
  return in.force.allFinite() && in.torque.allFinite() && in.position.allFinite() &&
         std::isfinite(in.command_age_s) && std::isfinite(in.interval_s) && std::isfinite(in.speed_m_s) &&
         std::isfinite(in.temperature);
}

// Moves `sent` towards `wanted`, the norm of the change bounded. Both lie in a ball, so all between does.
std::uint32_t follow(const Vec3& wanted, double largest_change, Vec3& sent) {
  const Vec3 change = wanted - sent;
  const double norm = length(change);
  const bool too_fast = norm > largest_change;
  sent = too_fast ? Vec3(sent + change * (largest_change / norm)) : wanted;
  return too_fast ? static_cast<std::uint32_t>(reason_slew) : 0;
}

}  // namespace

std::uint32_t limit_force(const SafetyLimits& limits, const SafetyInput& in, SafetyState& state) {
  // Nothing at all, and a soft start to come.
  std::uint32_t stop = 0;
  if (!in.permitted) stop |= reason_not_permitted;
  if (!in.pose_valid) stop |= reason_pose;
  if (!finite(in)) stop |= reason_not_finite;
  if (in.interval_s > limits.max_interval_s) stop |= reason_stall;
  if (in.pose_valid && in.speed_m_s >= limits.max_speed_m_s) stop |= reason_speed;
  if (stop != 0) {
    state = SafetyState();
    return stop;
  }

  const double interval_s = std::max(in.interval_s, 0.0);
  const double soft_start_step = limits.soft_start_s > 0 ? interval_s / limits.soft_start_s : 1.0;
  state.soft_start = std::min(1.0, state.soft_start + soft_start_step);

  // A share of the command.
  std::uint32_t reasons = 0;
  double share = 1;
  auto reduce = [&](double factor, SafetyReason reason) {
    if (factor < 1) reasons |= reason;
    share *= factor;
  };
  reduce(fade(in.command_age_s, limits.watchdog_s, limits.watchdog_s + limits.decay_s), reason_command_age);
  reduce(fade(distance_outside(limits, in.position), 0, limits.workspace_fade_m), reason_workspace);
  reduce(fade(in.speed_m_s, limits.fade_speed_m_s, limits.max_speed_m_s), reason_speed);
  reduce(fade(in.temperature, limits.fade_temperature, limits.max_temperature), reason_temperature);
  reduce(state.soft_start, reason_soft_start);

  // The bound on the norm shrinks with the share too, so that a large command does not hide the fades.
  const auto scaled = [&](const Vec3& wanted, double largest) {
    const double norm = length(wanted);
    if (norm <= largest) return Vec3(share * wanted);
    reasons |= reason_norm;
    return Vec3(wanted * (share * largest / norm));
  };
  const double change_s = std::min(interval_s, longest_change_s);
  reasons |= follow(scaled(in.force, limits.max_force_N), limits.slew_N_s * change_s, state.force);
  reasons |=
      follow(scaled(in.torque, limits.max_torque_N_m), limits.torque_slew_N_m_s * change_s, state.torque);
  return reasons;
}

}  // namespace sulcus
