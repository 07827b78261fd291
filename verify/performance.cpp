#include "verify/performance.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "verify/report.h"
#include "verify/report_parts.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

constexpr double count_step = 0.03, time_step = 0.05;  // relative changes that are marked
constexpr std::size_t most_lines = 6;                  // in a chart

struct Point {
  std::size_t entry = 0;  // of the history, from 0
  double value = 0;
  double spread = 0;  // of repeated measurements; 0 for counts
};

// One quantity over the history; its points are comparable with each other.
struct Trend {
  std::string group, name, basis;  // chart, line, and compiler or machine
  std::vector<Point> points;
};

struct StepChange {
  std::size_t entry = 0;
  const Trend* trend = nullptr;
  double before = 0, now = 0;
};

Json read_entries(const fs::path& path) {
  std::ifstream file(path);
  if (!file) throw InputError(path.string() + ": cannot be read; tools/perf bless and record write it");
  try {
    Json entries = Json::parse(file);
    if (!entries.is_array() || entries.empty())
      throw InputError(path.string() + ": found no entry, expected an array of them, oldest first");
    for (const Json& entry : entries) {
      for (const char* key : {"commit", "day", "why"}) entry.at(key).get<std::string>();
    }
    return entries;
  } catch (const Json::exception& error) {
    throw InputError(path.string() + ": " + error.what() + "; take it from the repository again");
  }
}

// Finds or makes the trend of a quantity; other compilers or machines have their own.
Trend& trend_of(std::vector<Trend>& trends, const std::string& group, const std::string& name,
                const std::string& basis) {
  for (Trend& trend : trends) {
    if (trend.group == group && trend.name == name && trend.basis == basis) return trend;
  }
  return trends.emplace_back(Trend{group, name, basis, {}});
}

std::vector<Trend> count_trends(const Json& entries) {
  std::vector<Trend> trends;
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const auto compiler = entries[e].at("compiler").get<std::string>();
    for (const auto& [scenario, counts] : entries[e].at("counts").items()) {
      for (const char* kind : {"instructions", "work"}) {
        for (const auto& [name, value] : counts.at(kind).items())
          trend_of(trends, scenario, name, compiler).points.push_back({e, value.get<double>(), 0});
      }
    }
  }
  return trends;
}

std::vector<Trend> time_trends(const Json& entries) {
  std::vector<Trend> trends;
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const auto machine = entries[e].at("machine").get<std::string>();
    for (const auto& [name, time] : entries[e].at("times").items())
      trend_of(trends, machine, name, machine)
          .points.push_back({e, time.at("median").get<double>(), time.at("spread").get<double>()});
  }
  return trends;
}

double largest_change(const Trend& trend) {
  double change = 0;
  for (const Point& point : trend.points) {
    if (trend.points.front().value > 0)
      change = std::max(change, std::abs(point.value / trend.points.front().value - 1));
  }
  return change;
}

std::vector<StepChange> step_changes(const std::vector<Trend>& trends, double limit) {
  std::vector<StepChange> found;
  for (const Trend& trend : trends) {
    for (std::size_t p = 1; p < trend.points.size(); ++p) {
      const Point &before = trend.points[p - 1], &now = trend.points[p];
      const double change = std::abs(now.value - before.value);
      if (change > limit * before.value && change > before.spread + now.spread)
        found.push_back({now.entry, &trend, before.value, now.value});
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const StepChange& a, const StepChange& b) { return a.entry > b.entry; });
  return found;
}

// The lines of a group that changed most, in their order.
std::vector<const Trend*> drawn_trends(const std::vector<Trend>& trends, const std::string& group) {
  std::vector<const Trend*> chosen;
  for (const Trend& trend : trends) {
    if (trend.group == group) chosen.push_back(&trend);
  }
  const auto more = [](const Trend* a, const Trend* b) { return largest_change(*a) > largest_change(*b); };
  std::stable_sort(chosen.begin(), chosen.end(), more);
  chosen.resize(std::min(chosen.size(), most_lines));
  return chosen;
}

Chart chart_of(const std::vector<Trend>& trends, const std::string& group, const Json& entries,
               const std::vector<StepChange>& changes) {
  Chart chart;
  chart.title = group;
  chart.x_label = "entry of the history";
  chart.y_label = "change since the first [%]";
  chart.kind = ChartKind::trend;
  double low = 0, high = 1;
  for (const Trend* trend : drawn_trends(trends, group)) {
    Curve curve{trend->name, {}, {}};
    for (const Point& point : trend->points) {
      const double first = trend->points.front().value;
      curve.x.push_back(static_cast<double>(point.entry + 1));
      curve.y.push_back(first > 0 ? 100 * (point.value / first - 1) : 0);
      low = std::min(low, curve.y.back());
      high = std::max(high, curve.y.back());
    }
    chart.curves.push_back(std::move(curve));
  }
  const double half = 0.006 * static_cast<double>(entries.size() + 1);
  std::vector<bool> marked(entries.size(), false);
  for (const StepChange& change : changes) {
    if (change.trend->group != group || marked[change.entry]) continue;
    marked[change.entry] = true;
    const double x = static_cast<double>(change.entry + 1);
    chart.bands.push_back(
        {chart.bands.empty() ? "step change" : "", {x - half, x + half}, {low, low}, {high, high}});
  }
  return chart;
}

std::string percent(double before, double now) {
  if (!(before > 0)) return "new";
  char text[32];
  std::snprintf(text, sizeof text, "%+.1f %%", 100 * (now / before - 1));
  return text;
}

std::string number(double value) {
  if (value == std::floor(value)) return report::whole_number(value);
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

// Rows of a name and three numbers; on a narrow page the name stands above its numbers.
std::string table_head(const char* first, const char* second) {
  std::string html = "<table class=\"timing\"><thead><tr><th>what</th>";
  for (const char* title : {first, second, "change"})
    html += std::string("<th class=\"number\">") + title + "</th>";
  return html + "</tr></thead><tbody>\n";
}

std::string table_row(const Trend& trend, double before, double now) {
  std::string html = "<tr><th scope=\"row\">" + escape_html(trend.group + ": " + trend.name) + "</th>";
  for (const std::string& text : {number(before), number(now), percent(before, now)})
    html += "<td class=\"number\">" + escape_html(text) + "</td>";
  return html + "</tr>\n";
}

// A table for each entry that changed something, the newest first.
std::string changes_tables(const std::vector<StepChange>& changes, const Json& entries) {
  if (changes.empty()) return "<p>No step change.</p>\n";
  std::string html;
  for (std::size_t c = 0; c < changes.size(); ++c) {
    const Json& entry = entries[changes[c].entry];
    if (c == 0 || changes[c].entry != changes[c - 1].entry) {
      html += (c == 0 ? "" : "</tbody></table>\n") + ("<h4>Entry " + std::to_string(changes[c].entry + 1)) +
              ", commit " + escape_html(entry.at("commit").get<std::string>()) + ", " +
              escape_html(entry.at("day").get<std::string>()) + "</h4>\n<p>" +
              escape_html(entry.at("why").get<std::string>()) + "</p>\n" + table_head("before", "since");
    }
    html += table_row(*changes[c].trend, changes[c].before, changes[c].now);
  }
  return html + "</tbody></table>\n";
}

std::string newest_table(const std::vector<Trend>& trends, std::size_t newest) {
  std::string html = table_head("first", "newest");
  for (const Trend& trend : trends) {
    if (trend.points.back().entry == newest)
      html += table_row(trend, trend.points.front().value, trend.points.back().value);
  }
  return html + "</tbody></table>\n";
}

std::string section(const std::string& title, const std::string& text, const std::vector<Trend>& trends,
                    const Json& entries, double limit) {
  const std::vector<StepChange> changes = step_changes(trends, limit);
  std::string html = "<h2>" + title + "</h2>\n<p>" + text + "</p>\n<div class=\"charts\">\n";
  std::vector<std::string> groups;
  for (const Trend& trend : trends) {
    if (std::find(groups.begin(), groups.end(), trend.group) == groups.end()) groups.push_back(trend.group);
  }
  for (const std::string& group : groups)
    html += "<figure><figcaption>" + escape_html(group) + "</figcaption>" +
            chart_svg(chart_of(trends, group, entries, changes)) + "</figure>\n";
  return html + "</div>\n<h3>Step changes</h3>\n" + changes_tables(changes, entries) +
         "<details><summary>All of the newest entry</summary>\n" + newest_table(trends, entries.size() - 1) +
         "</details>\n";
}

}  // namespace

std::string performance_html(const fs::path& folder) {
  const Json counts = read_entries(folder / "counts.json");
  std::string body = "<h1>Sulcus · performance over time</h1>\n";
  try {
    body += section("Counts",
                    "Instructions (callgrind, one thread, kernels for AVX2) and work of short runs; an entry "
                    "for each commit "
                    "that changed them. Of each scenario the six quantities are drawn that changed most.",
                    count_trends(counts), counts, count_step);
    if (fs::exists(folder / "times.json")) {
      const Json times = read_entries(folder / "times.json");
      body +=
          section("Wall time",
                  "Medians of nine samples, one thread, by machine; for a verdict use tools/perf compare.",
                  time_trends(times), times, time_step);
    }
  } catch (const Json::exception& error) {
    throw InputError(folder.string() + ": " + error.what() + "; take it from the repository again");
  }
  return report::page("Sulcus: performance over time", body);
}

}  // namespace sulcus
