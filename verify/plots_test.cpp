#include "verify/plots.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

bool has_gnuplot() {
  return std::system("gnuplot --version > /dev/null 2>&1") == 0;
}

#define NEEDS_GNUPLOT() \
  if (!has_gnuplot()) GTEST_SKIP() << "gnuplot is not installed (Debian: gnuplot-nox)"

Chart waves() {
  Chart chart;
  chart.title = "Waves & <more>";
  chart.x_label = "time [s]";
  chart.y_label = "it's \"high\" [N]";
  for (const char* name : {"first <b>", "second & 'third'"}) {
    Curve curve{name, {}, {}};
    for (int i = 0; i < 300; ++i) {
      curve.x.push_back(i * 0.01);
      curve.y.push_back(std::sin(i * 0.05) + (name[0] == 's'));
    }
    chart.curves.push_back(curve);
  }
  return chart;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(Plots, ThinningKeepsEveryExtreme) {
  Curve curve{"c", {}, {}};
  for (int i = 0; i < 10000; ++i) {
    curve.x.push_back(i);
    curve.y.push_back(i == 4321 ? 7 : i == 8765 ? -9 : std::sin(i * 0.3));
  }
  const Curve thin = thinned(curve, 100);
  EXPECT_LE(thin.x.size(), 200u);
  EXPECT_TRUE(std::is_sorted(thin.x.begin(), thin.x.end()));
  EXPECT_EQ(*std::max_element(thin.y.begin(), thin.y.end()), 7);
  EXPECT_EQ(*std::min_element(thin.y.begin(), thin.y.end()), -9);
  for (std::size_t i = 0; i < thin.x.size(); ++i) {
    EXPECT_EQ(thin.y[i], curve.y[static_cast<std::size_t>(thin.x[i])]);
  }
}

TEST(Plots, ThinningKeepsShortCurvesAndGaps) {
  const Curve small{"c", {1, 2, 3}, {4, NAN, 6}};
  EXPECT_EQ(thinned(small, 2).x, small.x);
  Curve gap{"g", {}, {}};
  for (int i = 0; i < 1000; ++i) {
    gap.x.push_back(i);
    gap.y.push_back(i >= 400 && i < 600 ? NAN : 1);
  }
  const Curve thin = thinned(gap, 50);
  EXPECT_TRUE(std::any_of(thin.y.begin(), thin.y.end(), [](double y) { return std::isnan(y); }));
  EXPECT_EQ(std::count(thin.y.begin(), thin.y.end(), 1.0), 60 + 20);
}

TEST(Plots, AChartIsSelfContainedAndEscaped) {
  NEEDS_GNUPLOT();
  const std::string svg = chart_svg(waves());
  EXPECT_EQ(svg.rfind("<svg", 0), 0u);
  EXPECT_EQ(svg.substr(svg.size() - 6), "</svg>");
  for (const char* never : {"http", "<?xml", "<!DOCTYPE", "<script", "first <b>", "rgb(18,52,86)",
                            "gnuplot 5", "<title>gnuplot"}) {
    EXPECT_FALSE(contains(svg, never)) << never;
  }
  for (const char* always : {"Waves &amp; &lt;more&gt;", "first &lt;b", "time [s]", "currentColor"}) {
    EXPECT_TRUE(contains(svg, always)) << always;
  }
}

TEST(Plots, TheSameChartGivesTheSameText) {
  NEEDS_GNUPLOT();
  EXPECT_EQ(chart_svg(waves()), chart_svg(waves()));
}

TEST(Plots, EveryKindIsDrawn) {
  NEEDS_GNUPLOT();
  Chart chart = waves();
  const std::string lines = chart_svg(chart);
  chart.kind = ChartKind::stacked;
  const std::string stacked = chart_svg(chart);
  chart.kind = ChartKind::points;
  chart.log_y = true;
  const std::string points = chart_svg(chart);
  chart.has_bound = true;
  chart.bound = 0.5;
  const std::string bounded = chart_svg(chart);
  EXPECT_FALSE(contains(lines, "<polygon"));
  EXPECT_TRUE(contains(stacked, "<polygon"));
  EXPECT_GT(points.size(), 1000u);
  EXPECT_TRUE(contains(bounded, "208,  69,  69") || contains(bounded, "208,69,69"));
  EXPECT_FALSE(contains(points, "208,  69,  69") || contains(points, "208,69,69"));
}

TEST(Plots, AChartWithoutDataSaysSo) {
  Chart chart;
  chart.title = "nothing";
  EXPECT_TRUE(contains(chart_svg(chart), "nothing recorded"));
  chart.curves = {{"c", {1, 2}, {NAN, NAN}}};
  EXPECT_TRUE(contains(chart_svg(chart), "nothing recorded"));
  chart.curves = {{"c", {1, 2}, {0, -1}}};
  chart.log_y = true;
  EXPECT_TRUE(contains(chart_svg(chart), "nothing recorded"));
}

TEST(Plots, OnePointAndEqualValuesAreDrawn) {
  NEEDS_GNUPLOT();
  Chart chart;
  chart.curves = {{"c", {1}, {0}}};
  EXPECT_TRUE(contains(chart_svg(chart), "currentColor"));
  chart.curves = {{"c", {1, 2, 3}, {5, 5, 5}}};
  EXPECT_TRUE(contains(chart_svg(chart), "currentColor"));
  chart.log_y = true;
  EXPECT_TRUE(contains(chart_svg(chart), "currentColor"));
}

TEST(Plots, CurvesOfTwoLengthsAreRefused) {
  Chart chart;
  chart.curves = {{"c", {1, 2}, {1}}};
  EXPECT_THROW(chart_svg(chart), InputError);
  chart.kind = ChartKind::stacked;
  chart.curves = {{"c", {1, 2}, {1, 2}}, {"d", {1}, {1}}};
  EXPECT_THROW(chart_svg(chart), InputError);
}

TEST(Plots, WithoutGnuplotTheRemedyIsNamed) {
  const char* path = std::getenv("PATH");
  const std::string before = path ? path : "";
  setenv("PATH", "/no/such/folder", 1);
  try {
    chart_svg(waves());
    ADD_FAILURE() << "drawn without gnuplot";
  } catch (const EnvironmentError& error) {
    EXPECT_TRUE(contains(error.what(), "gnuplot-nox")) << error.what();
  }
  setenv("PATH", before.c_str(), 1);
}

}  // namespace
}  // namespace sulcus
