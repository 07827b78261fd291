// A session: the engine in real time beside the servos of its devices.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "engine/scene/step.h"
#include "tools/sulcus/hand.h"

namespace sulcus {

enum class SessionEnd {
  time_over,     // the planned duration
  device_ended,  // the trajectory is over
  interrupted,   // Ctrl-C or SIGTERM
  device_fault,  // a device gave a fatal error
  not_finite,    // the state is no longer finite
  recorder,      // the log could not take a step, or could not be written
};
const char* end_text(SessionEnd end);

struct SessionPlan {
  double duration_s = 0;  // s; may be infinite
  int threads = 1;        // of the engine
  std::int64_t state_every_steps = 1;
  SessionClock clock;
};

struct SessionOutcome {
  SessionEnd end = SessionEnd::time_over;
  std::int64_t steps = 0;
  std::int64_t held_samples = 0;  // steps for which a device had nothing new or nothing sound
};

// Runs the engine at the scene's step until the session ends. A step reads the newest samples, computes,
// hands all it consumed to the log, and publishes the coupling. It is due one step's time after the one
// before; if that is over already it begins at once, and the time is not caught up with. A sample that is not
// new or not finite is replaced by the one before. At the end the couplings are taken back. `samples`: the
// first ones, that `state` comes from.
SessionOutcome run_session(const Scene& scene, const SessionPlan& plan,
                           const std::vector<std::unique_ptr<Hand>>& hands, const RunHeader& header,
                           std::vector<DeviceSample> samples, State& state, SessionLog& log);

// While it lives, SIGINT, SIGTERM and SIGHUP end the session: all forces stop at once, and interrupted() is
// true. A second one takes its usual course. A signal that was ignored from outside (nohup) stays so.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  static bool interrupted();
};

}  // namespace sulcus
