// What the subcommands share.
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "engine/scene/step.h"
#include "scenarios/loader/scenario.h"
#include "verify/check.h"
#include "verify/recording.h"
#include "verify/statements.h"
#include "verify/step_tree.h"

namespace sulcus {

int threads_or_all(int threads);  // threads, or all that the machine has for 0
std::map<std::string, std::string> build_provenance();

// Header of a recording: mesh and tools of the scene, the scenario with its overrides and the hashes of its
// files.
// Pose and velocities.
bool is_finite(const DeviceSample& sample);

RunHeader recording_header(const Scenario& scenario, const Scene& scene,
                           const std::vector<std::string>& overrides, int threads);
std::filesystem::path find_scenario(const std::string& name_or_path);

// A folder for a run: new, or with `force` emptied of an earlier run.
void prepare_folder(const std::filesystem::path& out, bool force);

// "cells", "mesh_pieces", "voxel_pieces", ...: what the statements need to know of the mesh.
std::map<std::string, double> topology_numbers(const Scene& scene);

// The log of a session becomes run.h5 and summary.json in `out`; the log goes, and the numbers are printed.
void record_log(const std::filesystem::path& log, const std::filesystem::path& out, const Scenario& scenario,
                const Scene& scene, int threads);
void print_session(const RunData& run);  // nothing for a recording that is no session

// Statements, and golden comparison (values, bits, pictures) if `golden` is not empty: a folder with
// golden.json, or with <scenario>/golden.json.
std::vector<Check> check_run(const RunData& run, const std::filesystem::path& run_dir,
                             const std::filesystem::path& golden);
std::filesystem::path golden_folder(const std::filesystem::path& golden, const std::string& scenario);

// Shows on standard error how far a long job is, from two seconds on, once a second.
class Progress {
 public:
  Progress(std::string what, std::int64_t total);
  ~Progress();
  void at(std::int64_t done);

 private:
  std::string what_;
  std::int64_t total_;
  std::chrono::steady_clock::time_point start_, shown_;
  bool visible_ = false;
};

// Wall clock of the stages of a step.
class StageClock : public StageObserver {
 public:
  void start() {
    seconds_.fill(0.0);
    last_ = std::chrono::steady_clock::now();
  }
  void stage_done(Stage stage) override {
    const auto now = std::chrono::steady_clock::now();
    seconds_[static_cast<std::size_t>(stage)] += std::chrono::duration<double>(now - last_).count();
    last_ = now;
  }
  void go_on() { last_ = std::chrono::steady_clock::now(); }  // what happened since the stage is not counted
  const std::array<double, stage_count>& seconds() const { return seconds_; }
  double total() const {
    double sum = 0;
    for (double s : seconds_) sum += s;
    return sum;
  }

 private:
  std::array<double, stage_count> seconds_{};
  std::chrono::steady_clock::time_point last_;
};

// Both, and the hashes take time that is none of the step's.
struct ClockAndTree : StageObserver {
  ClockAndTree(StageClock& the_clock, StepTree& the_tree) : clock(the_clock), tree(the_tree) {}
  void stage_done(Stage stage) override {
    clock.stage_done(stage);
    tree.stage_done(stage);
    clock.go_on();
  }
  StageClock& clock;
  StepTree& tree;
};

}  // namespace sulcus
