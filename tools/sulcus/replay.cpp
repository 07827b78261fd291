#include <cstdio>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/lockstep.h"
#include "tools/sulcus/rerun.h"
#include "tools/sulcus/servo_replay.h"
#include "tools/sulcus/support.h"
#include "verify/fingerprint.h"

namespace sulcus {

int replay_command(const ReplayOptions& options) {
  const RunData run = read_run(options.recording);
  const std::string place = options.recording.string();
  if (run.numbers.contains("static/balance")) {
    throw InputError(place +
                     ": it holds a place of rest, which no steps lead to; run `sulcus static` again instead");
  }
  const int threads = threads_or_all(options.threads);
  if (options.serve) return serve_lockstep(run, place, threads);
  if (!options.lockstep.empty()) return lockstep(run, place, threads, options.lockstep);

  Rerun again(run, place, threads, false);
  const auto same = [&] {
    const auto differing = differing_leaves(recorded_tree_row(run, again.done()), again.row());
    if (differing.empty()) return true;
    std::printf("%s\n", describe_leaves(differing, again.done(), run.steps).c_str());
    return false;
  };
  if (!same()) return 1;
  ServoReplay servo(again.scene(), run);
  Progress progress(run.header.scenario_name + ": replay", run.steps);
  for (std::int64_t n = 0; n < run.steps; ++n) {
    again.step();
    if (!same()) return 1;
    servo.after_step(again.state());
    progress.at(n + 1);
  }
  const ServoReplay::Outcome ticks = servo.compare();
  if (!ticks.difference.empty()) {
    std::printf("DIFFERS in what the servo rendered, first: %s\n", ticks.difference.c_str());
    return 1;
  }
  std::printf("SAME  %s: %lld steps, fingerprint %s\n", run.header.scenario_name.c_str(),
              static_cast<long long>(run.steps), hex16(run.fingerprint()).c_str());
  if (run.session) {
    std::printf("SAME  %lld ticks of the servo; %lld more stand behind a gap and were not compared\n",
                static_cast<long long>(ticks.ticks), static_cast<long long>(ticks.skipped));
  }
  return 0;
}

}  // namespace sulcus
