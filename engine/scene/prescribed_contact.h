// Contact by prescribed displacement (thesis 3.3.3, equations 3.12-3.14 and 3.24 as corrected): the nodes
// that a tool touches go where the tool takes them, whatever force that takes; the tool gets the reactions.
// Private to this room.
//
// The tool is where its device is, at every step: there is no virtual coupling. A contact asks that its place
// on the tissue end the step touch_m inside the tool's surface at the end of the step (so that a touch
// remains one to the next search). Each node that carries at least a quarter of a contact is led by the mean
// of what its contacts ask: along their normal only (anisotropy 0, the tissue slides), or altogether
// (anisotropy 1, it sticks, as in the thesis). The system stays symmetric and positive definite: a led node
// drops out of it, or its direction does. Nodes that would have to be pulled are let go, and the step is
// solved again.
#pragma once

#include "engine/scene/system.h"

namespace sulcus {

inline constexpr double touch_m = 1e-4;  // m

// Makes workspace.led from the contacts of the tools, and takes these out of workspace.contacts.
void lead_nodes(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                Workspace& workspace);

// Drops out of the matrix what is led, and sets the increments that lead it.
template <class Real>
void impose_led(const Scene& scene, const State& state, Numbers<Real>& numbers, const Workspace& workspace);

// After a solve: workspace.led's forces, from the residual that stays where nodes are led.
template <class Real>
void read_led_forces(const Scene& scene, const Numbers<Real>& numbers, Workspace& workspace);

// Lets go nodes that the tool would pull; returns whether there were any.
bool release_led(const Scene& scene, Workspace& workspace, StepReport& report);

// The tool's report but for what its pose gives: forces of the led nodes, their count.
void report_led(const Workspace& workspace, StepReport& report);

}  // namespace sulcus
