#include "tools/sulcus/rerun.h"

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"

namespace sulcus {
namespace {

Scene scene_of(const RunData& run, const std::string& place) {
  Scene scene = make_scene(load_scenario_text(run.header.scenario_json, place, "."));
  if (scene.settings.tools.size() != run.header.tool_names.size() ||
      scene.node_count() != run.header.node_count() || scene.tet_count() != run.header.tet_count()) {
    throw InputError(place +
                     ": the scenario in it gives another mesh or other tools than the recording has; was its "
                     "label map changed?");
  }
  return scene;
}

// The first frame is the state before the first step: where tools and nodes started.
State start_of(const Scene& scene, const RunData& run, const std::string& place) {
  if (run.frames.empty() || run.frames.front().step != 0)
    throw InputError(place + ": it holds no frame of the start, so it cannot be run again");
  std::vector<DeviceSample> start(run.header.tool_names.size());
  for (std::size_t t = 0; t < start.size(); ++t) {
    const double* pose = &run.frames.front().tool_poses[7 * t];
    start[t].position = {pose[0], pose[1], pose[2]};
    start[t].orientation = {pose[3], pose[4], pose[5], pose[6]};
  }
  State state = initial_state(scene, start);
  state.positions = run.frames.front().positions;
  return state;
}

}  // namespace

Rerun::Rerun(const RunData& run, const std::string& place, int threads, bool keep_arrays)
    : run_(run),
      scene_(scene_of(run, place)),
      state_(start_of(scene_, run, place)),
      first_(state_.step),
      workspace_(make_workspace(scene_, threads)),
      report_(make_report(scene_)),
      tree_(*workspace_, keep_arrays) {}

void Rerun::step() {
  const std::size_t tools = run_.header.tool_names.size();
  const std::span<const DeviceSample> samples(run_.samples.data() + static_cast<std::size_t>(done()) * tools,
                                              tools);
  tree_.begin(samples);
  sulcus::step(scene_, samples, state_, report_, *workspace_, &tree_);
}

TreeRow Rerun::row() const {
  std::vector<std::uint64_t> fields(state_field_names().size());
  hash_state(state_, fields);
  return tree_row(done() > 0 ? tree_.hashes() : std::span<const std::uint64_t>(), fields);
}

LeafArray Rerun::array(std::size_t leaf) const {
  return leaf_array(leaf, tree_, state_);
}

std::string describe_leaves(const std::vector<std::size_t>& differing, std::int64_t done,
                            std::int64_t steps) {
  const std::string first = tree_leaf_names().at(differing.at(0));
  const auto slash = first.find('/');
  std::string text = "DIFFERS after " + std::to_string(done) + " of " + std::to_string(steps) +
                     " steps, first in stage " + first.substr(0, slash) + ", field " +
                     first.substr(slash + 1);
  for (std::size_t i = 1; i < differing.size(); ++i)
    text += (i == 1 ? "; then " : ", ") + tree_leaf_names().at(differing[i]);
  return text;
}

}  // namespace sulcus
