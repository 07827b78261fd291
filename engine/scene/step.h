// One time step: backward Euler of tissue and tools as one symmetric positive definite system (equations.md
// 4).
//
//   sample -> contacts -> assembly -> solve -> update, coupling -> fracture
//
// What tears at the end of a step is missing from all that the next one does; the state after the step, and
// so what is recorded and drawn of it, has it removed already.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "engine/device/device.h"
#include "engine/numerics/isa.h"
#include "engine/scene/scene.h"
#include "engine/scene/state.h"

namespace sulcus {

enum class Stage : int { contacts, assembly, solve, update, fracture };
inline constexpr int stage_count = 5;
inline constexpr std::array<const char*, stage_count> stage_names = {"contacts", "assembly", "solve",
                                                                     "update", "fracture"};

// Told when a stage ends; the place for clocks, which the engine itself does not read. Must not throw.
struct StageObserver {
  virtual ~StageObserver() = default;
  virtual void stage_done(Stage stage) = 0;
};

struct ToolReport {
  // N, of the tissue on the tool: by the tool's balance of momentum, or the sum of the led nodes' reactions
  Vec3 contact_force = Vec3::Zero();
  Vec3 contact_torque = Vec3::Zero();   // N m, about the centre of mass
  Vec3 tissue_force = Vec3::Zero();     // N, of the tool on the tissue, by the law of contact, over its nodes
  Vec3 coupling_force = Vec3::Zero();   // N, of the tool on the hand, before the filter
  Vec3 coupling_torque = Vec3::Zero();  // N m
  Vec3 displayed_force = Vec3::Zero();  // N, after the filter and within the device's limits
  Vec3 displayed_torque = Vec3::Zero();
  double max_penetration_m = 0;       // m, of the contacts found at the start of the step
  std::int32_t contacts = 0;          // or led nodes, of contact by prescribed displacement
  std::int32_t dropped_contacts = 0;  // by the tension rule
  bool force_limited = false;         // whether force or torque was beyond the device's limits
  bool sample_refused = false;        // the device gave no finite pose: its hand let go for this step
  double min_push_N = 0;              // N, smallest normal force of a kept contact, > 0 pushes
};

struct ObstacleReport {
  Vec3 contact_force = Vec3::Zero();  // N, of the tissue on the obstacle, by the law of contact
  double max_penetration_m = 0;       // m, of the contacts found at the start of the step
  std::int32_t contacts = 0;
  std::int32_t dropped_contacts = 0;  // by the tension rule
};

// Where the energy of a run is and went, J. What is stored is that of a moment; the rest are sums over all
// steps before it.
struct EnergyBalance {
  double hand_J = 0, gravity_J = 0, paths_J = 0;  // work of hands, gravity and loads, nodes on paths
  double put_in_J = 0;                            // the positive ones of these works, step by step
  double kinetic_J = 0, elastic_J = 0;            // stored in the tissue, incl. springs
  double tool_kinetic_J = 0, coupling_J = 0;      // stored in the tools and in their couplings' springs
  double contact_J = 0;                           // stored in the penalty springs
  double damping_loss_J = 0;                      // Rayleigh damping and that of the boundary's springs
  double coupling_loss_J = 0;                     // damping of the couplings
  double contact_loss_J = 0;      // damping and friction of contacts, their making and breaking
  double integration_loss_J = 0;  // backward Euler, rotations held over a step
  double torn_loss_J = 0;         // with removed elements
  double residual_J = 0;          // put in - change of what is stored - lost: what the solver left over
};

// In a report that is handed from step to step: sums and what they need. balance: at the start of the step.
struct EnergyLedger {
  EnergyBalance balance;
  EnergyBalance sums;  // with the step's own works
  bool begun = false;
  double stored_at_first_J = 0, contact_at_first_J = 0, contact_taken_J = 0, frozen_elastic_J = 0;
  std::vector<RigidBodyState> hands;  // [tools], the devices at the end of the last step
};

struct StepReport {
  std::int64_t step = 0;  // number of the step that was done, from 0
  double time_s = 0;      // s, at the end of the step
  std::int32_t iterations = 0;
  double residual = 0;          // relative, as the solver's tolerance is
  bool converged = false;       // by tolerance; false: stopped by the cap
  bool finite = true;           // all of the new state
  double kinetic_energy_J = 0;  // J, tissue, at the end of the step (0 unless the scene asks for energies)
  double elastic_energy_J = 0;  // J, tissue incl. springs, at the start of the step, likewise
  std::vector<ToolReport> tools;
  std::vector<ObstacleReport> obstacles;
  std::vector<Vec3> motion_forces;         // [motions] N, that the nodes of the path exert on the tissue
  std::vector<Vec3> plane_forces;          // [planes] N, on the nodes that slide on them, across the planes
  std::optional<FractureReport> fracture;  // in scenes that fracture
  // In scenes that ask for it: of all steps since make_report, so the report must go from step to step.
  std::optional<EnergyLedger> energy;
};

// Scratch memory of step(): its content never influences a result.
struct Workspace;
struct WorkspaceDeleter {
  void operator()(Workspace* workspace) const;
};
using WorkspacePtr = std::unique_ptr<Workspace, WorkspaceDeleter>;
// Small meshes get fewer threads. Throws EnvironmentError if the processor does not round as results suppose.
WorkspacePtr make_workspace(const Scene& scene, int threads, Isa isa = widest_isa());

// Advances `state` by scene.settings.step_s. samples: one a tool, the device at the END of the step.
// Neither allocates (after the first step) nor throws. report comes from make_report.
void step(const Scene& scene, std::span<const DeviceSample> samples, State& state, StepReport& report,
          Workspace& workspace, StageObserver* observer = nullptr);
StepReport make_report(const Scene& scene);

// Relative error of the velocity increment that the scene's solver settings leave in the coming step, against
// a solve in double precision to 1e-10: |dv - dv*| / max(|dv*|, sqrt(nodes) * resting_increment_m_s): at
// rest, where dv* is nothing but rounding, a relative error would mean nothing. Leaves the state alone. Slow;
// for reports.
inline constexpr double resting_increment_m_s = 1e-6;  // m/s a step
double measure_solver_error(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                            int threads);

// Largest principal stress of each element [tets], Pa (equations.md 2.4); 0 for removed elements.
std::vector<double> max_principal_stress(const Scene& scene, const State& state);

// The contacts of tools and obstacles that the coming step would begin with, in its order. Slow; for
// pictures.
std::vector<Contact> contacts_in(const Scene& scene, const State& state);

// Elements with det F <= 0 among the alive ones.
std::int64_t count_inverted(const Scene& scene, const State& state);

}  // namespace sulcus
