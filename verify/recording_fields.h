// The lists of what is recorded of a step, once for writing and reading. Used by recording_*.cpp alone.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include "verify/recording.h"

namespace sulcus {

// Fields of a device sample as the arrays of numbers that stand in the file.
inline std::array<std::uint64_t, 1> to_numbers(std::uint64_t value) {
  return {value};
}
inline std::array<std::int64_t, 1> to_numbers(std::int64_t value) {
  return {value};
}
inline std::array<std::uint32_t, 1> to_numbers(std::uint32_t value) {
  return {value};
}
inline std::array<std::uint8_t, 1> to_numbers(bool value) {
  return {static_cast<std::uint8_t>(value)};
}
inline std::array<double, 1> to_numbers(double value) {
  return {value};
}
inline std::array<double, 3> to_numbers(const Vec3& v) {
  return {v[0], v[1], v[2]};
}
inline std::array<double, 4> to_numbers(const Quaternion& q) {
  return {q.s, q.x, q.y, q.z};
}
inline void from_numbers(const std::uint64_t* numbers, std::uint64_t& value) {
  value = *numbers;
}
inline void from_numbers(const std::int64_t* numbers, std::int64_t& value) {
  value = *numbers;
}
inline void from_numbers(const std::uint32_t* numbers, std::uint32_t& value) {
  value = *numbers;
}
inline void from_numbers(const std::uint8_t* numbers, bool& value) {
  value = *numbers != 0;
}
inline void from_numbers(const double* numbers, double& value) {
  value = *numbers;
}
inline void from_numbers(const double* numbers, Vec3& v) {
  v = {numbers[0], numbers[1], numbers[2]};
}
inline void from_numbers(const double* numbers, Quaternion& q) {
  q = {numbers[0], numbers[1], numbers[2], numbers[3]};
}

// Calls visit(name, unit, member pointer) for every field of DeviceSample.
template <class Visit>
void for_each_sample_field(Visit&& visit) {
  visit("sequence", "", &DeviceSample::sequence);
  visit("time_s", "s", &DeviceSample::time_s);
  visit("interval_s", "s", &DeviceSample::interval_s);
  visit("position_m", "m", &DeviceSample::position);
  visit("orientation", "", &DeviceSample::orientation);
  visit("linear_velocity_m_s", "m/s", &DeviceSample::linear_velocity);
  visit("angular_velocity_rad_s", "rad/s", &DeviceSample::angular_velocity);
  visit("linear_velocity_valid", "", &DeviceSample::linear_velocity_valid);
  visit("angular_velocity_valid", "", &DeviceSample::angular_velocity_valid);
  visit("docked", "", &DeviceSample::docked);
  visit("buttons", "", &DeviceSample::buttons);
  visit("force_sent_N", "N", &DeviceSample::force_sent);
  visit("motor_temperature", "", &DeviceSample::motor_temperature);
}

// Calls visit(name, unit, member pointer) for every field of ServoTick but its sample.
template <class Visit>
void for_each_tick_field(Visit&& visit) {
  visit("number", "", &ServoTick::number);
  visit("tick_time_s", "s", &ServoTick::time_s);
  visit("work_s", "s", &ServoTick::work_s);
  visit("coupling_step", "", &ServoTick::coupling_step);
  visit("error", "", &ServoTick::error);
  visit("force_N", "N", &ServoTick::force);
  visit("torque_N_m", "N m", &ServoTick::torque);
}

// Largest |a - b| over vectors of three; NaN if any is.
inline double largest_distance(std::span<const double> a, std::span<const double> b) {
  double largest = 0;
  for (std::size_t i = 0; i + 2 < a.size(); i += 3) {
    const double dx = a[i] - b[i], dy = a[i + 1] - b[i + 1], dz = a[i + 2] - b[i + 2];
    const double squared = dx * dx + dy * dy + dz * dz;
    if (std::isnan(squared)) return std::numeric_limits<double>::quiet_NaN();
    if (squared > largest) largest = squared;
  }
  return std::sqrt(largest);
}

inline double largest_norm(std::span<const double> a) {
  double largest = 0;
  for (std::size_t i = 0; i + 2 < a.size(); i += 3) {
    const double squared = a[i] * a[i] + a[i + 1] * a[i + 1] + a[i + 2] * a[i + 2];
    if (std::isnan(squared)) return std::numeric_limits<double>::quiet_NaN();
    if (squared > largest) largest = squared;
  }
  return std::sqrt(largest);
}

// Calls visit(name, unit, components, numbers) for every series but the device's, in a fixed order.
template <class Visit>
void for_each_step_series(const StepReport& report, const State& state,
                          std::span<const double> rest_positions, std::span<const double> stage_s,
                          double total_s, Visit&& visit) {
  const auto number = [&](const std::string& name, const char* unit, double value) {
    visit(name, unit, 1, &value);
  };
  const auto vector = [&](const std::string& name, const char* unit, const Vec3& v) {
    visit(name, unit, 3, v.data());
  };

  number("time_s", "s", report.time_s);
  number("finite", "", report.finite);
  number("solver/iterations", "", report.iterations);
  number("solver/residual", "", report.residual);
  number("solver/converged", "", report.converged);
  number("tissue/kinetic_energy_J", "J", report.kinetic_energy_J);
  number("tissue/elastic_energy_J", "J", report.elastic_energy_J);
  number("tissue/max_displacement_m", "m", largest_distance(state.positions, rest_positions));
  number("tissue/max_speed_m_s", "m/s", largest_norm(state.velocities));
  std::int64_t alive = 0;
  for (const std::uint8_t present : state.alive) alive += present;
  number("tissue/alive_tets", "", static_cast<double>(alive));
  if (report.fracture) {
    number("fracture/by_criterion", "", report.fracture->by_criterion);
    number("fracture/by_avoidance", "", report.fracture->by_avoidance);
    number("fracture/detached", "", report.fracture->detached);
    number("fracture/passes", "", report.fracture->passes);
    number("fracture/margin", "", report.fracture->margin);
    number("fracture/lost_volume_m3", "m^3", report.fracture->lost_volume_m3);
  }
  for (std::size_t m = 0; m < report.motion_forces.size(); ++m)
    vector("motions/" + std::to_string(m) + "/force_N", "N", report.motion_forces[m]);
  for (std::size_t stage = 0; stage < stage_count; ++stage)
    number("stage/" + std::string(stage_names[stage]) + "_s", "s", stage_s[stage]);
  number("stage/total_s", "s", total_s);

  for (std::size_t i = 0; i < report.tools.size(); ++i) {
    const ToolReport& tool = report.tools[i];
    const std::string prefix = "tools/" + std::to_string(i) + "/";
    vector(prefix + "contact_force_N", "N", tool.contact_force);
    vector(prefix + "contact_torque_N_m", "N m", tool.contact_torque);
    vector(prefix + "tissue_force_N", "N", tool.tissue_force);
    vector(prefix + "coupling_force_N", "N", tool.coupling_force);
    vector(prefix + "coupling_torque_N_m", "N m", tool.coupling_torque);
    vector(prefix + "displayed_force_N", "N", tool.displayed_force);
    vector(prefix + "displayed_torque_N_m", "N m", tool.displayed_torque);
    number(prefix + "max_penetration_m", "m", tool.max_penetration_m);
    number(prefix + "contacts", "", tool.contacts);
    number(prefix + "dropped_contacts", "", tool.dropped_contacts);
    number(prefix + "min_push_N", "N", tool.min_push_N);
    visit(prefix + "position_m", "m", 3, &state.tool_poses[7 * i]);
    visit(prefix + "orientation", "", 4, &state.tool_poses[7 * i + 3]);
    visit(prefix + "linear_momentum_kg_m_s", "kg m/s", 3, &state.tool_momenta[6 * i]);
    visit(prefix + "angular_momentum_kg_m2_s", "kg m^2/s", 3, &state.tool_momenta[6 * i + 3]);
  }
  for (std::size_t i = 0; i < report.obstacles.size(); ++i) {
    const ObstacleReport& obstacle = report.obstacles[i];
    const std::string prefix = "obstacles/" + std::to_string(i) + "/";
    vector(prefix + "contact_force_N", "N", obstacle.contact_force);
    number(prefix + "max_penetration_m", "m", obstacle.max_penetration_m);
    number(prefix + "contacts", "", obstacle.contacts);
    number(prefix + "dropped_contacts", "", obstacle.dropped_contacts);
  }
}

// Throws InputError if the header contradicts itself.
void check_header(const RunHeader& header, const std::string& place);
// A state whose arrays have the sizes that the header's mesh and tools give.
State sized_state(const RunHeader& header);
// Throws InputError if an array of the state does not have that size.
void check_state_sizes(const State& state, const RunHeader& header, const std::string& place);

}  // namespace sulcus
