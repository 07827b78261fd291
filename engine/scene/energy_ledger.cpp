#include "engine/scene/energy_ledger.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/fem/stress.h"
#include "engine/scene/contact_system.h"

namespace sulcus {
namespace {

double kinetic_energy(const RigidBody& body, const RigidBodyState& state) {
  return 0.5 * (state.linear_momentum.squaredNorm() / body.mass_kg +
                state.angular_momentum.dot(angular_velocity(body, state)));
}

double coupling_energy(const VirtualCoupling& coupling, const RigidBodyState& hand,
                       const RigidBodyState& tool) {
  return 0.5 * (coupling.stiffness_N_m * (hand.position - tool.position).squaredNorm() +
                coupling.rotational_stiffness_N_m_rad *
                    misalignment(hand.orientation, tool.orientation).squaredNorm());
}

double spring_energy(const Scene& scene, const State& state) {
  double energy = 0;
  for (const NodeSpring& spring : scene.settings.springs) {
    const Vec3 stretch = node_vector(state.positions, spring.node) -
                         scene.mesh.rest_positions[static_cast<std::size_t>(spring.node)];
    energy += 0.5 * spring.stiffness_N_m * stretch.squaredNorm();
  }
  return energy;
}

void add_work(double work_J, double& sum_J, EnergyBalance& sums) {
  sum_J += work_J;
  sums.put_in_J += std::fmax(work_J, 0.0);
}

// Second difference of the elastic energy over the step, J: with the rotations held, the energy is a
// quadratic form, and this is h^2 v . K v. weights: [elements] or empty. ahead_J becomes the energy at the
// step's end.
double curvature(const Scene& scene, const State& state, std::span<const double> weights,
                 Workspace& workspace, double& ahead_J) {
  const double h = scene.settings.step_s;
  const auto energy_back = [&](double steps) {
    for (std::size_t i = 0; i < state.positions.size(); ++i)
      workspace.places[i] = state.positions[i] - steps * h * state.velocities[i];
    return elastic_energy(scene.elements, workspace.places, state.rotations, present(scene, state),
                          workspace.threads, weights, true);
  };
  ahead_J = energy_back(0);
  return ahead_J + energy_back(2) - 2 * energy_back(1);
}

void book_tissue(const Scene& scene, const State& state, Workspace& workspace, EnergyLedger& ledger) {
  const double h = scene.settings.step_s;
  EnergyBalance& sums = ledger.sums;
  double gravity_J = 0;
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
    const double mass = scene.elements.node_mass[n];
    const auto node = static_cast<std::int32_t>(n);
    const Vec3 velocity = node_vector(state.velocities, node);
    const double drag = scene.elements.drag_kg_s.empty() ? scene.settings.damping.alpha_1_s * mass
                                                         : scene.elements.drag_kg_s[n];
    sums.integration_loss_J += 0.5 * mass * node_vector(workspace.increments, node).squaredNorm();
    sums.damping_loss_J += h * drag * velocity.squaredNorm();
    gravity_J += h * mass * scene.settings.gravity.dot(velocity);
  }
  for (const NodeForce& load : scene.settings.forces)
    gravity_J += h * load.force_N.dot(node_vector(state.velocities, load.node));
  add_work(gravity_J, sums.gravity_J, sums);
  add_work(workspace.path_work_J, sums.paths_J, sums);
  for (const NodeSpring& spring : scene.settings.springs) {
    const double speed2 = node_vector(state.velocities, spring.node).squaredNorm();
    sums.damping_loss_J += h * spring.damping_N_s_m * speed2;
    sums.integration_loss_J += 0.5 * h * h * spring.stiffness_N_m * speed2;
  }
  double ahead_J = 0, unused = 0;
  const double curved_J = curvature(scene, state, {}, workspace, ahead_J);
  sums.integration_loss_J += 0.5 * curved_J;
  sums.damping_loss_J += scene.elements.beta_s.empty()
                             ? scene.settings.damping.beta_s / h * curved_J
                             : curvature(scene, state, scene.elements.beta_s, workspace, unused) / h;
  ledger.frozen_elastic_J = ahead_J + spring_energy(scene, state);
}

void book_tool(const Scene& scene, const DeviceSample& sample, std::size_t t, const State& state,
               const Workspace& workspace, const ToolReport& report, EnergyLedger& ledger) {
  const double h = scene.settings.step_s;
  const ToolSystem& tool = workspace.tools[t];
  const RigidBody& body = scene.settings.tools[t].body;
  const VirtualCoupling& coupling = scene.settings.tools[t].coupling;
  const RigidBodyState end = tool_state(state, t);
  EnergyBalance& sums = ledger.sums;
  RigidBodyState hand;
  hand.position = sample.position;
  hand.orientation = normalised(sample.orientation);
  const double gained = kinetic_energy(body, end) - kinetic_energy(body, tool.start);
  if (scene.settings.contact.prescribed) {  // the hand leads tool and nodes itself
    double work_J = gained;
    for (const LedNode& led : workspace.led) {
      if (led.tool == static_cast<std::int32_t>(t))
        work_J += h * led.force.dot(node_vector(state.velocities, led.node));
    }
    add_work(work_J, sums.hand_J, sums);
    ledger.hands[t] = hand;
    return;
  }
  const Vec6 velocity = tool.velocity + tool.increment;
  const Vec3 linear = velocity.head<3>(), angular = velocity.tail<3>();
  sums.integration_loss_J += body.mass_kg * linear.dot(tool.increment.head<3>()) +
                             angular.dot(tool.inertia * tool.increment.tail<3>()) - gained;
  ledger.contact_taken_J -= h * h * angular.dot(tool.lever * angular);
  // what the hand does, what of it does not reach the tool, and what the spring keeps of that
  const Vec3 force = -report.coupling_force, torque = -report.coupling_torque;
  const Vec3 hand_way = hand.position - ledger.hands[t].position;
  const Vec3 hand_turn = misalignment(hand.orientation, ledger.hands[t].orientation);
  add_work(force.dot(hand_way) + torque.dot(hand_turn), sums.hand_J, sums);
  const Vec3 stretch = hand_way - h * linear, twist = hand_turn - h * angular;
  const Vec3 hand_velocity = sample.linear_velocity_valid ? sample.linear_velocity : Vec3(Vec3::Zero());
  const Vec3 hand_rotation = sample.angular_velocity_valid ? sample.angular_velocity : Vec3(Vec3::Zero());
  const double damped = coupling.damping_N_s_m * (hand_velocity - linear).dot(stretch) +
                        coupling.rotational_damping_N_m_s_rad * (hand_rotation - angular).dot(twist);
  const double kept =
      coupling_energy(coupling, hand, end) - coupling_energy(coupling, ledger.hands[t], tool.start);
  sums.coupling_loss_J += damped;
  sums.integration_loss_J += force.dot(stretch) + torque.dot(twist) - damped - kept;
  ledger.hands[t] = hand;
}

}  // namespace

void open_step(const Scene& scene, const State& state, const Workspace& workspace, EnergyLedger& ledger) {
  EnergyBalance& sums = ledger.sums;
  if (!ledger.begun) {  // the hands begin where the tools are
    for (std::size_t t = 0; t < ledger.hands.size(); ++t) ledger.hands[t] = tool_state(state, t);
  }
  sums.kinetic_J = 0;
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
    sums.kinetic_J += 0.5 * scene.elements.node_mass[n] *
                      node_vector(state.velocities, static_cast<std::int32_t>(n)).squaredNorm();
  }
  sums.tool_kinetic_J = sums.coupling_J = sums.contact_J = 0;
  for (std::size_t t = 0; t < ledger.hands.size(); ++t) {
    const Tool& tool = scene.settings.tools[t];
    sums.tool_kinetic_J += kinetic_energy(tool.body, tool_state(state, t));
    if (!scene.settings.contact.prescribed)
      sums.coupling_J += coupling_energy(tool.coupling, ledger.hands[t], tool_state(state, t));
  }
  for (const Contact& contact : workspace.contacts) {
    const ContactLaw& law = law_of(scene, contact.tool);
    if (law.prescribed) continue;
    sums.contact_J +=
        0.5 * law.stiffness_N_m * contact.gap.dot(respond(scene, contact).direction * contact.gap);
  }
}

void settle(double elastic_J, EnergyLedger& ledger) {
  EnergyBalance& sums = ledger.sums;
  sums.elastic_J = elastic_J;
  const double stored =
      sums.kinetic_J + sums.elastic_J + sums.tool_kinetic_J + sums.coupling_J + sums.contact_J;
  if (ledger.begun) {
    sums.integration_loss_J += ledger.frozen_elastic_J - elastic_J;
  } else {
    ledger.stored_at_first_J = stored;
    ledger.contact_at_first_J = sums.contact_J;
    ledger.begun = true;
  }
  sums.contact_loss_J = ledger.contact_taken_J - (sums.contact_J - ledger.contact_at_first_J);
  sums.residual_J = sums.hand_J + sums.gravity_J + sums.paths_J - (stored - ledger.stored_at_first_J) -
                    sums.damping_loss_J - sums.coupling_loss_J - sums.contact_loss_J -
                    sums.integration_loss_J - sums.torn_loss_J;
  ledger.balance = sums;
}

void book_contacts(const Scene& scene, const State& state, const Workspace& workspace, EnergyLedger& ledger) {
  for (const Contact& contact : workspace.contacts) {
    ledger.contact_taken_J +=
        scene.settings.step_s *
        contact_force(scene, state, contact, workspace).dot(contact_rate(scene, state, contact, workspace));
  }
}

void book_step(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
               Workspace& workspace, const StepReport& report, EnergyLedger& ledger) {
  book_tissue(scene, state, workspace, ledger);
  for (std::size_t t = 0; t < samples.size(); ++t)
    book_tool(scene, samples[t], t, state, workspace, report.tools[t], ledger);
}

void book_torn(const Scene& scene, const State& state, const Workspace& workspace, double lost_kinetic_J,
               EnergyLedger& ledger) {
  const double left_J = elastic_energy(scene.elements, state.positions, state.rotations,
                                       present(scene, state), workspace.threads, {}, true) +
                        spring_energy(scene, state);
  ledger.sums.torn_loss_J += ledger.frozen_elastic_J - left_J + lost_kinetic_J;
  ledger.frozen_elastic_J = left_J;
}

}  // namespace sulcus
