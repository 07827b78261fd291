// The results of many scenarios at a glance: a page with a table that can be sorted, and a short text for
// continuous integration.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "verify/check.h"
#include "verify/summary.h"

namespace sulcus {

struct SuiteEntry {
  std::string name;           // of the scenario
  std::vector<Check> checks;  // all hold: the scenario holds
  RunSummary summary;         // all zero if the scenario did not run
  double wall_s = 0;          // s, for run, replay, verification and report
  std::string report;         // its page, relative to the index; "" if there is none
  std::string reproduce;      // the command line that shows the same
};

struct SuiteTotals {
  std::size_t scenarios = 0, failed = 0, checks = 0;
};
SuiteTotals totals_of(std::span<const SuiteEntry> entries);

// How one kind of golden went: "holds", "fails", or "–" where there is no such check.
std::string verdict_of(const SuiteEntry& entry, const std::string& kind);

// index.html: self-contained, readable without JavaScript (which only sorts the table). wall_s: of all.
std::string suite_html(std::span<const SuiteEntry> entries, double wall_s);

// Markdown: a table, and below it every failed check with the command that shows it again.
std::string suite_markdown(std::span<const SuiteEntry> entries, double wall_s);

}  // namespace sulcus
