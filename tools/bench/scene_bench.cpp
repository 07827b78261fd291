// A scenario's scene made, and its first steps done: what that costs, as JSON on standard output. tools/perf
// counts its instructions and compares its times between builds.
//
//   build/release/tools/scene_bench cylinder_retraction --steps 60 --isa avx2
//
// scene_ms: of making the scene; step_ms, stages_ms: medians over the steps; residual: the largest relative
// one that the solver left, the error the time was bought with; iterations, contacts, torn_elements: sums
// over the steps; tets, nodes: of the mesh.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "engine/scene/step.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {
namespace {

using Clock = std::chrono::steady_clock;

struct Options {
  std::string scenario;
  std::vector<std::string> overrides;
  std::int64_t steps = 0;  // 0: all
  int threads = 1;
  std::string isa;  // "": the widest of the machine
};

double milliseconds(Clock::duration time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Stages : StageObserver {
  std::array<std::vector<double>, stage_count> ms;
  Clock::time_point last;
  void stage_done(Stage stage) override {
    const auto now = Clock::now();
    ms[static_cast<std::size_t>(stage)].push_back(milliseconds(now - last));
    last = now;
  }
};

Isa isa_of(const std::string& name) {
  for (const Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
    if (name == isa_name(isa) && isa <= widest_isa()) return isa;
  }
  if (name.empty()) return widest_isa();
  throw InputError("--isa: found \"" + name +
                   "\", expected sse2, avx2 or avx512, and one that this processor has");
}

std::vector<DeviceSample> read(std::vector<std::unique_ptr<Device>>& devices, double time_s) {
  std::vector<DeviceSample> samples(devices.size());
  for (std::size_t d = 0; d < devices.size(); ++d) {
    if (devices[d]->read(time_s, samples[d]) != DeviceError::none)
      throw InputError("tool " + std::to_string(d) + ": its device has no sample for " +
                       std::to_string(time_s) + " s");
  }
  return samples;
}

nlohmann::ordered_json run(const Options& options) {
  std::filesystem::path path = options.scenario;
  if (path.extension() != ".json") path = SULCUS_SOURCE_DIR "/scenarios/" + options.scenario + ".json";
  const Scenario scenario = load_scenario(path, options.overrides);
  const auto start = Clock::now();
  const Scene scene = make_scene(scenario);
  const double scene_ms = milliseconds(Clock::now() - start);

  auto devices = make_devices(scenario);
  for (auto& device : devices) {
    device->open();
    device->calibrate();
    device->arm();
  }
  State state = initial_state(scene, read(devices, 0));
  WorkspacePtr workspace = make_workspace(scene, options.threads, isa_of(options.isa));
  StepReport report = make_report(scene);
  Stages stages;
  std::vector<double> step_ms;
  std::int64_t iterations = 0, contacts = 0, torn = 0;
  double residual = 0;
  const std::int64_t steps = options.steps > 0 ? std::min(options.steps, scenario.steps()) : scenario.steps();
  for (std::int64_t n = 0; n < steps; ++n) {
    const auto samples = read(devices, static_cast<double>(n + 1) * scene.settings.step_s);
    const auto begin = stages.last = Clock::now();
    step(scene, samples, state, report, *workspace, &stages);
    step_ms.push_back(milliseconds(Clock::now() - begin));
    if (!report.finite) throw InputError("step " + std::to_string(n) + ": the state is no longer finite");
    iterations += report.iterations;
    residual = std::max(residual, report.residual);
    for (const ToolReport& tool : report.tools) contacts += tool.contacts;
    for (const ObstacleReport& obstacle : report.obstacles) contacts += obstacle.contacts;
    if (report.fracture)
      torn += report.fracture->by_criterion + report.fracture->by_avoidance + report.fracture->detached;
    for (std::size_t t = 0; t < devices.size(); ++t) {
      devices[t]->write({report.tools[t].displayed_force, report.tools[t].displayed_torque,
                         report.time_s + 2 * scene.settings.step_s});
    }
  }
  for (auto& device : devices) device->close();

  nlohmann::ordered_json result = {{"scenario", scenario.name},
                                   {"steps", steps},
                                   {"scene_ms", scene_ms},
                                   {"step_ms", median(step_ms)},
                                   {"residual", residual},
                                   {"work",
                                    {{"iterations", iterations},
                                     {"contacts", contacts},
                                     {"torn_elements", torn},
                                     {"tets", scene.mesh.tets.size()},
                                     {"nodes", scene.mesh.rest_positions.size()}}}};
  for (std::size_t s = 0; s < stages.ms.size(); ++s) {
    if (!stages.ms[s].empty()) result["stages_ms"][stage_names[s]] = median(stages.ms[s]);
  }
  return result;
}

int command_line(int argc, char** argv) {
  CLI::App app("Makes a scenario's scene, does its first steps, and prints what that cost as JSON.");
  Options options;
  app.add_option("SCENARIO", options.scenario, "JSON file, or a name in scenarios/")->required();
  app.add_option("--steps", options.steps, "how many (default: all)")->check(CLI::PositiveNumber);
  app.add_option("--threads", options.threads, "of the engine")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--isa", options.isa, "sse2, avx2 or avx512 (default: the widest of this processor)");
  app.add_option("--set", options.overrides, "/json/pointer=value, changes the scenario")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  CLI11_PARSE(app, argc, argv);
  std::printf("%s\n", run(options).dump(1).c_str());
  return 0;
}

}  // namespace
}  // namespace sulcus

int main(int argc, char** argv) {
  try {
    return sulcus::command_line(argc, argv);
  } catch (const sulcus::EnvironmentError& error) {
    std::fprintf(stderr, "scene_bench: %s\n", error.what());
    return 3;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "scene_bench: %s\n", error.what());
    return 2;
  }
}
