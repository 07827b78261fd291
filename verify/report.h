// The report: one HTML file that says first whether the run holds, then shows why. Everything is inside
// (pictures as base64 PNG, charts as inline SVG); no network; light and dark; from a phone's width upwards.
// All can be read without JavaScript, which only adds a slider that moves pictures and the charts' cursors
// together.
#pragma once

#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "verify/golden_bands.h"
#include "verify/png.h"
#include "verify/recording.h"
#include "verify/statements.h"

namespace sulcus {

struct ReportPicture {
  std::string caption;  // "before", "open", ...; also the text for those who cannot see it
  Image image;
  double time_s = std::numeric_limits<double>::quiet_NaN();  // s, of the run; NaN: not said
};

struct RunReportInput {
  std::string name;                     // of the scenario; defaults to the recording's
  std::string description;              // one or two sentences: what the run shows
  const RunData* run = nullptr;         // required
  std::vector<Check> checks;            // the verdict: all of them hold
  std::vector<ReportPicture> pictures;  // in order of time
  std::vector<ReportPicture> differences;  // golden picture, picture now, where they differ: three each
  std::vector<GoldenBand> golden;       // the golden run's values; empty: not compared
  std::string reproduce;                // the one command line that gives this run again
};

// Writes the file whole or not at all. Throws InputError without runs, EnvironmentError (no gnuplot, place
// not writable).
void write_report(const std::vector<RunReportInput>& runs, const std::filesystem::path& path);

// The page's text, as written by write_report.
std::string report_html(const std::vector<RunReportInput>& runs);

// Text as it may stand in HTML, in an element or in a quoted attribute.
std::string escape_html(const std::string& text);

}  // namespace sulcus
