#include "tools/sulcus/support.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <thread>

#include "engine/mesh/topology.h"
#include "engine/numerics/error.h"
#include "engine/numerics/isa.h"
#include "tools/sulcus/build_info.h"
#include "tools/sulcus/git_version.h"
#include "tools/sulcus/golden_pictures.h"
#include "verify/fingerprint.h"
#include "verify/golden.h"
#include "verify/golden_provenance.h"
#include "verify/measures.h"
#include "verify/summary.h"

namespace sulcus {
namespace fs = std::filesystem;

int threads_or_all(int threads) {
  if (threads > 0) return threads;
  return static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

std::map<std::string, std::string> build_provenance() {
  return {{"version", SULCUS_VERSION},   {"git", SULCUS_GIT},
          {"compiler", SULCUS_COMPILER}, {"build type", SULCUS_BUILD_TYPE},
          {"flags", SULCUS_FLAGS},       {"instruction set", isa_name(widest_isa())}};
}

fs::path find_scenario(const std::string& name_or_path) {
  if (fs::exists(name_or_path)) return name_or_path;
  for (const fs::path& directory : {fs::path("scenarios"), fs::path(SULCUS_SCENARIO_DIR)}) {
    for (const fs::path& folder : {directory, directory / "hard"}) {
      const fs::path path = folder / (name_or_path + ".json");
      if (fs::exists(path)) return path;
    }
  }
  throw InputError(name_or_path + ": no such scenario; give a JSON file, or a name that `sulcus list` shows");
}

fs::path golden_folder(const fs::path& golden, const std::string& scenario) {
  return fs::exists(golden / "golden.json") ? golden : golden / scenario;
}

void prepare_folder(const fs::path& out, bool force) {
  std::error_code error;
  if (fs::exists(out)) {
    const bool is_run =
        fs::exists(out / "run.h5") || fs::exists(out / "run.h5.part") || fs::exists(out / "run.h5.log");
    if (!fs::is_directory(out)) throw InputError(out.string() + " is not a folder; give another --out");
    if (!force && !fs::is_empty(out)) {
      throw InputError(out.string() +
                       " exists already; give another --out, or --force to replace the run in it");
    }
    if (force && !fs::is_empty(out) && !is_run) {
      throw InputError(out.string() +
                       " holds no run of Sulcus, so --force does not empty it; give another --out");
    }
    for (const char* name :
         {"run.h5", "run.h5.part", "run.h5.log", "summary.json", "junit.xml", "report.html", "pictures"}) {
      fs::remove_all(out / name, error);
    }
  }
  fs::create_directories(out / "pictures", error);
  if (error) {
    throw EnvironmentError(out.string() + ": cannot be made (" + error.message() +
                           "); give an --out that can be written to");
  }
}

std::map<std::string, double> topology_numbers(const Scene& scene) {
  // pieces of the voxels that the mesh holds: small islands may have been left out on purpose
  LabelMap meshed = scene.settings.map;
  std::int64_t left_out = 0;
  for (std::size_t v = 0; v < meshed.labels.size(); ++v) {
    if (scene.mesh.cell_of_voxel[v] >= 0 || meshed.labels[v] == 0) continue;
    meshed.labels[v] = 0;
    ++left_out;
  }
  const Pieces of_mesh = mesh_pieces(scene.mesh.tets, scene.node_count());
  const auto of_voxels = voxel_pieces(meshed, scene.settings.pairs);
  return {{"cells", static_cast<double>(scene.mesh.cell_nodes.size())},
          {"nodes", static_cast<double>(scene.node_count())},
          {"tets", static_cast<double>(scene.tet_count())},
          {"mesh_pieces", static_cast<double>(of_mesh.item_count.size())},
          {"voxels_left_out", static_cast<double>(left_out)},
          {"voxel_pieces", static_cast<double>(of_voxels.item_count.size())}};
}

namespace {

StatementBounds bounds_of(const Scenario& scenario) {
  StatementBounds bounds;
  bounds.max_penetration_m = scenario.checks.max_penetration_m;
  bounds.max_displayed_force_N = scenario.checks.max_force_N;
  bounds.max_solver_error = scenario.checks.max_solver_error;
  bounds.max_final_displacement_m = scenario.checks.returns_to_rest_m;
  bounds.contact_expected = !scenario.scene.tools.empty() && scenario.checks.contact_expected;
  if (scenario.checks.max_energy_growth) bounds.max_energy_growth = scenario.checks.max_energy_growth;
  // prescribed motions, forces and gravity do work that the statement about energies at rest does not know
  if (!scenario.motions.empty() || !scenario.forces.empty() || scenario.scene.gravity.norm() > 0)
    bounds.max_energy_growth.reset();
  if (scenario.scene.fracture) {
    bounds.torn = TornBounds{scenario.scene.fracture->avoid_singularities,
                             scenario.checks.min_torn_elements,
                             scenario.checks.max_torn_elements,
                             scenario.checks.labels_stay,
                             scenario.checks.max_hanging_elements,
                             scenario.checks.min_hanging_energy_J};
  }
  bounds.max_kinetic_energy_J = scenario.checks.max_kinetic_energy_J;
  bounds.pieces_at_start = scenario.checks.pieces_at_start;
  bounds.pieces_at_end = scenario.checks.pieces_at_end;
  return bounds;
}

double peak(const Series* series) {  // of a series of one component
  if (series == nullptr || series->values.empty()) return 0;
  return *std::max_element(series->values.begin(), series->values.end());
}

// Elements of a recorded frame whose volume is not positive.
std::int64_t inverted_elements(const RunHeader& mesh, const Frame& frame) {
  std::int64_t inverted = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); t += 4) {
    if (!frame.alive[t / 4]) continue;
    std::array<Vec3, 4> x;
    for (std::size_t c = 0; c < 4; ++c) {
      const auto n = static_cast<std::size_t>(mesh.tets[t + c]);
      x[c] = {frame.positions[3 * n], frame.positions[3 * n + 1], frame.positions[3 * n + 2]};
    }
    if (!((x[1] - x[0]).dot((x[2] - x[0]).cross(x[3] - x[0])) > 0)) ++inverted;
  }
  return inverted;
}

// The bounds that a scenario sets for itself: that the run shows what it is about, and how well it was
// solved.
void check_peaks(const RunData& run, const Scenario& scenario, std::vector<Check>& checks) {
  if (scenario.checks.min_peak_force_N) {
    double force = 0;
    for (const ToolSummary& tool : summarise(run).tools) force = std::max(force, tool.max_displayed_force_N);
    checks.push_back(check_at_least("peak_force", "statement", force, *scenario.checks.min_peak_force_N, "N",
                                    run.steps, "largest displayed force of the run"));
  }
  if (scenario.checks.min_peak_displacement_m) {
    checks.push_back(check_at_least(
        "peak_displacement", "statement", peak(run.find("tissue/max_displacement_m")),
        *scenario.checks.min_peak_displacement_m, "m", run.steps, "largest displacement of a node"));
  }
  if (scenario.checks.max_residual) {
    checks.push_back(check_at_most("residual", "statement", peak(run.find("solver/residual")),
                                   *scenario.checks.max_residual, "", run.steps,
                                   "largest relative residual"));
  }
  if (scenario.checks.max_inverted_elements) {
    std::int64_t most = 0;
    for (const Frame& frame : run.frames) most = std::max(most, inverted_elements(run.header, frame));
    checks.push_back(check_at_most("inverted_in_frames", "statement", static_cast<double>(most),
                                   static_cast<double>(*scenario.checks.max_inverted_elements), "",
                                   static_cast<std::int64_t>(run.frames.size()),
                                   "most inverted elements of a frame"));
  }
}

std::vector<Measure> measures_of(const Scenario& scenario) {
  std::vector<Measure> measures;
  for (const MeasureBounds& m : scenario.checks.measures) {
    measures.push_back(
        {m.what, m.tool, m.path, m.from_s, m.to_s, m.above_Hz, m.within_rad, m.along, m.at_least, m.at_most});
  }
  return measures;
}

}  // namespace

std::vector<Check> check_run(const RunData& run, const fs::path& run_dir, const fs::path& golden) {
  const Scenario scenario = load_scenario_text(run.header.scenario_json, run_dir / "run.h5", ".");
  // The scenario's own bounds are about its script; a hand in a session goes where it wants.
  StatementBounds bounds = bounds_of(scenario);
  if (run.session) {
    bounds = StatementBounds();
    bounds.max_energy_growth.reset();
    bounds.contact_expected = false;
  }
  std::vector<Check> checks = check_statements(run, bounds);
  if (!run.session) {
    check_peaks(run, scenario, checks);
    for (Check& check : check_measures(run, measures_of(scenario))) checks.push_back(std::move(check));
  }
  if (!golden.empty() && scenario.golden.kept) {
    const fs::path folder = golden_folder(golden, run.header.scenario_name);
    for (Check& check : compare_golden(run, folder)) checks.push_back(std::move(check));
    for (Check& check : check_pictures(run_dir, folder, scenario.golden)) checks.push_back(std::move(check));
    checks.push_back(check_provenance(folder));
  }
  return checks;
}

Progress::Progress(std::string what, std::int64_t total)
    : what_(std::move(what)), total_(total), start_(std::chrono::steady_clock::now()), shown_(start_) {}

Progress::~Progress() {
  if (visible_) std::fputs("\n", stderr);
}

void Progress::at(std::int64_t done) {
  const auto now = std::chrono::steady_clock::now();
  if (now - start_ < std::chrono::seconds(2) || now - shown_ < std::chrono::seconds(1)) return;
  shown_ = now;
  visible_ = true;
  std::fprintf(stderr, "\r%s: %lld of %lld (%.0f s)", what_.c_str(), static_cast<long long>(done),
               static_cast<long long>(total_), std::chrono::duration<double>(now - start_).count());
}

bool is_finite(const DeviceSample& s) {
  const Quaternion& q = s.orientation;
  return s.position.allFinite() && s.linear_velocity.allFinite() && s.angular_velocity.allFinite() &&
         std::isfinite(q.s + q.x + q.y + q.z);
}

RunHeader recording_header(const Scenario& scenario, const Scene& scene,
                           const std::vector<std::string>& overrides, int threads) {
  RunHeader header = make_run_header(scene);
  header.scenario_name = scenario.name;
  header.scenario_json = scenario.resolved_json;
  header.overrides = overrides;
  header.build = build_provenance();
  header.threads = threads;
  for (const fs::path& file : scenario.input_files) header.inputs[file.string()] = hash_file(file);
  return header;
}

}  // namespace sulcus
