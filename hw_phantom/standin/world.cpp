#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <sstream>
#include <string>

#include "hw_phantom/standin/omni.h"
#include "hw_phantom/standin/standin.h"

namespace sulcus::standin {
namespace {

Log* open_log() {
  const char* path = std::getenv("SULCUS_STANDIN_LOG");
  if (path == nullptr) return nullptr;
  const int file = ::open(path, O_RDWR | O_CREAT, 0600);
  if (file < 0 || ftruncate(file, sizeof(Log)) != 0) return nullptr;
  void* memory = mmap(nullptr, sizeof(Log), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  ::close(file);
  return memory == MAP_FAILED ? nullptr : static_cast<Log*>(memory);
}

// A program that is not a test's own process is told by SULCUS_STANDIN what it meets: "name=value" in a row.
void configure(World& w, const char* text) {
  SimulatedDevice& device = w.devices[0];
  device.motion.joints[1] = device.motion.joints[2] = 0.4;
  Faults& f = w.faults;
  const std::map<std::string, std::function<void(double)>> settings = {
      {"swing_rad", [&](double v) { device.motion.joint_amplitude[2] = v; }},
      {"swing_Hz", [&](double v) { device.motion.frequency_Hz = v; }},
      {"docked_ticks", [&](double v) { f.docked_ticks = static_cast<std::uint64_t>(v); }},
      {"nan_from", [&](double v) { f.nan_from = static_cast<std::uint64_t>(v); }},
      {"nan_ticks", [&](double v) { f.nan_ticks = static_cast<std::uint64_t>(v); }},
      {"jitter_s", [&](double v) { f.jitter_s = v; }},
      {"stall_from", [&](double v) { f.stall_from = static_cast<std::uint64_t>(v); }},
      {"stall_s", [&](double v) { f.stall_s = v; }},
      {"error", [&](double v) { f.error = static_cast<unsigned int>(v); }},
      {"error_internal", [&](double v) { f.error_internal = static_cast<int>(v); }},
      {"error_from", [&](double v) { f.error_from = static_cast<std::uint64_t>(v); }},
      {"error_every", [&](double v) { f.error_every = static_cast<std::uint64_t>(v); }},
  };
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::size_t equals = word.find('=');
    const auto found = settings.find(word.substr(0, equals));
    if (found == settings.end()) std::abort();  // a test that says nothing the stand-in understands
    found->second(std::atof(word.c_str() + equals + 1));
  }
}

double steady_now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double norm(const double (&v)[3]) {
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

bool within(std::uint64_t tick, std::uint64_t from, std::uint64_t count) {
  return count > 0 && tick >= from && tick < from + count;
}

}  // namespace

World& world() {
  static World* const w = [] {
    auto* made = new World;
    made->log = open_log();
    if (const char* text = std::getenv("SULCUS_STANDIN")) configure(*made, text);
    return made;
  }();
  return *w;
}

void push(World& w, unsigned int code, int internal) {
  w.errors.push_back({code, internal, w.current});
}

SimulatedDevice* current_device(World& w) {
  if (w.current < device_count && w.devices[w.current].initialised) return &w.devices[w.current];
  push(w, 0x0104);
  return nullptr;
}

unsigned int calibration(const World& w, const SimulatedDevice& device) {
  if (w.tick <= w.faults.manual_input_ticks && w.faults.manual_input_ticks > 0) return hd::needs_manual_input;
  return w.faults.needs_update && !device.updated ? hd::needs_update : hd::calibration_ok;
}

void sample(World& w, SimulatedDevice& device) {
  const Motion& m = device.motion;
  const double swing = std::sin(2 * 3.141592653589793 * m.frequency_Hz * static_cast<double>(w.tick) * 1e-3);
  for (int i = 0; i < 3; ++i) {
    device.joints[i] = device.dead_joints ? 0 : m.joints[i] + m.joint_amplitude[i] * swing;
    device.gimbals[i] = m.gimbals[i] + m.gimbal_amplitude[i] * swing;
  }
  double transform[16];
  omni_transform(device.joints, device.gimbals, transform);
  for (int i = 0; i < 3; ++i) {
    if (w.faults.needs_update && !device.updated) transform[12 + i] -= w.faults.jump_mm[i];
  }
  const double period_s = w.faults.period_s > 0 ? w.faults.period_s : 1e-3;
  for (int i = 0; i < 3; ++i) {
    const double rate =
        device.seen.frames == 0 ? 0 : (transform[12 + i] - device.transform[12 + i]) / period_s;
    device.velocity[i] += 0.3 * (rate - device.velocity[i]);  // smoothed, as the driver does
  }
  std::copy(transform, transform + 16, device.transform);

  // Faults of the data and of the frame.
  const Faults& f = w.faults;
  if (w.tick <= f.garbage_ticks) std::fill(device.transform, device.transform + 16, 0.0);
  if (within(w.tick, f.nan_from, f.nan_ticks))
    device.transform[13] = std::numeric_limits<double>::quiet_NaN();
  const bool due =
      f.error != 0 && w.tick >= f.error_from &&
      (f.error_every == 0 ? w.errors_pushed == 0 : (w.tick - f.error_from) % f.error_every == 0) &&
      (f.error_count == 0 || w.errors_pushed < f.error_count);
  if (due) {
    push(w, f.error, f.error_internal);
    ++w.errors_pushed;
  }
}

void finish_frame(World& w, SimulatedDevice& device) {
  const bool on = w.running && device.enabled.count(hd::force_output) != 0;
  Observation& seen = device.seen;
  double step[3];
  for (int i = 0; i < 3; ++i) {
    const double force = on && device.force_set ? device.force[i] : 0;
    step[i] = force - seen.force_N[i];
    seen.force_N[i] = force;
    seen.torque_mN_m[i] = on && device.force_set ? device.torque[i] : 0;
    device.last_force[i] = force;
    device.force[i] = 0;
  }
  ++seen.frames;
  const double force_N = norm(seen.force_N);
  seen.largest_force_N = std::max(seen.largest_force_N, force_N);
  seen.largest_step_N = std::max(seen.largest_step_N, norm(step));
  if (force_N > 0 && calibration(w, device) != hd::calibration_ok) ++seen.forces_while_uncalibrated;
  if (force_N > 0 && w.tick <= w.faults.docked_ticks) ++seen.forces_while_docked;
  if (force_N > 3.3 && device.enabled.count(hd::software_force_limit) != 0) push(w, hd::exceeded_force);
  device.force_set = false;
  if (w.log != nullptr && &device == &w.devices[0]) {
    *w.log = {seen.frames, force_N, seen.largest_force_N, w.running ? 1u : 0u, 0};
  }
}

double next_period(World& w) {
  const Faults& f = w.faults;
  double period_s = f.period_s > 0 ? f.period_s : 1e-3;
  w.random = w.random * 6364136223846793005u + 1442695040888963407u;
  period_s += f.jitter_s * (static_cast<double>(w.random >> 11) * 0x1p-52 - 1);
  if (f.stall_from > 0 && w.tick + 1 == f.stall_from) period_s += f.stall_s;
  return std::max(period_s, 1e-5);
}

void run_tick(World& w) {
  std::vector<ScheduledCallback>& due = w.due;  // keeps its memory: a servo must not allocate
  {
    const std::scoped_lock lock(w.mutex);
    ++w.tick;
    w.tick_start_s = w.manual ? w.clock_s : steady_now_s();
    w.servo_thread = std::this_thread::get_id();
    due = w.callbacks;
  }
  std::stable_sort(due.begin(), due.end(),
                   [](const auto& a, const auto& b) { return a.priority > b.priority; });
  for (const ScheduledCallback& callback : due) {
    if (callback.function(callback.user) != hd::callback_done) continue;
    const std::scoped_lock lock(w.mutex);
    std::erase_if(w.callbacks, [&](const auto& c) { return c.operation == callback.operation; });
  }
  const std::scoped_lock lock(w.mutex);
  w.servo_thread = std::thread::id();
  w.changed.notify_all();
}

void start(World& w) {
  std::unique_lock lock(w.mutex);
  if (w.running) return;
  w.running = true;
  w.tick = 0;
  w.next_tick_s = w.clock_s + next_period(w);
  if (w.manual || w.faults.never_ticks) return;
  w.thread = std::thread([&w] {
    auto next = std::chrono::steady_clock::now();
    for (;;) {
      {
        std::unique_lock wait(w.mutex);
        next += std::chrono::duration_cast<std::chrono::steady_clock::duration>(
            std::chrono::duration<double>(next_period(w)));
        if (w.changed.wait_until(wait, next, [&w] { return !w.running; })) return;
      }
      run_tick(w);
    }
  });
}

void stop(World& w) {
  std::thread ending;
  {
    const std::scoped_lock lock(w.mutex);
    w.running = false;
    for (SimulatedDevice& device : w.devices) {
      if (norm(device.seen.force_N) > 0) ++device.seen.stops_with_force;
      for (double& f : device.seen.force_N) f = 0;  // the motors go off with the scheduler
    }
    if (w.log != nullptr) w.log->force_N = 0, w.log->scheduler_runs = 0;
    ending = std::move(w.thread);
  }
  w.changed.notify_all();
  if (ending.joinable()) ending.join();
}

}  // namespace sulcus::standin

using namespace sulcus::standin;

namespace {

void reset(bool manual) {
  World& w = world();
  stop(w);
  const std::scoped_lock lock(w.mutex);
  w.faults = Faults{};
  w.devices = {};
  for (SimulatedDevice& device : w.devices) device.motion.joints[1] = device.motion.joints[2] = 0.4;
  w.current = sulcus::hd::invalid_handle;
  w.errors.clear();
  w.callbacks.clear();
  w.manual = manual;
  w.tick = 0;
  w.clock_s = 0;
  w.inits_failed = 0;
  w.errors_pushed = 0;
  w.random = 1;
}

void sleep_manually(double s) {
  World& w = world();
  const double end_s = w.clock_s + s;
  while (w.running && !w.faults.never_ticks && w.next_tick_s <= end_s) {
    w.clock_s = w.next_tick_s;
    run_tick(w);
    w.next_tick_s += next_period(w);
  }
  w.clock_s = end_s;
}

void step(int ticks) {
  World& w = world();
  for (int i = 0; i < ticks && w.running; ++i) {
    w.clock_s = w.next_tick_s;
    run_tick(w);
    w.next_tick_s += next_period(w);
  }
}

}  // namespace

extern "C" {
extern __attribute__((visibility("default"))) const Control standin_control;
}
const Control standin_control = {
    reset,
    [](const Faults* faults) {
      const std::scoped_lock lock(world().mutex);
      world().faults = *faults;
      world().errors_pushed = 0;
    },
    [](int device, const Motion* motion) {
      const std::scoped_lock lock(world().mutex);
      world().devices[static_cast<std::size_t>(device)].motion = *motion;
    },
    [](int device, Observation* out) {
      const std::scoped_lock lock(world().mutex);
      const SimulatedDevice& d = world().devices[static_cast<std::size_t>(device)];
      *out = d.seen;
      out->initialised = d.initialised;
      out->motors_on = d.enabled.count(sulcus::hd::force_output) != 0;
      out->frame_open = d.frame_open;
    },
    step,
    sleep_manually,
    [] { return world().manual ? world().clock_s : steady_now_s(); },
    [] {
      const std::scoped_lock lock(world().mutex);
      return static_cast<int>(world().errors.size());
    },
    omni_transform,
    [] {
      const std::scoped_lock lock(world().mutex);
      return world().tick;
    },
    [] {
      const std::scoped_lock lock(world().mutex);
      return world().running;
    },
    [] {
      const std::scoped_lock lock(world().mutex);
      return world().inits_failed;
    },
};
