#include "verify/work_precision.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "verify/check.h"
#include "verify/gnuplot.h"

namespace sulcus {
namespace {

constexpr const char* colours[] = {"#2f7fc6", "#d5791a", "#2a9070", "#b64a83",
                                   "#7b6fc8", "#a08a1e", "#777777", "#c0392b"};

std::string text_of(double value, const char* format = "%.4g") {
  if (!std::isfinite(value)) return "";
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Marks what nothing cheaper, or as cheap, is better than.
void mark(std::vector<WorkPrecisionRow>& rows, double WorkPrecisionRow::*cost,
          double WorkPrecisionRow::*error, bool WorkPrecisionRow::*front) {
  for (WorkPrecisionRow& row : rows) {
    const bool usable = row.problem.empty() && std::isfinite(row.*error);
    row.*front = usable && std::none_of(rows.begin(), rows.end(), [&](const WorkPrecisionRow& other) {
                   return other.problem.empty() && other.*cost <= row.*cost && other.*error <= row.*error &&
                          (other.*cost < row.*cost || other.*error < row.*error);
                 });
  }
}

// Cost of the scenario's own settings over that of the cheapest row in which none of the errors is larger;
// NaN where there is nothing to compare.
double own_over_front(const std::vector<WorkPrecisionRow>& rows,
                      std::initializer_list<double WorkPrecisionRow::*> errors) {
  const auto own =
      std::find_if(rows.begin(), rows.end(), [](const WorkPrecisionRow& row) { return row.own; });
  if (own == rows.end() || !own->problem.empty()) return NAN;
  double cheapest = INFINITY;
  for (const WorkPrecisionRow& row : rows) {
    const bool as_exact = std::all_of(errors.begin(), errors.end(), [&](double WorkPrecisionRow::*error) {
      return row.*error <= (*own).*error;
    });
    if (row.problem.empty() && as_exact) cheapest = std::fmin(cheapest, row.per_second);
  }
  return std::isfinite(cheapest) ? own->per_second / cheapest : NAN;
}

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string joined(const std::vector<std::string>& texts, const std::string& between) {
  std::string out;
  for (const std::string& text : texts) out += (out.empty() ? "" : between) + text;
  return out;
}

std::string short_key(const std::string& pointer) {
  return pointer.substr(pointer.rfind('/') + 1);
}

// All keys but the last that take several values: what a curve of the diagram is.
std::string curve_name(const WorkPrecisionStudy& study, const WorkPrecisionRow& row) {
  std::string name;
  for (std::size_t k = 0; k + 1 < study.keys.size(); ++k) {
    const bool varies = std::any_of(study.rows.begin(), study.rows.end(), [&](const WorkPrecisionRow& other) {
      return other.values[k] != row.values[k];
    });
    if (varies) name += (name.empty() ? "" : ", ") + short_key(study.keys[k]) + " " + row.values[k];
  }
  return name.empty() ? short_key(study.keys.front()) : name;
}

std::string marks(bool by_step, bool by_second) {
  return std::string(" | ") + (by_step ? "F" : "") + (by_second ? "f" : "") +
         (by_step || by_second ? " | " : "| ");
}

struct Panel {
  const char* title;
  const char* x_label;
  const char* y_label;
  double WorkPrecisionRow::*cost;
  double WorkPrecisionRow::*error;
  bool WorkPrecisionRow::*front;
  double WorkPrecisionStudy::*floor;
};

constexpr Panel panels[] = {
    {"displacement against time of a step", "wall clock of a step [ms]", "displacement error",
     &WorkPrecisionRow::step_ms, &WorkPrecisionRow::displacement_error,
     &WorkPrecisionRow::on_displacement_front, &WorkPrecisionStudy::reference_displacement_error},
    {"force against time of a step", "wall clock of a step [ms]", "force error", &WorkPrecisionRow::step_ms,
     &WorkPrecisionRow::force_error, &WorkPrecisionRow::on_force_front,
     &WorkPrecisionStudy::reference_force_error},
    {"displacement against computing", "computing for a simulated second [s]", "displacement error",
     &WorkPrecisionRow::per_second, &WorkPrecisionRow::displacement_error,
     &WorkPrecisionRow::on_displacement_front_by_second, &WorkPrecisionStudy::reference_displacement_error},
    {"force against computing", "computing for a simulated second [s]", "force error",
     &WorkPrecisionRow::per_second, &WorkPrecisionRow::force_error,
     &WorkPrecisionRow::on_force_front_by_second, &WorkPrecisionStudy::reference_force_error}};

void add_data(std::ostream& out, const std::string& name,
              const std::vector<std::pair<double, double>>& points) {
  out << name << " << EOD\n";
  for (const auto& [x, y] : points) out << gnuplot_number(x) << ' ' << gnuplot_number(y) << '\n';
  out << "EOD\n";
}

// Range of positive numbers with room around it, for a logarithmic axis.
std::string log_range(const char* axis, const std::vector<double>& values) {
  double low = INFINITY, high = 0;
  for (double v : values) {
    if (!std::isfinite(v) || v <= 0) continue;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  if (high == 0) low = high = 1;
  const double room = std::max(1.3, std::pow(high / low, 0.08));
  low /= room;
  high *= room;
  // decades alone would leave a short axis without a number
  const double span = high / low;
  const std::vector<double> digits = span < 6    ? std::vector<double>{1, 1.5, 2, 3, 4, 5, 7}
                                     : span < 30 ? std::vector<double>{1, 2, 5}
                                                 : std::vector<double>{1};
  std::string ticks;
  for (double decade = std::pow(10, std::floor(std::log10(low))); decade < high; decade *= 10) {
    for (double digit : digits) {
      const double tick = digit * decade;
      if (tick >= low && tick <= high) ticks += (ticks.empty() ? "" : ",") + gnuplot_number(tick);
    }
  }
  return std::string("set ") + axis + "range [" + gnuplot_number(low) + ":" + gnuplot_number(high) +
         "]\nset " + axis + "tics (" + ticks + ")\n";
}

void add_panel(std::ostream& out, const WorkPrecisionStudy& study, const Panel& panel, std::size_t number,
               const std::vector<std::string>& names) {
  std::map<std::string, std::vector<std::pair<double, double>>> curves;
  std::vector<std::pair<double, double>> front, own;
  std::vector<double> xs, ys{study.*panel.floor};
  for (const WorkPrecisionRow& row : study.rows) {
    const double x = row.*panel.cost, y = row.*panel.error;
    if (!row.problem.empty() || !std::isfinite(y) || y <= 0 || x <= 0) continue;
    curves[curve_name(study, row)].emplace_back(x, y);
    if (row.*panel.front) front.emplace_back(x, y);
    if (row.own) own.emplace_back(x, y);
    xs.push_back(x);
    ys.push_back(y);
  }
  std::sort(front.begin(), front.end());
  const std::string mark = "$p" + std::to_string(number);
  out << "set title " << gnuplot_text(panel.title) << "\nset xlabel " << gnuplot_text(panel.x_label)
      << "\nset ylabel " << gnuplot_text(panel.y_label) << "\n"
      << log_range("x", xs) << log_range("y", ys) << "unset arrow\n";
  if (xs.empty()) {
    out << "set label 1 'nothing to compare' at graph 0.5,0.5 center\nplot NaN notitle\nunset label 1\n";
    return;
  }
  const double floor = study.*panel.floor;
  if (floor > 0) {
    out << "set arrow from graph 0, first " << gnuplot_number(floor) << " to graph 1, first "
        << gnuplot_number(floor) << " nohead dt 3 lw 1.2 lc rgb '#888888'\n";
  }
  for (std::size_t c = 0; c < names.size(); ++c)
    add_data(out, mark + "_" + std::to_string(c), curves[names[c]]);
  add_data(out, mark + "_front", front);
  add_data(out, mark + "_own", own);
  std::string plots;
  if (front.size() > 1) plots += ", " + mark + "_front using 1:2 with lines lw 5 lc rgb '#50999999' notitle";
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (curves[names[c]].empty()) continue;
    plots += ", " + mark + "_" + std::to_string(c) +
             " using 1:2 with linespoints pt 7 ps 1.1 lw 1.3 dt 2 lc rgb '" +
             colours[c % std::size(colours)] + "' notitle";
  }
  if (!front.empty())
    plots += ", " + mark + "_front using 1:2 with points pt 6 ps 2.2 lw 1.5 lc rgb '#222222' notitle";
  if (!own.empty())
    plots += ", " + mark + "_own using 1:2 with points pt 4 ps 2.8 lw 1.5 lc rgb '#222222' notitle";
  if (number == 0) {
    for (std::size_t c = 0; c < names.size(); ++c) {
      plots += std::string(", keyentry with linespoints pt 7 ps 1.1 lw 1.3 dt 2 lc rgb '") +
               colours[c % std::size(colours)] + "' title " + gnuplot_text(names[c]);
    }
    plots += ", keyentry with points pt 6 ps 2.2 lw 1.5 lc rgb '#222222' title 'Pareto front'";
    plots +=
        ", keyentry with points pt 4 ps 2.8 lw 1.5 lc rgb '#222222' title 'the scenario''s own settings'";
    plots += ", keyentry with lines dt 3 lw 1.2 lc rgb '#888888' title 'the reference''s own error'";
  }
  out << (number == 0 ? "set key at screen 0.5,0.985 center top vertical maxcols 1 noenhanced samplen 2\n"
                      : "unset key\n")
      << "plot " << plots.substr(2) << "\n";
}

nlohmann::json number_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

}  // namespace

void mark_fronts(WorkPrecisionStudy& study) {
  using Row = WorkPrecisionRow;
  mark(study.rows, &Row::step_ms, &Row::displacement_error, &Row::on_displacement_front);
  mark(study.rows, &Row::step_ms, &Row::force_error, &Row::on_force_front);
  mark(study.rows, &Row::per_second, &Row::displacement_error, &Row::on_displacement_front_by_second);
  mark(study.rows, &Row::per_second, &Row::force_error, &Row::on_force_front_by_second);
  study.own_over_displacement_front = own_over_front(study.rows, {&Row::displacement_error});
  study.own_over_force_front = own_over_front(study.rows, {&Row::force_error});
  study.own_over_front = std::isfinite(study.own_over_force_front)
                             ? own_over_front(study.rows, {&Row::displacement_error, &Row::force_error})
                             : study.own_over_displacement_front;
}

std::string work_precision_csv(const WorkPrecisionStudy& study) {
  std::ostringstream out;
  for (const std::string& key : study.keys) out << csv_cell(key) << ',';
  out << "step_ms,computing_s_per_s,displacement_error,force_error,iterations,converged_share,"
         "on_displacement_front,on_force_front,on_displacement_front_by_second,on_force_front_by_second,own,"
         "problem\n";
  for (const WorkPrecisionRow& row : study.rows) {
    for (const std::string& value : row.values) out << csv_cell(value) << ',';
    for (double value : {row.step_ms, row.per_second, row.displacement_error, row.force_error, row.iterations,
                         row.converged_share})
      out << text_of(value, "%.6g") << ',';
    for (bool mark : {row.on_displacement_front, row.on_force_front, row.on_displacement_front_by_second,
                      row.on_force_front_by_second, row.own})
      out << mark << ',';
    out << csv_cell(row.problem) << '\n';
  }
  return out.str();
}

std::string work_precision_json(const WorkPrecisionStudy& study) {
  nlohmann::json json = {{"scenario", study.scenario},
                         {"machine", study.machine},
                         {"threads", study.threads},
                         {"repetitions", study.repetitions},
                         {"keys", study.keys},
                         {"settings", study.settings},
                         {"own_over_displacement_front", number_or_null(study.own_over_displacement_front)},
                         {"own_over_force_front", number_or_null(study.own_over_force_front)},
                         {"own_over_front", number_or_null(study.own_over_front)},
                         {"reference",
                          {{"settings", study.reference},
                           {"own_displacement_error", number_or_null(study.reference_displacement_error)},
                           {"own_force_error", number_or_null(study.reference_force_error)},
                           {"displacement_mm", number_or_null(study.displacement_mm)},
                           {"force_N", number_or_null(study.force_N)}}}};
  for (const WorkPrecisionRow& row : study.rows) {
    json["rows"].push_back({{"values", row.values},
                            {"step_ms", number_or_null(row.step_ms)},
                            {"computing_s_per_s", number_or_null(row.per_second)},
                            {"displacement_error", number_or_null(row.displacement_error)},
                            {"force_error", number_or_null(row.force_error)},
                            {"iterations", number_or_null(row.iterations)},
                            {"converged_share", number_or_null(row.converged_share)},
                            {"on_displacement_front", row.on_displacement_front},
                            {"on_force_front", row.on_force_front},
                            {"on_displacement_front_by_second", row.on_displacement_front_by_second},
                            {"on_force_front_by_second", row.on_force_front_by_second},
                            {"own", row.own},
                            {"problem", row.problem}});
  }
  return json.dump(2) + "\n";
}

std::string work_precision_markdown(const WorkPrecisionStudy& study, const std::string& picture) {
  std::ostringstream out;
  out << "# Work against precision: " << study.scenario << "\n\n![](" << picture << ")\n\n"
      << "Errors are relative to a reference run with `" << joined(study.reference, "` `") << "`"
      << (study.settings.empty() ? "" : ", all runs with `" + joined(study.settings, "` `") + "`")
      << ": root mean square over material points (displacement, " << text_of(study.displacement_mm)
      << " mm in the reference) and over moments (force, " << text_of(study.force_N)
      << " N). The reference itself differs from a run with twice its time step by "
      << text_of(study.reference_displacement_error, "%.2g") << " and "
      << (std::isfinite(study.reference_force_error) ? text_of(study.reference_force_error, "%.2g") : "-")
      << ": errors below that mean little. Time: medians of " << study.repetitions
      << " interleaved repetitions with " << study.threads
      << (study.threads == 1 ? " thread on " : " threads on ") << study.machine
      << ". F: on the Pareto front of time of a step against that error; f: of computing for a simulated "
         "second.\n\n";
  if (std::isfinite(study.own_over_displacement_front)) {
    out << "The scenario's own settings (in bold) cost "
        << text_of(study.own_over_displacement_front, "%.2f");
    if (std::isfinite(study.own_over_force_front))
      out << " (displacement), " << text_of(study.own_over_force_front, "%.2f") << " (force) and "
          << text_of(study.own_over_front, "%.2f") << " (both)";
    out << " times what the cheapest of these with no larger error do, by simulated second.\n\n";
  }
  out << '|';
  for (const std::string& key : study.keys) out << ' ' << key << " |";
  out << " step ms | s for a simulated s | displacement error | | force error | | iterations | converged "
         "|\n|";
  for (std::size_t i = 0; i < study.keys.size() + 8; ++i) out << " --- |";
  out << '\n';
  for (const WorkPrecisionRow& row : study.rows) {
    out << '|';
    const std::string bold = row.own ? "**" : "";
    for (const std::string& value : row.values) out << ' ' << bold << value << bold << " |";
    if (!row.problem.empty()) {
      out << " | | | | | | | " << row.problem << " |\n";
      continue;
    }
    out << ' ' << text_of(row.step_ms, "%.3g") << " | " << text_of(row.per_second, "%.3g") << " | "
        << text_of(row.displacement_error, "%.3g")
        << marks(row.on_displacement_front, row.on_displacement_front_by_second)
        << text_of(row.force_error, "%.3g") << marks(row.on_force_front, row.on_force_front_by_second)
        << text_of(row.iterations, "%.3g") << " | " << text_of(100 * row.converged_share, "%.0f") << " % |\n";
  }
  return out.str();
}

std::string work_precision_png(const WorkPrecisionStudy& study) {
  std::vector<std::string> names;
  for (const WorkPrecisionRow& row : study.rows) {
    const std::string name = curve_name(study, row);
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  const double top = 1 - 0.0205 * static_cast<double>(names.size() + 3) - 0.02;
  std::ostringstream out;
  out << "set terminal pngcairo size 1200,900 font 'sans-serif,12' background '#ffffff'\n"
      << "set encoding utf8\nset datafile missing 'NaN'\nset border 3\nset tics nomirror scale 0.5\n"
      << "set logscale xy\nset format xy '%g'\nset grid lt 1 lc rgb '#B0808080' lw "
         "0.7\n"
      << "set multiplot layout 2,2 margins 0.08,0.98,0.07," << gnuplot_number(top - 0.03)
      << " spacing 0.09,0.13\n";
  for (std::size_t p = 0; p < std::size(panels); ++p) add_panel(out, study, panels[p], p, names);
  out << "unset multiplot\n";
  return draw_with_gnuplot(out.str());
}

void write_work_precision(const std::filesystem::path& folder, const WorkPrecisionStudy& study) {
  write_file_atomically(folder / "work_precision.csv", work_precision_csv(study));
  write_file_atomically(folder / "work_precision.json", work_precision_json(study));
  write_file_atomically(folder / "work_precision.md", work_precision_markdown(study, "work_precision.png"));
  // last: the numbers are there if it cannot be drawn
  write_file_atomically(folder / "work_precision.png", work_precision_png(study));
}

}  // namespace sulcus
