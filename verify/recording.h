// The recording of a run, run.h5 (HDF5, docs/recording-format.md): enough to run it again from the device
// samples alone, to compare it step by step, to check it, to report on it, and to go on from its last state.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/device/device.h"
#include "engine/scene/state.h"
#include "engine/scene/step.h"
#include "verify/session.h"

namespace sulcus {

inline constexpr int recording_format_version = 2;

// What is known before the first step. All of it is recorded as given.
struct RunHeader {
  std::string scenario_name;
  std::string scenario_json;                  // resolved: defaults and overrides are in it
  std::vector<std::string> overrides;         // of the command line, "/json/pointer=value"
  std::map<std::string, std::string> build;   // provenance: "version", "git", "compiler", "flags", ...
  std::map<std::string, std::string> inputs;  // input file as named in the scenario -> hash_file()
  int threads = 1;
  double step_s = 0;                        // s, time step
  std::vector<std::string> tool_names;      // [tools]
  std::vector<std::string> motion_names;    // [motions]; with fractures, says which series there are
  std::vector<std::string> obstacle_names;  // [obstacles]
  std::vector<std::string> stage_leaves;    // stage_leaf_names(), if the steps' stages are hashed too
  std::size_t plane_count = 0;              // not read back: series planes/... tell
  bool ledger = false;                      // whether there are series energy/..., likewise
  bool fractures = false;                   // not read back: a series fracture/... tells
  std::vector<double> rest_positions;       // [3*nodes], m
  std::vector<std::int32_t> tets;           // [4*tets]
  std::optional<SessionHeader> session;     // of a session in real time

  std::int64_t tool_count() const { return static_cast<std::int64_t>(tool_names.size()); }
  std::int64_t node_count() const { return static_cast<std::int64_t>(rest_positions.size() / 3); }
  std::int64_t tet_count() const { return static_cast<std::int64_t>(tets.size() / 4); }
};
RunHeader make_run_header(const Scene& scene);  // mesh, tools and time step; the caller adds the rest

// One quantity over all steps; entry n belongs to the step with number n.
//
//   time_s  finite (0/1)
//   solver/iterations  solver/residual  solver/converged (0/1)
//   tissue/kinetic_energy_J  tissue/elastic_energy_J  tissue/max_displacement_m  tissue/max_speed_m_s
//   tissue/alive_tets
//   fracture/by_criterion  by_avoidance  detached  passes  margin  lost_volume_m3       (scenes that
//   fracture) motions/<i>/force_N [3]                                                             (of nodes
//   on paths) planes/<i>/force_N [3]  (on the nodes that slide on them)
//   stage/<contacts|assembly|solve|update|fracture>_s  stage/total_s      wall clock, from the caller
//   tools/<i>/contact_force_N [3]   contact_torque_N_m [3]  tissue_force_N [3]       (i from 0)
//             coupling_force_N [3]  coupling_torque_N_m [3] displayed_force_N [3]  displayed_torque_N_m [3]
//             max_penetration_m  contacts  dropped_contacts  min_push_N  force_limited  sample_refused
//             position_m [3]  orientation [4]  linear_momentum_kg_m_s [3]  angular_momentum_kg_m2_s [3]
//   energy/<field of EnergyBalance>        scenes with a ledger
//   obstacles/<i>/contact_force_N [3]  max_penetration_m  contacts  dropped_contacts
//   device/<i>/<field of DeviceSample>   sequence  time_s  interval_s  position_m [3]  orientation [4]
//             linear_velocity_m_s [3]  angular_velocity_rad_s [3]  linear_velocity_valid
//             angular_velocity_valid docked  buttons  force_sent_N [3]  motor_temperature
//   session/<due|read|published>_s         of sessions: SessionStep
struct Series {
  std::string unit;  // "" for plain numbers
  int components = 1;
  std::vector<double> values;  // [steps*components]
};

struct SolverErrorSample {
  std::int64_t step = 0;  // number of the step that was measured
  double error = 0;       // relative, of measure_solver_error
};

struct RunEvent {
  std::int64_t step = 0;
  std::string text;
};

// A state to look at. step: steps done (0 = before the first).
struct Frame {
  std::int64_t step = 0;
  double time_s = 0;
  std::vector<double> positions;    // [3*nodes], m
  std::vector<double> tool_poses;   // [7*tools]
  std::vector<std::uint8_t> alive;  // [tets]
  std::vector<double> stress_Pa;    // [tets], max_principal_stress; NaN in frames written without
};

struct RunData {
  RunHeader header;
  std::int64_t steps = 0;
  std::vector<DeviceSample> samples;  // [steps*tools], step-major, exact
  std::map<std::string, Series> series;
  std::vector<std::string> field_names;     // of the state
  std::vector<std::uint64_t> fingerprints;  // [steps+1], chain; entry n: after n steps
  std::vector<std::uint64_t> field_hashes;  // [(steps+1)*fields], step-major
  std::vector<std::uint64_t> stage_hashes;  // [steps*stage_leaves], step-major (verify/step_tree.h)
  std::vector<SolverErrorSample> solver_errors;
  std::vector<Frame> frames;
  State final_state;
  std::map<std::string, double>
      numbers;  // "cells", "mesh_pieces", "voxel_pieces", "inverted_elements_at_end", ...
  std::vector<std::string> warnings;
  std::vector<RunEvent> events;
  std::optional<SessionData> session;  // of a session in real time

  std::uint64_t fingerprint() const { return fingerprints.empty() ? 0 : fingerprints.back(); }
  const Series* find(const std::string& name) const;  // nullptr if not recorded
};

// What a step leaves in the series and in the fingerprint: a few kilobytes.
struct StepRow {
  std::vector<double> numbers;  // of all series above but the device's and the session's, in their order
  std::vector<std::uint64_t> hashes;        // one for each array of the state
  std::vector<std::uint64_t> stage_hashes;  // [header.stage_leaves]
};
// stage_s: [stage_count]. The memory of `row` is used again.
void make_step_row(const RunHeader& header, const StepReport& report, const State& state,
                   std::span<const double> stage_s, double total_s, StepRow& row);

// Writes a recording while the run goes on: to `path` + ".part", renamed to `path` by finish(). Keeps at most
// some hundred steps in memory. All members throw EnvironmentError with the place and the remedy if the disk
// is full, the place cannot be written to, or HDF5 fails; afterwards the writer only refuses. Without
// finish() nothing stands under the final name; what was written stays under partial_path() (not sealed:
// read_run refuses it and says so).
class RunWriter {
 public:
  // initial: the state before the first step; its hash is the first link of the chain. An existing file is
  // replaced at finish(). Throws InputError if the header contradicts itself or the state.
  RunWriter(std::filesystem::path path, const RunHeader& header, const State& initial);
  ~RunWriter();
  RunWriter(const RunWriter&) = delete;
  RunWriter& operator=(const RunWriter&) = delete;

  // One step that was done: the samples it was given [tools], its report, the state after it, and the
  // wall-clock seconds of its stages [stage_count] and of all of it (0 where not measured; never part of the
  // fingerprint). stage_hashes: [header.stage_leaves].
  void write_step(std::span<const DeviceSample> samples, const StepReport& report, const State& state,
                  std::span<const double> stage_s, double total_s,
                  std::span<const std::uint64_t> stage_hashes = {});
  // The same from what make_step_row made of it; with the times of the step in a session.
  void write_row(std::span<const DeviceSample> samples, const StepRow& row, const SessionStep& times = {});
  void write_frame(const State& state, double time_s, std::span<const double> stress_Pa = {});
  void write_tick(std::size_t tool, const ServoTick& tick);  // of a session
  void write_histograms(std::span<const Histogram> histograms);
  void write_solver_error(std::int64_t step, double error);
  void add_warning(const std::string& text);
  void add_event(std::int64_t step, const std::string& text);
  void set_number(const std::string& name, double value);

  void finish(const State& final_state);

  std::uint64_t fingerprint() const;  // of the steps so far
  const std::filesystem::path& partial_path() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Reads a finished recording. Throws InputError, which says what is wrong, if the file is missing, not a
// recording, of another format version, unfinished, cut, damaged (its seal does not fit its bytes), or if its
// arrays contradict each other. Never allocates more than about a thousand times the file's size.
RunData read_run(const std::filesystem::path& path);

// Writes the seal (length and XXH3 of all bytes) into the user block of a recording. finish() does this; a
// program that edits a recording on purpose has to do it again.
void seal_recording(const std::filesystem::path& path);

}  // namespace sulcus
