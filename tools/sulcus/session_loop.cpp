#include <algorithm>
#include <csignal>

#include "hw_phantom/emergency.h"
#include "tools/sulcus/realtime.h"
#include "tools/sulcus/servo_replay.h"
#include "tools/sulcus/session.h"
#include "tools/sulcus/support.h"

namespace sulcus {
namespace {

volatile std::sig_atomic_t interrupt_came = 0;

constexpr int interrupts[] = {SIGINT, SIGTERM, SIGHUP};

extern "C" void interrupt(int) {
  stop_all_forces();
  interrupt_came = 1;
}

// What the engine gets of the devices at one moment.
class Consumer {
 public:
  Consumer(const std::vector<std::unique_ptr<Hand>>& hands, std::vector<DeviceSample> samples,
           SessionLog& log)
      : hands_(hands), samples_(std::move(samples)), log_(log), told_(hands.size(), 0) {}

  enum class Result { go_on, ended, fault };
  Result read(double time_s, std::int64_t step) {
    bool held_any = false;
    for (std::size_t h = 0; h < hands_.size(); ++h) {
      Hand& hand = *hands_[h];
      DeviceSample sample = samples_[h];
      const DeviceError error = hand.newest(time_s, sample);
      if (error == DeviceError::ended && hand.leads()) return Result::ended;
      if (error == DeviceError::ended) continue;  // the tool stays where its way ended
      if (error == DeviceError::fatal) {
        log_.push_event(step, "device " + std::to_string(h) + " (" + hand.device().capabilities().model +
                                  ") failed: it gives no more samples and renders no force");
        return Result::fault;
      }
      const bool sound = error == DeviceError::none && is_finite(sample);
      if (sound) {
        samples_[h] = sample;
        told_[h] = 0;
      } else if (const unsigned reason = error == DeviceError::none ? not_finite : not_new;
                 !(told_[h] & reason)) {
        log_.push_event(step, "device " + std::to_string(h) + " gives nothing " +
                                  (reason == not_finite ? "finite" : "new") +
                                  "; its last sound sample is held");
        told_[h] |= reason;
      }
      held_any = held_any || !sound;
    }
    if (held_any) ++held_;
    return Result::go_on;
  }
  const std::vector<DeviceSample>& samples() const { return samples_; }
  std::int64_t held() const { return held_; }

 private:
  const std::vector<std::unique_ptr<Hand>>& hands_;
  std::vector<DeviceSample> samples_;
  SessionLog& log_;
  static constexpr unsigned not_new = 1, not_finite = 2;
  std::vector<unsigned> told_;  // [hands] reasons for holding that were told since the last sound sample
  std::int64_t held_ = 0;
};

}  // namespace

const char* end_text(SessionEnd end) {
  switch (end) {
    case SessionEnd::time_over:
      return "its time is over";
    case SessionEnd::device_ended:
      return "the trajectory is over";
    case SessionEnd::interrupted:
      return "interrupted";
    case SessionEnd::device_fault:
      return "a device failed";
    case SessionEnd::not_finite:
      return "the state is no longer finite";
    case SessionEnd::recorder:
      return "the recorder cannot keep up or cannot write";
  }
  return "";
}

InterruptGuard::InterruptGuard() {
  interrupt_came = 0;
  struct sigaction action {};
  action.sa_handler = interrupt;
  action.sa_flags = SA_RESETHAND;
  sigemptyset(&action.sa_mask);
  for (const int number : interrupts) {
    struct sigaction present {};
    sigaction(number, nullptr, &present);
    if (present.sa_handler != SIG_IGN) sigaction(number, &action, nullptr);
  }
}

InterruptGuard::~InterruptGuard() {
  for (const int number : interrupts) {
    struct sigaction present {};
    sigaction(number, nullptr, &present);
    if (present.sa_handler == interrupt) std::signal(number, SIG_DFL);
  }
}

bool InterruptGuard::interrupted() {
  return interrupt_came != 0;
}

SessionOutcome run_session(const Scene& scene, const SessionPlan& plan,
                           const std::vector<std::unique_ptr<Hand>>& hands, const RunHeader& header,
                           std::vector<DeviceSample> samples, State& state, SessionLog& log) {
  const double h = scene.settings.step_s;
  const SessionClock& clock = plan.clock;
  WorkspacePtr workspace = make_workspace(scene, plan.threads);
  StepReport report = make_report(scene);
  StepRow row;
  StageClock stages;
  StepTree tree(*workspace);
  ClockAndTree observers(stages, tree);
  {  // once beforehand, on a copy: the first step allocates and touches memory
    State copy = state;
    tree.begin(samples);
    step(scene, samples, copy, report, *workspace, &observers);
    make_step_row(header, report, copy, stages.seconds(), 0, row);
  }
  Consumer consumer(hands, std::move(samples), log);
  SessionOutcome outcome;

  SessionStep times;
  times.due_s = clock.now_s();
  for (;; times.due_s = std::max(times.due_s + h, times.published_s)) {
    sleep_until_s(clock.zero_s + times.due_s);
    const auto ends = [&](SessionEnd end) {
      outcome.end = end;
      return true;
    };
    if (InterruptGuard::interrupted() && ends(SessionEnd::interrupted)) break;
    times.read_s = clock.now_s();
    if (times.read_s >= plan.duration_s && ends(SessionEnd::time_over)) break;
    const Consumer::Result result = consumer.read(times.read_s, state.step);
    if (result == Consumer::Result::ended && ends(SessionEnd::device_ended)) break;
    if (result == Consumer::Result::fault && ends(SessionEnd::device_fault)) break;

    tree.begin(consumer.samples());
    stages.start();
    step(scene, consumer.samples(), state, report, *workspace, &observers);
    make_step_row(header, report, state, stages.seconds(), stages.total(), row);
    row.stage_hashes.assign(tree.hashes().begin(), tree.hashes().end());
    times.published_s = clock.now_s();
    const bool taken = log.push_step(report.step, consumer.samples(), times, row);
    if ((!taken || log.failed()) && ends(SessionEnd::recorder)) break;
    if (!report.finite && ends(SessionEnd::not_finite)) break;
    for (const auto& hand : hands)
      hand->publish(coupling_of(scene, state, hand->tool(), times.read_s), state.step);
    if (state.step % plan.state_every_steps == 0) log.push_state(state);
  }
  for (const auto& hand : hands) hand->publish({}, -1);
  outcome.steps = state.step;
  outcome.held_samples = consumer.held();
  return outcome;
}

}  // namespace sulcus
