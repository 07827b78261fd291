// A check: one thing that was compared with what it has to be, and how it went.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <string_view>

namespace sulcus {

// Three kinds of verdict, from strict to fundamental:
//   bits       the fingerprint is the golden one
//   values     a quantity agrees with the golden one within its tolerance
//   statement  a law that holds in every run, whatever the golden says
struct Check {
  std::string name;  // "penetration", "golden/tools/0/contact_force_N"
  std::string kind;  // "bits", "values" or "statement"
  bool passed = false;
  double value =
      std::numeric_limits<double>::quiet_NaN();  // what was found, in `unit`; NaN where no number says it
  double bound = std::numeric_limits<double>::quiet_NaN();  // what it is held against, in `unit`
  std::string unit;
  double margin =
      std::numeric_limits<double>::quiet_NaN();  // in `unit`; what is left to the bound, >= 0 if passed
  std::int64_t comparisons = 0;                  // how many numbers were compared; a check without any fails
  std::string detail;                            // one line for people: where the worst was, or what is wrong
};

// value <= bound passes, value >= bound passes; NaN on either side, or no comparison at all, fails.
Check check_at_most(std::string name, std::string kind, double value, double bound, std::string unit,
                    std::int64_t comparisons, std::string detail);
Check check_at_least(std::string name, std::string kind, double value, double bound, std::string unit,
                     std::int64_t comparisons, std::string detail);
Check failed_check(std::string name, std::string kind, std::string detail);

bool all_passed(std::span<const Check> checks);  // false if there is none

// "PASS  penetration  0.4 mm of at most 2 mm (step 31)": the line that the command prints.
std::string check_line(const Check& check);

// Writes `text` to a file of its own and renames it to `path`, so that nothing half-written stands under that
// name. Throws EnvironmentError with the place and the remedy.
void write_file_atomically(const std::filesystem::path& path, std::string_view text);

}  // namespace sulcus
