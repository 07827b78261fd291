// A tick of the servo in a session: all of Sulcus' own work, from the sample to the recorder's ring. Figure:
// below 5 microseconds median. Prints the median of all ticks beside Google Benchmark's mean.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "tools/sulcus/hand.h"
#include "tools/sulcus/realtime.h"

namespace sulcus {
namespace {

// Gives a pose that moves, at once.
class MovingDevice final : public Device {
 public:
  DeviceCapabilities capabilities() const override { return {.model = "moving"}; }
  DeviceState state() const override { return DeviceState::running; }
  void open() override {}
  void calibrate() override {}
  void arm() override {}
  void close() noexcept override {}
  DeviceError read(double time_s, DeviceSample& sample) override {
    sample.time_s = time_s;
    sample.interval_s = 0.001;
    sample.position.x() += 1e-6;
    sample.linear_velocity_valid = sample.angular_velocity_valid = true;
    return DeviceError::none;
  }
  void write(const DeviceCommand&) override {}
};

void session_tick(benchmark::State& bench) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / "sulcus_session_bench.log";
  RunHeader header;
  header.tool_names = {"tool"};
  header.session = SessionHeader{{"moving"}, {ServoSettings{.filter_Hz = 10}}};
  State state;
  state.tool_poses.assign(7, 0.0);
  state.tool_momenta.assign(6, 0.0);
  state.filtered_forces.assign(6, 0.0);
  std::vector<double> times_us;
  times_us.reserve(1 << 20);
  {
    SessionLog log(path, header, state);
    Hand hand(std::make_unique<MovingDevice>(), 0, header.session->servo[0], true);
    hand.arm();
    const SessionClock clock{steady_now_s()};
    hand.start({}, clock, log, false);
    CouplingSnapshot coupling;
    coupling.valid = true;
    coupling.stiffness_N_m = 1000;
    coupling.damping_N_s_m = 10;
    coupling.rotational_stiffness_N_m_rad = 0.3;
    coupling.rotational_damping_N_m_s_rad = 0.03;
    std::int64_t number = 0;
    for (auto _ : bench) {
      const double now_s = clock.now_s();
      if (++number % 33 == 0) {
        coupling.time_s = now_s;
        hand.publish(coupling, number / 33);
      }
      const double from_s = steady_now_s();
      hand.serve(now_s);
      if (times_us.size() < times_us.capacity()) times_us.push_back(1e6 * (steady_now_s() - from_s));
    }
  }
  std::filesystem::remove(path);
  const auto middle = times_us.begin() + static_cast<std::ptrdiff_t>(times_us.size() / 2);
  std::nth_element(times_us.begin(), middle, times_us.end());
  bench.counters["median_us"] = *middle;
}
BENCHMARK(session_tick);

}  // namespace
}  // namespace sulcus
