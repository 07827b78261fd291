#include "tools/sulcus/golden_pictures.h"

#include <algorithm>
#include <optional>
#include <set>

#include "verify/picture_diff.h"
#include "verify/png.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

constexpr int golden_picture_factor = 3;
constexpr double told_apart = 2 * 2.3;  // CIELAB distance, twice what is just noticeable

std::vector<fs::path> png_files(const fs::path& folder) {
  std::vector<fs::path> files;
  if (!fs::is_directory(folder)) return files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".png") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

// "03_open.png" -> "open"
std::string shot_of(const fs::path& file) {
  const std::string stem = file.stem().string();
  return stem.substr(std::min<std::size_t>(3, stem.size()));
}

Image small(const fs::path& file) {
  return shrunk(read_png(file), golden_picture_factor);
}

// A golden picture and that of a run in its size, and how far they are apart: nothing where they differ in
// size.
struct Compared {
  Image expected, found;
  std::optional<PictureDifference> difference;
};

Compared compared(const fs::path& golden, const fs::path& now) {
  Compared result{read_png(golden), small(now), {}};
  if (result.expected.width == result.found.width && result.expected.height == result.found.height)
    result.difference = compare_pictures(result.expected, result.found, told_apart);
  return result;
}

}  // namespace

std::vector<fs::path> picture_files(const fs::path& run_dir) {
  return png_files(run_dir / "pictures");
}

void write_golden_pictures(const Scenario& scenario, const fs::path& run_dir, const fs::path& golden) {
  for (const fs::path& file : png_files(golden)) fs::remove(file);
  const std::vector<fs::path> pictures = picture_files(run_dir);
  std::set<std::string> wanted;
  for (const Shot& shot : scenario.pictures.shots) {
    if (shot.golden) wanted.insert(shot.name);
  }
  for (std::size_t p = 0; p < pictures.size(); ++p) {
    const bool kept =
        wanted.empty() ? p == 0 || p == pictures.size() / 2 : wanted.count(shot_of(pictures[p])) > 0;
    if (kept) write_png(small(pictures[p]), golden / pictures[p].filename());
  }
}

std::vector<Check> check_pictures(const fs::path& run_dir, const fs::path& golden,
                                  const GoldenSettings& settings) {
  std::vector<Check> checks;
  for (const fs::path& file : png_files(golden)) {
    const std::string name = "golden/" + file.filename().string();
    const fs::path now = run_dir / "pictures" / file.filename();
    if (!fs::exists(now)) {
      checks.push_back(failed_check(name, "values", "the run has no picture of this name"));
      continue;
    }
    const auto [expected, found, difference] = compared(file, now);
    if (!difference) {
      checks.push_back(failed_check(name, "values", "the pictures differ in size"));
      continue;
    }
    const std::int64_t pixels = std::int64_t{expected.width} * expected.height;
    checks.push_back(check_at_most(name, "values", difference->differing_fraction,
                                   1 - settings.picture_conformity, "", pixels,
                                   "share of pixels that an eye tells apart"));
    checks.push_back(check_at_most(name + "/blocks", "values", difference->max_block_distance,
                                   settings.picture_block_distance, "", pixels,
                                   "largest CIELAB distance of the means of 4 x 4 pixels"));
  }
  return checks;
}

std::vector<ReportPicture> differing_pictures(const fs::path& run_dir, const fs::path& golden,
                                              const GoldenSettings& settings) {
  std::vector<ReportPicture> pictures;
  for (const fs::path& file : png_files(golden)) {
    const fs::path now = run_dir / "pictures" / file.filename();
    if (!fs::exists(now)) continue;
    const auto [expected, found, difference] = compared(file, now);
    if (!difference || (difference->differing_fraction <= 1 - settings.picture_conformity &&
                        difference->max_block_distance <= settings.picture_block_distance))
      continue;
    std::string shot = shot_of(file);
    std::replace(shot.begin(), shot.end(), '_', ' ');
    pictures.push_back({shot + ", golden", expected});
    pictures.push_back({shot + ", this run", found});
    pictures.push_back({shot + ", where they differ", difference_picture(expected, found, told_apart)});
  }
  return pictures;
}

}  // namespace sulcus
