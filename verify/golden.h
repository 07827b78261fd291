// Golden outputs: what a scenario has to give. golden/<scenario>/golden.json holds the fingerprint, counts of
// topology, counters of work, and decimated series with a tolerance each and the basis of that tolerance
// beside it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "verify/check.h"
#include "verify/recording.h"

namespace sulcus {

inline constexpr int golden_points = 40;                   // of a series, at most
inline constexpr std::int64_t golden_max_bytes = 300'000;  // of one scenario's folder

// A run of the same scenario by other arithmetic (moved by one ulp, another precision, another solver), to
// measure how far values move when the physics does not.
struct GoldenVariant {
  std::string label;  // "start moved by one ulp"
  const RunData* run = nullptr;
  bool same_work = true;  // false: it asks the solver for other work, so its iterations say nothing
};

// Writes dir/golden.json (and dir). Tolerances: with variants, spread_factor times the largest difference
// seen between them and the run, but at least least_tolerance_share of the series' peak; without variants, those of the
// golden that stood there before; else a default share of the peak whose basis says that it is not measured.
// Counts that differ between variants are left out of "counts" and stand in "work" with their tolerance.
// Throws InputError if the run holds a number that is not finite, has no step, or needs more than
// golden_max_bytes; EnvironmentError if the place cannot be written to.
inline constexpr double spread_factor =
    3;  // three variants are few: what they show is not the most there can be
inline constexpr double least_tolerance_share = 1e-9;  // of the peak: rounding alone
void write_golden(const RunData& run, const std::filesystem::path& dir,
                  std::span<const GoldenVariant> variants = {});

// Verdicts: "golden/fingerprint" (bits), "golden/steps", "golden/counts", "golden/work" and one for each
// golden series (values). If the bits break and the values hold, the fingerprint's detail says "arithmetic
// changed, physics did not". Whatever is wrong with the golden itself (missing, damaged, empty, of other
// length) is a failed check, not an exception.
std::vector<Check> compare_golden(const RunData& run, const std::filesystem::path& dir);

}  // namespace sulcus
