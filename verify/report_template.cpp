// The frame and the style of the page.
#include "verify/report_parts.h"

namespace sulcus::report {
namespace {

constexpr const char* style = R"(
:root { color-scheme: light dark; --paper: #f4f5f8; --card: #ffffff; --ink: #1b2130; --pale: #5d6677; --line: #dfe3ea;
  --good: #17794a; --good-soft: #e2f4ea; --bad: #b92b27; --bad-soft: #fce8e6; --code: #eef1f5; }
@media (prefers-color-scheme: dark) { :root { --paper: #11141a; --card: #1a1f28; --ink: #e7eaf0; --pale: #9aa4b5;
  --line: #2d3441; --good: #5ecb93; --good-soft: #15301f; --bad: #ff8a80; --bad-soft: #3a1a1a; --code: #242b36; } }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.5 system-ui, -apple-system, "Segoe UI",
  Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 20px 16px 56px; }
h1, h2, h3 { line-height: 1.25; margin: 0; }
h1 { font-size: 1.05rem; font-weight: 600; color: var(--pale); margin-bottom: 14px; }
h2 { font-size: 1.5rem; }
h3 { font-size: 1.05rem; margin: 34px 0 12px; }
p { margin: 6px 0; }
a { color: inherit; }
.verdict { border-radius: 14px; padding: 20px 22px; border-left: 8px solid; }
.verdict strong { display: block; font-size: 1.75rem; line-height: 1.2; }
.verdict p { color: var(--ink); max-width: 75ch; }
.verdict.holds { background: var(--good-soft); border-color: var(--good); }
.holds strong, .mark.holds { color: var(--good); }
.verdict.fails { background: var(--bad-soft); border-color: var(--bad); }
.fails strong, .mark.fails { color: var(--bad); }
.mark { font-weight: 700; white-space: nowrap; }
.runs { list-style: none; margin: 16px 0 0; padding: 0; display: grid; gap: 8px;
  grid-template-columns: repeat(auto-fill, minmax(240px, 1fr)); }
.runs a { display: block; text-decoration: none; background: var(--card); border: 1px solid var(--line);
  border-radius: 10px; padding: 10px 14px; }
.run { margin-top: 40px; }
.run > header p { color: var(--pale); max-width: 75ch; }
.run > .verdict { margin-top: 14px; } .run > .verdict strong { font-size: 1.3rem; }
.facts { display: grid; gap: 10px; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); margin: 16px 0 0; }
.facts div { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 10px 14px; }
.facts dt { color: var(--pale); font-size: .85rem; } .facts dd { margin: 0; font-size: 1.25rem; font-weight: 600; }
.facts dd small { display: block; font-size: .8rem; font-weight: 400; color: var(--pale); }
.pictures, .charts { display: grid; gap: 14px; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); }
figure { margin: 0; background: var(--card); border: 1px solid var(--line); border-radius: 12px; overflow: hidden; }
.pictures figure { max-width: 720px; }
.differences { display: grid; gap: 14px; grid-template-columns: repeat(3, minmax(0, 1fr)); }
@media (max-width: 700px) { .differences { grid-template-columns: minmax(0, 1fr); } }
figure img { display: block; width: 100%; height: auto; }
figcaption { padding: 10px 14px; font-weight: 600; } figcaption small { display: block; font-weight: 400;
  color: var(--pale); }
.charts figure { display: flex; flex-direction: column; justify-content: space-between; }
.charts figcaption { padding-bottom: 0; } figure svg { display: block; width: 100%; height: auto; padding: 6px 8px; }
.slider { display: none; position: sticky; top: 0; z-index: 2; background: var(--paper); padding: 8px 0; gap: 14px;
  align-items: center; margin-bottom: 8px; } .live .slider { display: flex; }
.slider input { flex: 1; min-width: 0; } .slider output { min-width: 13ch; font-variant-numeric: tabular-nums; }
.live .pictures.timed figure[data-time] { display: none; } .live .pictures.timed figure.now { display: block; }
.strip { display: grid; grid-template-columns: auto 1fr; gap: 0 10px; background: var(--card); border: 1px solid
  var(--line); border-radius: 12px; padding: 12px 14px; }
.strip ol { list-style: none; margin: 0; padding: 0; font-size: 12px; line-height: 20px; color: var(--pale); }
.strip img { width: 100%; height: 120px; image-rendering: pixelated; display: block; }
table { width: 100%; border-collapse: collapse; background: var(--card); border: 1px solid var(--line);
  border-radius: 12px; overflow: hidden; }
th, td { text-align: left; padding: 8px 12px; border-top: 1px solid var(--line); vertical-align: top;
  overflow-wrap: anywhere; }
thead th { border-top: 0; color: var(--pale); font-size: .85rem; font-weight: 600; }
th[scope=row] { font-weight: 600; }
table.timing { margin-bottom: 12px; } th[scope=row] small { font-weight: 400; color: var(--pale); }
td.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; overflow-wrap: normal; }
thead th.number { text-align: right; }
td small, .note { color: var(--pale); } tr.failed { background: var(--bad-soft); }
tr.kind th { background: var(--code); font-size: .85rem; color: var(--pale); }
pre { background: var(--code); border-radius: 10px; padding: 12px 14px; overflow-x: auto; margin: 8px 0; font-size: .9rem;
  white-space: pre-wrap; overflow-wrap: anywhere; }
code, .code { font-family: ui-monospace, "DejaVu Sans Mono", Menlo, monospace; font-size: .9em; overflow-wrap: anywhere; }
details { margin-top: 12px; } summary { cursor: pointer; font-weight: 600; }
ul.plain { padding-left: 20px; margin: 6px 0; }
@media (max-width: 640px) {
  .verdict strong { font-size: 1.4rem; }
  .facts { grid-template-columns: 1fr 1fr; }
  table.checks thead { display: none; }
  table.checks tr:not(.kind) { display: grid; grid-template-columns: 1fr auto; padding: 8px 4px;
    border-top: 1px solid var(--line); }
  table.checks tr.kind, table.checks tr.kind th { display: block; }
  table.checks td, table.checks th[scope=row] { border: 0; padding: 2px 10px; }
  table.checks td.number { grid-column: 1 / -1; text-align: left; }
  table.checks td.number::before { content: attr(data-label) ": "; color: var(--pale); }
  table.checks td.detail { grid-column: 1 / -1; } table.checks td:empty { display: none; }
  table.checks .mark { grid-row: 1; grid-column: 2; }
  table.timing tr { display: grid; grid-template-columns: repeat(3, 1fr); }
  table.timing th:first-child { grid-column: 1 / -1; } table.timing thead th:first-child { display: none; }
  table.timing td { border: 0; padding-top: 0; } table.timing .number { text-align: left; }
}
@media print { body { background: #fff; } figure, table, .verdict { break-inside: avoid; } }
)";

}  // namespace

std::string page(const std::string& title, const std::string& body) {
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         escape_html(title) + "</title>\n<style>" + style + "</style>\n</head>\n<body>\n<main>\n" + body +
         "</main>\n</body>\n</html>\n";
}

}  // namespace sulcus::report
