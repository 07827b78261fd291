#include "engine/scene/step.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include <Eigen/Geometry>

#include "engine/fem/stress.h"
#include "engine/numerics/error.h"
#include "engine/numerics/float_environment.h"
#include "engine/scene/contact_system.h"

namespace sulcus {

void WorkspaceDeleter::operator()(Workspace* workspace) const {
  delete workspace;
}

namespace {

void find_contacts(const Scene& scene, const State& state, Workspace& workspace) {
  const bool by_nodes = scene.settings.detection == ContactDetection::surface_nodes;
  if (scene.fracture || scene.nodes_touch()) update(scene, state.alive, workspace.view);
  workspace.contacts.clear();
  for (std::size_t t = 0; t < scene.settings.tools.size(); ++t) {
    const RigidBodyState tool = tool_state(state, t);
    if (by_nodes) {
      find_node_contacts(scene.boundary_mesh(), present(scene, state), workspace.view.boundary,
                         state.positions, scene.tool_distances[t], tool, static_cast<std::int32_t>(t),
                         workspace.contacts);
      continue;
    }
    const Mat3 rotation = rotation_matrix(tool.orientation);
    const auto& vertices = scene.settings.tools[t].surface.vertices;
    workspace.vertices.resize(vertices.size());
    for (std::size_t v = 0; v < vertices.size(); ++v)
      workspace.vertices[v] = tool.position + rotation * vertices[v];
    find_embedded_contacts(scene.settings.map, scene.settings.pairs, *scene.distance, scene.mesh,
                           state.positions, {}, static_cast<std::int32_t>(t), workspace.vertices,
                           tool.position, workspace.search, workspace.contacts);
  }
  for (std::size_t o = 0; o < scene.settings.obstacles.size(); ++o) {
    RigidBodyState pose;
    pose.position = scene.settings.obstacles[o].position;
    pose.orientation = scene.settings.obstacles[o].orientation;
    find_node_contacts(scene.boundary_mesh(), present(scene, state), workspace.view.boundary, state.positions,
                       scene.obstacle_distances[o], pose,
                       static_cast<std::int32_t>(scene.settings.tools.size() + o), workspace.contacts,
                       WayOut::shortest);
  }
  begin_friction(scene, state, workspace);
}

// Calls visit(the report of the tool or obstacle that a contact is with).
template <class Visit>
void with_body(StepReport& report, const Contact& contact, Visit&& visit) {
  const auto body = static_cast<std::size_t>(contact.tool), tools = report.tools.size();
  if (body < tools) {
    visit(report.tools[body]);
  } else {
    visit(report.obstacles[body - tools]);
  }
}

// Drops the contacts that would pull; returns whether any did.
bool drop_pulling_contacts(const Scene& scene, const State& state, Workspace& workspace, StepReport& report) {
  const auto pulls = [&](const Contact& contact) {
    if (!law_of(scene, contact.tool).tension_rule) return false;
    if (!(contact_force(scene, state, contact, workspace).dot(contact.normal) > 0)) return false;
    with_body(report, contact, [](auto& body) { ++body.dropped_contacts; });
    return true;
  };
  const auto end = std::remove_if(workspace.contacts.begin(), workspace.contacts.end(), pulls);
  const bool any = end != workspace.contacts.end();
  workspace.contacts.erase(end, workspace.contacts.end());
  return any;
}

void report_contacts(const Scene& scene, const State& state, const Workspace& workspace, StepReport& report) {
  for (const Contact& contact : workspace.contacts) {
    const Vec3 force = contact_force(scene, state, contact, workspace);
    const auto number = static_cast<std::size_t>(contact.tool);
    if (number >= report.tools.size()) {
      ObstacleReport& obstacle = report.obstacles[number - report.tools.size()];
      obstacle.contact_force -= force;
      ++obstacle.contacts;
      continue;
    }
    ToolReport& tool = report.tools[number];
    tool.contact_torque -= contact.arm.cross(force);
    for (double weight : contact.weights) tool.tissue_force += weight * force;
    const double push = -force.dot(contact.normal);
    tool.min_push_N = tool.contacts == 0 ? push : std::fmin(tool.min_push_N, push);
    ++tool.contacts;
  }
}

void report_elastic_energy(const Scene& scene, const State& state, int threads, StepReport& report) {
  report.elastic_energy_J =
      elastic_energy(scene.elements, state.positions, state.rotations, present(scene, state), threads);
  for (const NodeSpring& spring : scene.settings.springs) {
    const Vec3 stretch = node_vector(state.positions, spring.node) -
                         scene.mesh.rest_positions[static_cast<std::size_t>(spring.node)];
    report.elastic_energy_J += 0.5 * spring.stiffness_N_m * stretch.squaredNorm();
  }
}

void report_kinetic_energy(const Scene& scene, const State& state, StepReport& report) {
  report.kinetic_energy_J = 0;
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
    report.kinetic_energy_J += 0.5 * scene.elements.node_mass[n] *
                               node_vector(state.velocities, static_cast<std::int32_t>(n)).squaredNorm();
  }
}

// x += h v and the like; returns whether all is finite.
bool update_tissue(const Scene& scene, const Workspace& workspace, State& state) {
  const double h = scene.settings.step_s;
  const std::size_t count = state.positions.size();
  bool finite = true;
  for (std::size_t i = 0; i < count; ++i) {
    state.velocities[i] += workspace.increments[i];
    state.positions[i] += h * state.velocities[i];
    finite = finite && std::isfinite(state.positions[i]);
  }
  return finite;
}

bool update_tool(const Scene& scene, const DeviceSample& sample, std::size_t t, const Workspace& workspace,
                 State& state, ToolReport& report) {
  const double h = scene.settings.step_s;
  const VirtualCoupling& coupling = scene.settings.tools[t].coupling;
  const ToolSystem& tool = workspace.tools[t];
  const Vec6 velocity = tool.velocity + tool.increment;
  const Vec3 linear = velocity.head<3>();
  const Vec3 angular = velocity.tail<3>();
  const Vec3 position = tool.start.position + h * linear;
  const Quaternion orientation =
      normalised(quaternion_from_rotation_vector(h * angular) * tool.start.orientation);
  const Vec3 linear_momentum = scene.settings.tools[t].body.mass_kg * linear;
  const Vec3 angular_momentum = tool.inertia * angular;

  double* pose = &state.tool_poses[7 * t];
  double* momentum = &state.tool_momenta[6 * t];
  double* filtered = &state.filtered_forces[6 * t];
  const double numbers[7] = {position[0],   position[1],   position[2],  orientation.s,
                             orientation.x, orientation.y, orientation.z};
  std::copy(numbers, numbers + 7, pose);
  const Vec3 hand_velocity = sample.linear_velocity_valid ? sample.linear_velocity : Vec3(Vec3::Zero());
  const Vec3 hand_rotation = sample.angular_velocity_valid ? sample.angular_velocity : Vec3(Vec3::Zero());
  report.coupling_force = -(coupling.stiffness_N_m * (sample.position - position) +
                            coupling.damping_N_s_m * (hand_velocity - linear));
  report.coupling_torque =
      -(coupling.rotational_stiffness_N_m_rad * (tool.misalignment - h * (tool.stiffness * angular)) +
        coupling.rotational_damping_N_m_s_rad * (hand_rotation - angular));
  // from the tool's balance of momentum, not from the law of contact: the tissue's side comes from that
  if (report.contacts > 0) {
    report.contact_force = (linear_momentum - tool.start.linear_momentum) / h + report.coupling_force;
  }
  bool finite = true;
  for (int d = 0; d < 3; ++d) {
    momentum[d] = linear_momentum[d];
    momentum[3 + d] = angular_momentum[d];
    filtered[d] += scene.filter_alpha[t] * (report.coupling_force[d] - filtered[d]);
    filtered[3 + d] += scene.filter_alpha[t] * (report.coupling_torque[d] - filtered[3 + d]);
    report.displayed_force[d] = filtered[d];
    report.displayed_torque[d] = filtered[3 + d];
    finite =
        finite && std::isfinite(position[d]) && std::isfinite(momentum[d]) && std::isfinite(momentum[3 + d]);
  }
  return finite;
}

// Removes what tears. Nodes that no element holds any more stay where they are.
void tear_tissue(const Scene& scene, State& state, Workspace& workspace, StepReport& report) {
  report.fracture =
      tear(scene.elements, *scene.fracture, *scene.settings.fracture, scene.stars(),
           scene.mesh.rest_positions, state.positions, state.alive, state.steps_above, workspace.fracture);
  for (std::int32_t element : workspace.fracture.removed) {
    for (std::int32_t node : scene.mesh.tets[static_cast<std::size_t>(element)]) {
      if (!is_orphan(scene, state.alive, node)) continue;
      const auto n = static_cast<std::size_t>(node);
      for (std::size_t d = 0; d < 3; ++d) state.velocities[3 * n + d] = 0;
    }
  }
}

template <class Real>
void step_in(const Scene& scene, std::span<const DeviceSample> samples, State& state, StepReport& report,
             Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer) {
  find_contacts(scene, state, workspace);
  for (ToolReport& tool : report.tools) tool = ToolReport{};
  for (ObstacleReport& obstacle : report.obstacles) obstacle = ObstacleReport{};
  for (const Contact& contact : workspace.contacts) {
    with_body(report, contact, [&](auto& body) {
      body.max_penetration_m = std::fmax(body.max_penetration_m, contact.depth_m);
    });
  }
  if (observer != nullptr) observer->stage_done(Stage::contacts);

  const SolverSettings& settings = scene.settings.solver;
  SolveResult result = assemble_and_solve(scene, samples, state, numbers, workspace, observer,
                                          settings.tolerance, settings.velocity_floor_m_s);
  report.iterations = result.iterations;
  const auto must_solve_again = [&] {
    const bool dropped = drop_pulling_contacts(scene, state, workspace, report);
    return correct_friction(scene, state, workspace) || dropped;
  };
  constexpr int most_solves_again =
      4;  // what still pulls then is smaller by orders: the report's min_push tells
  for (int again = 0; again < most_solves_again && scene.solves_again() && must_solve_again(); ++again) {
    result = assemble_and_solve(scene, samples, state, numbers, workspace, observer, settings.tolerance,
                                settings.velocity_floor_m_s, true);
    report.iterations += result.iterations;
  }
  report.residual = result.residual;
  report.converged = result.converged;

  report_contacts(scene, state, workspace, report);
  if (scene.settings.energies) report_elastic_energy(scene, state, workspace.threads, report);
  report.finite = update_tissue(scene, workspace, state) && !result.broken;
  if (scene.settings.energies) report_kinetic_energy(scene, state, report);
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    report.finite = update_tool(scene, samples[t], t, workspace, state, report.tools[t]) && report.finite;
  }
  report.step = state.step;
  ++state.step;
  report.time_s = static_cast<double>(state.step) * scene.settings.step_s;
  std::copy(workspace.motion_forces.begin(), workspace.motion_forces.end(), report.motion_forces.begin());
  if (observer != nullptr) observer->stage_done(Stage::update);
  if (scene.fracture) {
    tear_tissue(scene, state, workspace, report);
    if (observer != nullptr) observer->stage_done(Stage::fracture);
  }
}

}  // namespace

WorkspacePtr make_workspace(const Scene& scene, int threads, Isa isa) {
  assert(threads >= 1);
  if (!default_float_environment()) {
    throw EnvironmentError(
        "processor: its floating-point unit does not round to nearest or drops subnormal numbers (MXCSR); "
        "results "
        "would not be repeatable; a library built with -ffast-math does that: find it and leave it out");
  }
  WorkspacePtr workspace(new Workspace);
  workspace->threads = threads;
  if (scene.settings.solver.precision == Precision::single_precision) {
    workspace->single = make_numbers<float>(scene, threads, isa);
  } else {
    workspace->twice = make_numbers<double>(scene, threads, isa);
  }
  const std::size_t nodes = scene.mesh.rest_positions.size();
  workspace->forces.assign(3 * nodes, 0.0);
  workspace->increments.assign(3 * nodes, 0.0);
  workspace->tools.resize(scene.settings.tools.size());
  workspace->motion_forces.assign(scene.settings.motions.size(), Vec3::Zero());
  if (scene.fracture)
    workspace->fracture = make_fracture_scratch(scene.elements, scene.stars(), isa, threads);
  workspace->contacts.reserve(most_contacts(scene));
  if (!scene.settings.tools.empty()) {
    workspace->row_of_node.assign(nodes, -1);
    workspace->touched.reserve(nodes);
  }
  if (scene.distance) {
    std::size_t most = 0;
    for (const Tool& tool : scene.settings.tools) most = std::max(most, tool.surface.vertices.size());
    workspace->vertices.reserve(most);
    workspace->search.found.reserve(most);
    workspace->search.candidates.reserve(scene.mesh.tets.size());
    workspace->search.cell_items.reserve(8 * scene.mesh.tets.size());
    workspace->search.cell_start.reserve(16 * 16 * 16 + 1);
  }
  return workspace;
}

StepReport make_report(const Scene& scene) {
  StepReport report;
  report.tools.resize(scene.settings.tools.size());
  report.obstacles.resize(scene.settings.obstacles.size());
  report.motion_forces.assign(scene.settings.motions.size(), Vec3::Zero());
  if (scene.fracture) report.fracture.emplace();
  return report;
}

void step(const Scene& scene, std::span<const DeviceSample> samples, State& state, StepReport& report,
          Workspace& workspace, StageObserver* observer) {
  assert(default_float_environment());
  assert(samples.size() == scene.settings.tools.size() && report.tools.size() == samples.size());
  if (workspace.single) {
    step_in(scene, samples, state, report, *workspace.single, workspace, observer);
  } else {
    step_in(scene, samples, state, report, *workspace.twice, workspace, observer);
  }
}

double measure_solver_error(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                            int threads) {
  State copy = state;
  WorkspacePtr workspace = make_workspace(scene, threads);
  find_contacts(scene, copy, *workspace);
  // the scene's own solve
  const SolverSettings& settings = scene.settings.solver;
  if (workspace->single) {
    assemble_and_solve(scene, samples, copy, *workspace->single, *workspace, nullptr, settings.tolerance,
                       settings.velocity_floor_m_s);
  } else {
    assemble_and_solve(scene, samples, copy, *workspace->twice, *workspace, nullptr, settings.tolerance,
                       settings.velocity_floor_m_s);
  }
  const std::vector<double> own = workspace->increments;
  // the reference: same contacts, double precision, tight tolerance
  const auto numbers = make_numbers<double>(scene, threads, widest_isa());
  copy = state;
  assemble_and_solve(scene, samples, copy, *numbers, *workspace, nullptr, 1e-10, 0);
  const std::vector<double>& reference = workspace->increments;
  double error = 0, size = 0;
  for (std::size_t i = 0; i < state.positions.size(); ++i) {
    const double difference = own[i] - reference[i];
    error += difference * difference;
    size += reference[i] * reference[i];
  }
  const double rest = static_cast<double>(scene.node_count()) * resting_increment_m_s * resting_increment_m_s;
  return std::sqrt(error / std::max(size, rest));
}

std::vector<double> max_principal_stress(const Scene& scene, const State& state) {
  return largest_principal_stress(scene.elements, scene.mesh.rest_positions, state.positions, state.alive);
}

std::int64_t count_inverted(const Scene& scene, const State& state) {
  return count_inverted_elements(scene.elements, scene.mesh.rest_positions, state.positions, state.alive);
}

}  // namespace sulcus
