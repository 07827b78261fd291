// Why a golden is as it is: golden/<scenario>/provenance.json, one entry for each time it was changed, newest
// first: the reason, the commit and compiler it came from, every quantity that changed (old, new, relative),
// and the hashes of the golden's files. A golden whose files are not those of its newest entry was changed
// without a reason.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "verify/check.h"

namespace sulcus {

struct GoldenChange {
  std::string
      quantity;  // "series/tools/0/contact_force_N", "work/iterations", "tolerance of ...", "fingerprint"
  std::string unit;
  std::string before, now;  // as text; "" for what was not there. Of a series: the peak
  double relative = 0;      // largest difference / peak before; NaN where no number says it
};

// What differs between two golden.json; `before` may be empty (all is new, and one row says so).
std::vector<GoldenChange> golden_changes(const std::string& before, const std::string& now);

inline constexpr std::size_t provenance_entries = 10;  // that are kept; Git has the older ones

// Puts an entry with the files that stand in `dir` now on top. Throws InputError if `why` is empty;
// EnvironmentError if the place cannot be written to.
void write_provenance(const std::filesystem::path& dir, const std::string& why,
                      const std::map<std::string, std::string>& build,
                      const std::vector<GoldenChange>& changes);

// "golden/provenance": every file of the golden is the one that the newest entry names, and it has a reason.
Check check_provenance(const std::filesystem::path& dir);

}  // namespace sulcus
