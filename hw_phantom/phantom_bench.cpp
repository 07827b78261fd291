// The servo tick's own work: everything between the driver's calls, with a driver that does nothing but give
// a pose. Figure: below 5 microseconds median. Prints the median of all ticks beside Google Benchmark's mean.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <vector>

#include "engine/device/servo.h"
#include "hw_phantom/phantom_servo.h"

namespace sulcus {
namespace {

double pose_mm[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 20, 30, 1};

hd::Api idle_driver() {
  hd::Api api{};
  api.begin_frame = [](hd::Handle) {};
  api.end_frame = [](hd::Handle) {};
  api.get_error = [] { return hd::ErrorRecord{0, 0, 0}; };
  api.make_current_device = [](hd::Handle) {};
  api.enable = [](unsigned int) {};
  api.disable = [](unsigned int) {};
  api.is_enabled = [](unsigned int) -> hd::Boolean { return 1; };
  api.get_integer = [](unsigned int, int* out) { *out = 0; };
  api.get_boolean = [](unsigned int, hd::Boolean* out) { *out = 1; };
  api.get_double = [](unsigned int parameter, double* out) {
    if (parameter == hd::current_transform) std::memcpy(out, pose_mm, sizeof(pose_mm));
    if (parameter == hd::current_velocity) out[0] = out[1] = out[2] = 1;
  };
  api.set_double = [](unsigned int, const double*) {};
  return api;
}

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct Session {
  CouplingSnapshot coupling;
  ServoSettings settings;
  ServoState state;
};

void servo_tick(benchmark::State& bench) {
  const hd::Api api = idle_driver();
  Session session;
  session.coupling.valid = true;
  session.coupling.stiffness_N_m = 100;
  session.coupling.rotational_stiffness_N_m_rad = 0.3;
  session.settings.filter_Hz = 10;
  session.settings.max_age_s = 1e9;
  PhantomServo servo;
  servo.now_s = now_s;
  servo.has_inkwell = servo.has_temperature = true;
  servo.function = [](void* user, const DeviceSample& sample) {
    auto& s = *static_cast<Session*>(user);
    return render(s.coupling, sample, s.settings, s.state);
  };
  servo.user = &session;
  servo.start_s.store(now_s());
  servo.mode.store(ServoMode::run);
  for (int i = 0; i < 200; ++i) servo.tick(api, 0);
  std::vector<double> times_us;
  times_us.reserve(1 << 20);
  for (auto _ : bench) {
    pose_mm[12] += 1e-5;
    const double from_s = now_s();
    servo.tick(api, 0);
    if (times_us.size() < times_us.capacity()) times_us.push_back(1e6 * (now_s() - from_s));
  }
  std::nth_element(times_us.begin(), times_us.begin() + static_cast<std::ptrdiff_t>(times_us.size() / 2),
                   times_us.end());
  bench.counters["median_us"] = times_us[times_us.size() / 2];
}
BENCHMARK(servo_tick);

}  // namespace
}  // namespace sulcus
