// The golden pictures of a scenario: which are kept, how those of a run are held against them, and where they
// differ. They are kept small, at a third of their size.
#pragma once

#include <filesystem>
#include <vector>

#include "scenarios/loader/scenario.h"
#include "verify/check.h"
#include "verify/report.h"

namespace sulcus {

// Pictures of a run's folder, in order of the shots.
std::vector<std::filesystem::path> picture_files(const std::filesystem::path& run_dir);

// Replaces the pictures in `golden` by those of the run whose shots ask for it; if none does, by the first
// and the one in the middle, where most is to be seen.
void write_golden_pictures(const Scenario& scenario, const std::filesystem::path& run_dir,
                           const std::filesystem::path& golden);

// Two verdicts on each golden picture: how many pixels an eye tells apart ("golden/<file>"), and how far the
// means of any 4 x 4 pixels are apart ("golden/<file>/blocks"), which finds small things that are missing. A
// picture that the run lacks, or of another size, fails.
std::vector<Check> check_pictures(const std::filesystem::path& run_dir, const std::filesystem::path& golden,
                                  const GoldenSettings& settings);

// For each picture that fails: the golden one, that of the run in its size, and where they differ.
std::vector<ReportPicture> differing_pictures(const std::filesystem::path& run_dir,
                                              const std::filesystem::path& golden,
                                              const GoldenSettings& settings);

}  // namespace sulcus
