#include "verify/performance.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

std::string counts(int step, int multiply, const std::string& commit, const std::string& why,
                   const std::string& compiler = "GNU 12") {
  return R"({"commit": ")" + commit + R"(", "day": "2026-01-01", "why": ")" + why + R"(", "compiler": ")" +
         compiler + R"(", "counts": {"bar": {"instructions": {"step": )" + std::to_string(step) +
         R"(, "multiply": )" + std::to_string(multiply) + R"(}, "work": {"contacts": 0}}}})";
}

class Performance : public testing::Test {
 protected:
  fs::path folder = fs::temp_directory_path() / ("sulcus-performance-" + std::to_string(getpid()));
  void SetUp() override { fs::create_directories(folder); }
  void TearDown() override { fs::remove_all(folder); }
  void write(const std::string& name, const std::string& text) { std::ofstream(folder / name) << text; }
};

TEST_F(Performance, AStepChangeIsNamedWithCommitAndReason) {
  write("counts.json", "[" + counts(1000, 500, "aaaa", "first") + "," + counts(1010, 500, "bbbb", "noise") +
                           "," + counts(1010, 550, "cccc", "a <longer> product") + "]");
  const std::string page = performance_html(folder);
  EXPECT_NE(page.find("commit cccc, 2026-01-01</h4>\n<p>a &lt;longer&gt; product</p>"), std::string::npos);
  EXPECT_NE(page.find("bar: multiply</th><td class=\"number\">500</td><td class=\"number\">550</td>"
                      "<td class=\"number\">+10.0 %</td>"),
            std::string::npos);
  EXPECT_EQ(page.find("commit bbbb"), std::string::npos);
  EXPECT_NE(page.find("step change"), std::string::npos) << "the chart marks it";
}

TEST_F(Performance, AnotherCompilerBeginsItsOwnLine) {
  write("counts.json",
        "[" + counts(1000, 500, "aaaa", "first") + "," + counts(2000, 900, "bbbb", "x", "Clang 14") + "]");
  EXPECT_NE(performance_html(folder).find("No step change."), std::string::npos);
}

TEST_F(Performance, ATimeWithinTheSpreadIsNoStep) {
  write("counts.json", "[" + counts(1000, 500, "aaaa", "first") + "]");
  const auto times = [](const char* commit, double median, double spread) {
    return std::string(R"({"commit": ")") + commit +
           R"(", "day": "d", "why": "w", "machine": "m", "times": {"t": {"median": )" +
           std::to_string(median) + R"(, "spread": )" + std::to_string(spread) + R"(, "error": null}}})";
  };
  write("times.json", "[" + times("t1", 10, 1) + "," + times("t2", 11.5, 1) + "," + times("t3", 16, 1) + "]");
  const std::string page = performance_html(folder);
  EXPECT_EQ(page.find("commit t2"), std::string::npos);
  EXPECT_NE(page.find("commit t3"), std::string::npos);
}

TEST_F(Performance, AMissingEmptyOrDamagedHistoryIsRefused) {
  EXPECT_THROW(performance_html(folder), InputError);
  for (const char* text :
       {"", "[]", "{}", "[{}]", "[{\"commit\": 1}]",
        R"([{"commit": "a", "day": "b", "why": "c", "compiler": "d", "counts": {"bar": 1}}])"}) {
    write("counts.json", text);
    EXPECT_THROW(performance_html(folder), InputError) << text;
  }
}

TEST_F(Performance, OfTheRepositoryCanBeDrawn) {
  EXPECT_NE(performance_html(SULCUS_SOURCE_DIR "/golden/performance").find("cylinder_retraction"),
            std::string::npos);
}

}  // namespace
}  // namespace sulcus
