// Which curves of a recording are shown, and in which units.
#include <algorithm>
#include <cmath>

#include "engine/numerics/quaternion.h"
#include "verify/report_parts.h"

namespace sulcus::report {
namespace {

std::vector<double> times(const RunData& run) {
  const Series* time = run.find("time_s");
  if (time && time->components == 1) return time->values;
  std::vector<double> values;
  for (std::int64_t n = 0; n < run.steps; ++n)
    values.push_back(static_cast<double>(n + 1) * run.header.step_s);
  return values;
}

// The series over time, its length if it is a vector, times `factor`. Without points if it was not recorded
// whole.
Curve curve_of(const RunData& run, const std::string& series_name, const std::string& curve_name,
               double factor) {
  Curve curve{curve_name, {}, {}};
  const Series* series = run.find(series_name);
  const std::vector<double> time = times(run);
  if (!series || series->components < 1 ||
      series->values.size() != time.size() * static_cast<std::size_t>(series->components)) {
    return curve;
  }
  curve.x = time;
  const auto components = static_cast<std::size_t>(series->components);
  for (std::size_t n = 0; n < time.size(); ++n) {
    double value = series->values[n * components];
    if (components > 1) {
      double sum = 0;
      for (std::size_t c = 0; c < components; ++c) {
        sum += series->values[n * components + c] * series->values[n * components + c];
      }
      value = std::sqrt(sum);
    }
    curve.y.push_back(value * factor);
  }
  return curve;
}

// Draws the check's bound if the data come near enough for both to be seen.
void set_bound(Chart& chart, std::span<const Check> checks, const std::string& name, double factor) {
  double highest = 0;
  for (const Curve& curve : chart.curves) {
    for (const double y : curve.y) highest = std::isfinite(y) ? std::max(highest, y) : highest;
  }
  for (const Check& check : checks) {
    const double bound = check.bound * factor;
    if (check.name != name || !std::isfinite(bound)) continue;
    chart.has_bound = chart.log_y ? bound > 0 : bound < 2.5 * highest;
    chart.bound = bound;
  }
}

// One component of a series of vectors, times `factor`; without points if it hardly moves or is not there.
Curve component_of(const RunData& run, const std::string& series_name, std::size_t component,
                   const std::string& curve_name, double factor, double least_range) {
  Curve curve{curve_name, {}, {}};
  const Series* series = run.find(series_name);
  if (!series || series->components != 3) return curve;
  std::vector<double> values;
  for (std::size_t i = component; i < series->values.size(); i += 3)
    values.push_back(factor * series->values[i]);
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  if (values.empty() || !(*high - *low >= least_range)) return curve;
  curve.x = times(run);
  curve.y = std::move(values);
  if (curve.x.size() != curve.y.size()) curve.x.clear(), curve.y.clear();
  return curve;
}

// Angle between the device and the tool.
Curve misalignment_of(const RunData& run, std::size_t tool, const std::string& curve_name) {
  Curve curve{curve_name, {}, {}};
  const std::string number = std::to_string(tool);
  const Series* device = run.find("device/" + number + "/orientation");
  const Series* own = run.find("tools/" + number + "/orientation");
  const std::vector<double> time = times(run);
  if (!device || !own || device->values.size() != 4 * time.size() || own->values.size() != 4 * time.size())
    return curve;
  for (std::size_t n = 0; n < time.size(); ++n) {
    const double *d = &device->values[4 * n], *q = &own->values[4 * n];
    curve.x.push_back(time[n]);
    curve.y.push_back(
        rotation_vector(Quaternion{d[0], d[1], d[2], d[3]} * conjugate(Quaternion{q[0], q[1], q[2], q[3]}))
            .norm());
  }
  return curve;
}

class Charts {
 public:
  explicit Charts(std::span<const Check> checks) : checks_(checks) {}

  void add(const std::string& caption, Chart chart, const std::string& bound_of = "", double factor = 1) {
    std::erase_if(chart.curves, [](const Curve& curve) { return curve.x.empty(); });
    if (chart.curves.empty()) return;
    chart.x_label = "time [s]";
    if (!bound_of.empty()) set_bound(chart, checks_, bound_of, factor);
    charts.push_back({caption + (chart.has_bound ? " Dashed: the bound." : ""), std::move(chart)});
  }

  std::vector<CaptionedChart> charts;

 private:
  std::span<const Check> checks_;
};

Chart chart(const std::string& title, const std::string& y_label, ChartKind kind = ChartKind::lines) {
  Chart out;
  out.title = title;
  out.y_label = y_label;
  out.kind = kind;
  return out;
}

const GoldenBand* band_of(std::span<const GoldenBand> golden, const std::string& series) {
  for (const GoldenBand& band : golden) {
    if (band.series == series) return &band;
  }
  return nullptr;
}

double size_at(const std::vector<double>& values, std::size_t entry, std::size_t components) {
  double sum = 0;
  for (std::size_t c = 0; c < components; ++c)
    sum += values[entry * components + c] * values[entry * components + c];
  return components == 1 ? values[entry] : std::sqrt(sum);
}

// The golden values of a series with their tolerance, times `factor`; of vectors the length.
void add_band(const RunData& run, std::span<const GoldenBand> golden, const std::string& series,
              const std::string& name, double factor, Chart& chart) {
  const GoldenBand* of = band_of(golden, series);
  const std::vector<double> time = times(run);
  if (of == nullptr) return;
  Band band{name, {}, {}, {}};
  for (std::size_t k = 0; k < of->steps.size(); ++k) {
    const auto step = static_cast<std::size_t>(of->steps[k]);
    if (step >= time.size()) return;
    const double value = size_at(of->values, k, of->components);
    band.x.push_back(time[step]);
    band.low.push_back(factor * (value - of->tolerance));
    band.high.push_back(factor * (value + of->tolerance));
  }
  chart.bands.push_back(std::move(band));
}

// How far a series is from the golden one, in its tolerances.
Curve distance_of(const RunData& run, std::span<const GoldenBand> golden, const std::string& series,
                  const std::string& name) {
  Curve curve{name, {}, {}};
  const GoldenBand* of = band_of(golden, series);
  const Series* now = run.find(series);
  const std::vector<double> time = times(run);
  if (of == nullptr || now == nullptr || !(of->tolerance > 0)) return curve;
  for (std::size_t k = 0; k < of->steps.size(); ++k) {
    const auto step = static_cast<std::size_t>(of->steps[k]);
    if (step >= time.size() || now->values.size() != time.size() * of->components) return {name, {}, {}};
    double largest = 0;
    for (std::size_t c = 0; c < of->components; ++c)
      largest = std::max(
          largest, std::abs(now->values[step * of->components + c] - of->values[k * of->components + c]));
    curve.x.push_back(time[step]);
    curve.y.push_back(largest / of->tolerance);
  }
  return curve;
}

}  // namespace

std::vector<CaptionedChart> charts_of(const RunData& run, std::span<const Check> checks,
                                      std::span<const GoldenBand> golden) {
  Charts out(checks);
  Chart force = chart("Force", "force [N]"), depth = chart("Penetration", "deepest contact [mm]");
  const std::size_t tools = run.header.tool_names.size();
  for (std::size_t t = 0; t < tools; ++t) {
    const std::string of = "tools/" + std::to_string(t) + "/",
                      name = tools > 1 ? run.header.tool_names[t] + ": " : "";
    force.curves.push_back(curve_of(run, of + "contact_force_N", name + "tissue on tool", 1));
    force.curves.push_back(curve_of(run, of + "displayed_force_N", name + "shown to the hand", 1));
    add_band(run, golden, of + "displayed_force_N", name + "golden", 1, force);
    add_band(run, golden, of + "max_penetration_m", name + "golden", 1e3, depth);
    depth.curves.push_back(
        curve_of(run, of + "max_penetration_m", tools > 1 ? run.header.tool_names[t] : "", 1e3));
  }
  out.add("Size of the force between tool and tissue, and of what the hand feels.", force, "displayed_force");
  out.add("How deep the tool sinks below the tissue's surface.", depth, "penetration", 1e3);

  if (tools == 1) {
    Chart way = chart("Trajectory", "position [mm]");
    for (std::size_t axis = 0; axis < 3; ++axis) {
      constexpr double least_range_mm = 1;  // an axis along which the hand hardly moves is left out
      const std::string name(1, "xyz"[axis]);
      Curve hand = component_of(run, "device/0/position_m", axis, name + ", device", 1e3, least_range_mm);
      if (hand.x.empty()) continue;
      way.curves.push_back(std::move(hand));
      way.curves.push_back(component_of(run, "tools/0/position_m", axis, name + ", tool", 1e3, 0));
    }
    out.add("Where the device is, and the tool that hangs on it by the virtual coupling.", way);
  }
  Chart turned = chart("Misalignment", "angle [rad]");
  for (std::size_t t = 0; t < tools; ++t)
    turned.curves.push_back(misalignment_of(run, t, tools > 1 ? run.header.tool_names[t] : ""));
  out.add("By which angle the tool lags behind the device.", turned);

  Chart time = chart("Time for each step", "time [ms]", ChartKind::stacked);
  for (const char* stage : stage_names) {
    Curve curve = curve_of(run, std::string("stage/") + stage + "_s", stage, 1e3);
    const bool any = std::any_of(curve.y.begin(), curve.y.end(), [](double y) { return y > 0; });
    if (any) time.curves.push_back(std::move(curve));  // stages that the scene has
  }
  out.add("Wall clock, split by stage; of many steps the slowest is shown.", time);

  Chart torn = chart("Torn elements", "elements a step", ChartKind::stacked);
  torn.curves = {curve_of(run, "fracture/by_criterion", "by their stress", 1),
                 curve_of(run, "fracture/by_avoidance", "hung on a vertex or an edge", 1),
                 curve_of(run, "fracture/detached", "touched no other", 1)};
  out.add("Elements removed at each step, and why; of many steps the one with most is shown.", torn);

  Chart pulled = chart("Force on the paths", "force [N]");
  for (std::size_t m = 0; m < run.header.motion_names.size(); ++m) {
    pulled.curves.push_back(
        curve_of(run, "motions/" + std::to_string(m) + "/force_N", run.header.motion_names[m], 1));
  }
  out.add("Size of the force that moves the nodes on prescribed paths.", pulled);

  Chart iterations = chart("Solver iterations", "iterations");
  iterations.curves = {curve_of(run, "solver/iterations", "", 1)};
  out.add("Of conjugate gradients, for each step.", iterations);

  Chart error = chart("Solver error", "relative error", ChartKind::points);
  error.log_y = true;
  Curve measured{"", {}, {}};
  const std::vector<double> time_s = times(run);
  for (const SolverErrorSample& sample : run.solver_errors) {
    if (sample.step < 0 || static_cast<std::size_t>(sample.step) >= time_s.size()) continue;
    measured.x.push_back(time_s[static_cast<std::size_t>(sample.step)]);
    measured.y.push_back(sample.error);
  }
  error.curves = {measured};
  out.add("Measured against a solve to full precision, at some steps.", error, "solver_error");

  Chart energy = chart("Energy of the tissue", "energy [mJ]");
  energy.curves = {curve_of(run, "tissue/elastic_energy_J", "elastic", 1e3),
                   curve_of(run, "tissue/kinetic_energy_J", "kinetic", 1e3)};
  add_band(run, golden, "tissue/elastic_energy_J", "golden", 1e3, energy);
  out.add("Elastic energy at the start, kinetic energy at the end of each step.", energy);

  Chart distance = chart("Distance from the golden run", "difference / tolerance");
  for (std::size_t t = 0; t < tools; ++t) {
    const std::string of = "tools/" + std::to_string(t) + "/",
                      name = tools > 1 ? run.header.tool_names[t] + ": " : "";
    distance.curves.push_back(distance_of(run, golden, of + "displayed_force_N", name + "force"));
    distance.curves.push_back(distance_of(run, golden, of + "max_penetration_m", name + "penetration"));
  }
  distance.curves.push_back(distance_of(run, golden, "tissue/elastic_energy_J", "elastic energy"));
  distance.has_bound = true;
  distance.bound = 1;
  out.add("Largest difference of a component in tolerances, which are measured; 1 is the most allowed.",
          distance);

  if (tools == 0) {
    Chart moved = chart("Displacement", "largest displacement [mm]");
    moved.curves = {curve_of(run, "tissue/max_displacement_m", "", 1e3)};
    out.add("Of the node that is farthest from its rest position.", moved);
  }
  return std::move(out.charts);
}

}  // namespace sulcus::report
