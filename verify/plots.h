// Charts as inline SVG, drawn by gnuplot. Lines and text take the page's colours (CSS currentColor), so that
// one chart serves light and dark pages. The same data give the same text.
#pragma once

#include <string>
#include <vector>

namespace sulcus {

struct Curve {
  std::string name;          // for the key; empty: not in the key
  std::vector<double> x, y;  // of equal length; points that are not finite leave a gap
};

// A strip between two curves, painted behind them.
struct Band {
  std::string name;
  std::vector<double> x, low, high;  // of equal length
};

enum class ChartKind { lines, stacked, points, trend };

struct Chart {
  std::string title, x_label, y_label;  // units in brackets: "force [N]"
  ChartKind kind = ChartKind::lines;    // stacked: curves share x and are piled up in order; trend: lines with a mark at each point
  std::vector<Curve> curves;
  std::vector<Band> bands;
  bool log_y = false;  // values <= 0 leave a gap
  double bound = 0;    // dashed line at this y if has_bound
  bool has_bound = false;
};

// At most `columns` columns of lowest and highest values, so that no peak is lost. Curves with fewer points
// are kept.
Curve thinned(const Curve& curve, std::size_t columns);

// <svg ...>...</svg>, without references to anything outside; its attributes data-left, data-right (in its
// own units), data-from, data-to (of x) say where an x lies. A chart without a finite point says so. Throws
// EnvironmentError if gnuplot is missing or fails, with the remedy; InputError for curves whose x and y
// differ in length.
std::string chart_svg(const Chart& chart);

}  // namespace sulcus
