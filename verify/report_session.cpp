// What a session in real time says about time: a table, and the histograms.
#include <algorithm>

#include "verify/report_parts.h"

namespace sulcus::report {
namespace {

struct Words {
  const char* name;
  const char* title;
  const char* caption;
};
constexpr Words words[] = {
    {"servo_interval_s", "Servo interval", "from one tick to the next; asked for is 1 ms"},
    {"servo_work_s", "Work of a tick", "Sulcus' own, without the driver"},
    {"coupling_age_s", "Age of the coupling", "that a tick renders, since the engine read the hand"},
    {"force_latency_s", "Latency from sample to force",
     "from the engine's reading of the hand to the first tick that renders the effect"},
    {"step_lateness_s", "Lateness of steps", "from when a step was due to when it began"},
    {"step_time_s", "Time of a step", "from reading the hand to handing the coupling over"},
};

const Words* words_of(const std::string& name) {
  const auto found =
      std::find_if(std::begin(words), std::end(words), [&](const Words& w) { return w.name == name; });
  return found == std::end(words) ? nullptr : &*found;
}

// Steps around the bins, up to the last one that is not empty; the counts on a logarithmic scale.
Chart histogram_chart(const Histogram& histogram, const std::string& title) {
  Chart chart;
  chart.title = title;
  const bool micro = histogram.bin_s * Histogram::bins < 1e-3;
  chart.x_label = micro ? "time [us]" : "time [ms]";
  chart.y_label = "count";
  chart.log_y = true;
  const double width = histogram.bin_s * (micro ? 1e6 : 1e3);
  std::size_t last = 0;
  for (std::size_t b = 0; b < Histogram::bins; ++b) {
    if (histogram.counts[b] > 0) last = b;
  }
  Curve curve;
  constexpr double nothing = 0.5;  // stands for zero where zero cannot be drawn
  for (std::size_t b = 0; b <= last; ++b) {
    const double count = std::max(nothing, static_cast<double>(histogram.counts[b]));
    curve.x.insert(curve.x.end(), {width * static_cast<double>(b), width * static_cast<double>(b + 1)});
    curve.y.insert(curve.y.end(), {count, count});
  }
  chart.curves.push_back(std::move(curve));
  return chart;
}

double number_of(const RunData& run, const char* name) {
  const auto found = run.numbers.find(name);
  return found == run.numbers.end() ? 0 : found->second;
}

}  // namespace

std::string session_section(const RunData& run) {
  if (!run.session || !run.header.session) return "";
  std::size_t ticks = 0;
  for (const auto& of_tool : run.session->ticks) ticks += of_tool.size();
  std::string devices;
  for (const std::string& device : run.header.session->devices)
    devices += (devices.empty() ? "" : ", ") + device;
  const double lost = number_of(run, "session_ticks_lost") + number_of(run, "session_frames_lost");
  std::string html =
      "<h3>In real time</h3>\n<p>Device: " + escape_html(devices) + ". " +
      whole_number(static_cast<double>(ticks)) + " ticks of the servo; " +
      whole_number(number_of(run, "session_missed_deadlines")) + " of " +
      whole_number(static_cast<double>(run.steps)) + " steps missed their deadline; " +
      whole_number(number_of(run, "session_held_samples")) +
      " steps went on with an earlier sample; the recorder lost " + whole_number(lost) +
      " records.</p>\n<table class=\"timing\"><thead><tr><th>what</th><th class=\"number\">median</th><th "
      "class=\"number\">99 % within</th><th class=\"number\">largest</th></tr></thead><tbody>\n";
  std::string charts;
  for (const Histogram& histogram : run.session->histograms) {
    const Words* known = words_of(histogram.name);
    const std::string title = known ? known->title : histogram.name;
    const std::string caption = known ? known->caption : "";
    html += "<tr><th scope=\"row\">" + escape_html(title) + "<br><small>" + escape_html(caption) +
            "</small></th>";
    for (const double value_s : {histogram.median_s, histogram.p99_s, histogram.max_s})
      html += "<td class=\"number\">" + escape_html(quantity(value_s, "s")) + "</td>";
    html += "</tr>\n";
    if (histogram.total() == 0) continue;
    charts += "<figure><figcaption>" + escape_html(title) + "<small>" + escape_html(caption) +
              "</small></figcaption>" + chart_svg(histogram_chart(histogram, title)) + "</figure>\n";
  }
  return html + "</tbody></table>\n<div class=\"charts\">" + charts + "</div>\n";
}

}  // namespace sulcus::report
