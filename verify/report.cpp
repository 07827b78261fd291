#include "verify/report.h"

#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/report_parts.h"
#include "verify/summary.h"

namespace sulcus {
namespace {

using report::quantity;
using report::whole_number;

std::string name_of(const RunReportInput& input) {
  return input.name.empty() ? input.run->header.scenario_name : input.name;
}

std::size_t count_failed(const std::vector<Check>& checks) {
  return static_cast<std::size_t>(
      std::count_if(checks.begin(), checks.end(), [](const Check& c) { return !c.passed; }));
}

bool holds(const RunReportInput& input) {
  return all_passed(input.checks);
}

std::string plural(std::size_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

// "<div class=verdict holds>": the sentence in large letters, then why.
std::string verdict_box(bool good, const std::string& sentence, const std::string& html) {
  return std::string("<div class=\"verdict ") + (good ? "holds" : "fails") + "\"><strong>" +
         (good ? "✓ " : "✗ ") + escape_html(sentence) + "</strong>" + html + "</div>\n";
}

std::string run_verdict(const RunReportInput& input) {
  const std::size_t failed = count_failed(input.checks);
  if (input.checks.empty()) {
    return verdict_box(false, "Nothing was checked",
                       "<p>This run has no checks, so nothing says that it is right.</p>");
  }
  if (failed == 0) {
    const std::string all = input.checks.size() == 1
                                ? "The one check holds"
                                : "All " + plural(input.checks.size(), "check") + " hold";
    return verdict_box(true, all, "");
  }
  std::string why = "<ul class=\"plain\">";
  for (const Check& check : input.checks) {
    if (check.passed) continue;
    why += "<li><b>" + escape_html(check.name) + "</b>" +
           (check.detail.empty() ? "" : ": " + escape_html(check.detail)) + "</li>";
  }
  return verdict_box(false,
                     std::to_string(failed) + " of " + plural(input.checks.size(), "check") +
                         (failed == 1 ? " fails" : " fail"),
                     why + "</ul>");
}

std::string fact(const std::string& name, const std::string& value, const std::string& note) {
  return "<div><dt>" + escape_html(name) + "</dt><dd>" + escape_html(value) +
         (note.empty() ? "" : "<small>" + escape_html(note) + "</small>") + "</dd></div>";
}

std::string facts(const RunData& run, const RunSummary& summary) {
  std::string html = "<dl class=\"facts\">";
  html +=
      fact("simulated", quantity(static_cast<double>(run.steps) * run.header.step_s, "s"),
           whole_number(static_cast<double>(run.steps)) + " steps of " + quantity(run.header.step_s, "s"));
  if (std::isfinite(summary.total.median_s)) {
    html += fact("time for a step", quantity(summary.total.median_s, "s"),
                 "median; 95 % below " + quantity(summary.total.p95_s, "s"));
  }
  if (!summary.tools.empty()) {
    double force = 0, depth = 0;
    for (const ToolSummary& tool : summary.tools) {
      force = std::max(force, tool.max_contact_force_N);
      depth = std::max(depth, tool.max_penetration_m);
    }
    html += fact("largest force", quantity(force, "N"), "tissue on tool");
    html += fact("deepest contact", quantity(depth, "m"), "below the surface");
  }
  if (summary.solver_errors_measured > 0) {
    html +=
        fact("solver error", quantity(summary.max_solver_error, ""),
             "largest of " + whole_number(static_cast<double>(summary.solver_errors_measured)) + " measured");
  }
  return html + "</dl>\n";
}

std::string figure(const ReportPicture& picture) {
  const std::string caption = escape_html(picture.caption);
  const std::string time =
      std::isfinite(picture.time_s) ? " data-time=\"" + std::to_string(picture.time_s) + "\"" : "";
  return "<figure" + time + "><img alt=\"" + caption + "\" width=\"" + std::to_string(picture.image.width) +
         "\" height=\"" + std::to_string(picture.image.height) + "\" src=\"data:image/png;base64," +
         report::base64(encode_png(picture.image)) + "\"><figcaption>" + caption + "</figcaption></figure>\n";
}

std::string pictures(const RunReportInput& input) {
  if (input.pictures.empty()) return "";
  std::string html = "<h3>What happened</h3>\n" + report::slider(*input.run) + "<div class=\"pictures\">";
  for (const ReportPicture& picture : input.pictures) html += figure(picture);
  return html + "</div>\n";
}

std::string differences(const RunReportInput& input) {
  if (input.differences.empty()) return "";
  std::string html = "<h3>Pictures that differ from the golden ones</h3>\n<div class=\"differences\">";
  for (const ReportPicture& picture : input.differences) html += figure(picture);
  return html + "</div>\n";
}

std::string charts(const RunReportInput& input) {
  const auto list = report::charts_of(*input.run, input.checks, input.golden);
  if (list.empty()) return "";
  std::string html = "<h3>Over time</h3>\n" + (input.pictures.empty() ? report::slider(*input.run) : "") +
                     "<div class=\"charts\">";
  for (const auto& [caption, chart] : list) {
    html += "<figure><figcaption>" + escape_html(chart.title) + "<small>" + escape_html(caption) +
            "</small></figcaption>" + chart_svg(chart) + "</figure>\n";
  }
  return html + "</div>\n";
}

std::string check_row(const Check& check) {
  // Whether a bound is an upper or a lower one, its margin tells.
  const double room = check.bound - check.value;
  const std::string sign = room == 0                                                         ? ""
                           : std::abs(room - check.margin) <= std::abs(-room - check.margin) ? "≤ "
                                                                                             : "≥ ";
  const std::string bound = std::isnan(check.bound) ? "–" : sign + quantity(check.bound, check.unit);
  const auto number = [](const std::string& label, const std::string& text) {
    return "<td class=\"number\" data-label=\"" + label + "\">" + escape_html(text) + "</td>";
  };
  return std::string("<tr") + (check.passed ? "" : " class=\"failed\"") + "><td class=\"mark " +
         (check.passed ? "holds\">✓ holds" : "fails\">✗ fails") + "</td><th scope=\"row\">" +
         escape_html(check.name) + "</th>" + number("value", quantity(check.value, check.unit)) +
         number("bound", bound) + number("margin", quantity(check.margin, check.unit)) +
         "<td class=\"detail\"><small>" + escape_html(check.detail) + "</small></td></tr>\n";
}

std::string check_table(const std::vector<Check>& checks) {
  if (checks.empty()) return "";
  std::string html =
      "<h3>Every check</h3>\n<table class=\"checks\"><thead><tr><th>verdict</th><th>check</th><th "
      "class=\"number\">"
      "value</th><th class=\"number\">bound</th><th class=\"number\">margin</th><th>where, or "
      "why</th></tr></thead><tbody>\n";
  struct Kind {
    const char* kind;
    const char* heading;
  };
  constexpr Kind kinds[] = {{"statement", "Laws that every run has to keep"},
                            {"values", "Agreement with the golden run, within tolerances"},
                            {"bits", "The same bits as the golden run"}};
  const auto rows = [&](const std::string& heading, const auto& belongs) {
    std::string found;
    for (const bool passed : {false, true}) {
      for (const Check& check : checks) {
        if (check.passed == passed && belongs(check.kind)) found += check_row(check);
      }
    }
    if (found.empty()) return;
    html += "<tr class=\"kind\"><th colspan=\"6\">" + heading + "</th></tr>\n" + found;
  };
  for (const Kind& kind : kinds) rows(kind.heading, [&](const std::string& k) { return k == kind.kind; });
  rows("Others", [&](const std::string& k) {
    return std::none_of(std::begin(kinds), std::end(kinds), [&](const Kind& kind) { return k == kind.kind; });
  });
  return html + "</tbody></table>\n";
}

std::string row(const std::string& name, const std::string& value_html, bool number = false) {
  return "<tr><th scope=\"row\">" + escape_html(name) + "</th><td" + (number ? " class=\"number\">" : ">") +
         value_html + "</td></tr>\n";
}

// "mesh_pieces" -> "mesh pieces"
std::string words(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string mesh_table(const RunData& run) {
  std::string html = "<h3>Mesh and work</h3>\n<table><tbody>\n";
  html += row("nodes", whole_number(static_cast<double>(run.header.node_count())), true);
  html += row("tetrahedra", whole_number(static_cast<double>(run.header.tet_count())), true);
  for (const auto& [name, value] : run.numbers)
    html += row(words(name), escape_html(quantity(value, "")), true);
  return html + "</tbody></table>\n";
}

std::string list_of(const std::string& heading, const std::vector<std::string>& items) {
  if (items.empty()) return "";
  std::string html = "<h3>" + heading + "</h3>\n<ul class=\"plain\">";
  for (const std::string& item : items) html += "<li>" + escape_html(item) + "</li>";
  return html + "</ul>\n";
}

std::string provenance(const RunData& run) {
  const auto code = [](const std::string& text) { return "<code>" + escape_html(text) + "</code>"; };
  std::string html = "<h3>Where it comes from</h3>\n<table><tbody>\n";
  html += row("fingerprint", code(hex16(run.fingerprint())));
  for (const auto& [name, value] : run.header.build) html += row(words(name), code(value));
  html += row("threads", std::to_string(run.header.threads));
  for (const std::string& change : run.header.overrides) html += row("changed by hand", code(change));
  for (const auto& [file, hash] : run.header.inputs) html += row("input " + file, code(hash));
  html += "</tbody></table>\n";
  if (!run.header.scenario_json.empty()) {
    html += "<details><summary>The scenario, with every default</summary><pre>" +
            escape_html(run.header.scenario_json) + "</pre></details>\n";
  }
  return html;
}

std::string reproduce(const std::string& command) {
  if (command.empty()) return "";
  return "<h3>See it again</h3>\n<p>One line gives the same run, bit by bit:</p><pre><code>" +
         escape_html(command) + "</code></pre>\n";
}

std::string run_section(const RunReportInput& input, std::size_t number) {
  const RunData& run = *input.run;
  std::vector<std::string> events;
  for (const RunEvent& event : run.events)
    events.push_back("step " + std::to_string(event.step) + ": " + event.text);
  return "<section class=\"run\" id=\"run" + std::to_string(number) + "\">\n<header><h2>" +
         escape_html(name_of(input)) + "</h2>" +
         (input.description.empty() ? "" : "<p>" + escape_html(input.description) + "</p>") + "</header>\n" +
         run_verdict(input) + facts(run, summarise(run)) + differences(input) + pictures(input) +
         charts(input) + report::fingerprint_section(run) + report::session_section(run) +
         check_table(input.checks) + list_of("Warnings", run.warnings) + list_of("Events", events) +
         mesh_table(run) + reproduce(input.reproduce) + provenance(run) + "</section>\n";
}

// For several runs: one verdict over all, and a list that leads to each.
std::string overview(const std::vector<RunReportInput>& runs) {
  const auto good = static_cast<std::size_t>(std::count_if(runs.begin(), runs.end(), holds));
  std::string html =
      good == runs.size()
          ? verdict_box(true, "All " + plural(runs.size(), "run") + " hold", "")
          : verdict_box(false,
                        std::to_string(runs.size() - good) + " of " + plural(runs.size(), "run") +
                            (runs.size() - good == 1 ? " fails" : " fail"),
                        "");
  html += "<ul class=\"runs\">";
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const bool passed = holds(runs[r]);
    html += "<li><a href=\"#run" + std::to_string(r + 1) + "\"><span class=\"mark " +
            (passed ? "holds\">✓" : "fails\">✗") + "</span> " + escape_html(name_of(runs[r])) + "</a></li>";
  }
  return html + "</ul>\n";
}

}  // namespace

std::string report_html(const std::vector<RunReportInput>& runs) {
  if (runs.empty()) throw InputError("a report needs a run; none was given");
  for (const RunReportInput& input : runs) {
    if (!input.run)
      throw InputError("the report's run '" + input.name + "' has no recording; read it with read_run");
  }
  const bool good = std::all_of(runs.begin(), runs.end(), holds);
  const std::string subject = runs.size() == 1 ? name_of(runs.front()) : plural(runs.size(), "run");
  std::string body =
      "<h1>Sulcus · report of a " + std::string(runs.size() == 1 ? "run" : "set of runs") + "</h1>\n";
  if (runs.size() > 1) body += overview(runs);
  for (std::size_t r = 0; r < runs.size(); ++r) body += run_section(runs[r], r + 1);
  return report::page(subject + (good ? ": holds" : ": fails"), body + report::slider_script);
}

void write_report(const std::vector<RunReportInput>& runs, const std::filesystem::path& path) {
  write_file_atomically(path, report_html(runs));
}

}  // namespace sulcus
