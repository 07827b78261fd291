// Keeps the energy ledger of a run (EnergyLedger in step.h). Private to this room.
//
// Each force of the step is multiplied by the way that its place goes in the step. All those works together
// are the change of kinetic energy and what backward Euler loses of it, but for what the solver left over.
#pragma once

#include "engine/scene/system.h"

namespace sulcus {

// What is stored at the start of a step, with the contacts found, none dropped yet.
void open_step(const Scene& scene, const State& state, const Workspace& workspace, EnergyLedger& ledger);

// After the solve, when elastic_J, the elastic energy of the start, is known: the balance of all steps
// before.
void settle(double elastic_J, EnergyLedger& ledger);

// The works of the step's contacts; `state` is still that of its start.
void book_contacts(const Scene& scene, const State& state, const Workspace& workspace, EnergyLedger& ledger);

// All other works; `state` is that of the step's end, its rotations those of the start, nothing torn yet.
void book_step(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
               Workspace& workspace, const StepReport& report, EnergyLedger& ledger);

// After tissue has torn; lost_kinetic_J went with nodes that no element holds any more.
void book_torn(const Scene& scene, const State& state, const Workspace& workspace, double lost_kinetic_J,
               EnergyLedger& ledger);

}  // namespace sulcus
