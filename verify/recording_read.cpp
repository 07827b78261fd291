#include <algorithm>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/hdf5_file.h"
#include "verify/recording.h"
#include "verify/recording_fields.h"
#include "verify/recording_session.h"
#include "verify/seal.h"

namespace sulcus {

namespace {

using hdf5::Reader;

constexpr std::int64_t most_steps = 1'000'000'000;
constexpr std::int64_t most_components = 64;
constexpr std::int64_t most_tools = 1000;

std::map<std::string, std::string> read_map(Reader& file, const std::string& group) {
  const std::vector<std::string> keys = file.strings(group + "/keys");
  const std::vector<std::string> values = file.strings(group + "/values");
  if (keys.size() != values.size()) file.refuse(group, "has keys and values of different number");
  std::map<std::string, std::string> map;
  for (std::size_t i = 0; i < keys.size(); ++i) map[keys[i]] = values[i];
  return map;
}

RunHeader read_header(Reader& file, const std::string& place) {
  RunHeader header;
  header.scenario_name = file.text_attribute("/", "scenario_name");
  header.threads = static_cast<int>(file.integer_attribute("threads"));
  header.step_s = file.real_attribute("step_s");
  const std::vector<std::string> json = file.strings("/header/scenario_json");
  if (json.size() != 1) file.refuse("/header/scenario_json", "is not one text");
  header.scenario_json = json[0];
  header.overrides = file.strings("/header/overrides");
  header.tool_names = file.strings("/header/tool_names");
  header.motion_names = file.strings("/header/motion_names");
  if (file.exists("/header/obstacle_names")) header.obstacle_names = file.strings("/header/obstacle_names");
  if (header.tool_count() > most_tools) file.refuse("/header/tool_names", "names too many tools");
  header.build = read_map(file, "/header/build");
  header.inputs = read_map(file, "/header/inputs");
  header.rest_positions = file.array<double>("/mesh/rest_positions_m", {Reader::any});
  header.tets = file.array<std::int32_t>("/mesh/tets", {Reader::any});
  check_header(header, place);
  return header;
}

void read_series(Reader& file, RunData& run) {
  for (const std::string& name : file.datasets_below("/series")) {
    const std::string path = "/series/" + name;
    std::vector<std::int64_t> shape = file.shape(path);
    if (shape.empty() || shape.size() > 2 || (shape.size() == 2 && shape[1] > most_components))
      file.refuse(path, "has a shape that no series has");
    shape[0] = run.steps;
    Series series;
    series.components = shape.size() == 2 ? static_cast<int>(shape[1]) : 1;
    series.unit = file.text_attribute(path, "unit");
    series.values = file.array<double>(path, shape);
    run.series[name] = std::move(series);
  }
}

// Samples as they were, and each of their fields as a series.
void read_samples(Reader& file, RunData& run) {
  const auto tools = static_cast<std::size_t>(run.header.tool_count());
  const auto steps = static_cast<std::size_t>(run.steps);
  for (std::size_t tool = 0; tool < tools; ++tool) {
    const std::string group = "device/" + std::to_string(tool) + "/";
    for_each_sample_field([&](const char* name, const char* unit, auto member) {
      using Numbers = decltype(to_numbers(DeviceSample{}.*member));
      const std::size_t components = Numbers{}.size();
      std::vector<std::int64_t> shape = {run.steps};
      if (components > 1) shape.push_back(static_cast<std::int64_t>(components));
      const auto numbers = file.array<typename Numbers::value_type>("/" + group + name, shape);
      run.samples.resize(steps * tools);  // only now is it known that the file holds so many steps
      for (std::size_t step = 0; step < steps; ++step)
        from_numbers(&numbers[step * components], run.samples[step * tools + tool].*member);
      run.series[group + name] = {unit, static_cast<int>(components),
                                  std::vector<double>(numbers.begin(), numbers.end())};
    });
  }
}

void read_fingerprints(Reader& file, RunData& run) {
  run.field_names = file.strings("/fingerprint/field_names");
  const auto fields = static_cast<std::int64_t>(run.field_names.size());
  run.fingerprints = file.array<std::uint64_t>("/fingerprint/chain", {run.steps + 1});
  run.field_hashes = file.array<std::uint64_t>("/fingerprint/fields", {run.steps + 1, fields});
  if (file.exists("/fingerprint/stages")) {
    run.header.stage_leaves = file.strings("/fingerprint/stage_names");
    run.stage_hashes = file.array<std::uint64_t>(
        "/fingerprint/stages", {run.steps, static_cast<std::int64_t>(run.header.stage_leaves.size())});
  }
  std::uint64_t previous = 0;
  for (std::size_t n = 0; n < run.fingerprints.size(); ++n) {
    previous = chain_hash(
        previous, std::span(run.field_hashes).subspan(n * run.field_names.size(), run.field_names.size()));
    if (previous != run.fingerprints[n])
      file.refuse("/fingerprint/chain",
                  "does not follow from the hashes of the fields at step " + std::to_string(n));
  }
}

void read_frames(Reader& file, RunData& run) {
  std::vector<std::int64_t> shape = {Reader::any};
  const std::vector<std::int64_t> steps = file.array<std::int64_t>("/frames/step", shape);
  const std::int64_t count = shape[0];
  const RunHeader& header = run.header;
  const auto times = file.array<double>("/frames/time_s", {count});
  const auto positions = file.array<double>("/frames/positions_m", {count, 3 * header.node_count()});
  const auto poses = file.array<double>("/frames/tool_poses", {count, 7 * header.tool_count()});
  const auto alive = file.array<std::uint8_t>("/frames/alive", {count, header.tet_count()});
  const auto stress = file.array<double>("/frames/stress_Pa", {count, header.tet_count()});
  const auto row = [](const auto& all, std::size_t i, std::int64_t width) {
    const auto begin = all.begin() + static_cast<std::ptrdiff_t>(i) * width;
    return std::decay_t<decltype(all)>(begin, begin + width);
  };
  for (std::size_t i = 0; i < steps.size(); ++i)
    run.frames.push_back({steps[i], times[i], row(positions, i, 3 * header.node_count()),
                          row(poses, i, 7 * header.tool_count()), row(alive, i, header.tet_count()),
                          row(stress, i, header.tet_count())});
}

void read_final_state(Reader& file, RunData& run) {
  run.final_state = sized_state(run.header);
  for_each_field(
      run.final_state, [&]<class T, std::size_t extent>(std::string_view name, std::span<T, extent> field) {
        const std::vector<T> values =
            file.array<T>("/final_state/" + std::string(name), {static_cast<std::int64_t>(field.size())});
        std::copy(values.begin(), values.end(), field.begin());
      });
}

void read_lists(Reader& file, RunData& run) {
  std::vector<std::int64_t> shape = {Reader::any};
  const auto error_steps = file.array<std::int64_t>("/solver_error/step", shape);
  const auto errors = file.array<double>("/solver_error/error", shape);
  for (std::size_t i = 0; i < errors.size(); ++i) run.solver_errors.push_back({error_steps[i], errors[i]});

  const std::vector<std::string> names = file.strings("/numbers/names");
  const auto values = file.array<double>("/numbers/values", {static_cast<std::int64_t>(names.size())});
  for (std::size_t i = 0; i < names.size(); ++i) run.numbers[names[i]] = values[i];

  run.warnings = file.strings("/warnings");
  const std::vector<std::string> texts = file.strings("/events/text");
  const auto event_steps =
      file.array<std::int64_t>("/events/step", {static_cast<std::int64_t>(texts.size())});
  for (std::size_t i = 0; i < texts.size(); ++i) run.events.push_back({event_steps[i], texts[i]});
}

}  // namespace

RunData read_run(const std::filesystem::path& path) {
  const std::uint64_t bytes = check_seal(path);
  Reader file(path.string(), bytes);
  RunData run;
  run.steps = file.integer_attribute("steps");
  if (run.steps < 0 || run.steps > most_steps)
    file.refuse("attribute steps", "is " + std::to_string(run.steps));
  run.header = read_header(file, path.string());
  read_series(file, run);
  read_samples(file, run);
  read_fingerprints(file, run);
  read_frames(file, run);
  read_final_state(file, run);
  read_lists(file, run);
  read_session(file, run);
  return run;
}

}  // namespace sulcus
