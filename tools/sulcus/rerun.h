// A recorded run, done again by this program from the recorded device samples.
#pragma once

#include <string>

#include "scenarios/loader/scenario.h"
#include "verify/step_tree.h"

namespace sulcus {

class Rerun {
 public:
  // At the recorded start. place: of the recording, for messages. Throws InputError if the scenario in it
  // gives another mesh or other tools than it has.
  Rerun(const RunData& run, const std::string& place, int threads, bool keep_arrays);

  void step();  // the next; only while done() < the run's steps
  std::int64_t done() const { return state_.step - first_; }
  TreeRow row() const;                      // of the last step, at the start of the state alone
  LeafArray array(std::size_t leaf) const;  // likewise; if kept
  const Scene& scene() const { return scene_; }
  const State& state() const { return state_; }

 private:
  const RunData& run_;
  Scene scene_;
  State state_;
  std::int64_t first_ = 0;
  WorkspacePtr workspace_;
  StepReport report_;
  StepTree tree_;
};

// "DIFFERS after 71 of 100 steps, first in stage solve, field positions": then what else differs, in order.
std::string describe_leaves(const std::vector<std::size_t>& differing, std::int64_t done, std::int64_t steps);

}  // namespace sulcus
