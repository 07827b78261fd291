// Measures: numbers that a scenario takes from its run to say what it is there to show, each held between
// bounds of its own. Beside the statements, which hold in every run.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "verify/check.h"
#include "verify/recording.h"

namespace sulcus {

// Of one tool, over the steps that end within [from_s, to_s]:
//
//   contact_force_N    largest |force of the tissue on the tool|
//   contacts           most contacts of a step
//   penetration_mm     deepest contact
//   pull_N             largest part of that force against `along`, the way by which the tool leaves the
//                      tissue: what sticks; 0 if the tissue never pulls
//   force_ripple_N     how much the force vibrates: root of the mean square of what it has above above_Hz.
//                      Spectrum of the force less its mean under a Hann window, the three components
//                      together; a sine of amplitude A through the whole window gives A / sqrt(2). The window
//                      fades out the ends, so that neither a step between them nor a slow motion leaks in
//   overshoot_rad      the tool's turn past the device's: largest part of the misalignment against its
//                      direction at the first step where there is one (device turned once, then at rest)
//   settling_s         end of the last step whose misalignment is not below within_rad, plus one step: time
//                      of the run after which it stays below; none if the last step is one
//
// Of the tissue, without a tool:
//
//   least_position_mm  smallest coordinate along `along` of any node at the end of the run: all of the tissue
//                      is beyond
//   opening_mm         largest distance between two nodes that share a place at rest, over the recorded
//   frames
//                      of the window: how wide a fissure is open
//   displacement_mm    largest displacement of a node from rest
//   drift_mm           by how much that varies within the window
//   path_force_N       largest force on the nodes of the path (a motion of the scenario) named `path`
struct Measure {
  std::string what;  // a name from above
  std::string tool;  // a tool's name; empty for measures of the tissue
  std::string path;  // a motion's name, of path_force_N
  double from_s = 0, to_s = std::numeric_limits<double>::infinity();  // s
  double above_Hz = 0;
  double within_rad = 0;
  Vec3 along = Vec3::UnitZ();               // any length > 0
  std::optional<double> at_least, at_most;  // in the unit that the name ends with
};

// One check of kind "statement" for each bound, named "<what>/<tool>", "<what>/<path>" or "<what>". Names
// that are not known, windows without a step and series that are not recorded give failed checks.
std::vector<Check> check_measures(const RunData& run, std::span<const Measure> measures);

}  // namespace sulcus
