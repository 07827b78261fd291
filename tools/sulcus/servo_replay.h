// The coupling that the servo renders, taken from the engine's state; and the check that a recorded servo did
// render just that.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "engine/device/servo.h"
#include "engine/scene/state.h"
#include "verify/recording.h"

namespace sulcus {

// After a step that read its samples at read_s [s, session clock].
CouplingSnapshot coupling_of(const Scene& scene, const State& state, std::size_t tool, double read_s);

// The command of a tick; `state` as the tick before left it. After an error there is none.
DeviceCommand servo_command(const CouplingSnapshot& coupling, const ServoTick& tick,
                            const ServoSettings& settings, ServoState& state);

// Goes along with a replay, step by step, and then runs all ticks of the servos again.
class ServoReplay {
 public:
  // Both live longer than this. Does nothing for recordings that are no session.
  ServoReplay(const Scene& scene, const RunData& run) : scene_(scene), run_(run) {}

  void after_step(const State& state);

  struct Outcome {
    std::int64_t ticks = 0;    // compared
    std::int64_t skipped = 0;  // behind a gap in the recording: the filter's state before it is not known
    std::string difference;    // the first one; empty: all the same bits
  };
  Outcome compare() const;

 private:
  const Scene& scene_;
  const RunData& run_;
  std::vector<std::vector<CouplingSnapshot>> couplings_;  // [steps][tools]
};

}  // namespace sulcus
