#include "verify/golden_provenance.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int provenance_format_version = 1;
const std::string check_name = "golden/provenance";

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

double relative(double difference, double before) {
  if (difference == 0) return 0;
  return before == 0 ? std::nan("") : difference / std::abs(before);
}

double peak(const Json& series) {
  double largest = 0;
  for (const char* end : {"lowest", "highest"}) {
    for (const Json& value : series.at(end)) largest = std::max(largest, std::abs(value.get<double>()));
  }
  return largest;
}

void compare_tolerance(const std::string& quantity, const std::string& unit, const Json& before,
                       const Json& now, std::vector<GoldenChange>& changes) {
  const double old_one = before.at("tolerance").get<double>(), new_one = now.at("tolerance").get<double>();
  if (old_one == new_one) return;
  changes.push_back({"tolerance of " + quantity, unit, number(old_one), number(new_one),
                     relative(std::abs(new_one - old_one), old_one)});
}

void compare_series(const std::string& name, const Json& before, const Json& now,
                    std::vector<GoldenChange>& changes) {
  const std::string quantity = "series/" + name, unit = now.at("unit").get<std::string>();
  const auto& old_values = before.at("values");
  const auto& new_values = now.at("values");
  double largest = old_values.size() == new_values.size() ? 0 : std::nan("");
  for (std::size_t i = 0; i < std::min(old_values.size(), new_values.size()); ++i) {
    const double difference = std::abs(new_values[i].get<double>() - old_values[i].get<double>());
    if (!std::isnan(largest)) largest = std::max(largest, difference);
  }
  if (largest != 0 || peak(before) != peak(now))
    changes.push_back(
        {quantity, unit, number(peak(before)), number(peak(now)), relative(largest, peak(before))});
  compare_tolerance(quantity, unit, before, now, changes);
}

// Calls both(name, before, now) for what both have; what one of them lacks is a change of its own.
template <class Both>
void compare_group(const std::string& group, const Json& before, const Json& now,
                   std::vector<GoldenChange>& changes, Both&& both) {
  for (const auto& [name, entry] : now.at(group).items()) {
    if (before.at(group).contains(name))
      both(name, before.at(group).at(name), entry);
    else
      changes.push_back({group + "/" + name, "", "", "new", std::nan("")});
  }
  for (const auto& [name, entry] : before.at(group).items()) {
    if (!now.at(group).contains(name)) changes.push_back({group + "/" + name, "", "gone", "", std::nan("")});
  }
}

Json files_in(const fs::path& dir) {
  std::map<std::string, std::string> hashes;
  for (const auto& entry : fs::directory_iterator(dir)) {
    const std::string name = entry.path().filename().string();
    if (name != "provenance.json") hashes[name] = hash_file(entry.path().string());
  }
  return hashes;
}

Json row_of(const GoldenChange& change) {
  Json row = {
      {"quantity", change.quantity}, {"unit", change.unit}, {"before", change.before}, {"now", change.now}};
  if (std::isfinite(change.relative)) row["relative"] = std::stod(number(change.relative));
  return row;
}

// One line for each change and file, so that it reads well in a diff.
std::string pretty(const Json& entries) {
  std::string text =
      "{\"format_version\": " + std::to_string(provenance_format_version) + ",\n \"entries\": [";
  for (std::size_t e = 0; e < entries.size(); ++e) {
    text += e == 0 ? "{" : ",\n {";
    bool first = true;
    for (const auto& [key, value] : entries[e].items()) {
      text += std::string(first ? "\n" : ",\n") + "  " + Json(key).dump() + ": ";
      first = false;
      if (!value.is_structured() || value.empty()) {
        text += value.dump();
        continue;
      }
      std::string lines;
      for (const auto& [name, item] : value.items()) {
        lines += lines.empty() ? "\n   " : ",\n   ";
        lines += (value.is_object() ? Json(name).dump() + ": " : "") + item.dump();
      }
      text += (value.is_object() ? "{" : "[") + lines + "\n  " + (value.is_object() ? "}" : "]");
    }
    text += "\n }";
  }
  return text + "]\n}\n";
}

}  // namespace

std::vector<GoldenChange> golden_changes(const std::string& before_text, const std::string& now_text) {
  std::vector<GoldenChange> changes;
  const Json before = Json::parse(before_text, nullptr, false), now = Json::parse(now_text);
  if (!before.is_object()) return {{"golden", "", "", "new", std::nan("")}};
  try {
    if (before.at("fingerprint") != now.at("fingerprint"))
      changes.push_back({"fingerprint", "", before.at("fingerprint").get<std::string>(),
                         now.at("fingerprint").get<std::string>(), std::nan("")});
    if (before.at("steps") != now.at("steps"))
      changes.push_back({"steps", "", before.at("steps").dump(), now.at("steps").dump(), std::nan("")});
    const auto plain = [&](const std::string& quantity, double a, double b) {
      if (a != b) changes.push_back({quantity, "", number(a), number(b), relative(std::abs(b - a), a)});
    };
    compare_group("counts", before, now, changes, [&](const std::string& name, const Json& a, const Json& b) {
      plain("counts/" + name, a.get<double>(), b.get<double>());
    });
    compare_group("work", before, now, changes, [&](const std::string& name, const Json& a, const Json& b) {
      plain("work/" + name, a.at("value").get<double>(), b.at("value").get<double>());
      compare_tolerance("work/" + name, "", a, b, changes);
    });
    compare_group("series", before, now, changes, [&](const std::string& name, const Json& a, const Json& b) {
      compare_series(name, a, b, changes);
    });
  } catch (const Json::exception&) {
    return {{"golden", "", "of another format", "new", std::nan("")}};
  }
  return changes;
}

void write_provenance(const fs::path& dir, const std::string& why,
                      const std::map<std::string, std::string>& build,
                      const std::vector<GoldenChange>& changes) {
  if (why.find_first_not_of(" \t\n") == std::string::npos)
    throw InputError("a golden changes for a reason; give it with --why \"...\"");
  Json entry;
  entry["why"] = why;
  entry["build"] = build;
  entry["files"] = files_in(dir);
  entry["changes"] = Json::array();
  for (const GoldenChange& change : changes) entry["changes"].push_back(row_of(change));
  Json entries = Json::array({entry});
  std::ifstream file(dir / "provenance.json");
  const Json before = Json::parse(file, nullptr, false);
  if (before.is_object() && before.contains("entries") && before["entries"].is_array()) {
    for (const Json& old_entry : before["entries"]) {
      if (entries.size() < provenance_entries && old_entry.is_object()) entries.push_back(old_entry);
    }
  }
  write_file_atomically(dir / "provenance.json", pretty(entries));
}

Check check_provenance(const fs::path& dir) {
  const std::string remedy = "; change goldens with `sulcus bless SCENARIO --why \"...\"` only";
  std::ifstream file(dir / "provenance.json");
  if (!file) return failed_check(check_name, "values", "there is no provenance.json" + remedy);
  try {
    const Json entry = Json::parse(file).at("entries").at(0);
    if (entry.at("why").get<std::string>().find_first_not_of(" \t\n") == std::string::npos)
      return failed_check(check_name, "values", "its newest entry gives no reason" + remedy);
    const Json& blessed = entry.at("files");
    const Json standing = files_in(dir);
    std::string wrong;
    for (const auto& [name, hash] : standing.items()) {
      if (!blessed.contains(name) || blessed.at(name) != hash) wrong += (wrong.empty() ? "" : ", ") + name;
    }
    for (const auto& [name, hash] : blessed.items()) {
      if (!standing.contains(name)) wrong += (wrong.empty() ? "" : ", ") + name + " (gone)";
    }
    if (!wrong.empty())
      return failed_check(check_name, "values", "changed without a reason: " + wrong + remedy);
    Check check = check_at_most(check_name, "values", 0, 0, "", static_cast<std::int64_t>(blessed.size()),
                                entry.at("why").get<std::string>());
    check.value = check.bound = check.margin = std::nan("");
    return check;
  } catch (const Json::exception& error) {
    return failed_check(check_name, "values",
                        std::string("provenance.json cannot be read (") + error.what() + ")" + remedy);
  }
}

}  // namespace sulcus
