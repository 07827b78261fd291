#include "tools/sulcus/recorded_hand.h"

#include <algorithm>

#include "verify/recording.h"

namespace sulcus {

RecordedTrajectory recorded_hand(const HandFile& file) {
  const RunData run = read_run(file.path);
  const std::string place = file.path.string() + ": ";
  const auto& names = run.header.tool_names;
  const auto found = std::find(names.begin(), names.end(), file.tool);
  if (found == names.end()) {
    std::string known;
    for (const std::string& name : names) known += (known.empty() ? "" : ", ") + name;
    throw InputError(place + "it has no tool \"" + file.tool + "\"; expected one of " + known +
                     " (/tools/.../device/recorded/tool)");
  }
  if (run.steps == 0 || run.frames.empty()) throw InputError(place + "it holds no step");
  const auto tool = static_cast<std::size_t>(found - names.begin());
  const double* pose = &run.frames.front().tool_poses[7 * tool];
  RecordedTrajectory trajectory;
  trajectory.samples.emplace_back();
  trajectory.samples[0].position = {pose[0], pose[1], pose[2]};
  trajectory.samples[0].orientation = {pose[3], pose[4], pose[5], pose[6]};
  trajectory.read_times_s = {0};
  for (std::size_t step = 0; step < static_cast<std::size_t>(run.steps); ++step) {
    trajectory.samples.push_back(run.samples[step * names.size() + tool]);
    trajectory.read_times_s.push_back(static_cast<double>(step + 1) * run.header.step_s);
  }
  return trajectory;
}

}  // namespace sulcus
