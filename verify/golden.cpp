#include "verify/golden.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"

namespace sulcus {

namespace {

using Json = nlohmann::ordered_json;

constexpr int golden_format_version = 1;
constexpr double unmeasured_share = 1e-3;        // of the peak, quantities
constexpr double unmeasured_count_share = 0.05;  // of the peak, counts, and at least 2
const std::string values_kind = "values";
const std::string iterations_series = "solver/iterations";

struct Tolerance {
  double absolute = 0;  // in the unit of the quantity
  std::string basis;
};

// --- what is compared

std::vector<std::string> golden_series_names(const RunData& run) {
  std::vector<std::string> names = {"solver/iterations", "tissue/alive_tets", "tissue/elastic_energy_J",
                                    "tissue/kinetic_energy_J", "tissue/max_displacement_m"};
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool)
    for (const char* name : {"contact_force_N", "contact_torque_N_m", "contacts", "displayed_force_N",
                             "max_penetration_m", "position_m"})
      names.push_back("tools/" + std::to_string(tool) + "/" + name);
  for (std::size_t motion = 0; motion < run.header.motion_names.size(); ++motion)
    names.push_back("motions/" + std::to_string(motion) + "/force_N");
  return names;
}

bool is_count(const std::string& name) {
  return name == iterations_series || name == "tissue/alive_tets" || name.ends_with("/contacts");
}

// Steps whose values are kept, evenly spread, first and last among them.
std::vector<std::int64_t> kept_steps(std::int64_t steps) {
  const std::int64_t points = std::min<std::int64_t>(golden_points, steps);
  std::vector<std::int64_t> kept;
  for (std::int64_t k = 0; k < points; ++k)
    kept.push_back(points == 1 ? 0 : (k * (steps - 1) + (points - 1) / 2) / (points - 1));
  return kept;
}

double sum_of(const RunData& run, const std::string& name) {
  const Series* series = run.find(name);
  double sum = 0;
  if (series != nullptr)
    for (const double value : series->values) sum += value;
  return sum;
}

// Counters of work over the whole run.
std::map<std::string, double> work_of(const RunData& run) {
  std::map<std::string, double> work;
  work["iterations"] = sum_of(run, "solver/iterations");
  work["steps_not_converged"] = static_cast<double>(run.steps) - sum_of(run, "solver/converged");
  for (std::int64_t tool = 0; tool < run.header.tool_count(); ++tool) {
    const std::string prefix = "tools/" + std::to_string(tool) + "/";
    work["contacts"] += sum_of(run, prefix + "contacts");
    work["dropped_contacts"] += sum_of(run, prefix + "dropped_contacts");
  }
  return work;
}

// Whole numbers of topology and the like; they agree exactly or not at all.
std::map<std::string, std::int64_t> counts_of(const RunData& run) {
  std::map<std::string, std::int64_t> counts = {{"nodes", run.header.node_count()},
                                                {"tets", run.header.tet_count()},
                                                {"tools", run.header.tool_count()}};
  for (const auto& [name, value] : run.numbers)
    if (value == std::floor(value) && std::abs(value) < 1e15)
      counts.emplace(name, static_cast<std::int64_t>(value));
  return counts;
}

struct Range {
  std::vector<double> lowest, highest;  // [components]
};

Range range_of(const Series& series) {
  const auto components = static_cast<std::size_t>(series.components);
  Range range{{series.values.begin(), series.values.begin() + series.components}, {}};
  range.highest = range.lowest;
  for (std::size_t i = 0; i < series.values.size(); ++i) {
    range.lowest[i % components] = std::min(range.lowest[i % components], series.values[i]);
    range.highest[i % components] = std::max(range.highest[i % components], series.values[i]);
  }
  return range;
}

double peak_of(const Series& series) {
  double peak = 0;
  for (const double value : series.values) peak = std::max(peak, std::abs(value));
  return peak;
}

// --- tolerances

std::vector<GoldenVariant> of_same_work(std::span<const GoldenVariant> variants) {
  std::vector<GoldenVariant> same;
  std::copy_if(variants.begin(), variants.end(), std::back_inserter(same),
               [](const GoldenVariant& variant) { return variant.same_work; });
  return same;
}

std::string labels_of(std::span<const GoldenVariant> variants) {
  std::string labels;
  for (const GoldenVariant& variant : variants) labels += (labels.empty() ? "" : ", ") + variant.label;
  return labels;
}

Tolerance measured(double spread, double peak, std::span<const GoldenVariant> variants) {
  std::ostringstream basis;
  basis << spread_factor << " x the largest difference (" << spread
        << ") to runs of other arithmetic: " << labels_of(variants);
  return {std::max(spread_factor * spread, least_tolerance_share * peak), basis.str()};
}

Tolerance unmeasured(double peak, bool count) {
  if (count)
    return {std::max(2.0, unmeasured_count_share * peak), "not measured: 5 % of the peak, at least 2"};
  return {unmeasured_share * peak, "not measured: 0.1 % of the peak"};
}

// The tolerance at `place` of the golden that stood there before, if it was measured.
std::optional<Tolerance> kept_tolerance(const Json& before, const char* group, const std::string& name) {
  try {
    const Json& entry = before.at(group).at(name);
    Tolerance tolerance{entry.at("tolerance").get<double>(), entry.at("basis").get<std::string>()};
    if (!tolerance.basis.starts_with("not measured") && tolerance.absolute >= 0) return tolerance;
  } catch (const Json::exception&) {  // not there, or not of this form: nothing to keep
  }
  return std::nullopt;
}

Tolerance tolerance_of_series(const Series& series, const std::string& name, const Json& before,
                              std::span<const GoldenVariant> variants) {
  if (variants.empty()) {
    const auto kept = kept_tolerance(before, "series", name);
    return kept ? *kept : unmeasured(peak_of(series), is_count(name));
  }
  double spread = 0;
  for (const GoldenVariant& variant : variants) {
    const Series* other = variant.run->find(name);
    if (other == nullptr || other->values.size() != series.values.size())
      throw InputError("variant " + variant.label + ": series " + name +
                       " has another length than the run's; give runs of the same scenario");
    for (std::size_t i = 0; i < series.values.size(); ++i) {
      const double difference = std::abs(series.values[i] - other->values[i]);
      if (!std::isfinite(difference))
        throw InputError("variant " + variant.label + ": series " + name +
                         " holds a number that is not finite");
      spread = std::max(spread, difference);
    }
  }
  return measured(spread, peak_of(series), variants);
}

Tolerance tolerance_of_work(const std::string& name, double value, const Json& before,
                            std::span<const GoldenVariant> variants) {
  if (variants.empty()) {
    const auto kept = kept_tolerance(before, "work", name);
    return kept ? *kept : unmeasured(value, true);
  }
  const std::vector<GoldenVariant> same_work = of_same_work(variants);
  const bool of_solver = name == "iterations" || name == "steps_not_converged";
  const auto compared = of_solver ? std::span<const GoldenVariant>(same_work) : variants;
  double spread = 0;
  for (const GoldenVariant& variant : compared)
    spread = std::max(spread, std::abs(work_of(*variant.run)[name] - value));
  return measured(spread, value, compared);
}

// Takes out of `counts` what is not the same in all variants (how much tears, say), with the tolerance that
// gives.
Json take_varying(std::map<std::string, std::int64_t>& counts, const Json& before,
                  std::span<const GoldenVariant> variants) {
  Json varying = Json::object();
  for (auto count = counts.begin(); count != counts.end();) {
    const auto& [name, value] = *count;
    double spread = 0;
    for (const GoldenVariant& variant : variants) {
      const auto found = variant.run->numbers.find(name);
      if (found != variant.run->numbers.end())
        spread = std::max(spread, std::abs(found->second - static_cast<double>(value)));
    }
    std::optional<Tolerance> tolerance;
    if (variants.empty()) tolerance = kept_tolerance(before, "varying_counts", name);
    if (spread > 0) tolerance = measured(spread, static_cast<double>(value), variants);
    if (!tolerance) {
      ++count;
      continue;
    }
    varying[name] = {{"value", value}, {"tolerance", tolerance->absolute}, {"basis", tolerance->basis}};
    count = counts.erase(count);
  }
  return varying;
}

// --- the file

std::filesystem::path file_in(const std::filesystem::path& dir) {
  return dir / "golden.json";
}

// An empty object if there is none or it cannot be read.
Json read_before(const std::filesystem::path& dir) {
  std::ifstream file(file_in(dir));
  Json before = Json::parse(file, nullptr, false);
  return before.is_object() ? before : Json::object();
}

// One line for each entry of the groups, so that a change reads well in a diff.
std::string pretty(const Json& json) {
  std::string text = "{";
  for (const auto& [key, value] : json.items()) {
    text += (text.size() > 1 ? ",\n " : "\n ") + Json(key).dump() + ": ";
    if (!value.is_object() || value.empty()) {
      text += value.dump();
      continue;
    }
    std::string entries;
    for (const auto& [name, entry] : value.items())
      entries += (entries.empty() ? "\n  " : ",\n  ") + Json(name).dump() + ": " + entry.dump();
    text += "{" + entries + "\n }";
  }
  return text + "\n}\n";
}

Json golden_series(const RunData& run, const std::string& name, const Json& before,
                   std::span<const GoldenVariant> variants) {
  const Series* series = run.find(name);
  const std::string place = "golden of " + run.header.scenario_name + ": series " + name;
  if (series == nullptr || series->components < 1 ||
      series->values.size() != static_cast<std::size_t>(run.steps * series->components))
    throw InputError(place + " is not recorded for every step; record the run again");
  for (std::size_t i = 0; i < series->values.size(); ++i)
    if (!std::isfinite(series->values[i]))
      throw InputError(place + " is not finite at step " +
                       std::to_string(i / static_cast<std::size_t>(series->components)) +
                       "; a golden is taken from a good run only");
  std::vector<double> values;
  for (const std::int64_t step : kept_steps(run.steps))
    for (int c = 0; c < series->components; ++c)
      values.push_back(series->values[static_cast<std::size_t>(step * series->components + c)]);
  const std::vector<GoldenVariant> same_work = of_same_work(variants);
  const Tolerance tolerance =
      tolerance_of_series(*series, name, before,
                          name == iterations_series ? std::span<const GoldenVariant>(same_work) : variants);
  const Range range = range_of(*series);
  return {{"unit", series->unit},     {"components", series->components}, {"tolerance", tolerance.absolute},
          {"basis", tolerance.basis}, {"lowest", range.lowest},           {"highest", range.highest},
          {"values", values}};
}

// --- comparing

struct Difference {
  double largest = 0;  // NaN if a number is missing or not one
  std::string place;
  std::int64_t comparisons = 0;

  void add(double found, double golden, const std::string& where) {
    ++comparisons;
    const double difference = std::abs(found - golden);
    if (std::isnan(largest) || difference <= largest) return;
    largest = difference;
    place = where;
  }
};

Check compare_series(const RunData& run, const std::string& name, const Json& golden) {
  const std::string check_name = "golden/" + name;
  const Series* series = run.find(name);
  if (series == nullptr) return failed_check(check_name, values_kind, "the run has no such series");
  const int components = golden.at("components").get<int>();
  const auto unit = golden.at("unit").get<std::string>();
  const double tolerance = golden.at("tolerance").get<double>();
  const std::string basis = golden.at("basis").get<std::string>();
  const auto values = golden.at("values").get<std::vector<double>>();
  const auto lowest = golden.at("lowest").get<std::vector<double>>();
  const auto highest = golden.at("highest").get<std::vector<double>>();

  const std::vector<std::int64_t> steps = kept_steps(run.steps);
  const auto width = static_cast<std::size_t>(std::max(components, 0));
  if (series->components != components || series->unit != unit)
    return failed_check(check_name, values_kind,
                        "the run has " + std::to_string(series->components) + " component(s) in '" +
                            series->unit + "', the golden " + std::to_string(components) + " in '" + unit +
                            "'");
  if (series->values.size() != static_cast<std::size_t>(run.steps) * width ||
      values.size() != steps.size() * width || lowest.size() != width || highest.size() != width ||
      width == 0)
    return failed_check(check_name, values_kind,
                        "the lengths differ: the golden keeps " + std::to_string(values.size()) +
                            " numbers, the run gives " + std::to_string(steps.size() * width));
  if (!(tolerance >= 0) || !std::isfinite(tolerance))
    return failed_check(check_name, values_kind, "the golden's tolerance is not a number >= 0");

  Difference difference;
  for (std::size_t k = 0; k < steps.size(); ++k)
    for (std::size_t c = 0; c < width; ++c)
      difference.add(series->values[static_cast<std::size_t>(steps[k]) * width + c], values[k * width + c],
                     "at step " + std::to_string(steps[k]));
  if (!series->values.empty()) {
    const Range range = range_of(*series);
    for (std::size_t c = 0; c < width; ++c) {
      difference.add(range.lowest[c], lowest[c], "of the lowest value");
      difference.add(range.highest[c], highest[c], "of the highest value");
    }
  }
  for (const double value : series->values)  // min and max of a range may step over a NaN
    if (!std::isfinite(value)) difference.add(value, 0, "of a number that is not finite");
  return check_at_most(
      check_name, values_kind, difference.largest, tolerance, unit, difference.comparisons,
      (difference.place.empty() ? "no difference" : "largest difference " + difference.place) +
          "; tolerance: " + basis);
}

Check compare_counts(const RunData& run, const Json& golden, const Json& varying) {
  auto counts = counts_of(run);
  for (const auto& [name, entry] : varying.items()) counts.erase(name);
  std::string wrong;
  std::int64_t bad = 0;
  const auto note = [&](const std::string& text) {
    ++bad;
    wrong += (wrong.empty() ? "" : "; ") + text;
  };
  for (const auto& [name, value] : golden.items()) {
    const auto found = counts.find(name);
    const auto expected = value.get<std::int64_t>();
    if (found == counts.end())
      note(name + " is not in the run");
    else if (found->second != expected)
      note(name + " is " + std::to_string(found->second) + ", golden " + std::to_string(expected));
  }
  for (const auto& [name, value] : counts)
    if (!golden.contains(name)) note(name + " = " + std::to_string(value) + " is not in the golden");
  return check_at_most("golden/counts", values_kind, static_cast<double>(bad), 0, "",
                       static_cast<std::int64_t>(golden.size()),
                       wrong.empty() ? std::to_string(golden.size()) + " counts equal" : wrong);
}

// Numbers with a value and a tolerance each.
std::vector<Check> compare_numbers(const std::string& group, const std::map<std::string, double>& numbers,
                                   const Json& golden) {
  std::vector<Check> checks;
  for (const auto& [name, entry] : golden.items()) {
    const double expected = entry.at("value").get<double>();
    const std::string check_name = "golden/" + group + "/" + name;
    const auto found = numbers.find(name);
    if (found == numbers.end()) {
      checks.push_back(failed_check(check_name, values_kind, "the run does not count it"));
      continue;
    }
    std::ostringstream detail;
    detail << found->second << ", golden " << expected
           << "; tolerance: " << entry.at("basis").get<std::string>();
    checks.push_back(check_at_most(check_name, values_kind, std::abs(found->second - expected),
                                   entry.at("tolerance").get<double>(), "", 1, detail.str()));
  }
  return checks;
}

Check compare_fingerprint(const RunData& run, const Json& golden, bool physics_holds) {
  const auto text = golden.get<std::string>();
  std::uint64_t expected = 0;
  Check check;
  check.name = "golden/fingerprint";
  check.kind = "bits";
  if (!parse_hex16(text, expected)) {
    check.detail = "the golden's fingerprint '" + text.substr(0, 40) + "' is not 16 hexadecimal digits";
    return check;
  }
  if (run.fingerprints.empty()) {
    check.detail = "nothing was compared: the run has no fingerprint";
    return check;
  }
  check.comparisons = 1;
  check.passed = run.fingerprint() == expected;
  check.detail = hex16(run.fingerprint());
  if (!check.passed)
    check.detail += ", golden " + text + ": " +
                    (physics_holds ? "arithmetic changed, physics did not" : "bits and values changed");
  return check;
}

// Where other elements tore than in the golden: whether one stood so near its threshold that a rounding may
// have decided.
std::string nearest_to_threshold(const RunData& run) {
  const Series* margins = run.find("fracture/margin");
  if (margins == nullptr || margins->values.empty()) return "";
  const auto least = std::min_element(margins->values.begin(), margins->values.end());
  constexpr double rounding =
      1e-4;  // what a change of rounding moves a stress by, relative, with room to spare
  std::ostringstream text;
  text << "; the element nearest to its threshold was " << *least << " of it away, at step "
       << least - margins->values.begin()
       << (*least < rounding ? ": a rounding may have decided what tears" : ": no rounding decides that");
  return text.str();
}

std::vector<Check> compare_with(const RunData& run, const Json& golden) {
  std::vector<Check> checks;
  const auto steps = golden.at("steps").get<std::int64_t>();
  const bool same_steps = steps == run.steps && run.steps > 0;
  if (!same_steps) {
    checks.push_back(failed_check(
        "golden/steps", values_kind,
        "the run has " + std::to_string(run.steps) + " steps, the golden " + std::to_string(steps)));
  } else {
    checks.push_back(
        check_at_most("golden/steps", values_kind, 0, 0, "", 1, std::to_string(steps) + " steps"));
    const Json varying = golden.value("varying_counts", Json::object());
    checks.push_back(compare_counts(run, golden.at("counts"), varying));
    for (Check& check : compare_numbers("counts", run.numbers, varying)) checks.push_back(std::move(check));
    if (golden.at("series").empty())
      checks.push_back(
          failed_check("golden/series", values_kind, "nothing was compared: the golden has no series"));
    for (const auto& [name, series] : golden.at("series").items()) {
      checks.push_back(compare_series(run, name, series));
      if (name == "tissue/alive_tets" && !checks.back().passed)
        checks.back().detail += nearest_to_threshold(run);
    }
    for (const std::string& name : golden_series_names(run))
      if (!golden.at("series").contains(name))
        checks.push_back(
            failed_check("golden/" + name, values_kind, "the golden has no such series; write it again"));
  }
  // how much the solver worked is no physics
  const bool physics_holds = std::all_of(checks.begin(), checks.end(), [](const Check& check) {
    return check.passed || check.name == "golden/" + iterations_series;
  });
  if (same_steps) {
    for (Check& check : compare_numbers("work", work_of(run), golden.at("work")))
      checks.push_back(std::move(check));
  }
  checks.insert(checks.begin(), compare_fingerprint(run, golden.at("fingerprint"), physics_holds));
  return checks;
}

}  // namespace

void write_golden(const RunData& run, const std::filesystem::path& dir,
                  std::span<const GoldenVariant> variants) {
  const std::string place = "golden of " + run.header.scenario_name;
  if (run.steps <= 0) throw InputError(place + ": the run has no step; record one first");
  const Json before = read_before(dir);
  Json golden;
  golden["format_version"] = golden_format_version;
  golden["scenario"] = run.header.scenario_name;
  golden["fingerprint"] = hex16(run.fingerprint());
  golden["steps"] = run.steps;
  golden["written_by"] = run.header.build;
  auto counts = counts_of(run);
  golden["varying_counts"] = take_varying(counts, before, variants);
  golden["counts"] = counts;
  golden["work"] = Json::object();
  for (const auto& [name, value] : work_of(run)) {
    if (!std::isfinite(value)) throw InputError(place + ": counter " + name + " is not finite");
    const Tolerance tolerance = tolerance_of_work(name, value, before, variants);
    golden["work"][name] = {{"value", value}, {"tolerance", tolerance.absolute}, {"basis", tolerance.basis}};
  }
  golden["series"] = Json::object();
  for (const std::string& name : golden_series_names(run))
    golden["series"][name] = golden_series(run, name, before, variants);
  golden["steps_kept"] = kept_steps(run.steps);

  const std::string text = pretty(golden);
  if (static_cast<std::int64_t>(text.size()) > golden_max_bytes)
    throw InputError(place + ": needs " + std::to_string(text.size()) + " bytes, more than " +
                     std::to_string(golden_max_bytes) + "; use fewer tools in a golden scenario");
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error)
    throw EnvironmentError(dir.string() + ": cannot be created (" + error.message() +
                           "); choose a place that can be written to");
  write_file_atomically(file_in(dir), text);
}

std::vector<Check> compare_golden(const RunData& run, const std::filesystem::path& dir) {
  const std::string place = file_in(dir).string();
  std::ifstream file(file_in(dir));
  if (!file)
    return {failed_check("golden", values_kind,
                         place + " is missing; write it from a good run of this scenario")};
  try {
    const Json golden = Json::parse(file);
    if (golden.at("format_version") != golden_format_version)
      return {failed_check("golden", values_kind, place + " has another format version; write it again")};
    if (golden.at("scenario") != run.header.scenario_name)
      return {failed_check("golden", values_kind,
                           place + " belongs to scenario " + golden.at("scenario").dump() +
                               ", the run to \"" + run.header.scenario_name + "\"")};
    return compare_with(run, golden);
  } catch (const Json::exception& error) {
    return {failed_check("golden", values_kind,
                         place + " cannot be read (" + error.what() + "); write it again")};
  }
}

}  // namespace sulcus
