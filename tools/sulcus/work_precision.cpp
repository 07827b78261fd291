// Runs a scenario with a matrix of settings and a reference, and compares what they give at the same material
// points and moments.
#include "verify/work_precision.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "engine/numerics/error.h"
#include "engine/scene/pieces.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/recorded_hand.h"
#include "tools/sulcus/support.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t most_points = 200;  // material points compared
constexpr std::size_t moments = 200;      // over the run

// "/a/b=1,[2,3],x" -> "/a/b" and "1", "[2,3]", "x": commas within brackets or quotes do not part.
struct Varied {
  std::string key;
  std::vector<std::string> values;
};
Varied read_varied(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || text[0] != '/' || equals + 1 == text.size())
    throw InputError("--vary: found \"" + text + "\", expected /json/pointer=value,value,...");
  Varied varied{text.substr(0, equals), {""}};
  int depth = 0;
  bool quoted = false;
  for (const char c : text.substr(equals + 1)) {
    quoted ^= c == '"';
    if (!quoted) depth += (c == '[' || c == '{') - (c == ']' || c == '}');
    if (c == ',' && depth == 0 && !quoted) {
      varied.values.emplace_back();
    } else {
      varied.values.back() += c;
    }
  }
  return varied;
}

// All choices, the last key running fastest.
std::vector<std::vector<std::string>> choices(const std::vector<Varied>& varied) {
  std::vector<std::vector<std::string>> all{{}};
  for (const Varied& one : varied) {
    std::vector<std::vector<std::string>> longer;
    for (const auto& choice : all) {
      for (const std::string& value : one.values) {
        longer.push_back(choice);
        longer.back().push_back(value);
      }
    }
    all = std::move(longer);
  }
  return all;
}

// A place in the tissue: a tetrahedron and the share of its nodes.
struct MaterialPoint {
  std::int32_t tet = 0;
  std::array<double, 4> weights{};
};

// Voxels that every mesh holds, evenly through the map.
std::vector<std::size_t> common_voxels(const std::vector<const Scene*>& scenes) {
  std::vector<std::size_t> held;
  const std::size_t count = scenes.front()->mesh.cell_of_voxel.size();
  for (const Scene* scene : scenes) {
    if (scene->mesh.cell_of_voxel.size() != count)
      throw InputError(
          "--vary: the label map changes with the settings; errors need the same tissue in all runs");
  }
  for (std::size_t v = 0; v < count; ++v) {
    if (std::all_of(scenes.begin(), scenes.end(),
                    [&](const Scene* scene) { return scene->mesh.cell_of_voxel[v] >= 0; }))
      held.push_back(v);
  }
  std::vector<std::size_t> chosen;
  const std::size_t wanted = std::min(most_points, held.size());
  for (std::size_t i = 0; i < wanted; ++i) chosen.push_back(held[(2 * i + 1) * held.size() / (2 * wanted)]);
  return chosen;
}

std::vector<MaterialPoint> locate(const Scene& scene, const std::vector<std::size_t>& voxels) {
  const Index3& size = scene.settings.map.size;
  std::vector<MaterialPoint> points;
  for (const std::size_t v : voxels) {
    const auto row = static_cast<std::size_t>(size[0]), slice = row * static_cast<std::size_t>(size[1]);
    const Vec3 voxel(static_cast<double>(v % row), static_cast<double>(v % slice / row),
                     static_cast<double>(v / slice));
    MaterialPoint point;
    point.tet = locate_tet_in_cell(scene.mesh, scene.mesh.cell_of_voxel[v], voxel, point.weights);
    points.push_back(point);
  }
  return points;
}

// Displacements of the points (m), three numbers each, and forces (N): of the tissue on tools, on paths and
// on planes; before the first step and after each.
struct Trace {
  double step_s = 0;
  std::vector<std::vector<double>> displacements, forces;
  std::string problem;
  double iterations = 0, converged = 0;  // mean over steps
};

void look(const Scene& scene, const std::vector<MaterialPoint>& points, const State& state,
          const StepReport& report, Trace& trace) {
  auto& displacements = trace.displacements.emplace_back();
  for (const MaterialPoint& point : points) {
    const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(point.tet)];
    Vec3 u = Vec3::Zero();
    for (std::size_t c = 0; c < 4; ++c) {
      u += point.weights[c] * (node_vector(state.positions, nodes[c]) -
                               scene.mesh.rest_positions[static_cast<std::size_t>(nodes[c])]);
    }
    displacements.insert(displacements.end(), {u[0], u[1], u[2]});
  }
  auto& forces = trace.forces.emplace_back();
  const auto add = [&](const Vec3& f) { forces.insert(forces.end(), {f[0], f[1], f[2]}); };
  for (const ToolReport& tool : report.tools) add(tool.contact_force);
  for (const Vec3& force : report.motion_forces) add(force);
  for (const Vec3& force : report.plane_forces) add(force);
}

struct Times {
  double step_ms = 0, per_second = 0;
};

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

// One run. trace: filled if given.
Times run_once(const Scenario& scenario, const Scene& scene, const std::vector<MaterialPoint>& points,
               int threads, Trace* trace) {
  auto devices = make_devices(scenario);
  const auto read = [&](double time_s) {
    std::vector<DeviceSample> samples(devices.size());
    for (std::size_t d = 0; d < devices.size(); ++d) {
      if (devices[d]->read(time_s, samples[d]) != DeviceError::none) {
        throw InputError("device " + std::to_string(d) + ": it has no sample for " + std::to_string(time_s) +
                         " s; let its last way-point be at or after /time/duration_s");
      }
    }
    return samples;
  };
  for (auto& device : devices) {
    device->open();
    device->calibrate();
    device->arm();
  }
  State state = initial_state(scene, read(0));
  WorkspacePtr workspace = make_workspace(scene, threads);
  StepReport report = make_report(scene);
  if (trace != nullptr) {
    trace->step_s = scene.settings.step_s;
    look(scene, points, state, report, *trace);
  }
  StageClock clock;
  std::vector<double> step_ms;
  double sum_s = 0;
  for (std::int64_t n = 0; n < scenario.steps(); ++n) {
    const auto samples = read(static_cast<double>(n + 1) * scene.settings.step_s);
    clock.start();
    step(scene, samples, state, report, *workspace, &clock);
    step_ms.push_back(1e3 * clock.total());
    sum_s += clock.total();
    for (std::size_t t = 0; t < devices.size(); ++t) {
      devices[t]->write({report.tools[t].displayed_force, report.tools[t].displayed_torque,
                         report.time_s + 2 * scene.settings.step_s});
    }
    if (trace == nullptr) continue;
    if (!report.finite) {
      trace->problem = "step " + std::to_string(n) + ": " + explain_failure(scene, samples, state);
      break;
    }
    look(scene, points, state, report, *trace);
    trace->iterations += report.iterations / static_cast<double>(scenario.steps());
    trace->converged += report.converged / static_cast<double>(scenario.steps());
  }
  for (auto& device : devices) device->close();
  return {median(step_ms), sum_s / (static_cast<double>(step_ms.size()) * scene.settings.step_s)};
}

// Entry i of a series at a time, straight between steps.
double at(const std::vector<std::vector<double>>& series, double step_s, double time_s, std::size_t i) {
  const double place = std::clamp(time_s / step_s, 0.0, static_cast<double>(series.size() - 1));
  const auto before = std::min(static_cast<std::size_t>(place), series.size() - 1);
  const auto after = std::min(before + 1, series.size() - 1);
  const double share = place - static_cast<double>(before);
  return (1 - share) * series[before][i] + share * series[after][i];
}

struct Difference {
  double relative = NAN, reference = 0;  // root mean squares
};

Difference compare(const std::vector<std::vector<double>>& a, double step_a,
                   const std::vector<std::vector<double>>& reference, double step_reference, double end_s) {
  const std::size_t entries = reference.front().size();
  if (entries == 0 || a.front().size() != entries) return {};
  double difference = 0, size = 0;
  for (std::size_t m = 1; m <= moments; ++m) {
    const double time_s = end_s * static_cast<double>(m) / static_cast<double>(moments);
    for (std::size_t i = 0; i < entries; ++i) {
      const double expected = at(reference, step_reference, time_s, i);
      const double d = at(a, step_a, time_s, i) - expected;
      difference += d * d;
      size += expected * expected;
    }
  }
  const double places = static_cast<double>(moments * entries) / 3;
  return {size > 0 ? std::sqrt(difference / size) : NAN, std::sqrt(size / places)};
}

// What the reference is by default: see the help.
std::vector<std::string> reference_settings(const WorkPrecisionOptions& options,
                                            const std::vector<Varied>& varied,
                                            const std::vector<Scenario>& scenarios) {
  std::vector<std::string> settings = options.overrides;
  for (const Varied& one : varied) settings.push_back(one.key + "=" + one.values.front());
  double step_s = INFINITY, size_m = INFINITY;
  for (const Scenario& scenario : scenarios) {
    step_s = std::fmin(step_s, scenario.scene.step_s);
    size_m = std::fmin(size_m, scenario.scene.embedding.size_m);
  }
  const auto number = [](double value) {
    char text[40];
    std::snprintf(text, sizeof text, "%.9g", value);
    return std::string(text);
  };
  settings.push_back("/solver/precision=double");
  settings.push_back("/solver/tolerance=1e-8");
  settings.push_back("/solver/max_iterations=100000");
  settings.push_back("/time/step_s=" + number(step_s / 4));
  settings.push_back("/mesh/size_mm=" + number(1e3 * size_m));
  settings.insert(settings.end(), options.reference.begin(), options.reference.end());
  return settings;
}

// The last setting of each key, for the page.
std::vector<std::string> without_overridden(const std::vector<std::string>& settings) {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < settings.size(); ++i) {
    const std::string key = settings[i].substr(0, settings[i].find('=') + 1);
    const bool again = std::any_of(settings.begin() + static_cast<std::ptrdiff_t>(i) + 1, settings.end(),
                                   [&](const std::string& later) { return later.starts_with(key); });
    if (!again) out.push_back(settings[i]);
  }
  return out;
}

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "an unknown processor";
}

// Whether a choice of the varied keys is what the scenario has by itself. A key that its file leaves out is
// looked up among the settings that are usually varied.
bool is_own(const Scenario& a, const Scenario& b, const std::vector<std::string>& keys) {
  static const std::set<std::string> usual = {
      "/time/step_s",           "/mesh/size_mm",          "/solver/tolerance", "/solver/precision",
      "/solver/preconditioner", "/solver/max_iterations", "/solver/start",     "/solver/velocity_floor_m_s"};
  const auto chosen = nlohmann::json::parse(a.resolved_json), own = nlohmann::json::parse(b.resolved_json);
  for (const std::string& key : keys) {
    const nlohmann::json::json_pointer place(key);
    if (own.contains(place) ? own.at(place) != chosen.at(place) : !usual.contains(key)) return false;
  }
  const SolverSettings &s = a.scene.solver, &t = b.scene.solver;
  return a.scene.step_s == b.scene.step_s && a.scene.embedding.size_m == b.scene.embedding.size_m &&
         s.tolerance == t.tolerance && s.precision == t.precision && s.preconditioner == t.preconditioner &&
         s.max_iterations == t.max_iterations && s.first_guess == t.first_guess &&
         s.velocity_floor_m_s == t.velocity_floor_m_s;
}

}  // namespace

int work_precision_command(const WorkPrecisionOptions& options) {
  const fs::path path = find_scenario(options.scenario);
  std::vector<Varied> varied;
  for (const std::string& text : options.varied) varied.push_back(read_varied(text));
  WorkPrecisionStudy study;
  for (const Varied& one : varied) {
    if (std::ranges::count(study.keys, one.key) > 0)
      throw InputError("--vary: " + one.key + " is given twice; name all its values in one");
    study.keys.push_back(one.key);
  }

  // everything is read and checked before anything runs
  std::vector<Scenario> scenarios;
  const Scenario own = load_scenario(path, options.overrides, recorded_hand);
  for (const std::vector<std::string>& choice : choices(varied)) {
    std::vector<std::string> settings = options.overrides;
    for (std::size_t k = 0; k < choice.size(); ++k) settings.push_back(varied[k].key + "=" + choice[k]);
    scenarios.push_back(load_scenario(path, settings, recorded_hand));
    study.rows.push_back({});
    study.rows.back().values = choice;
    study.rows.back().own = is_own(scenarios.back(), own, study.keys);
  }
  study.reference = without_overridden(reference_settings(options, varied, scenarios));
  const Scenario reference = load_scenario(path, study.reference, recorded_hand);
  std::vector<std::string> doubled = study.reference;
  char step[40];
  std::snprintf(step, sizeof step, "/time/step_s=%.17g", 2 * reference.scene.step_s);
  doubled.push_back(step);
  const Scenario longer_steps = load_scenario(path, doubled, recorded_hand);
  std::vector<Scene> scenes;
  for (const Scenario& scenario : scenarios) scenes.push_back(make_scene(scenario));
  const Scene reference_scene = make_scene(reference), longer_scene = make_scene(longer_steps);
  std::vector<const Scene*> all{&reference_scene};
  for (const Scene& scene : scenes) all.push_back(&scene);
  const std::vector<std::size_t> voxels = common_voxels(all);
  std::error_code error;
  fs::create_directories(options.out, error);
  if (error || !fs::is_directory(options.out))
    throw InputError(options.out.string() + " is no folder and cannot be made one; give another --out");

  const int threads = threads_or_all(options.threads);
  study.scenario = reference.name;
  study.machine = processor();
  study.settings = options.overrides;
  study.threads = threads;
  study.repetitions = options.repetitions;
  Progress progress(reference.name + ": runs",
                    2 + static_cast<std::int64_t>(scenes.size()) * options.repetitions);
  Trace exact, check;
  run_once(reference, reference_scene, locate(reference_scene, voxels), threads, &exact);
  progress.at(1);
  run_once(longer_steps, longer_scene, locate(longer_scene, voxels), threads, &check);
  progress.at(2);
  if (!exact.problem.empty()) throw InputError("the reference stopped at " + exact.problem);
  const double end_s = reference.duration_s;
  const auto of_displacement = [&](const Trace& trace) {
    return compare(trace.displacements, trace.step_s, exact.displacements, exact.step_s, end_s);
  };
  const auto of_force = [&](const Trace& trace) {
    return compare(trace.forces, trace.step_s, exact.forces, exact.step_s, end_s);
  };
  study.reference_displacement_error = of_displacement(check).relative;
  study.reference_force_error = of_force(check).relative;
  study.displacement_mm = 1e3 * of_displacement(check).reference;
  study.force_N = of_force(check).reference;

  std::vector<std::vector<double>> step_ms(scenes.size()), per_second(scenes.size());
  for (int repetition = 0; repetition < options.repetitions; ++repetition) {
    for (std::size_t s = 0; s < scenes.size(); ++s) {
      WorkPrecisionRow& row = study.rows[s];
      Trace trace;
      const Times times = run_once(scenarios[s], scenes[s], locate(scenes[s], voxels), threads, &trace);
      step_ms[s].push_back(times.step_ms);
      per_second[s].push_back(times.per_second);
      progress.at(2 + repetition * static_cast<std::int64_t>(scenes.size()) + static_cast<std::int64_t>(s) +
                  1);
      if (repetition > 0) continue;
      row.problem = trace.problem;
      row.displacement_error = of_displacement(trace).relative;
      row.force_error = of_force(trace).relative;
      row.iterations = trace.iterations;
      row.converged_share = trace.converged;
    }
  }
  for (std::size_t s = 0; s < scenes.size(); ++s) {
    study.rows[s].step_ms = median(step_ms[s]);
    study.rows[s].per_second = median(per_second[s]);
  }
  mark_fronts(study);
  write_work_precision(options.out, study);
  std::printf("%s\nin %s\n", work_precision_markdown(study, "work_precision.png").c_str(),
              options.out.string().c_str());
  return 0;
}

}  // namespace sulcus
