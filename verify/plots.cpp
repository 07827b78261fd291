#include "verify/plots.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "engine/numerics/error.h"
#include "verify/gnuplot.h"

namespace sulcus {
namespace {

constexpr std::size_t columns = 600;  // of data; more cannot be seen

// Of middle lightness: readable on white and on black.
constexpr const char* colours[] = {"#3f8fd6", "#e5892a", "#33a07a", "#c65a93", "#8b7fd8", "#b09a2e"};
// Stands for the page's own text colour until the text is there.
constexpr const char* ink = "#123456";
constexpr const char* ink_in_svg[] = {"rgb(18,52,86)", "rgb( 18,  52,  86)"};

// The same columns for all curves: of each column, the place with the largest pile. So every pile shown is
// one that was.
std::vector<std::size_t> highest_piles(const std::vector<Curve>& curves) {
  const std::size_t count = curves.front().x.size(), shown = std::min(count, columns);
  std::vector<std::size_t> places;
  for (std::size_t c = 0; c < shown; ++c) {
    std::size_t best = c * count / shown;
    double highest = -INFINITY;
    for (std::size_t i = best; i < (c + 1) * count / shown; ++i) {
      double pile = 0;
      for (const Curve& curve : curves) pile += std::isfinite(curve.y[i]) ? curve.y[i] : 0;
      if (pile > highest) {
        highest = pile;
        best = i;
      }
    }
    places.push_back(best);
  }
  return places;
}

// What gnuplot draws: curves thinned, piles added up, gaps where nothing can be drawn.
std::vector<Curve> drawn_curves(const Chart& chart) {
  std::vector<Curve> drawn;
  if (chart.kind == ChartKind::stacked && !chart.curves.empty()) {
    const std::vector<std::size_t> places = highest_piles(chart.curves);
    std::vector<double> pile(places.size(), 0);
    for (const Curve& curve : chart.curves) {
      Curve sum{curve.name, {}, {}};
      for (std::size_t p = 0; p < places.size(); ++p) {
        pile[p] += std::isfinite(curve.y[places[p]]) ? curve.y[places[p]] : 0;
        sum.x.push_back(curve.x[places[p]]);
        sum.y.push_back(pile[p]);
      }
      drawn.push_back(std::move(sum));
    }
  } else {
    for (const Curve& curve : chart.curves) drawn.push_back(thinned(curve, columns));
  }
  if (chart.log_y) {
    for (Curve& curve : drawn) {
      for (double& y : curve.y) y = y > 0 ? y : NAN;
    }
  }
  return drawn;
}

constexpr double plot_left = 0.14, plot_right = 0.97;  // of the chart's width

struct Range {
  double low = INFINITY, high = -INFINITY;
  void take(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  bool empty() const { return !(low <= high); }
};

std::string axis_ranges(const Chart& chart, const Range& x, Range y) {
  if (chart.has_bound) y.take(chart.bound);
  std::ostringstream out;
  out << "set xrange [" << gnuplot_number(x.low) << ":" << gnuplot_number(x.high) << "]\n";
  if (chart.log_y) {
    // Whole decades.
    double low = std::floor(std::log10(y.low)), high = std::ceil(std::log10(y.high));
    if (low == high) high += 1;
    out << "set logscale y\nset format y '10^{%T}'\nset yrange [1e" << low << ":1e" << high << "]\n";
  } else {
    const double low = std::min(0.0, y.low), high = std::max(0.0, y.high);
    const double room = high > low ? 0.06 * (high - low) : 1;
    out << "set yrange [" << gnuplot_number(low < 0 ? low - room : 0) << ":" << gnuplot_number(high + room)
        << "]\n";
  }
  return out.str();
}

std::string script(const Chart& chart, const std::vector<Curve>& drawn, const Range& x, const Range& y) {
  // entries of a history have whole numbers
  const bool few_whole = chart.kind == ChartKind::trend && x.high - x.low < 12;
  std::ostringstream out;
  out << "set terminal svg size 520,290 dynamic enhanced font 'sans-serif,13'\n"
      << "set encoding utf8\nset datafile missing 'NaN'\n"
      << "set lmargin at screen " << plot_left << "\nset rmargin at screen " << plot_right << "\n"
      << "set border 3 front lc rgb '" << ink << "' lw 0.7\n"
      << "set tics nomirror scale 0.5 tc rgb '" << ink << "'\n"
      << "set grid ytics lt 1 lc rgb '#B0808080' lw 0.7\n"
      << "set xlabel " << gnuplot_text(chart.x_label) << " noenhanced tc rgb '" << ink << "' offset 0,0.3\n"
      << "set ylabel " << gnuplot_text(chart.y_label) << " noenhanced tc rgb '" << ink << "' offset 0.5,0\n"
      << (few_whole ? "set xtics 1\n" : "set xtics autofreq\n") << "set style fill solid 0.85 noborder\n"
      << "set key above left horizontal Left reverse noenhanced samplen 0.9 width -1 maxcols 4 font ',12' tc "
         "rgb '"
      << ink << "'\n"
      << axis_ranges(chart, x, y);
  if (chart.has_bound) {
    out << "set arrow from graph 0, first " << gnuplot_number(chart.bound) << " to graph 1, first "
        << gnuplot_number(chart.bound) << " nohead dt 2 lw 1.3 lc rgb '#d04545' front\n";
  }
  for (std::size_t c = 0; c < drawn.size(); ++c) {
    out << "$c" << c << " << EOD\n";
    for (std::size_t i = 0; i < drawn[c].x.size(); ++i) {
      out << gnuplot_number(drawn[c].x[i]) << ' ' << gnuplot_number(drawn[c].y[i]) << '\n';
    }
    out << "EOD\n";
  }
  for (std::size_t b = 0; b < chart.bands.size(); ++b) {
    const Band& band = chart.bands[b];
    out << "$b" << b << " << EOD\n";
    for (std::size_t i = 0; i < band.x.size(); ++i)
      out << gnuplot_number(band.x[i]) << ' ' << gnuplot_number(band.low[i]) << ' ' << gnuplot_number(band.high[i]) << '\n';
    out << "EOD\n";
  }
  const auto style = [&](std::size_t c) -> std::string {
    const std::string colour = std::string(" lc rgb '") + colours[c % std::size(colours)] + "'";
    if (chart.kind == ChartKind::stacked) return " with filledcurves y1=0" + colour;
    if (chart.kind == ChartKind::points) return " with points pt 7 ps 0.5" + colour;
    if (chart.kind == ChartKind::trend) return " with linespoints pt 7 ps 0.5 lw 1.6" + colour;
    return " with lines lw 1.6" + colour;
  };
  // Piles are painted from the highest down, each over the one before; the key keeps the order of the curves.
  const bool stacked = chart.kind == ChartKind::stacked;
  const char* separator = "plot ";
  constexpr const char* band_style = " with filledcurves fs solid 0.35 lc rgb '#8a8f98'";
  for (std::size_t b = 0; b < chart.bands.size(); ++b) {
    out << separator << "$b" << b << " using 1:2:3" << band_style << " title " << gnuplot_text(chart.bands[b].name);
    separator = ", ";
  }
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    const std::size_t c = stacked ? drawn.size() - 1 - i : i;
    out << separator << "$c" << c << " using 1:2" << style(c) << " notitle";
    separator = ", ";
  }
  for (std::size_t c = 0; c < drawn.size(); ++c) {
    if (!drawn[c].name.empty()) out << ", keyentry" << style(c) << " title " << gnuplot_text(drawn[c].name);
  }
  out << "\n";
  return out.str();
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
    text.replace(at, from.size(), to);
  }
}

std::string escaped(const std::string& text) {
  std::string out = text;
  replace_all(out, "&", "&amp;");
  replace_all(out, "<", "&lt;");
  replace_all(out, ">", "&gt;");
  return out;
}

// Leaves the drawing alone: no XML head, no addresses, the page's ink, identifiers of the chart's own.
std::string fit_for_page(const std::string& svg, const std::string& title, const Range& x) {
  const std::size_t begin = svg.find("<svg"), head_end = svg.find('>', begin), end = svg.rfind("</svg>");
  if (begin == std::string::npos)
    throw EnvironmentError("gnuplot's chart is not SVG; expected gnuplot 5.2 or later");
  std::string body = svg.substr(head_end + 1, end - head_end - 1);
  // gnuplot's own title and description name its version.
  for (const char* element : {"title", "desc"}) {
    const std::string open = std::string("<") + element + ">", close = std::string("</") + element + ">";
    const std::size_t first = body.find(open), last = body.find(close);
    if (first != std::string::npos && last != std::string::npos && body.find("<g") > first) {
      body.erase(first, last + close.size() - first);
    }
  }
  for (const char* written : ink_in_svg) replace_all(body, written, "currentColor");
  replace_all(body, " color=\"black\"", "");  // axes: what the page inherits
  std::uint32_t hash = 2166136261u;
  for (const char c : title + body) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
  char mark[16];
  std::snprintf(mark, sizeof(mark), "c%08x-", hash);
  for (const char* before_name : {" id=\"", " id='", "href=\"#", "href='#", "url(#"}) {
    replace_all(body, before_name, std::string(before_name) + mark);
  }
  // Groups without a name of their own would show a made-up one under the pointer.
  for (std::size_t at = 0; (at = body.find("<title>gnuplot_plot_", at)) != std::string::npos;) {
    body.erase(at, body.find("</title>", at) + 8 - at);
  }
  const std::string label = escaped(title);
  std::string attribute = label;
  replace_all(attribute, "\"", "&quot;");
  const std::string place = "data-left=\"" + gnuplot_number(plot_left * 520) + "\" data-right=\"" +
                            gnuplot_number(plot_right * 520) + "\" data-from=\"" + gnuplot_number(x.low) + "\" data-to=\"" +
                            gnuplot_number(x.high) + "\"";
  return "<svg viewBox=\"0 0 520 290\" " + place + " role=\"img\" aria-label=\"" + attribute + "\"><title>" +
         label + "</title>" + body + "</svg>";
}

void check_curves(const Chart& chart) {
  for (const Curve& curve : chart.curves) {
    const bool piles = chart.kind != ChartKind::stacked || curve.x.size() == chart.curves.front().x.size();
    if (curve.x.size() != curve.y.size() || !piles) {
      throw InputError("the curve '" + curve.name + "' of the chart '" + chart.title + "' has " +
                       std::to_string(curve.x.size()) + " x and " + std::to_string(curve.y.size()) +
                       " y; give as many of both, and of all curves of a pile");
    }
  }
  for (const Band& band : chart.bands) {
    if (band.x.size() != band.low.size() || band.x.size() != band.high.size())
      throw InputError("the band '" + band.name + "' of the chart '" + chart.title +
                       "' has edges of other length");
  }
}

}  // namespace

Curve thinned(const Curve& curve, std::size_t column_count) {
  const std::size_t count = curve.x.size();
  if (column_count == 0 || count <= 2 * column_count) return curve;
  Curve out{curve.name, {}, {}};
  for (std::size_t c = 0; c < column_count; ++c) {
    const std::size_t first = c * count / column_count, last = (c + 1) * count / column_count;
    std::size_t lowest = first, highest = first;
    bool gap = false;
    for (std::size_t i = first; i < last; ++i) {
      if (!std::isfinite(curve.y[i])) {
        gap = true;
        continue;
      }
      if (!(curve.y[i] >= curve.y[lowest])) lowest = i;
      if (!(curve.y[i] <= curve.y[highest])) highest = i;
    }
    for (const std::size_t i : {std::min(lowest, highest), std::max(lowest, highest)}) {
      out.x.push_back(curve.x[i]);
      out.y.push_back(curve.y[i]);
    }
    if (gap) {
      out.x.push_back(curve.x[last - 1]);
      out.y.push_back(NAN);
    }
  }
  return out;
}

std::string chart_svg(const Chart& chart) {
  check_curves(chart);
  const std::vector<Curve> drawn = drawn_curves(chart);
  Range x, y;
  for (const Curve& curve : drawn) {
    for (std::size_t i = 0; i < curve.x.size(); ++i) {
      if (!std::isfinite(curve.x[i]) || !std::isfinite(curve.y[i])) continue;
      x.take(curve.x[i]);
      y.take(curve.y[i]);
    }
  }
  if (x.empty() || y.empty()) {
    return "<svg viewBox=\"0 0 520 60\" role=\"img\"><title>" + escaped(chart.title) +
           "</title><text x=\"260\" y=\"34\" text-anchor=\"middle\" fill=\"currentColor\" opacity=\"0.6\" "
           "font-family=\"sans-serif\" font-size=\"13\">nothing recorded</text></svg>";
  }
  for (const Band& band : chart.bands) {
    for (const double value : band.low) y.take(value);
    for (const double value : band.high) y.take(value);
  }
  if (x.low == x.high) {
    x.low -= 0.5;
    x.high += 0.5;
  }
  return fit_for_page(draw_with_gnuplot(script(chart, drawn, x, y)), chart.title, x);
}

}  // namespace sulcus
