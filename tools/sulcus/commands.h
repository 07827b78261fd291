// The sulcus command, one function a subcommand. Each returns the exit code: 0 fine, 1 a check failed. Input
// that is wrong leaves as InputError (exit code 2), surroundings that failed as EnvironmentError (3).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace sulcus {

struct RunOptions {
  std::string scenario;  // file, or the name of one in the scenarios' folder
  std::filesystem::path out;
  std::vector<std::string> overrides;  // "/json/pointer=value"
  int threads = 0;                     // 0: as many as the machine has
  bool force = false;                  // replace an earlier run in `out`
  bool pictures = true;
  std::uint64_t start_shift_seed = 0;  // not 0: every coordinate starts one ulp aside, up or down at random
};
int run_command(const RunOptions& options);

struct StaticOptions {
  std::string scenario;
  std::filesystem::path out;
  std::vector<std::string> overrides;
  double time_s = -1;  // s, whose places of the motions are meant; negative: the end of the scenario
  int threads = 0;
  bool force = false;
  bool pictures = true;
};
int static_command(const StaticOptions& options);

struct WorkPrecisionOptions {
  std::string scenario;
  std::filesystem::path out;
  std::vector<std::string> varied;     // "/json/pointer=value,value,..."
  std::vector<std::string> overrides;  // of all runs
  std::vector<std::string> reference;  // of the reference run, after the overrides
  int repetitions = 3;
  int threads = 0;
};
int work_precision_command(const WorkPrecisionOptions& options);

struct VerifyOptions {
  std::filesystem::path run;     // folder of a run
  std::filesystem::path golden;  // folder of golden outputs; empty: statements only
};
int verify_command(const VerifyOptions& options);

int summary_command(const std::filesystem::path& run, const std::filesystem::path& golden);

struct ReplayOptions {
  std::filesystem::path recording;  // run.h5
  int threads = 0;
  std::filesystem::path lockstep;  // another build of this program, to run beside; empty: none
  bool serve = false;              // is that other one
};
int replay_command(const ReplayOptions& options);

struct PhantomOptions {
  std::string library;      // file of libHD; empty: searched
  std::string device_name;  // empty: the driver's default
  double max_force_N = 0;   // N; 0: the default of docs/devices.md
  double turn_deg = 0;      // of the device about the scene's z
  double tip_offset_mm = 0;
  int hold_button = -1;
  double calibration_timeout_s = 30;  // s
};

struct SessionOptions {
  std::string scenario;
  std::string device = "scripted";  // phantom, scripted, recorded
  std::filesystem::path out;        // empty: a folder named by the time
  std::filesystem::path from;       // recorded: run.h5 or CSV
  std::string tool;                 // moved by a phantom or a CSV; empty: the first
  std::string hand;                 // scripted: light, firm, alone; empty: the script itself
  std::vector<std::string> faults;  // "name=value", of Perturbation
  std::vector<std::string> overrides;
  double filter_Hz = -1;  // Hz, cut-off of the rendered force; negative: the tool's of the scenario
  double duration_s = 0;  // s; 0: the scenario's for scripted, else until the device or the user ends
  int threads = 0;        // 0: all but one
  bool force = false;
  bool realtime = true;  // ask for real-time priority and locked memory
  PhantomOptions phantom;
};
int session_command(const SessionOptions& options);

struct RecoverOptions {
  std::filesystem::path folder;  // of a session that was cut off
  int threads = 0;
};
int recover_command(const RecoverOptions& options);

struct DeviceOptions {
  bool list = false;
  std::string check;  // "phantom"
  double watch_s = 5;
  PhantomOptions phantom;
};
int device_command(const DeviceOptions& options);

struct ReportOptions {
  std::vector<std::filesystem::path> runs;
  std::filesystem::path out = "report.html";
  std::filesystem::path golden;  // as in VerifyOptions
};
int report_command(const ReportOptions& options);

struct MovieOptions {
  std::filesystem::path run;              // folder of a run, or run.h5
  std::filesystem::path out = "run.mp4";  // or .gif
  std::string shot;                       // of the scenario, whose view is taken; empty: the first
};
int movie_command(const MovieOptions& options);

struct MeshOptions {
  std::filesystem::path label_map, pairs, out;
  double size_mm = 10;
  std::string split = "five";  // or "six", tetrahedra a cell
  std::int64_t min_island_cells = 0;
};
int mesh_command(const MeshOptions& options);

struct ExportOptions {
  std::filesystem::path recording;        // run.h5, or the folder of a run
  double at_s = -1;                       // s; negative: the end
  std::filesystem::path like;             // image to deform; empty: the run's label map
  std::filesystem::path out;              // image, or a folder for a DICOM series
  std::string interpolation = "nearest";  // or "linear"
  std::string overlay;                    // "max_principal_stress", or none
  double fill = 0;                        // of gaps and folds
};
int export_volume_command(const ExportOptions& options);

struct DiffOptions {
  std::filesystem::path a, b;  // folders of runs, or run.h5
  int threads = 0;
};
int diff_command(const DiffOptions& options);

struct BlessOptions {
  std::string scenario, why;
  std::filesystem::path golden;  // folder of golden outputs, in a clone of the repository
  int threads = 0;
};
int bless_command(const BlessOptions& options);

struct SuiteOptions {
  std::string filter;  // regular expression that a part of the name fits; empty: all
  int jobs = 0;        // scenarios at a time; 0: as many as the machine has cores
  std::filesystem::path out = "suite";
  std::filesystem::path scenarios;  // folder
  std::filesystem::path golden;     // as in VerifyOptions
  bool force = false;               // replace what is in `out`
};
int suite_command(const SuiteOptions& options);

struct FuzzOptions {
  double seconds = 60;                 // s, after which no further seed is begun
  std::uint64_t seed = 1;              // the first; the others follow
  std::int64_t seeds = 0;              // at most; 0: as many as there is time for
  std::filesystem::path out = "fuzz";  // for the scenarios that fail
};
int fuzz_command(const FuzzOptions& options);

struct PerfReportOptions {
  std::filesystem::path history;  // folder of counts.json and times.json
  std::filesystem::path out = "performance.html";
};
int perf_report_command(const PerfReportOptions& options);

int list_command(const std::filesystem::path& directory);

}  // namespace sulcus
