// The parts of the report, for verify/report*.cpp alone.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "verify/plots.h"
#include "verify/report.h"

namespace sulcus::report {

// "0.4 mm", "12,345", "3.2 × 10⁻⁵", "–" for not-a-number. Units get a prefix if they are one that takes it
// (m, s, N, Pa, J and what begins with one of them); three digits that count.
std::string quantity(double value, const std::string& unit);
std::string whole_number(double value);  // "12,345"

struct CaptionedChart {
  std::string caption;  // what is seen, in plain words
  Chart chart;
};

// The charts of a run, those without recorded data left out. Bounds of checks are drawn where they are in
// sight.
std::vector<CaptionedChart> charts_of(const RunData& run, std::span<const Check> checks,
                                      std::span<const GoldenBand> golden);

// The fingerprints of all steps as a picture: a row for each stage, a column for each step (or for some), the
// colour made of the hash; pale where a stage leaves what it left the step before.
Image fingerprint_strip(const RunData& run);
const std::vector<std::string>& fingerprint_strip_rows();
std::string fingerprint_section(const RunData& run);

// The slider of a run that has pictures or charts, and the script that all sliders share.
std::string slider(const RunData& run);
extern const char* const slider_script;

// What a session in real time says about time; "" for a run that is none.
std::string session_section(const RunData& run);

std::string base64(const std::string& bytes);

// The page around its content: head, style, colours.
std::string page(const std::string& title, const std::string& body);

}  // namespace sulcus::report
