// Statements: what has to hold in every run, whatever its golden outputs say. A golden says "changed", a
// statement says "wrong".
#pragma once

#include <optional>
#include <vector>

#include "verify/check.h"
#include "verify/recording.h"

namespace sulcus {

// What has to hold of tissue that tears.
struct TornBounds {
  bool manifold = true;                                    // no singular vertex or edge in any frame
  std::optional<std::int64_t> min_elements, max_elements;  // removed by the end
  std::vector<std::int32_t> labels_stay;                   // whose cells lose no element
  std::optional<std::int64_t> max_hanging_elements;        // in any frame
  std::optional<double> min_hanging_energy_J;              // J, peak over the frames: that they do swing
};

// Bounds of one scenario. A statement whose bound is not given is not made; one that is made and finds
// nothing to compare fails.
struct StatementBounds {
  std::optional<double> max_penetration_m;      // m, of any contact of any tool at any step
  std::optional<double> max_displayed_force_N;  // N, what the device can render
  std::optional<double> max_solver_error;       // relative, of the steps that were measured
  std::optional<double>
      max_final_displacement_m;  // m, of any node from rest at the end, the tools being gone
  std::optional<double> min_converged_share = 1.0;  // share of the steps that met the solver's tolerance
  std::optional<double> max_energy_growth =
      0.01;                        // share of the run's peak energy, see check "energy_at_rest"
  bool contact_expected = true;    // whether a run without any contact is a failure (in scenes with a tool)
  std::optional<TornBounds> torn;  // of scenes that fracture
  std::optional<std::int64_t> pieces_at_start, pieces_at_end;  // of the mesh, exactly
  std::optional<double> max_kinetic_energy_J;  // J, of the tissue at any step
  double rest_speed_m_s = 1e-4;                // m/s, at most: device and tool count as resting
  double rest_spin_rad_s = 1e-2;               // rad/s, likewise
};

// The checks, in this order, kind "statement":
//
//   finite                every recorded number and the final state (stress of frames aside)
//   force_balance         |contact_force + tissue_force| of every step, relative to the largest of both in
//   the run, at
//                         most 5e-6. The first comes from the tool's balance of momentum, the second from the
//                         law of contact, so a fault in the elimination of the tool shows. Basis: the solver
//                         keeps the coupling of tool and tissue in single precision (6e-8 of each of some
//                         hundred terms); on the scenarios of the repository 5e-9 and 6e-8 are seen, in a
//                         thousand random ones 1.8e-6 at most, where damping makes the terms ten times as
//                         large as their sum (180 contacts; 1e-13 in double precision)
//   penetration           max_penetration_m
//   pushing               min_push_N >= 0 at every step with contacts: a kept contact does not pull
//   displayed_force       |displayed_force|
//   pieces                numbers "mesh_pieces" == "voxel_pieces"
//   pieces_at_start       pieces of the recorded mesh that the elements present in the first frame make: as declared
//   pieces_at_end         likewise of the final state
//   inverted_elements     number "inverted_elements_at_end" == 0
//   converged             share of converged steps
//   solver_error          max over solver_errors
//   energy_at_rest        see below
//   energy_ledger         in runs with a ledger: |energy/residual_J| of every step, at most 1e-3 of the most
//   energy
//                         that was put in or stored. Basis: the work of the residual that the solver's
//                         tolerance leaves; 4e-8 to 3e-4 are seen on the scenarios of the repository
//   torn_stays_torn       no element that a frame lacks is present in a later one, nor does the number of
//                         elements present grow from step to step; with `torn`
//   manifold              singular vertices and edges over all frames: none; with torn->manifold
//   torn_elements         number of elements removed by the end; with its bounds
//   labels_stay           elements removed from cells of these labels: none (numbers "torn/label_<n>")
//   hanging_elements      number "hanging/most_elements"; with its bound
//   hanging_energy        number "hanging/peak_kinetic_energy_J" at least; with its bound
//   kinetic_energy        of any step
//   final_displacement    tissue/max_displacement_m of the last step, no tool in contact then
//
// energy_at_rest: E(n) = kinetic energy at the end of step n + elastic energy at the start of step n+1, so
// both of one moment. A step rests if every device and every tool moved since the step before by no more than
// rest_speed * h and turned by no more than rest_spin * h (from the recorded poses, not from the velocities a
// device claims; without tools every step rests). A window is a run of at least 3 resting steps. Within each
// window E may rise above its lowest earlier value in that window by at most max_energy_growth * (peak of E
// over the run), or by 1e-12 J, two kilograms at a micrometre a second: less is what a solver leaves in
// tissue that nobody has touched. The share is not zero because the springs of the contacts and of the
// coupling, which E leaves out, may hand to the tissue what they store; that is to the tissue's energy as the
// tissue's stiffness is to theirs. Energies that grow by themselves grow exponentially and pass any share.
// Does not hold where gravity does work on the tissue: leave its bound empty there.
std::vector<Check> check_statements(const RunData& run, const StatementBounds& bounds);

}  // namespace sulcus
