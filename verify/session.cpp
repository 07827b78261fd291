#include "verify/session.h"

#include <algorithm>
#include <cmath>

namespace sulcus {
namespace {

double quantile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0;
  const auto last = static_cast<double>(sorted.size() - 1);
  return sorted[static_cast<std::size_t>(std::ceil(share * last))];
}

}  // namespace

std::uint64_t Histogram::total() const {
  std::uint64_t sum = 0;
  for (const std::uint64_t count : counts) sum += count;
  return sum;
}

Histogram make_histogram(std::string name, double bin_s, std::vector<double> values_s) {
  std::erase_if(values_s, [](double value) { return !std::isfinite(value); });
  std::sort(values_s.begin(), values_s.end());
  Histogram histogram;
  histogram.name = std::move(name);
  histogram.bin_s = bin_s;
  for (const double value : values_s) {
    const double bin = std::clamp(value / bin_s, 0.0, static_cast<double>(Histogram::bins - 1));
    ++histogram.counts[static_cast<std::size_t>(bin)];
  }
  histogram.median_s = quantile(values_s, 0.5);
  histogram.p99_s = quantile(values_s, 0.99);
  histogram.max_s = quantile(values_s, 1);
  return histogram;
}

void SessionTiming::add_tick(std::size_t tool, const ServoTick& tick) {
  LastTick& last = last_[tool];
  works_s_.push_back(tick.work_s);
  const std::uint64_t expected = last.any ? last.number + 1 : 0;
  missing_ticks_ += tick.number - expected;
  if (last.any && tick.number == expected) intervals_s_.push_back(tick.time_s - last.time_s);
  const std::int64_t step = tick.coupling_step;
  if (step >= 1 && step <= static_cast<std::int64_t>(steps_.size())) {
    const double age_s = tick.time_s - steps_[static_cast<std::size_t>(step - 1)].read_s;
    ages_s_.push_back(age_s);
    if (step != last.coupling_step) latencies_s_.push_back(age_s + tick.work_s);
  }
  last = {true, tick.number, tick.time_s, step};
}

std::vector<Histogram> SessionTiming::histograms() const {
  std::vector<double> lateness_s, times_s;
  for (const SessionStep& step : steps_) {
    lateness_s.push_back(step.read_s - step.due_s);
    times_s.push_back(step.published_s - step.read_s);
  }
  return {make_histogram("servo_interval_s", 50e-6, intervals_s_),
          make_histogram("servo_work_s", 0.5e-6, works_s_),
          make_histogram("coupling_age_s", 1e-3, ages_s_),
          make_histogram("force_latency_s", 1e-3, latencies_s_),
          make_histogram("step_lateness_s", 0.5e-3, lateness_s),
          make_histogram("step_time_s", 1e-3, times_s)};
}

std::int64_t SessionTiming::missed_deadlines(double step_s) const {
  return std::count_if(steps_.begin(), steps_.end(),
                       [&](const SessionStep& step) { return step.published_s > step.due_s + step_s; });
}

const Histogram* SessionData::find(const std::string& name) const {
  const auto found = std::find_if(histograms.begin(), histograms.end(),
                                  [&](const Histogram& histogram) { return histogram.name == name; });
  return found == histograms.end() ? nullptr : &*found;
}

}  // namespace sulcus
