#include "verify/statements.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "engine/mesh/topology.h"
#include "verify/series.h"
#include "verify/torn_statements.h"

namespace sulcus {

namespace {

constexpr double force_balance_bound = 5e-6;  // relative, see the header
constexpr double energy_ledger_bound = 1e-3;  // likewise
constexpr double still_energy_J = 1e-12;      // likewise
constexpr std::int64_t shortest_window = 3;   // steps
const std::string statement = "statement";

// The largest (worst) of many numbers and where it was; NaN is worse than anything.
struct Worst {
  double value = -std::numeric_limits<double>::infinity();
  std::string place;
  std::int64_t comparisons = 0;

  void add(double candidate, const std::function<std::string()>& where) {
    ++comparisons;
    if (std::isnan(value) || !(std::isnan(candidate) || candidate > value)) return;
    value = candidate;
    place = where();
  }
};

std::string at_step(std::int64_t step) {
  return "at step " + std::to_string(step);
}

std::string at_tool(const RunData& run, std::int64_t tool, std::int64_t step) {
  return at_step(step) + ", tool " + run.header.tool_names[static_cast<std::size_t>(tool)];
}

double number_at(const Series& series, std::int64_t step) {
  return series.values[static_cast<std::size_t>(step)];
}

std::string tool_series(std::int64_t tool, const std::string& name) {
  return "tools/" + std::to_string(tool) + "/" + name;
}

Check unrecorded(const std::string& check, const std::string& series) {
  return failed_check(check, statement,
                      "series " + series + " is not recorded for every step; record the run again");
}

// Calls visit(tool, step, number) for a series of every tool. Returns the name of a series that is missing,
// or "".
template <class Visit>
std::string for_each_tool_number(const RunData& run, const std::string& name, Visit&& visit) {
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    const Series* series = series_of(run, tool_series(tool, name), 1);
    if (series == nullptr) return tool_series(tool, name);
    for (std::int64_t step = 0; step < run.steps; ++step) visit(tool, step, number_at(*series, step));
  }
  return "";
}

Check check_finite(const RunData& run) {
  std::int64_t compared = 0, bad = 0;
  std::string first;
  const auto look = [&](const std::string& name, std::span<const double> values, std::size_t row) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      ++compared;
      if (std::isfinite(values[i])) continue;
      if (bad++ > 0) continue;
      first = name;
      if (row > 0) first += ' ' + at_step(static_cast<std::int64_t>(i / row));
    }
  };
  for (const auto& [name, series] : run.series)
    look(name, series.values, static_cast<std::size_t>(std::max(series.components, 1)));
  for_each_field(run.final_state, [&]<class T>(std::string_view name, std::span<T> values) {
    if constexpr (std::is_same_v<std::remove_const_t<T>, double>)
      look("final_state/" + std::string(name), values, 0);
  });
  for (const Frame& frame : run.frames) look("frame " + at_step(frame.step), frame.positions, 0);
  for (const SolverErrorSample& sample : run.solver_errors)
    look("solver error " + at_step(sample.step), std::span(&sample.error, 1), 0);
  if (const Series* flags = series_of(run, "finite", 1)) {
    for (std::int64_t step = 0; step < run.steps; ++step)
      if (number_at(*flags, step) != 1 && bad++ == 0) first = "the state " + at_step(step);
  } else {
    return unrecorded("finite", "finite");
  }
  if (run.steps == 0) compared = 0;
  return check_at_most("finite", statement, static_cast<double>(bad), 0, "", compared,
                       bad > 0 ? "first: " + first : std::to_string(compared) + " numbers");
}

Check check_force_balance(const RunData& run) {
  Worst imbalance;
  double scale = 0;  // N
  std::int64_t touching = 0;
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    const Series* contact = series_of(run, tool_series(tool, "contact_force_N"), 3);
    const Series* tissue = series_of(run, tool_series(tool, "tissue_force_N"), 3);
    if (contact == nullptr) return unrecorded("force_balance", tool_series(tool, "contact_force_N"));
    if (tissue == nullptr) return unrecorded("force_balance", tool_series(tool, "tissue_force_N"));
    for (std::int64_t step = 0; step < run.steps; ++step) {
      const Vec3 on_tool = vector_at(*contact, step);
      const Vec3 on_tissue = vector_at(*tissue, step);
      const double size = std::max(on_tool.norm(), on_tissue.norm());
      if (size > 0) ++touching;
      scale = std::max(scale, size);
      imbalance.add((on_tool + on_tissue).norm(), [&] { return at_tool(run, tool, step); });
    }
  }
  const double value = imbalance.value == 0 ? 0 : imbalance.value / scale;
  return check_at_most(
      "force_balance", statement, value, force_balance_bound, "", imbalance.comparisons,
      "relative, " + imbalance.place + "; " + std::to_string(touching) + " steps with force");
}

Check check_penetration(const RunData& run, double bound_m) {
  Worst worst;
  const std::string missing = for_each_tool_number(
      run, "max_penetration_m", [&](std::int64_t tool, std::int64_t step, double depth_m) {
        worst.add(depth_m, [&] { return at_tool(run, tool, step); });
      });
  if (!missing.empty()) return unrecorded("penetration", missing);
  return check_at_most("penetration", statement, worst.value * 1e3, bound_m * 1e3, "mm", worst.comparisons,
                       worst.place);
}

// Kept contacts push; says whether there were any at all.
Check check_pushing(const RunData& run, bool contact_expected) {
  Worst pull;  // of -min_push
  std::string problem;
  std::int64_t steps = 0;
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    const Series* contacts = series_of(run, tool_series(tool, "contacts"), 1);
    const Series* push = series_of(run, tool_series(tool, "min_push_N"), 1);
    if (contacts == nullptr) return unrecorded("pushing", tool_series(tool, "contacts"));
    if (push == nullptr) return unrecorded("pushing", tool_series(tool, "min_push_N"));
    for (std::int64_t step = 0; step < run.steps; ++step) {
      ++steps;
      if (number_at(*contacts, step) > 0)
        pull.add(-number_at(*push, step), [&] { return at_tool(run, tool, step); });
    }
  }
  if (pull.comparisons == 0 && !contact_expected)
    return check_at_least("pushing", statement, 0, 0, "N", steps, "no contact, as expected");
  return check_at_least("pushing", statement, -pull.value, 0, "N", pull.comparisons,
                        pull.comparisons == 0 ? "no tool ever touched the tissue" : pull.place);
}

Check check_displayed_force(const RunData& run, double bound_N) {
  Worst worst;
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    const Series* force = series_of(run, tool_series(tool, "displayed_force_N"), 3);
    if (force == nullptr) return unrecorded("displayed_force", tool_series(tool, "displayed_force_N"));
    for (std::int64_t step = 0; step < run.steps; ++step)
      worst.add(vector_at(*force, step).norm(), [&] { return at_tool(run, tool, step); });
  }
  return check_at_most("displayed_force", statement, worst.value, bound_N, "N", worst.comparisons,
                       worst.place);
}

Check check_pieces(const RunData& run) {
  const auto mesh = run.numbers.find("mesh_pieces");
  const auto voxels = run.numbers.find("voxel_pieces");
  if (mesh == run.numbers.end() || voxels == run.numbers.end())
    return failed_check("pieces", statement, "numbers mesh_pieces and voxel_pieces are not recorded");
  Check check = check_at_most("pieces", statement, std::abs(mesh->second - voxels->second), 0, "", 1,
                              "difference between pieces of the mesh and of the voxels");
  check.value = mesh->second;
  check.bound = voxels->second;
  return check;
}

// Counted anew, from the recorded mesh.
Check check_declared_pieces(const std::string& name, const RunHeader& mesh,
                            std::span<const std::uint8_t> alive, std::int64_t declared) {
  std::vector<std::array<std::int32_t, 4>> tets(mesh.tets.size() / 4);
  for (std::size_t t = 0; t < tets.size(); ++t) std::copy_n(&mesh.tets[4 * t], 4, tets[t].begin());
  const auto found = static_cast<std::int64_t>(mesh_pieces(tets, mesh.node_count(), alive).item_count.size());
  Check check = check_at_most(name, statement, static_cast<double>(std::abs(found - declared)), 0, "",
                              static_cast<std::int64_t>(tets.size()),
                              "pieces of the mesh, declared: " + std::to_string(declared));
  check.value = static_cast<double>(found);
  check.bound = static_cast<double>(declared);
  return check;
}

Check check_inverted(const RunData& run) {
  const auto inverted = run.numbers.find("inverted_elements_at_end");
  if (inverted == run.numbers.end())
    return failed_check("inverted_elements", statement, "number inverted_elements_at_end is not recorded");
  return check_at_most("inverted_elements", statement, inverted->second, 0, "", 1, "at the end");
}

Check check_converged(const RunData& run, double share) {
  const Series* converged = series_of(run, "solver/converged", 1);
  if (converged == nullptr) return unrecorded("converged", "solver/converged");
  std::int64_t good = 0, first_bad = -1;
  for (std::int64_t step = 0; step < run.steps; ++step) {
    if (number_at(*converged, step) == 1)
      ++good;
    else if (first_bad < 0)
      first_bad = step;
  }
  const double value = run.steps > 0 ? static_cast<double>(good) / static_cast<double>(run.steps) : 0;
  return check_at_least(
      "converged", statement, value, share, "", run.steps,
      first_bad < 0 ? "all steps by tolerance" : "first stopped by the cap " + at_step(first_bad));
}

Check check_solver_error(const RunData& run, double bound) {
  Worst worst;
  for (const SolverErrorSample& sample : run.solver_errors)
    worst.add(sample.error, [&] { return at_step(sample.step); });
  return check_at_most(
      "solver_error", statement, worst.value, bound, "", worst.comparisons,
      "relative, " + worst.place + "; " + std::to_string(worst.comparisons) + " steps measured");
}

// Angle of the rotation between two orientations, rad, good for small ones: 2 |sin|, exact to third order.
double turn_between(const double* a, const double* b) {
  double same = 0, opposite = 0;
  for (int i = 0; i < 4; ++i) {
    same += (a[i] - b[i]) * (a[i] - b[i]);
    opposite += (a[i] + b[i]) * (a[i] + b[i]);
  }
  return 2 * std::sqrt(std::min(same, opposite));
}

// For every step whether devices and tools rest in it, from their poses. Returns a missing series' name, or
// "".
std::string find_rest(const RunData& run, const StatementBounds& bounds, std::vector<bool>& rests) {
  rests.assign(static_cast<std::size_t>(run.steps), true);
  if (run.header.tool_count() > 0 && !rests.empty()) rests[0] = false;  // no step before it to compare with
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    for (const std::string& prefix : {tool_series(tool, ""), "device/" + std::to_string(tool) + "/"}) {
      const Series* position = series_of(run, prefix + "position_m", 3);
      const Series* orientation = series_of(run, prefix + "orientation", 4);
      if (position == nullptr) return prefix + "position_m";
      if (orientation == nullptr) return prefix + "orientation";
      for (std::int64_t step = 1; step < run.steps; ++step) {
        const double moved_m = (vector_at(*position, step) - vector_at(*position, step - 1)).norm();
        const double* turned = &orientation->values[static_cast<std::size_t>(4 * step)];
        if (!(moved_m <= bounds.rest_speed_m_s * run.header.step_s) ||
            !(turn_between(turned, turned - 4) <= bounds.rest_spin_rad_s * run.header.step_s))
          rests[static_cast<std::size_t>(step)] = false;
      }
    }
  }
  return "";
}

Check check_energy_at_rest(const RunData& run, const StatementBounds& bounds) {
  const std::string name = "energy_at_rest";
  const Series* kinetic = series_of(run, "tissue/kinetic_energy_J", 1);
  const Series* elastic = series_of(run, "tissue/elastic_energy_J", 1);
  if (kinetic == nullptr) return unrecorded(name, "tissue/kinetic_energy_J");
  if (elastic == nullptr) return unrecorded(name, "tissue/elastic_energy_J");
  std::vector<bool> rests;
  const std::string missing = find_rest(run, bounds, rests);
  if (!missing.empty()) return unrecorded(name, missing);

  // The elastic energy of a moment is reported one step later than the kinetic one.
  const std::int64_t moments = run.steps - 1;
  const auto energy = [&](std::int64_t n) { return number_at(*kinetic, n) + number_at(*elastic, n + 1); };
  double peak = 0;
  for (std::int64_t n = 0; n < moments; ++n) peak = std::max(peak, energy(n));

  Worst growth;
  for (std::int64_t begin = 0; begin < moments;) {
    std::int64_t end = begin;
    while (end < moments && rests[static_cast<std::size_t>(end)]) ++end;
    if (end - begin >= shortest_window) {
      double lowest = energy(begin);
      for (std::int64_t n = begin + 1; n < end; ++n) {
        growth.add(energy(n) - lowest,
                   [&] { return at_step(n) + ", resting since step " + std::to_string(begin); });
        lowest = std::min(lowest, energy(n));
      }
    }
    begin = end + 1;
  }
  const double largest = std::isnan(growth.value) ? growth.value : std::max(growth.value, 0.0);
  return check_at_most(name, statement, largest, std::max(*bounds.max_energy_growth * peak, still_energy_J),
                       "J", growth.comparisons,
                       growth.comparisons == 0
                           ? "device and tools never rest for " + std::to_string(shortest_window) + " steps"
                           : growth.place + "; " + std::to_string(growth.comparisons) + " resting steps");
}

// The books of energy close: what the solver left over, which nothing else accounts for.
Check check_energy_ledger(const RunData& run) {
  const std::string name = "energy_ledger";
  Worst residual;
  double largest = 0;
  const Series& left_over = *series_of(run, "energy/residual_J", 1);
  for (const char* term : {"put_in_J", "kinetic_J", "elastic_J"}) {
    const Series* series = series_of(run, std::string("energy/") + term, 1);
    if (series == nullptr) return unrecorded(name, std::string("energy/") + term);
    for (std::int64_t n = 0; n < run.steps; ++n) largest = std::max(largest, number_at(*series, n));
  }
  for (std::int64_t n = 0; n < run.steps; ++n)
    residual.add(std::abs(number_at(left_over, n)), [&] { return at_step(n); });
  return check_at_most(name, statement, residual.value,
                       std::max(energy_ledger_bound * largest, still_energy_J), "J", residual.comparisons,
                       residual.place);
}

Check check_kinetic_energy(const RunData& run, double bound_J) {
  const Series* kinetic = series_of(run, "tissue/kinetic_energy_J", 1);
  if (kinetic == nullptr) return unrecorded("kinetic_energy", "tissue/kinetic_energy_J");
  Worst worst;
  for (std::int64_t step = 0; step < run.steps; ++step)
    worst.add(number_at(*kinetic, step), [&] { return at_step(step); });
  return check_at_most("kinetic_energy", statement, worst.value, bound_J, "J", worst.comparisons,
                       worst.place);
}

Check check_final_displacement(const RunData& run, double bound_m) {
  const std::string name = "final_displacement";
  const Series* displacement = series_of(run, "tissue/max_displacement_m", 1);
  if (displacement == nullptr) return unrecorded(name, "tissue/max_displacement_m");
  if (run.steps == 0) return failed_check(name, statement, "the run has no step");
  const std::int64_t last = run.steps - 1;
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    const Series* contacts = series_of(run, tool_series(tool, "contacts"), 1);
    if (contacts == nullptr) return unrecorded(name, tool_series(tool, "contacts"));
    if (number_at(*contacts, last) != 0)
      return failed_check(name, statement, "a tool still touches the tissue " + at_tool(run, tool, last));
  }
  return check_at_most(name, statement, number_at(*displacement, last) * 1e3, bound_m * 1e3, "mm", 1,
                       "of any node from rest, at the end");
}

}  // namespace

std::vector<Check> check_statements(const RunData& run, const StatementBounds& bounds) {
  const bool tools = run.header.tool_count() > 0;
  std::vector<Check> checks;
  checks.push_back(check_finite(run));
  if (tools) checks.push_back(check_force_balance(run));
  if (tools && bounds.max_penetration_m) checks.push_back(check_penetration(run, *bounds.max_penetration_m));
  if (tools) checks.push_back(check_pushing(run, bounds.contact_expected));
  if (tools && bounds.max_displayed_force_N)
    checks.push_back(check_displayed_force(run, *bounds.max_displayed_force_N));
  checks.push_back(check_pieces(run));
  if (bounds.pieces_at_start) {
    checks.push_back(run.frames.empty()
                         ? failed_check("pieces_at_start", statement, "the run has no frame")
                         : check_declared_pieces("pieces_at_start", run.header, run.frames.front().alive,
                                                 *bounds.pieces_at_start));
  }
  if (bounds.pieces_at_end) {
    checks.push_back(
        check_declared_pieces("pieces_at_end", run.header, run.final_state.alive, *bounds.pieces_at_end));
  }
  checks.push_back(check_inverted(run));
  if (bounds.min_converged_share) checks.push_back(check_converged(run, *bounds.min_converged_share));
  if (bounds.max_solver_error) checks.push_back(check_solver_error(run, *bounds.max_solver_error));
  if (bounds.max_energy_growth) checks.push_back(check_energy_at_rest(run, bounds));
  if (series_of(run, "energy/residual_J", 1) != nullptr) checks.push_back(check_energy_ledger(run));
  if (bounds.torn) {
    for (Check& check : check_torn(run, *bounds.torn)) checks.push_back(std::move(check));
  }
  if (bounds.max_kinetic_energy_J) checks.push_back(check_kinetic_energy(run, *bounds.max_kinetic_energy_J));
  if (bounds.max_final_displacement_m)
    checks.push_back(check_final_displacement(run, *bounds.max_final_displacement_m));
  return checks;
}

}  // namespace sulcus
