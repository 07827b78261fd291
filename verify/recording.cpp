#include "verify/recording.h"

#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "verify/recording_fields.h"

namespace sulcus {

RunHeader make_run_header(const Scene& scene) {
  RunHeader header;
  header.step_s = scene.settings.step_s;
  for (const Tool& tool : scene.settings.tools) header.tool_names.push_back(tool.name);
  for (const PrescribedMotion& motion : scene.settings.motions) header.motion_names.push_back(motion.name);
  for (const Obstacle& obstacle : scene.settings.obstacles) header.obstacle_names.push_back(obstacle.name);
  header.ledger = scene.settings.ledger;
  header.plane_count = scene.plane_count;
  header.fractures = scene.fracture != nullptr;
  header.rest_positions.reserve(3 * scene.mesh.rest_positions.size());
  for (const Vec3& position : scene.mesh.rest_positions)
    header.rest_positions.insert(header.rest_positions.end(), {position[0], position[1], position[2]});
  header.tets.reserve(4 * scene.mesh.tets.size());
  for (const auto& tet : scene.mesh.tets) header.tets.insert(header.tets.end(), tet.begin(), tet.end());
  return header;
}

const Series* RunData::find(const std::string& name) const {
  const auto found = series.find(name);
  return found == series.end() ? nullptr : &found->second;
}

void check_header(const RunHeader& header, const std::string& place) {
  if (header.rest_positions.size() % 3 != 0 || header.tets.size() % 4 != 0)
    throw InputError(place +
                     ": mesh arrays are not whole nodes and tetrahedra; expected [3*nodes] and [4*tets]");
  for (const std::int32_t node : header.tets)
    if (node < 0 || node >= header.node_count())
      throw InputError(place + ": a tetrahedron names node " + std::to_string(node) + ", but the mesh has " +
                       std::to_string(header.node_count()) + " nodes");
}

namespace {
// Of State::past_increments, as the scenario asks for them.
std::size_t past_numbers(const RunHeader& header) {
  const auto scenario = nlohmann::json::parse(header.scenario_json, nullptr, false);
  const auto start = nlohmann::json::json_pointer("/solver/start");
  const bool past = scenario.is_object() && scenario.contains(start) && scenario[start] == "past";
  return past ? 6 * static_cast<std::size_t>(header.node_count()) : 0;
}
}  // namespace

State sized_state(const RunHeader& header) {
  const auto nodes = static_cast<std::size_t>(header.node_count());
  const auto tets = static_cast<std::size_t>(header.tet_count());
  const auto tools = static_cast<std::size_t>(header.tool_count());
  State state;
  state.positions.resize(3 * nodes);
  state.velocities.resize(3 * nodes);
  state.rotations.resize(4 * tets);
  state.alive.resize(tets);
  state.steps_above.resize(tets);
  state.tool_poses.resize(7 * tools);
  state.tool_momenta.resize(6 * tools);
  state.filtered_forces.resize(6 * tools);
  state.past_increments.resize(past_numbers(header));
  state.past_impulses.resize(state.past_increments.size());
  return state;
}

void check_state_sizes(const State& state, const RunHeader& header, const std::string& place) {
  const auto check = [&](const char* name, std::size_t found, std::int64_t expected) {
    if (found != static_cast<std::size_t>(expected))
      throw InputError(place + ": array " + name + " of the state has " + std::to_string(found) +
                       " numbers, expected " + std::to_string(expected));
  };
  check("positions", state.positions.size(), 3 * header.node_count());
  check("velocities", state.velocities.size(), 3 * header.node_count());
  check("rotations", state.rotations.size(), 4 * header.tet_count());
  check("alive", state.alive.size(), header.tet_count());
  check("steps_above", state.steps_above.size(), header.tet_count());
  check("tool_poses", state.tool_poses.size(), 7 * header.tool_count());
  check("tool_momenta", state.tool_momenta.size(), 6 * header.tool_count());
  check("filtered_forces", state.filtered_forces.size(), 6 * header.tool_count());
  const auto past = static_cast<std::int64_t>(past_numbers(header));
  check("past_increments", state.past_increments.size(), past);
  check("past_impulses", state.past_impulses.size(), past);
}

}  // namespace sulcus
