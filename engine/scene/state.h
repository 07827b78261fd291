// State: plain data, every array of it. What is not in State does not influence the future.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "engine/scene/scene.h"

namespace sulcus {

struct State {
  std::int64_t step = 0;            // steps done
  std::vector<double> positions;    // [3*nodes], m, xyz interleaved
  std::vector<double> velocities;   // [3*nodes], m/s
  std::vector<double> rotations;    // [4*tets], unit quaternions (s,x,y,z) of the elements, rest -> world
  std::vector<std::uint8_t> alive;  // [tets], 1 = present, 0 = removed
  std::vector<std::uint8_t> steps_above;  // [tets], fracture's hysteresis: steps in a row above the threshold
  std::vector<double> tool_poses;         // [7*tools], centre of mass (m) and orientation (s,x,y,z)
  std::vector<double> tool_momenta;       // [6*tools], linear (kg m/s) and angular (kg m^2/s)
  std::vector<double> filtered_forces;    // [6*tools], N and N m, displayed to the hand
  // Of the last two steps, that of step n at n % 2, where a step's solver begins with them (past.h); else
  // empty. [2][3*nodes] change of the velocities, m/s, and what the step's matrix makes of it, N s
  std::vector<double> past_increments, past_impulses;
};

// At rest, or at the scene's start positions; without the singular vertices and edges that the mesh itself
// may have if the scene fractures and avoids them; tools at the poses of their first samples, nothing moving.
State initial_state(const Scene& scene, std::span<const DeviceSample> samples);

// Calls visit(name, span) for every array of the state in a fixed order: "step", "positions", ... The span is
// of std::int64_t, double or std::uint8_t. The one list of fields
// for recording, fingerprint and comparison.
template <class SomeState, class Visit>
void for_each_field(SomeState& state, Visit&& visit) {
  visit(std::string_view("step"), std::span(&state.step, 1));
  visit(std::string_view("positions"), std::span(state.positions));
  visit(std::string_view("velocities"), std::span(state.velocities));
  visit(std::string_view("rotations"), std::span(state.rotations));
  visit(std::string_view("alive"), std::span(state.alive));
  visit(std::string_view("steps_above"), std::span(state.steps_above));
  visit(std::string_view("tool_poses"), std::span(state.tool_poses));
  visit(std::string_view("tool_momenta"), std::span(state.tool_momenta));
  visit(std::string_view("filtered_forces"), std::span(state.filtered_forces));
  visit(std::string_view("past_increments"), std::span(state.past_increments));
  visit(std::string_view("past_impulses"), std::span(state.past_impulses));
}

RigidBodyState tool_state(const State& state, std::size_t tool);

}  // namespace sulcus
