#include "verify/test_run.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "verify/fingerprint.h"

namespace sulcus::test {

RunHeader small_header() {
  RunHeader header;
  header.scenario_name = "small";
  header.scenario_json = R"({"name": "small", "note": "µ, \"quoted\""})";
  header.overrides = {"/step_s=0.01", ""};
  header.build = {{"compiler", "gcc 12"}, {"git", "v0-1-gabcdef"}};
  header.inputs = {{"brain.nii.gz", "00ff"}};
  header.threads = 2;
  header.step_s = 0.01;
  header.tool_names = {"spatula"};
  header.rest_positions = {0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01, 0.01, 0.01, 0.01};
  header.tets = {0, 1, 2, 3, 1, 2, 3, 4};
  return header;
}

State small_state(const RunHeader& header) {
  State state;
  state.positions = header.rest_positions;
  state.velocities.assign(state.positions.size(), 0.0);
  state.rotations = {1, 0, 0, 0, 1, 0, 0, 0};
  state.alive = {1, 1};
  state.steps_above = {0, 0};
  state.tool_poses = {0, 0, 0.05, 1, 0, 0, 0};
  state.tool_momenta.assign(6, 0.0);
  state.filtered_forces.assign(6, 0.0);
  return state;
}

// The tool's depth over the steps, m: in by 0.1 mm a step, rest, out again, gone.
static double depth_at(std::int64_t n) {
  if (n < 20) return 0;
  if (n < 60) return 1e-4 * static_cast<double>(n - 20);
  if (n < 200) return 4e-3;
  return std::max(0.0, 4e-3 - 1e-4 * static_cast<double>(n - 200));
}

SmallStep advance(const RunHeader& header, std::int64_t n, State& state) {
  const double depth_m = depth_at(n);
  const double speed_m_s = (depth_m - depth_at(n - 1)) / header.step_s;
  SmallStep step;
  DeviceSample sample;
  sample.sequence = static_cast<std::uint64_t>(n) + (1ull << 60);
  sample.time_s = static_cast<double>(n + 1) * header.step_s;
  sample.interval_s = header.step_s;
  sample.position = {0, 0, 0.05 - depth_m};
  sample.orientation = {0.6, 0, 0.8, 0};
  sample.linear_velocity = {0, 0, -speed_m_s};
  sample.linear_velocity_valid = true;
  sample.buttons = static_cast<std::uint32_t>(n % 3);
  sample.docked = n < 5;
  sample.force_sent = {0.1, 0.2, 0.3};
  sample.motor_temperature = 0.25;
  step.samples = {sample};

  state.step = n + 1;
  state.positions[14] = header.rest_positions[14] - depth_m;
  state.velocities[14] = -speed_m_s;
  state.tool_poses = {0, 0, 0.05 - depth_m, 1, 0, 0, 0};
  state.tool_momenta[2] = -0.02 * speed_m_s;

  StepReport& report = step.report;
  report.step = n;
  report.time_s = sample.time_s;
  report.iterations = static_cast<std::int32_t>(10 + n % 4);
  report.residual = 1e-7;
  report.converged = true;
  report.kinetic_energy_J = 1e-3 * speed_m_s * speed_m_s;
  report.elastic_energy_J = 50 * depth_at(n - 1) * depth_at(n - 1);
  report.tools.resize(1);
  ToolReport& tool = report.tools[0];
  tool.contact_force = {0, 1e-3 * depth_m, 100 * depth_m};
  tool.contact_torque = {depth_m, 0, 0};
  tool.tissue_force = -tool.contact_force * (1 + 1e-14);
  tool.displayed_force = 0.9 * tool.contact_force;
  tool.max_penetration_m = 0.1 * depth_m;
  tool.contacts = depth_m > 0 ? 12 : 0;
  tool.min_push_N = 5 * depth_m;
  step.stage_s = {0.001, 0.002, 0.003, 0.0005, 0};
  return step;
}

std::uint64_t record_small_run(const std::filesystem::path& path, std::int64_t steps) {
  const RunHeader header = small_header();
  State state = small_state(header);
  RunWriter writer(path, header, state);
  writer.write_frame(state, 0);
  for (std::int64_t n = 0; n < steps; ++n) {
    const SmallStep step = advance(header, n, state);
    writer.write_step(step.samples, step.report, state, step.stage_s, 0.007);
    if (n % 100 == 50) {
      writer.write_frame(state, step.report.time_s, std::vector<double>{100.0, 200.0});
      writer.write_solver_error(n, 1e-4 * static_cast<double>(n));
    }
  }
  writer.add_warning("label 7 is absent");
  writer.add_event(21, "first contact");
  writer.set_number("cells", 1);
  writer.set_number("mesh_pieces", 1);
  writer.set_number("voxel_pieces", 1);
  writer.set_number("inverted_elements_at_end", 0);
  writer.finish(state);
  return writer.fingerprint();
}

RunData small_run(std::int64_t steps) {
  const std::filesystem::path path = scratch_dir() / "small.h5";
  record_small_run(path, steps);
  return read_run(path);
}

namespace {

// Removed when the program ends; child processes of tests leave it to their parent.
struct ScratchRoot {
  std::filesystem::path path;
  pid_t owner = ::getpid();

  ScratchRoot() {
    std::string pattern = (std::filesystem::temp_directory_path() / "sulcus_verify_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) std::abort();
    path = pattern;
  }
  ~ScratchRoot() {
    std::error_code ignored;
    if (::getpid() == owner) std::filesystem::remove_all(path, ignored);
  }
};

}  // namespace

std::filesystem::path scratch_dir() {
  static const ScratchRoot root;
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  const std::filesystem::path dir = root.path / (std::string(info->test_suite_name()) + "." + info->name());
  std::filesystem::create_directories(dir);
  return dir;
}

std::string read_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << text;
}

}  // namespace sulcus::test
