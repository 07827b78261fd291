#include "engine/scene/state.h"

#include <cassert>

#include "engine/scene/past.h"

namespace sulcus {

State initial_state(const Scene& scene, std::span<const DeviceSample> samples) {
  assert(samples.size() == scene.settings.tools.size());
  State state;
  state.positions.reserve(scene.mesh.rest_positions.size() * 3);
  const std::vector<Vec3>& start = scene.settings.start_positions;
  for (const Vec3& x : start.empty() ? scene.mesh.rest_positions : start) {
    for (int d = 0; d < 3; ++d) state.positions.push_back(x[d]);
  }
  state.velocities.assign(state.positions.size(), 0.0);
  state.rotations.assign(scene.mesh.tets.size() * 4, 0.0);
  for (std::size_t t = 0; t < scene.mesh.tets.size(); ++t) state.rotations[4 * t] = 1;
  state.alive.assign(scene.mesh.tets.size(), 1);
  if (scene.settings.fracture && scene.settings.fracture->avoid_singularities) {
    FractureScratch scratch;
    scratch.star = make_star_scratch(scene.stars());
    clear_singularities(scene.stars(), state.alive, scratch);
  }
  state.steps_above.assign(scene.mesh.tets.size(), 0);
  for (const DeviceSample& sample : samples) {
    const Quaternion q = normalised(sample.orientation);
    for (double value : {sample.position[0], sample.position[1], sample.position[2], q.s, q.x, q.y, q.z}) {
      state.tool_poses.push_back(value);
    }
  }
  state.tool_momenta.assign(samples.size() * 6, 0.0);
  state.filtered_forces.assign(samples.size() * 6, 0.0);
  state.past_increments.assign(past_size(scene), 0.0);
  state.past_impulses.assign(past_size(scene), 0.0);
  return state;
}

RigidBodyState tool_state(const State& state, std::size_t tool) {
  const double* pose = &state.tool_poses[7 * tool];
  const double* momentum = &state.tool_momenta[6 * tool];
  return {{pose[0], pose[1], pose[2]},
          {pose[3], pose[4], pose[5], pose[6]},
          {momentum[0], momentum[1], momentum[2]},
          {momentum[3], momentum[4], momentum[5]}};
}

}  // namespace sulcus
