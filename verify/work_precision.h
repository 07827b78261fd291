// Work against precision: what settings of one scenario cost and what error they leave, as a table (CSV,
// JSON, Markdown) and a diagram (PNG, by gnuplot).
#pragma once

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

namespace sulcus {

// One choice of the varied settings. Errors are relative to a reference run, NaN where there is nothing to
// compare: root mean square over places and moments of the difference, over that of the reference itself.
struct WorkPrecisionRow {
  std::vector<std::string> values;  // [keys] as given
  double step_ms = 0;               // wall clock of a step: median over steps, then over repetitions
  double per_second = 0;            // s of computing for a simulated second, median over repetitions
  double displacement_error = 0;
  double force_error = 0;
  double iterations = 0;       // mean over steps
  double converged_share = 1;  // of the steps, by tolerance
  std::string problem;         // empty, or why the run stopped early
  bool own = false;            // these are the scenario's own settings
  // On the Pareto front: nothing that costs no more has a smaller error. By the time of a step, and by
  // computing for a simulated second.
  bool on_displacement_front = false, on_force_front = false;
  bool on_displacement_front_by_second = false, on_force_front_by_second = false;
};

struct WorkPrecisionStudy {
  std::string scenario, machine;
  std::vector<std::string> keys;       // JSON pointers
  std::vector<std::string> settings;   // "/json/pointer=value" of all runs
  std::vector<std::string> reference;  // likewise, of the reference
  // What the reference itself may be wrong by: its difference from a run with twice its time step.
  double reference_displacement_error = 0, reference_force_error = 0;
  double displacement_mm = 0, force_N = 0;  // root mean square of the reference, what errors are relative to
  int repetitions = 1, threads = 1;
  std::vector<WorkPrecisionRow> rows;
  // What the scenario's own settings cost for a simulated second, over the cheapest with no larger error (in
  // displacements, in forces, in neither); NaN if they are not among the rows or have no such error.
  double own_over_displacement_front = NAN, own_over_force_front = NAN, own_over_front = NAN;
};

// Sets the marks of the fronts and the costs over them.
void mark_fronts(WorkPrecisionStudy& study);

// Texts of the files; study.rows marked.
std::string work_precision_csv(const WorkPrecisionStudy& study);
std::string work_precision_json(const WorkPrecisionStudy& study);
std::string work_precision_markdown(const WorkPrecisionStudy& study, const std::string& picture);

// The diagram, a PNG: time of a step (above) and computing for a simulated second (below) against the errors,
// logarithmic; one curve for each choice of all keys but the last, fronts drawn through. Throws
// EnvironmentError if gnuplot is missing.
std::string work_precision_png(const WorkPrecisionStudy& study);

// work_precision.csv, .json, .md and .png in a folder; nothing half-written under these names.
void write_work_precision(const std::filesystem::path& folder, const WorkPrecisionStudy& study);

}  // namespace sulcus
