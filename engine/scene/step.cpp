#include "engine/scene/step.h"

#include <omp.h>

#include <algorithm>
#include <cassert>
#include <cmath>

#include <Eigen/Geometry>

#include "engine/fem/stress.h"
#include "engine/numerics/error.h"
#include "engine/numerics/float_environment.h"
#include "engine/numerics/team.h"
#include "engine/scene/contact_system.h"
#include "engine/scene/energy_ledger.h"
#include "engine/scene/past.h"
#include "engine/scene/precision_error.h"
#include "engine/scene/prescribed_contact.h"
#include "engine/scene/system.h"

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
    const EmbeddedTissue tissue{scene.settings.map, scene.settings.pairs, *scene.distance, scene.mesh,
                                scene.owned_voxels};
    find_embedded_contacts(tissue, state.positions, {}, static_cast<std::int32_t>(t),
                           scene.settings.tools[t].surface.vertices, rotation_matrix(tool.orientation),
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

// Drops the contacts that would pull, in their order into workspace.dropped; returns whether any did.
bool drop_pulling_contacts(const Scene& scene, const State& state, Workspace& workspace, StepReport& report) {
  auto& contacts = workspace.contacts;
  std::size_t kept = 0;
  for (const Contact& contact : contacts) {
    if (law_of(scene, contact.tool).tension_rule &&
        contact_force(scene, state, contact, workspace).dot(contact.normal) > 0) {
      with_body(report, contact, [](auto& body) { ++body.dropped_contacts; });
      workspace.dropped.push_back(contact);
    } else {
      contacts[kept++] = contact;
    }
  }
  const bool any = kept < contacts.size();
  contacts.resize(kept);
  return any;
}

// Takes back those that a rough solution dropped and that would push by the exact one; returns whether any
// would.
bool take_back_pushing_contacts(const Scene& scene, const State& state, Workspace& workspace,
                                StepReport& report) {
  const std::size_t before = workspace.contacts.size();
  for (const Contact& contact : workspace.dropped) {
    if (!(contact_force(scene, state, contact, workspace).dot(contact.normal) < 0)) continue;
    with_body(report, contact, [](auto& body) { --body.dropped_contacts; });
    workspace.contacts.push_back(contact);
  }
  workspace.dropped.clear();
  return workspace.contacts.size() > before;
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

// As the assembly left it, in its precision; the balance of a ledger asks for double.
template <class Real>
void report_elastic_energy(const Scene& scene, const State& state, const SystemMatrix<Real>& system,
                           int threads, StepReport& report) {
  report.elastic_energy_J = 0;
  for (const double block : system.energies) report.elastic_energy_J += block;
  if (scene.settings.ledger)
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

// x += h v and the like; returns whether all is finite. Each thread moves the nodes that it assembles.
bool update_tissue(const Scene& scene, Workspace& workspace, State& state) {
  const double h = scene.settings.step_s;
#pragma omp parallel num_threads(workspace.threads)
  {
    const int thread = omp_get_thread_num();
    const Range nodes = share(scene.node_count(), thread, workspace.threads);
    bool finite = true;
    for (auto i = static_cast<std::size_t>(3 * nodes.first); i < static_cast<std::size_t>(3 * nodes.last);
         ++i) {
      state.velocities[i] += workspace.increments[i];
      state.positions[i] += h * state.velocities[i];
      finite = finite && std::isfinite(state.positions[i]);
    }
    workspace.finite[static_cast<std::size_t>(thread)] = finite;
  }
  return std::ranges::all_of(workspace.finite, [](std::uint8_t finite) { return finite != 0; });
}

void put_tool(const RigidBodyState& body, std::size_t t, State& state) {
  const Quaternion& q = body.orientation;
  const double pose[7] = {body.position[0], body.position[1], body.position[2], q.s, q.x, q.y, q.z};
  std::copy(pose, pose + 7, &state.tool_poses[7 * t]);
  for (int d = 0; d < 3; ++d) {
    state.tool_momenta[6 * t + static_cast<std::size_t>(d)] = body.linear_momentum[d];
    state.tool_momenta[6 * t + 3 + static_cast<std::size_t>(d)] = body.angular_momentum[d];
  }
}

// Brings a vector to a length if it is longer (and there is such a limit); returns whether it was.
bool shorten(Vec3& vector, double longest) {
  const double length = std::sqrt(vector.squaredNorm());
  if (!(longest > 0) || !(length > longest)) return false;
  vector *= longest / length;
  return true;
}

// The force of the tool on the hand to the device; returns whether the tool's state is finite.
bool display(const Scene& scene, const RigidBodyState& body, std::size_t t, State& state,
             ToolReport& report) {
  double* filtered = &state.filtered_forces[6 * t];
  for (int d = 0; d < 3; ++d) {
    filtered[d] += scene.filter_alpha[t] * (report.coupling_force[d] - filtered[d]);
    filtered[3 + d] += scene.filter_alpha[t] * (report.coupling_torque[d] - filtered[3 + d]);
    report.displayed_force[d] = filtered[d];
    report.displayed_torque[d] = filtered[3 + d];
  }
  const bool force = shorten(report.displayed_force, scene.settings.tools[t].max_force_N);
  const bool torque = shorten(report.displayed_torque, scene.settings.tools[t].max_torque_N_m);
  report.force_limited = force || torque;
  return body.position.allFinite() && body.linear_momentum.allFinite() && body.angular_momentum.allFinite();
}

// A tool that leads nodes is where its device is; the hand feels all that the nodes do.
bool lead_tool(const Scene& scene, const DeviceSample& sample, std::size_t t, const Workspace& workspace,
               State& state, ToolReport& report) {
  const double h = scene.settings.step_s;
  const ToolSystem& tool = workspace.tools[t];
  RigidBodyState end;
  end.position = sample.position;
  end.orientation = normalised(sample.orientation);
  end.linear_momentum = scene.settings.tools[t].body.mass_kg / h * (end.position - tool.start.position);
  end.angular_momentum = tool.inertia * misalignment(end.orientation, tool.start.orientation) / h;
  put_tool(end, t, state);
  report.contact_force = -report.tissue_force;
  report.coupling_force = report.contact_force;
  report.coupling_torque = report.contact_torque;
  return display(scene, end, t, state, report);
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

  const RigidBodyState end{position, orientation, linear_momentum, angular_momentum};
  put_tool(end, t, state);
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
  return display(scene, end, t, state, report);
}

// Removes what tears. Nodes that no element holds any more stay where they are.
void tear_tissue(const Scene& scene, State& state, Workspace& workspace, StepReport& report) {
  report.fracture =
      tear(scene.elements, *scene.fracture, *scene.settings.fracture, scene.stars(),
           scene.mesh.rest_positions, state.positions, state.alive, state.steps_above, workspace.fracture);
  double lost_kinetic_J = 0;
  for (std::int32_t element : workspace.fracture.removed) {
    for (std::int32_t node : scene.mesh.tets[static_cast<std::size_t>(element)]) {
      if (!is_orphan(scene, state.alive, node)) continue;
      const auto n = static_cast<std::size_t>(node);
      lost_kinetic_J += 0.5 * scene.elements.node_mass[n] * node_vector(state.velocities, node).squaredNorm();
      for (std::size_t d = 0; d < 3; ++d) state.velocities[3 * n + d] = 0;
    }
  }
  if (report.energy && !workspace.fracture.removed.empty())
    book_torn(scene, state, workspace, lost_kinetic_J, *report.energy);
}

// The samples of the step. Where a device has no finite pose, its tool is led by nobody: to where it is.
void take_samples(const Scene& scene, std::span<const DeviceSample> given, const State& state,
                  Workspace& workspace, StepReport& report) {
  workspace.samples.assign(given.begin(), given.end());
  for (std::size_t t = 0; t < scene.settings.tools.size(); ++t) {
    DeviceSample& sample = workspace.samples[t];
    const Quaternion& q = sample.orientation;
    sample.linear_velocity_valid = sample.linear_velocity_valid && sample.linear_velocity.allFinite();
    sample.angular_velocity_valid = sample.angular_velocity_valid && sample.angular_velocity.allFinite();
    if (sample.position.allFinite() && std::isfinite(q.s + q.x + q.y + q.z)) continue;
    const RigidBodyState tool = tool_state(state, t);
    report.tools[t].sample_refused = true;
    sample.position = tool.position;
    sample.orientation = tool.orientation;
    sample.linear_velocity_valid = sample.angular_velocity_valid = false;
  }
}

// Solves, drops the contacts that pull, and solves again without them. A rough solution tells nearly all that
// pull, so the first solve pauses there to look; what it told wrongly is taken back. Returns false if the
// solver broke down.
template <class Real>
bool solve_for_contacts(const Scene& scene, std::span<const DeviceSample> samples, State& state,
                        StepReport& report, Numbers<Real>& numbers, Workspace& workspace,
                        StageObserver* observer) {
  constexpr double rough_tolerance = 0.03;
  constexpr int most_solves_again =
      8;  // what still pulls then is smaller by orders: the report's min_push tells
  const SolverSettings& settings = scene.settings.solver;
  const bool leads = scene.settings.contact.prescribed;
  const auto must_solve_again = [&](bool rough) {
    const bool released = leads && release_led(scene, workspace, report);
    const bool taken_back = !rough && take_back_pushing_contacts(scene, state, workspace, report);
    const bool dropped = drop_pulling_contacts(scene, state, workspace, report);
    if (!rough) workspace.dropped.clear();
    return correct_friction(scene, state, workspace) || released || taken_back || dropped;
  };
  workspace.dropped.clear();
  const Effort whole{settings.tolerance, settings.velocity_floor_m_s, settings.max_iterations};
  Effort effort = whole;
  if (scene.only_drops_contacts() && !workspace.contacts.empty())
    effort.tolerance = std::fmax(rough_tolerance, whole.tolerance);
  SolveResult result = assemble_and_solve(scene, samples, state, numbers, workspace, observer, effort);
  report.iterations = result.iterations;
  bool rough = effort.tolerance > whole.tolerance;
  for (int again = 0;; rough = false) {
    const bool anew = again < most_solves_again && scene.solves_again() && must_solve_again(rough);
    if (!anew && !rough) break;
    effort = whole;
    if (anew) {
      ++again;
      result = assemble_and_solve(scene, samples, state, numbers, workspace, observer, effort, true);
    } else {
      effort.max_iterations -= result.iterations;
      result = go_on_solving(scene, state, numbers, workspace, observer, effort);
    }
    report.iterations += result.iterations;
  }
  report.residual = result.residual;
  report.converged = result.converged;
  return !result.broken;
}

template <class Real>
void step_in(const Scene& scene, std::span<const DeviceSample> given, State& state, StepReport& report,
             Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer) {
  for (ToolReport& tool : report.tools) tool = ToolReport{};
  take_samples(scene, given, state, workspace, report);
  const std::span<const DeviceSample> samples = workspace.samples;
  find_contacts(scene, state, workspace);
  for (ObstacleReport& obstacle : report.obstacles) obstacle = ObstacleReport{};
  for (const Contact& contact : workspace.contacts) {
    with_body(report, contact, [&](auto& body) {
      body.max_penetration_m = std::fmax(body.max_penetration_m, contact.depth_m);
    });
  }
  if (report.energy) open_step(scene, state, workspace, *report.energy);
  const bool leads = scene.settings.contact.prescribed;
  if (leads) lead_nodes(scene, samples, state, workspace);
  if (observer != nullptr) observer->stage_done(Stage::contacts);

  const bool broken = !solve_for_contacts(scene, samples, state, report, numbers, workspace, observer);
  if (scene.settings.solver.first_guess == FirstGuess::past)
    keep_for_guess(scene, workspace, numbers.solver, state);

  report_contacts(scene, state, workspace, report);
  if (leads) report_led(workspace, report);
  if (scene.settings.energies) report_elastic_energy(scene, state, numbers.system, workspace.threads, report);
  if (report.energy) {
    settle(report.elastic_energy_J, *report.energy);
    book_contacts(scene, state, workspace, *report.energy);
  }
  report.finite = update_tissue(scene, workspace, state) && !broken;
  if (scene.settings.energies) report_kinetic_energy(scene, state, report);
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    const bool finite = leads ? lead_tool(scene, samples[t], t, workspace, state, report.tools[t])
                              : update_tool(scene, samples[t], t, workspace, state, report.tools[t]);
    report.finite = finite && report.finite;
  }
  if (report.energy) book_step(scene, samples, state, workspace, report, *report.energy);
  report.step = state.step;
  ++state.step;
  report.time_s = static_cast<double>(state.step) * scene.settings.step_s;
  std::copy(workspace.motion_forces.begin(), workspace.motion_forces.end(), report.motion_forces.begin());
  std::copy(workspace.plane_forces.begin(), workspace.plane_forces.end(), report.plane_forces.begin());
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
  // below two blocks of 16 nodes a thread waits for the others longer than it works
  threads = std::clamp(static_cast<int>(scene.sparsity.chunks / 2), 1, threads);
  WorkspacePtr workspace(new Workspace);
  workspace->threads = threads;
  const SolverSettings& solver = scene.settings.solver;
  const bool refined = is_refined(solver);
  if (solver.precision == Precision::single_precision && !refined) {
    workspace->single = make_numbers<float>(scene, threads, isa);
  } else {
    workspace->twice = make_numbers<double>(scene, threads, isa, refined);
  }
  const std::size_t nodes = scene.mesh.rest_positions.size();
  workspace->forces.assign(3 * nodes, 0.0);
  workspace->increments.assign(3 * nodes, 0.0);
  workspace->finite.assign(static_cast<std::size_t>(threads), 1);
  workspace->tools.resize(scene.settings.tools.size());
  workspace->motion_forces.assign(scene.settings.motions.size(), Vec3::Zero());
  workspace->plane_forces.assign(scene.plane_count, Vec3::Zero());
  if (scene.fracture)
    workspace->fracture = make_fracture_scratch(scene.elements, scene.stars(), isa, threads);
  workspace->contacts.reserve(most_contacts(scene));
  workspace->dropped.reserve(most_contacts(scene));
  workspace->samples.reserve(scene.settings.tools.size());
  if (!scene.settings.tools.empty()) {
    workspace->row_of_node.assign(nodes, -1);
    workspace->touched.reserve(nodes);
  }
  if (past_size(scene) > 0) workspace->past_products.assign(5 * past_blocks(scene), 0.0);
  if (scene.settings.contact.prescribed) workspace->led.reserve(nodes);
  if (scene.settings.ledger) workspace->places.assign(3 * nodes, 0.0);
  if (scene.distance) {
    std::size_t most = 0;
    for (const Tool& tool : scene.settings.tools) most = std::max(most, tool.surface.vertices.size());
    workspace->search.vertices.reserve(most);
    workspace->search.found.reserve(most);
    workspace->search.touches.reserve(most);
    workspace->search.threads = threads;
    workspace->search.sides.reserve(nodes);
    workspace->search.parts.resize(static_cast<std::size_t>(threads));
    for (auto& part : workspace->search.parts) {
      part.near.reserve(scene.mesh.tets.size() / static_cast<std::size_t>(threads) + 6);
      part.candidates.reserve(scene.mesh.tets.size());
      part.cell_items.reserve(8 * scene.mesh.tets.size());
      part.cell_start.reserve(16 * 16 * 16 + 1);
    }
  }
  return workspace;
}

StepReport make_report(const Scene& scene) {
  StepReport report;
  report.tools.resize(scene.settings.tools.size());
  report.obstacles.resize(scene.settings.obstacles.size());
  report.motion_forces.assign(scene.settings.motions.size(), Vec3::Zero());
  report.plane_forces.assign(scene.plane_count, Vec3::Zero());
  if (scene.fracture) report.fracture.emplace();
  if (scene.settings.ledger) {
    report.energy.emplace();
    report.energy->hands.resize(scene.settings.tools.size());
  }
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

namespace {

// Increments of the velocities in the coming step, with the contacts of its start; the state stays as it is.
template <class Real>
std::vector<double> solve_step(const Scene& scene, std::span<const DeviceSample> samples, State state,
                               int threads, const Effort& effort, bool refined = false) {
  WorkspacePtr workspace = make_workspace(scene, threads);
  find_contacts(scene, state, *workspace);
  if (scene.settings.contact.prescribed) lead_nodes(scene, samples, state, *workspace);
  const auto numbers = make_numbers<Real>(scene, threads, widest_isa(), refined);
  assemble_and_solve(scene, samples, state, *numbers, *workspace, nullptr, effort);
  return workspace->increments;
}

// |found - reference| / max(|reference|, that of a resting body).
double relative_error(const std::vector<double>& found, const std::vector<double>& reference) {
  double error = 0, size = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const double difference = found[i] - reference[i];
    error += difference * difference;
    size += reference[i] * reference[i];
  }
  const double nodes = static_cast<double>(found.size() / 3);
  return std::sqrt(error / std::max(size, nodes * resting_increment_m_s * resting_increment_m_s));
}

constexpr Effort reference{1e-10, 0, 100000};

}  // namespace

double measure_solver_error(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                            int threads) {
  const SolverSettings& settings = scene.settings.solver;
  const Effort effort{settings.tolerance, settings.velocity_floor_m_s, settings.max_iterations};
  const bool refined = is_refined(settings);
  return relative_error(settings.precision == Precision::single_precision && !refined
                            ? solve_step<float>(scene, samples, state, threads, effort)
                            : solve_step<double>(scene, samples, state, threads, effort, refined),
                        solve_step<double>(scene, samples, state, threads, reference));
}

double measure_precision_error(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                               int threads) {
  if (scene.settings.solver.precision == Precision::double_precision) return 0;
  return relative_error(
      solve_step<float>(scene, samples, state, threads, {1e-6, 0, reference.max_iterations}),
      solve_step<double>(scene, samples, state, threads, reference));
}

std::vector<Contact> contacts_in(const Scene& scene, const State& state) {
  const WorkspacePtr workspace = make_workspace(scene, 1);
  find_contacts(scene, state, *workspace);
  return workspace->contacts;
}

std::vector<double> max_principal_stress(const Scene& scene, const State& state) {
  return largest_principal_stress(scene.elements, scene.mesh.rest_positions, state.positions, state.alive);
}

std::int64_t count_inverted(const Scene& scene, const State& state) {
  return count_inverted_elements(scene.elements, scene.mesh.rest_positions, state.positions, state.alive);
}

}  // namespace sulcus
