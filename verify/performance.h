// The history of performance (golden/performance, written by tools/perf) as one self-contained page with
// trend lines.
#pragma once

#include <filesystem>
#include <string>

namespace sulcus {

// folder: counts.json (instructions and work of each commit that changed them) and, if there, times.json
// (wall time, by machine): arrays of entries, oldest first, as tools/bench writes them. Lines are changes in
// % since the first entry of the same compiler or machine; a step change is marked in grey and told in a
// table with commit and reason: counts that differ by more than 3 % from the entry before, times by more than
// 5 % and more than the spread of the two. Throws InputError if counts.json is missing, has no entry, or is
// not what it should be; EnvironmentError without gnuplot.
std::string performance_html(const std::filesystem::path& folder);

}  // namespace sulcus
