#include "verify/report.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/report_parts.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;

bool runs(const std::string& command) {
  return std::system((command + " > /dev/null 2>&1").c_str()) == 0;
}
bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

#define NEEDS_GNUPLOT() \
  if (!runs("gnuplot --version")) GTEST_SKIP() << "gnuplot is not installed (Debian: gnuplot-nox)"

RunData small_run() {
  RunData run;
  run.header.scenario_name = "press & <pull>";
  run.header.scenario_json = "{\"note\": \"</pre><script>alert(1)</script>\"}";
  run.header.step_s = 0.01;
  run.header.tool_names = {"ball"};
  run.header.build = {{"compiler", "gcc <12>"}, {"git_commit", "abc123"}};
  run.header.inputs = {{"brain \"x\".nrrd", "00ff"}};
  run.header.overrides = {"/step/s=0.01"};
  run.header.rest_positions.assign(12, 0);
  run.header.tets = {0, 1, 2, 3};
  run.steps = 50;
  const auto add = [&](const std::string& name, int components, double factor) {
    Series& series = run.series[name];
    series.components = components;
    for (int i = 0; i < 50 * components; ++i) series.values.push_back(factor * (1 + std::sin(i * 0.1)));
  };
  add("time_s", 1, 0);
  for (int i = 0; i < 50; ++i) run.series["time_s"].values[static_cast<std::size_t>(i)] = 0.01 * (i + 1);
  add("tools/0/contact_force_N", 3, 0.4);
  add("tools/0/displayed_force_N", 3, 0.3);
  add("tools/0/max_penetration_m", 1, 0.001);
  for (const char* stage : stage_names) add(std::string("stage/") + stage + "_s", 1, 0.002);
  add("stage/total_s", 1, 0.008);
  add("solver/iterations", 1, 20);
  add("tissue/elastic_energy_J", 1, 0.001);
  run.field_names = state_field_names();
  for (std::uint64_t i = 0; i < 51 * run.field_names.size(); ++i)
    run.field_hashes.push_back(i * 0x9e3779b97f4a7c15);
  for (int i = 0; i < 50; i += 10) run.solver_errors.push_back({i, 1e-4 * (i + 1)});
  run.numbers = {{"mesh_pieces", 1}};
  run.warnings = {"a <warning>"};
  run.events = {{7, "an \"event\""}};
  run.fingerprints = {1, 0x0123456789abcdef};
  return run;
}

RunReportInput small_input(const RunData& run) {
  RunReportInput input;
  input.run = &run;
  input.description = "A ball & a <cube>.";
  input.reproduce = "sulcus run 'a b.json' --out <dir>";
  input.checks = {check_at_most("penetration", "statement", 0.001, 0.002, "m", 50, "step 12"),
                  check_at_least("pushing", "statement", 0.25, 0, "N", 50, ""),
                  check_at_most("golden/tools/0/<force>", "values", 1e-7, 1e-6, "N", 40, "entry \"3\"")};
  input.pictures = {{"before <it>", Image{2, 2, std::vector<std::uint8_t>(12, 200)}}};
  return input;
}

// Tags of the page, each closed in order; text of the first thing that is wrong, or "".
std::string structure_error(const std::string& html) {
  static const std::set<std::string> empty{"meta", "img", "input", "!doctype"};
  std::vector<std::string> open;
  for (std::size_t at = html.find('<'); at != std::string::npos; at = html.find('<', at)) {
    const std::size_t end = html.find('>', at);
    if (end == std::string::npos) return "'<' without '>'";
    std::string tag = html.substr(at + 1, end - at - 1);
    if (tag.starts_with("!--")) {
      at = html.find("-->", at);
      if (at == std::string::npos) return "a comment without end";
      continue;
    }
    if (tag.find('<') != std::string::npos) return "'<' within <" + tag + ">";
    if (std::count(tag.begin(), tag.end(), '"') % 2) return "an open quote in <" + tag + ">";
    const bool closing = tag.starts_with("/"), alone = tag.ends_with("/");
    if (closing) tag.erase(0, 1);
    std::string name = tag.substr(0, tag.find_first_of(" \n\t/"));
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    if (name.empty() || !(std::isalpha(static_cast<unsigned char>(name[0])) || name[0] == '!'))
      return "<" + tag + ">";
    if (closing) {
      if (open.empty() || open.back() != name)
        return "</" + name + "> closes " + (open.empty() ? "nothing" : open.back());
      open.pop_back();
    } else if (!alone && !empty.count(name)) {
      open.push_back(name);
    }
    at = name == "script" && !closing ? html.find("</script>", end) : end;  // a script holds no tags
  }
  return open.empty() ? "" : "<" + open.back() + "> stays open";
}

TEST(Report, TheStructureCheckSeesFaults) {
  EXPECT_EQ(structure_error("<p>a<b>c</b><img src=\"x\"></p>"), "");
  EXPECT_NE(structure_error("<p>a<b>c</p></b>"), "");
  EXPECT_NE(structure_error("<p>a"), "");
  EXPECT_NE(structure_error("<p class=\"a>b</p>"), "");
}

TEST(Report, ThePageIsWellFormedAndComplete) {
  NEEDS_GNUPLOT();
  const RunData run = small_run();
  const RunReportInput input = small_input(run);
  const std::string html = report_html({input});
  EXPECT_EQ(structure_error(html), "");
  for (const Check& check : input.checks) EXPECT_TRUE(contains(html, escape_html(check.name))) << check.name;
  for (const char* part :
       {"press &amp; &lt;pull&gt;", "A ball &amp; a &lt;cube&gt;.", "before &lt;it&gt;", "a &lt;warning&gt;",
        "an &quot;event&quot;", "gcc &lt;12&gt;", "git commit", "brain &quot;x&quot;.nrrd", "/step/s=0.01",
        "0123456789abcdef", "sulcus run &#39;a b.json&#39; --out &lt;dir&gt;", "mesh pieces", "1 mm",
        "≤ 2 mm", "≥ 0 N", "step 12", "All 3 checks hold", "prefers-color-scheme: dark",
        "name=\"viewport\""}) {
    EXPECT_TRUE(contains(html, part)) << part;
  }
  for (const char* chart :
       {">Force<", ">Penetration<", ">Time for each step<", ">Solver iterations<", ">Solver error<"}) {
    EXPECT_TRUE(contains(html, chart)) << chart;
  }
  for (const char* stage : stage_names) EXPECT_TRUE(contains(html, stage)) << stage;
}

TEST(Report, PicturesThatDifferStandBesideTheirGoldenOnes) {
  const RunData run = small_run();
  RunReportInput input = small_input(run);
  EXPECT_EQ(report_html({input}).find("differ from the golden ones"), std::string::npos);
  const Image image{2, 2, std::vector<std::uint8_t>(12, 100)};
  input.differences = {{"open, golden", image}, {"open, this run", image}, {"open, where they differ", image}};
  const std::string html = report_html({input});
  EXPECT_EQ(structure_error(html), "");
  for (const char* text : {"differ from the golden ones", "open, golden", "open, this run", "where they differ"})
    EXPECT_NE(html.find(text), std::string::npos) << text;
}

TEST(Report, NothingComesFromOutside) {
  NEEDS_GNUPLOT();
  const RunData run = small_run();
  const std::string html = report_html({small_input(run)});
  for (const char* never :
       {"http://", "https://", "<script src", "<link", "@import", "url(", "file:", "<iframe"}) {
    EXPECT_FALSE(contains(html, never)) << never;
  }
  std::size_t sources = 0;
  for (std::size_t at = html.find("src="); at != std::string::npos;
       at = html.find("src=", at + 1), ++sources) {
    EXPECT_EQ(html.compare(at, 27, "src=\"data:image/png;base64,"), 0);
  }
  EXPECT_EQ(sources, 2u) << "the picture and the strip of fingerprints";
  // What is referred to is on the page.
  for (std::size_t at = html.find("href="); at != std::string::npos; at = html.find("href=", at + 1)) {
    const char quote = html[at + 5];
    ASSERT_EQ(html[at + 6], '#');
    const std::string id = html.substr(at + 7, html.find(quote, at + 7) - at - 7);
    EXPECT_TRUE(contains(html, "id=\"" + id + "\"") || contains(html, "id='" + id + "'")) << id;
  }
}

TEST(Report, EveryNameOnThePageIsGivenOnce) {
  NEEDS_GNUPLOT();
  const RunData run = small_run();
  const std::string html = report_html({small_input(run)});
  std::set<std::string> names;
  for (std::size_t at = html.find(" id="); at != std::string::npos; at = html.find(" id=", at + 1)) {
    const std::string name = html.substr(at + 5, html.find(html[at + 4], at + 5) - at - 5);
    EXPECT_TRUE(names.insert(name).second) << name;
  }
  EXPECT_GT(names.size(), 10u);
}

TEST(Report, TheVerdictComesFirstAndNamesWhatFails) {
  NEEDS_GNUPLOT();
  const RunData run = small_run();
  RunReportInput good = small_input(run), bad = small_input(run), unchecked = small_input(run);
  bad.name = "bad one";
  bad.checks[1] = check_at_least("pushing", "statement", -0.25, 0, "N", 50, "it pulls at step 4");
  unchecked.checks.clear();
  const std::string failing = report_html({bad});
  EXPECT_TRUE(contains(failing, "1 of 3 checks fails"));
  EXPECT_LT(failing.find("it pulls at step 4"), failing.find("What happened"));
  EXPECT_FALSE(contains(failing, "✓ All"));
  EXPECT_TRUE(contains(failing, "<title>bad one: fails</title>"));
  const std::string empty = report_html({unchecked});
  EXPECT_TRUE(contains(empty, "Nothing was checked"));
  EXPECT_TRUE(contains(empty, ": fails</title>"));
  const std::string both = report_html({good, bad});
  EXPECT_EQ(structure_error(both), "");
  EXPECT_LT(both.find("1 of 2 runs fails"), both.find("All 3 checks hold"));
  EXPECT_TRUE(contains(both, "href=\"#run2\""));
  EXPECT_TRUE(contains(report_html({good, good}), "All 2 runs hold"));
}

TEST(Report, TheSameRunGivesTheSamePage) {
  NEEDS_GNUPLOT();
  const RunData run = small_run();
  EXPECT_EQ(report_html({small_input(run)}), report_html({small_input(run)}));
}

TEST(Report, ARunWithoutToolsSeriesOrPicturesStillHasAPage) {
  RunData run;
  run.header.scenario_name = "bare";
  RunReportInput input;
  input.run = &run;
  input.checks = {failed_check("finite", "statement", "no step")};
  const std::string html = report_html({input});
  EXPECT_EQ(structure_error(html), "");
  EXPECT_TRUE(contains(html, "The one check") || contains(html, "1 of 1 check fails"));
}

TEST(Report, MissingInputIsRefused) {
  EXPECT_THROW(report_html({}), InputError);
  EXPECT_THROW(report_html({RunReportInput{}}), InputError);
  RunData run;
  RunReportInput input;
  input.run = &run;
  EXPECT_THROW(write_report({input}, "/no/such/folder/report.html"), EnvironmentError);
}

std::string read_all(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// What the browser says about a page, and the page as it understood it.
struct Seen {
  std::string messages, page;
};
Seen open_in_browser(const fs::path& folder, const std::string& file) {
  const std::string out = folder / "page", messages = folder / "messages";
  const std::string command =
      "timeout 120 chromium --headless --no-sandbox --disable-gpu --disable-quic --no-first-run "
      "--disable-background-networking --disable-component-update --disable-sync --enable-logging=stderr "
      "--user-data-dir='" +
      (folder / "profile").string() + "' --dump-dom 'file://" + (folder / file).string() + "' > '" + out +
      "' 2> '" + messages + "'";
  EXPECT_EQ(std::system(command.c_str()), 0);
  return {read_all(messages), read_all(out)};
}

TEST(Report, ABrowserReadsItWithoutComplaint) {
  NEEDS_GNUPLOT();
  if (!runs("chromium --version"))
    GTEST_SKIP() << "chromium is not installed: the page was not opened in a browser";
  const fs::path folder = fs::temp_directory_path() / ("sulcus-report-test-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const RunData run = small_run();
  write_report({small_input(run)}, folder / "report.html");
  std::ofstream(folder / "faulty.html") << "<!DOCTYPE html><script>nothing.at.all()</script>";
  // The faulty page shows that complaints would be seen.
  EXPECT_TRUE(contains(open_in_browser(folder, "faulty.html").messages, "CONSOLE"));
  const Seen seen = open_in_browser(folder, "report.html");
  EXPECT_FALSE(contains(seen.messages, "CONSOLE")) << seen.messages;
  EXPECT_TRUE(contains(seen.page, "All 3 checks hold"));
  EXPECT_TRUE(contains(seen.page, "</html>"));
  fs::remove_all(folder);
}

// The page in a frame as wide as a phone or a desk, moved to half its steps; what it then says of itself.
TEST(Report, ASliderMovesPicturesAndCursorsAndNoWidthScrollsSideways) {
  NEEDS_GNUPLOT();
  if (!runs("chromium --version"))
    GTEST_SKIP() << "chromium is not installed: the page was not opened in a browser";
  const fs::path folder = fs::temp_directory_path() / ("sulcus-slider-test-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const RunData run = small_run();
  RunReportInput input = small_input(run);
  const double end_s = static_cast<double>(run.steps) * run.header.step_s;
  ASSERT_FALSE(input.pictures.empty());
  while (input.pictures.size() < 3) input.pictures.push_back(input.pictures.front());
  input.pictures.resize(3);
  input.pictures[0].time_s = 0;
  input.pictures[1].time_s = 0.4 * end_s;
  input.pictures[2].time_s = end_s;
  std::string html = report_html({input});
  html.insert(html.rfind("</body>"), R"(<script>
    const slider = document.querySelector('.slider input');
    slider.value = slider.max / 2;
    slider.dispatchEvent(new Event('input'));
    const shown = [...document.querySelectorAll('.pictures figure')].map(f => f.offsetHeight > 0 ? 1 : 0).join('');
    const cursor = document.querySelector('.charts .cursor');
    const middle = (+cursor.ownerSVGElement.dataset.left + +cursor.ownerSVGElement.dataset.right) / 2;
    const near = Math.abs(cursor.getAttribute('x1') - middle) < 5;
    const page = document.documentElement;
    parent.postMessage(`shown ${shown} cursor ${near} sideways ${page.scrollWidth - page.clientWidth}`, '*');
  </script>)");
  std::ofstream(folder / "report.html") << html;
  std::ofstream(folder / "frames.html") << R"(<!DOCTYPE html><p id="said"></p><script>
    addEventListener('message', e => document.getElementById('said').append(`[${e.data}]`));
  </script><iframe src="report.html" width="390" height="800"></iframe>
  <iframe src="report.html" width="1400" height="900"></iframe>)";
  const Seen seen = open_in_browser(folder, "frames.html");
  EXPECT_FALSE(contains(seen.messages, "CONSOLE")) << seen.messages;
  const std::string expected = "[shown 010 cursor true sideways 0]";
  EXPECT_TRUE(contains(seen.page, expected + expected)) << seen.page;
  EXPECT_TRUE(contains(html, "strip of fingerprints"));
  fs::remove_all(folder);
}

TEST(ReportValues, NumbersAreForPeople) {
  const auto q = [](double value, const std::string& unit) { return report::quantity(value, unit); };
  EXPECT_EQ(q(0.0004, "m"), "0.4 mm");
  EXPECT_EQ(q(-0.0123, "s"), "-12.3 ms");
  EXPECT_EQ(q(0.707, "N"), "0.707 N");
  EXPECT_EQ(q(0, "N"), "0 N");
  EXPECT_EQ(q(2500, "Pa"), "2.5 kPa");
  EXPECT_EQ(q(0.03, "N m"), "30 mN m");
  EXPECT_EQ(q(1e-20, "m"), "1 × 10⁻²⁰ m");
  EXPECT_EQ(q(12345, ""), "12,345");
  EXPECT_EQ(q(-1234567, ""), "-1,234,567");
  EXPECT_EQ(q(3.2e-13, ""), "3.2 × 10⁻¹³");
  EXPECT_EQ(q(9.99e-7, ""), "1 × 10⁻⁶");
  EXPECT_EQ(q(0.25, ""), "0.25");
  EXPECT_EQ(q(NAN, "m"), "–");
  EXPECT_EQ(q(-INFINITY, "m"), "-∞ m");
}

TEST(ReportValues, Base64IsThatOfRfc4648) {
  EXPECT_EQ(report::base64(""), "");
  EXPECT_EQ(report::base64("f"), "Zg==");
  EXPECT_EQ(report::base64("fo"), "Zm8=");
  EXPECT_EQ(report::base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(report::base64(std::string("\xff\x00\xfe", 3)), "/wD+");
}

TEST(ReportValues, TextCannotBecomeMarkup) {
  EXPECT_EQ(escape_html("<a href=\"x\">'&'</a>"), "&lt;a href=&quot;x&quot;&gt;&#39;&amp;&#39;&lt;/a&gt;");
  EXPECT_EQ(escape_html(std::string("a\0b\x01"
                                    "c",
                                    5)),
            "abc");
}

}  // namespace
}  // namespace sulcus
