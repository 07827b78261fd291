#include "tools/sulcus/moment.h"

#include <cmath>

#include "engine/numerics/error.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {
namespace fs = std::filesystem;

fs::path recording_of(const fs::path& path) {
  return fs::is_directory(path) ? path / "run.h5" : path;
}

Scene recorded_scene(const fs::path& recording, const RunData& run) {
  const Scenario scenario = load_scenario_text(run.header.scenario_json, recording.string(), ".");
  Scene scene = make_scene(scenario);
  std::vector<double> rest;
  for (const Vec3& x : scene.mesh.rest_positions) rest.insert(rest.end(), {x[0], x[1], x[2]});
  std::vector<std::int32_t> tets;
  for (const auto& tet : scene.mesh.tets) tets.insert(tets.end(), tet.begin(), tet.end());
  if (rest != run.header.rest_positions || tets != run.header.tets) {
    throw InputError(recording.string() +
                     ": the scenario in it gives another mesh than the recording has; was its label map "
                     "changed?");
  }
  return scene;
}

Moment nearest_moment(const fs::path& recording, const RunData& run, double wanted_s) {
  const double end_s = static_cast<double>(run.steps) * run.header.step_s;
  if (wanted_s < 0) wanted_s = end_s;
  if (!(wanted_s <= end_s + 0.5 * run.header.step_s)) {
    throw InputError(recording.string() + ": --at " + std::to_string(wanted_s) +
                     " lies behind the end of the run; give 0 to " + std::to_string(end_s) + " s");
  }
  Moment moment;
  moment.time_s = end_s;
  moment.state.positions = run.final_state.positions;
  moment.state.alive = run.final_state.alive;
  for (const Frame& frame : run.frames) {
    if (std::fabs(frame.time_s - wanted_s) >= std::fabs(moment.time_s - wanted_s)) continue;
    moment.time_s = frame.time_s;
    moment.state.positions = frame.positions;
    moment.state.alive = frame.alive;
  }
  return moment;
}

}  // namespace sulcus
