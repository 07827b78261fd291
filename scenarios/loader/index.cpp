#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {

namespace {

// Whether the file is meant to be a scenario: an object with the key "sulcus", or no JSON at all. Fills in
// what an otherwise wrong file says about itself.
bool looks_like_scenario(const std::filesystem::path& path, ScenarioSummary& summary) {
  std::ifstream stream(path);
  const nlohmann::json document = nlohmann::json::parse(stream, nullptr, false);
  if (document.is_discarded()) return true;
  if (!document.is_object() || !document.contains("sulcus")) return false;
  const auto text = [&](const char* key) {
    const auto member = document.find(key);
    return member != document.end() && member->is_string() ? member->get<std::string>() : std::string();
  };
  summary.name = text("name");
  summary.title = text("title");
  summary.description = text("description");
  return true;
}

}  // namespace

std::vector<ScenarioSummary> list_scenarios(const std::filesystem::path& directory) {
  std::error_code error;
  if (!std::filesystem::is_directory(directory, error)) {
    throw InputError(directory.string() + ": this directory does not exist");
  }
  std::vector<std::filesystem::path> files;
  const auto look_in = [&](const std::filesystem::path& folder) {
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      if (entry.is_regular_file() && entry.path().extension() == ".json") files.push_back(entry.path());
    }
  };
  look_in(directory);
  if (std::filesystem::is_directory(directory / "hard", error)) look_in(directory / "hard");
  std::sort(files.begin(), files.end());

  std::vector<ScenarioSummary> summaries;
  for (const auto& file : files) {
    ScenarioSummary summary;
    summary.path = file;
    summary.name = file.stem().string();
    if (!looks_like_scenario(file, summary)) continue;
    try {
      load_scenario(file);
    } catch (const InputError& refusal) {
      summary.error = refusal.what();
    } catch (const MissingData& absence) {
      summary.missing = absence.what();
    }
    summaries.push_back(std::move(summary));
  }
  return summaries;
}

}  // namespace sulcus
