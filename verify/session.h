// What is recorded of a session in real time beside what every run records: each tick of the servo, when each
// step was due, begun and done, and the histograms of what that says about time.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "engine/device/device.h"
#include "engine/device/servo.h"

namespace sulcus {

// One tick of a servo: what it saw, what it rendered. From the tick before, the coupling that the engine left
// after `coupling_step` steps and the sample, the command follows bit by bit (render(), servo.h).
struct ServoTick {
  std::uint64_t number = 0;         // from 0; a gap: ticks that the recorder could not take
  double time_s = 0;                // s, session clock: begin of the tick
  double work_s = 0;                // s, of Sulcus' own in this tick
  std::int64_t coupling_step = -1;  // steps done when that coupling was left; -1: none was there yet
  std::uint32_t error = 0;          // DeviceError of reading the sample
  DeviceSample sample;
  Vec3 force = Vec3::Zero();   // N, commanded
  Vec3 torque = Vec3::Zero();  // N m
};

// When a step was due, when it read the samples that it consumed, and when the servo got its result.
struct SessionStep {
  double due_s = 0, read_s = 0, published_s = 0;  // s, session clock
};

struct SessionHeader {
  std::vector<std::string> devices;  // [tools] "scripted", "Phantom Omni", ...
  std::vector<ServoSettings> servo;  // [tools]
};

// Counts of values in equal bins from 0; the last bin also counts all above.
struct Histogram {
  static constexpr std::size_t bins = 100;
  std::string name;
  double bin_s = 0;  // s, width
  std::array<std::uint64_t, bins> counts{};
  double median_s = 0, p99_s = 0, max_s = 0;  // of the values themselves; 0 without any

  std::uint64_t total() const;
};
Histogram make_histogram(std::string name, double bin_s, std::vector<double> values_s);

// Collects what the histograms are made of, record by record:
//   servo_interval_s    from one tick of a device to its next
//   servo_work_s        Sulcus' own work in a tick
//   coupling_age_s      age of the coupling that a tick renders: since the engine read that step's samples
//   force_latency_s     from the engine's reading of a sample to the first tick that renders its effect
//   step_lateness_s     from when a step was due to when it began
//   step_time_s         from reading the samples to publishing the result
class SessionTiming {
 public:
  explicit SessionTiming(std::size_t tools) : last_(tools) {}
  void add_step(const SessionStep& step) { steps_.push_back(step); }
  void add_tick(std::size_t tool, const ServoTick& tick);  // after the step whose coupling it renders
  std::vector<Histogram> histograms() const;
  std::int64_t missed_deadlines(double step_s) const;  // published later than a step's time after it was due
  std::uint64_t missing_ticks() const { return missing_ticks_; }  // gaps in their numbers

 private:
  struct LastTick {
    bool any = false;
    std::uint64_t number = 0;
    double time_s = 0;
    std::int64_t coupling_step = -1;
  };
  std::vector<LastTick> last_;
  std::vector<SessionStep> steps_;
  std::vector<double> intervals_s_, works_s_, ages_s_, latencies_s_;
  std::uint64_t missing_ticks_ = 0;
};

// Of a recording read again.
struct SessionData {
  std::vector<std::vector<ServoTick>> ticks;  // [tools]
  std::vector<Histogram> histograms;
  const Histogram* find(const std::string& name) const;  // nullptr if absent
};

}  // namespace sulcus
