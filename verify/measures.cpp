#include "verify/measures.h"
#include "verify/series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>

namespace sulcus {
namespace {

const std::string statement = "statement";
constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

// Steps [begin, end) of a window.
struct Window {
  std::int64_t begin = 0, end = 0;
};

Window window_of(const RunData& run, const Measure& measure) {
  const double h = run.header.step_s, slack = 1e-6 * h;
  Window window{run.steps, run.steps};
  for (std::int64_t n = run.steps - 1; n >= 0; --n) {
    const double time_s = static_cast<double>(n + 1) * h;
    if (time_s < measure.from_s - slack) break;
    window.begin = n;
    if (time_s > measure.to_s + slack) window.end = n;
  }
  return window;
}

Quaternion quaternion_at(const Series& series, std::int64_t step) {
  const double* q = &series.values[static_cast<std::size_t>(4 * step)];
  return {q[0], q[1], q[2], q[3]};
}

std::string at_step(std::int64_t step) {
  return "at step " + std::to_string(step);
}

// What was found, where, and from how many numbers; no comparison: nothing was.
struct Found {
  double value = nothing;
  std::int64_t comparisons = 0;
  std::string detail;
};

const Found not_recorded{nothing, 0, "its series is not recorded for every step; record the run again"};

// The largest of number(step) over the window; NaN is larger than anything.
template <class Number>
Found largest(const Window& window, Number&& number) {
  Found found;
  for (std::int64_t n = window.begin; n < window.end; ++n) {
    const double value = number(n);
    ++found.comparisons;
    if (n > window.begin && (std::isnan(found.value) || !(std::isnan(value) || value > found.value)))
      continue;
    found.value = value;
    found.detail = at_step(n);
  }
  return found;
}

// Mean square of what is above `above_Hz` in one component of the window (see the header).
double power_above(const Series& series, const Window& window, int component, double step_s,
                   double above_Hz) {
  const auto count = static_cast<std::size_t>(window.end - window.begin);
  std::vector<double> x(count);
  double mean = 0, squares = 0;  // of the values; of the window
  for (std::size_t n = 0; n < count; ++n) {
    x[n] =
        series.values[3 * (static_cast<std::size_t>(window.begin) + n) + static_cast<std::size_t>(component)];
    mean += x[n] / static_cast<double>(count);
  }
  for (std::size_t n = 0; n < count; ++n) {
    const double s = std::sin(std::numbers::pi * (static_cast<double>(n) + 0.5) / static_cast<double>(count));
    x[n] = (x[n] - mean) * s * s;
    squares += s * s * s * s;
  }
  double power = 0;
  for (std::size_t k = 1; 2 * k <= count; ++k) {
    if (static_cast<double>(k) < above_Hz * step_s * static_cast<double>(count)) continue;
    const std::complex<double> turn =
        std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(count));
    std::complex<double> sum = 0, phase = 1;
    for (const double value : x) {
      sum += value * phase;
      phase *= turn;
    }
    power += (2 * k == count ? 1 : 2) * std::norm(sum);
  }
  return power / (static_cast<double>(count) * squares);
}

Found force_ripple(const Series& force, const Window& window, double step_s, double above_Hz) {
  constexpr std::int64_t shortest = 8;  // steps; fewer have no spectrum
  if (window.end - window.begin < shortest) return {nothing, 0, "the window has less than 8 steps"};
  double power = 0;
  for (int component = 0; component < 3; ++component)
    power += power_above(force, window, component, step_s, above_Hz);
  return {std::sqrt(power), window.end - window.begin, "above " + std::to_string(above_Hz) + " Hz"};
}

Vec3 misalignment_at(const Series& device, const Series& tool, std::int64_t step) {
  return rotation_vector(quaternion_at(device, step) * conjugate(quaternion_at(tool, step)));
}

Found overshoot(const Series& device, const Series& tool, const Window& window) {
  Vec3 direction = Vec3::Zero();
  Found found = largest(window, [&](std::int64_t n) {
    const Vec3 u = misalignment_at(device, tool, n);
    if (direction.isZero(0) && u.norm() > 0) direction = u.normalized();
    return std::max(0.0, -u.dot(direction));
  });
  if (direction.isZero(0)) return {nothing, 0, "device and tool are never misaligned"};
  return found;
}

Found settling_time(const Series& device, const Series& tool, const Window& window, double step_s,
                    double within_rad) {
  for (std::int64_t n = window.end - 1; n >= window.begin; --n) {
    if (misalignment_at(device, tool, n).norm() < within_rad) continue;
    if (n == window.end - 1) return {nothing, window.end - window.begin, "does not settle"};
    return {static_cast<double>(n + 2) * step_s, window.end - window.begin, at_step(n + 1)};
  }
  return {nothing, 0, "is never misaligned by " + std::to_string(within_rad) + " rad"};
}

Found measure_tool(const RunData& run, const Measure& measure) {
  const auto tool = std::find(run.header.tool_names.begin(), run.header.tool_names.end(), measure.tool);
  if (tool == run.header.tool_names.end()) return {nothing, 0, "there is no tool \"" + measure.tool + "\""};
  const std::string number = std::to_string(tool - run.header.tool_names.begin());
  const Series* force = series_of(run, "tools/" + number + "/contact_force_N", 3);
  const Series* depth = series_of(run, "tools/" + number + "/max_penetration_m", 1);
  const Series* turn = series_of(run, "tools/" + number + "/orientation", 4);
  const Series* device = series_of(run, "device/" + number + "/orientation", 4);
  if (force == nullptr || depth == nullptr || turn == nullptr || device == nullptr)
    return {nothing, 0, "its series are not recorded for every step; record the run again"};
  const Window window = window_of(run, measure);
  if (measure.what == "contact_force_N")
    return largest(window, [&](std::int64_t n) { return vector_at(*force, n).norm(); });
  if (measure.what == "penetration_mm")
    return largest(window, [&](std::int64_t n) { return 1e3 * depth->values[static_cast<std::size_t>(n)]; });
  if (measure.what == "contacts") {
    const Series* contacts = series_of(run, "tools/" + number + "/contacts", 1);
    if (contacts == nullptr) return not_recorded;
    return largest(window, [&](std::int64_t n) { return contacts->values[static_cast<std::size_t>(n)]; });
  }
  if (measure.what == "pull_N") {
    const Vec3 away = measure.along.normalized();
    return largest(window, [&](std::int64_t n) { return std::max(0.0, -vector_at(*force, n).dot(away)); });
  }
  if (measure.what == "force_ripple_N")
    return force_ripple(*force, window, run.header.step_s, measure.above_Hz);
  if (measure.what == "overshoot_rad") return overshoot(*device, *turn, window);
  if (measure.what == "settling_s")
    return settling_time(*device, *turn, window, run.header.step_s, measure.within_rad);
  return {nothing, 0, "no such measure"};
}

Found least_position(const RunData& run, const Vec3& along) {
  const std::vector<double>& end = run.final_state.positions;
  Found found;
  for (std::size_t i = 0; i + 2 < end.size(); i += 3) {
    const double place_mm = 1e3 * Vec3(end[i], end[i + 1], end[i + 2]).dot(along.normalized());
    if (found.comparisons++ > 0 && !(place_mm < found.value)) continue;
    found.value = place_mm;
    found.detail = "node " + std::to_string(i / 3);
  }
  return found;
}

Found opening(const RunData& run, const Measure& measure) {
  const auto nodes = static_cast<std::size_t>(run.header.node_count());
  const auto place = [](const std::vector<double>& x, std::size_t node) {
    return std::array<double, 3>{x[3 * node], x[3 * node + 1], x[3 * node + 2]};
  };
  std::map<std::array<double, 3>, std::vector<std::size_t>> sharing;
  for (std::size_t n = 0; n < nodes; ++n) sharing[place(run.header.rest_positions, n)].push_back(n);
  Found found;
  for (const Frame& frame : run.frames) {
    if (frame.time_s < measure.from_s || frame.time_s > measure.to_s) continue;
    for (const auto& [rest, copies] : sharing) {
      for (std::size_t a = 0; a < copies.size(); ++a) {
        for (std::size_t b = a + 1; b < copies.size(); ++b) {
          const auto p = place(frame.positions, copies[a]), q = place(frame.positions, copies[b]);
          const double apart_mm = 1e3 * Vec3(p[0] - q[0], p[1] - q[1], p[2] - q[2]).norm();
          if (found.comparisons++ > 0 && !(apart_mm > found.value)) continue;
          found.value = apart_mm;
          found.detail = at_step(frame.step);
        }
      }
    }
  }
  return found;
}

Found displacement(const RunData& run, const Measure& measure) {
  const Series* series = series_of(run, "tissue/max_displacement_m", 1);
  if (series == nullptr) return not_recorded;
  const auto at = [&](std::int64_t n) { return 1e3 * series->values[static_cast<std::size_t>(n)]; };
  Found most = largest(window_of(run, measure), at);
  if (measure.what == "drift_mm")
    most.value += largest(window_of(run, measure), [&](std::int64_t n) { return -at(n); }).value;
  return most;
}

Found path_force(const RunData& run, const Measure& measure) {
  const auto& names = run.header.motion_names;
  const auto path = std::find(names.begin(), names.end(), measure.path);
  if (path == names.end()) return {nothing, 0, "there is no motion \"" + measure.path + "\""};
  const std::string number = std::to_string(path - names.begin());
  const Series* force = series_of(run, "motions/" + number + "/force_N", 3);
  if (force == nullptr) return not_recorded;
  return largest(window_of(run, measure), [&](std::int64_t n) { return vector_at(*force, n).norm(); });
}

Found find(const RunData& run, const Measure& measure) {
  if (measure.what == "displacement_mm" || measure.what == "drift_mm") return displacement(run, measure);
  if (measure.what == "path_force_N") return path_force(run, measure);
  if (measure.what == "least_position_mm") return least_position(run, measure.along);
  if (measure.what == "opening_mm") return opening(run, measure);
  return measure_tool(run, measure);
}

}  // namespace

std::vector<Check> check_measures(const RunData& run, std::span<const Measure> measures) {
  std::vector<Check> checks;
  for (const Measure& measure : measures) {
    const std::string of = measure.tool + measure.path;  // one of them at most
    const std::string name = of.empty() ? measure.what : measure.what + "/" + of;
    const std::string unit = measure.what.substr(measure.what.rfind('_') + 1);
    const Found found = find(run, measure);
    if (measure.at_least)
      checks.push_back(check_at_least(name, statement, found.value, *measure.at_least, unit,
                                      found.comparisons, found.detail));
    if (measure.at_most)
      checks.push_back(check_at_most(name, statement, found.value, *measure.at_most, unit, found.comparisons,
                                     found.detail));
  }
  return checks;
}

}  // namespace sulcus
