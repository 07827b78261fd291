#include "verify/suite_index.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "verify/fingerprint.h"
#include "verify/report.h"
#include "verify/report_parts.h"

namespace sulcus {
namespace {

using report::quantity;

constexpr const char* kinds[] = {"statement", "values", "bits"};

double largest_force_N(const RunSummary& summary) {
  double force = 0;
  for (const ToolSummary& tool : summary.tools) force = std::max(force, tool.max_displayed_force_N);
  return force;
}

double deepest_m(const RunSummary& summary) {
  double depth = 0;
  for (const ToolSummary& tool : summary.tools) depth = std::max(depth, tool.max_penetration_m);
  return depth;
}

std::string text(const char* format, double value) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

// A cell that is shown as `shown` and sorted by `key`.
std::string cell(const std::string& label, double key, const std::string& shown) {
  return "<td class=\"number\" data-label=\"" + label + "\" data-key=\"" + text("%.9g", key) + "\">" +
         escape_html(shown) + "</td>";
}

std::string verdict_cell(const std::string& label, const std::string& verdict) {
  const std::string mark = verdict == "holds" ? "✓ " : verdict == "fails" ? "✗ " : "";
  return "<td class=\"mark " + verdict + "\" data-label=\"" + label + "\" data-key=\"" +
         (verdict == "fails"   ? "0"
          : verdict == "holds" ? "1"
                               : "2") +
         "\">" + mark + verdict + "</td>";
}

std::string html_row(const SuiteEntry& entry) {
  const RunSummary& s = entry.summary;
  const std::string name = escape_html(entry.name);
  std::string row =
      std::string("<tr") + (all_passed(entry.checks) ? "" : " class=\"failed\"") +
      "><th scope=\"row\" data-key=\"" + name + "\">" +
      (entry.report.empty() ? name : "<a href=\"" + escape_html(entry.report) + "\">" + name + "</a>") +
      "</th>";
  for (const char* kind : kinds) row += verdict_cell(kind, verdict_of(entry, kind));
  const auto count = [](std::int64_t n) { return report::whole_number(static_cast<double>(n)); };
  row += cell("steps", static_cast<double>(s.steps), count(s.steps));
  row += cell("tetrahedra", static_cast<double>(s.tets), count(s.tets));
  row += cell("time per step", s.total.median_s, quantity(s.total.median_s, "s"));
  row += cell("solver error", s.solver_errors_measured > 0 ? s.max_solver_error : std::nan(""),
              s.solver_errors_measured > 0 ? quantity(s.max_solver_error, "") : "–");
  row += cell("force", largest_force_N(s), quantity(largest_force_N(s), "N"));
  row += cell("penetration", deepest_m(s), quantity(deepest_m(s), "m"));
  row += "<td class=\"code\" data-label=\"fingerprint\" data-key=\"" + hex16(s.fingerprint) + "\">" +
         hex16(s.fingerprint) + "</td>";
  row += cell("wall clock", entry.wall_s, text("%.1f s", entry.wall_s));
  return row + "</tr>\n";
}

std::string failures_html(std::span<const SuiteEntry> entries) {
  std::string html;
  for (const SuiteEntry& entry : entries) {
    if (all_passed(entry.checks)) continue;
    html += "<h3>" + escape_html(entry.name) + "</h3>\n<ul class=\"plain\">";
    for (const Check& check : entry.checks) {
      if (!check.passed)
        html += "<li><b>" + escape_html(check.name) + "</b> (" + escape_html(check.kind) +
                "): " + escape_html(check.detail) + "</li>";
    }
    html += "</ul>\n<pre><code>" + escape_html(entry.reproduce) + "</code></pre>\n";
  }
  return html;
}

std::string sentence_of(const SuiteTotals& totals) {
  const std::string all = std::to_string(totals.scenarios) + " scenario" + (totals.scenarios == 1 ? "" : "s");
  return totals.failed == 0
             ? (totals.scenarios == 1 ? "The one scenario holds" : "All " + all + " hold")
             : std::to_string(totals.failed) + " of " + all + (totals.failed == 1 ? " fails" : " fail");
}

// Sorts by the column whose heading is clicked; a second click turns the order round.
constexpr const char* sort_script = R"(<script>
document.querySelectorAll('table.suite thead th').forEach((head, column) => {
  head.tabIndex = 0;
  const sort = () => {
    const down = head.getAttribute('aria-sort') === 'ascending';
    document.querySelectorAll('table.suite thead th').forEach(h => h.removeAttribute('aria-sort'));
    head.setAttribute('aria-sort', down ? 'descending' : 'ascending');
    const body = document.querySelector('table.suite tbody');
    const key = row => row.children[column].dataset.key;
    const compare = (a, b) => {
      const x = key(a), y = key(b), n = Number(x), m = Number(y);
      if (column > 0 && x !== '' && !Number.isNaN(n) && !Number.isNaN(m)) return n - m;
      return x < y ? -1 : x > y ? 1 : 0;
    };
    const rows = [...body.children].sort(compare);
    if (down) rows.reverse();
    body.append(...rows);
  };
  head.addEventListener('click', sort);
  head.addEventListener('keydown', event => { if (event.key === 'Enter') sort(); });
});
</script>
)";

constexpr const char* suite_style = R"(<style>
main { max-width: 1560px; }
.wide { overflow-x: auto; margin-top: 20px; }
table.suite thead th { cursor: pointer; user-select: none; white-space: nowrap; }
table.suite th[aria-sort=ascending]::after { content: " ▲"; } table.suite th[aria-sort=descending]::after { content: " ▼"; }
table.suite td, table.suite th { white-space: nowrap; padding: 7px 9px; font-size: .9rem; }
table.suite tr.failed th[scope=row] { box-shadow: inset 4px 0 var(--bad); }
@media (max-width: 640px) {
  table.suite thead { display: none; }
  table.suite tr { display: grid; grid-template-columns: 1fr 1fr; padding: 8px 4px; border-top: 1px solid var(--line); }
  table.suite td, table.suite th[scope=row] { display: block; border: 0; padding: 1px 8px; text-align: left; font-size: .82rem; }
  table.suite th[scope=row], table.suite td[data-label=fingerprint] { grid-column: 1 / -1; }
  table.suite th[scope=row] { font-size: 1rem; } table.suite td[data-label=fingerprint] { order: 1; }
  table.suite td::before { content: attr(data-label) ": "; color: var(--pale); font-weight: 400; }
}
</style>
)";

}  // namespace

SuiteTotals totals_of(std::span<const SuiteEntry> entries) {
  SuiteTotals totals;
  totals.scenarios = entries.size();
  for (const SuiteEntry& entry : entries) {
    totals.failed += !all_passed(entry.checks);
    totals.checks += entry.checks.size();
  }
  return totals;
}

std::string verdict_of(const SuiteEntry& entry, const std::string& kind) {
  std::string verdict = "–";
  for (const Check& check : entry.checks) {
    if (check.kind != kind) continue;
    if (!check.passed) return "fails";
    verdict = "holds";
  }
  return verdict;
}

std::string suite_html(std::span<const SuiteEntry> entries, double wall_s) {
  const SuiteTotals totals = totals_of(entries);
  const bool good = totals.failed == 0 && totals.scenarios > 0;
  const std::string sentence = sentence_of(totals);
  std::string body = std::string(suite_style) + "<h1>Sulcus · all scenarios</h1>\n<div class=\"verdict " +
                     (good ? "holds" : "fails") + "\"><strong>" + (good ? "✓ " : "✗ ") + sentence +
                     "</strong><p>" + std::to_string(totals.checks) + " checks in " + text("%.0f s", wall_s) +
                     ". Each scenario was run, replayed with another number of threads, and held against its "
                     "statements and its golden outputs.</p></div>\n" +
                     failures_html(entries) + "<div class=\"wide\"><table class=\"suite\"><thead><tr>";
  for (const char* head : {"scenario", "statements", "values", "bits", "steps", "tetrahedra", "time per step",
                           "solver error", "force", "penetration", "fingerprint", "wall clock"})
    body += std::string("<th scope=\"col\">") + head + "</th>";
  body += "</tr></thead><tbody>\n";
  for (const SuiteEntry& entry : entries) body += html_row(entry);
  return report::page("Sulcus: " + sentence, body + "</tbody></table></div>\n" + sort_script);
}

std::string suite_markdown(std::span<const SuiteEntry> entries, double wall_s) {
  const SuiteTotals totals = totals_of(entries);
  std::string markdown = "## " + sentence_of(totals) + "\n\n" + std::to_string(totals.checks) +
                         " checks in " + text("%.0f s", wall_s) +
                         "\n\n| scenario | statements | values | bits | time per step | solver error | "
                         "fingerprint | wall clock |\n| --- | --- | --- | --- | ---: | ---: | --- | ---: |\n";
  const auto marked = [](const std::string& verdict) { return verdict == "fails" ? "**fails**" : verdict; };
  for (const SuiteEntry& entry : entries) {
    const RunSummary& s = entry.summary;
    markdown += "| " + entry.name;
    for (const char* kind : kinds) markdown += " | " + marked(verdict_of(entry, kind));
    markdown += " | " + text("%.2f ms", 1e3 * s.total.median_s) + " | " +
                (s.solver_errors_measured > 0 ? text("%.1e", s.max_solver_error) : "–") + " | `" +
                hex16(s.fingerprint) + "` | " + text("%.1f s", entry.wall_s) + " |\n";
  }
  for (const SuiteEntry& entry : entries) {
    if (all_passed(entry.checks)) continue;
    markdown += "\n### " + entry.name + "\n\n";
    for (const Check& check : entry.checks) {
      if (check.passed) continue;
      std::string line = check_line(check);
      std::replace(line.begin(), line.end(), '\n', ' ');
      std::replace(line.begin(), line.end(), '`', '\'');
      markdown += "- `" + line + "`\n";
    }
    markdown += "\n    " + entry.reproduce + "\n";
  }
  return markdown;
}

}  // namespace sulcus
