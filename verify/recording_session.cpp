#include "verify/recording_session.h"

#include "verify/recording_fields.h"

namespace sulcus {
namespace {

constexpr hsize_t ticks_per_chunk = 4096;
constexpr std::int64_t settings_count = 6;  // numbers of ServoSettings

std::array<double, settings_count> numbers_of(const ServoSettings& s) {
  return {s.filter_Hz, s.max_extrapolation_s, s.max_extrapolation_m, s.max_extrapolation_rad,
          s.max_age_s, s.command_life_s};
}

ServoSettings settings_of(const double* n) {
  return {.filter_Hz = n[0],
          .max_extrapolation_s = n[1],
          .max_extrapolation_m = n[2],
          .max_extrapolation_rad = n[3],
          .max_age_s = n[4],
          .command_life_s = n[5]};
}

std::string tick_group(std::size_t tool) {
  return "/session/ticks/" + std::to_string(tool) + "/";
}

// Calls visit(name, unit, the field of a tick) for every field of a tick, its sample's included.
template <class Visit>
void for_each_field_of_tick(Visit&& visit) {
  for_each_tick_field([&](const char* name, const char* unit, auto member) {
    visit(
        name, unit, [member](auto& tick) -> auto& { return tick.*member; });
  });
  for_each_sample_field([&](const char* name, const char* unit, auto member) {
    visit(
        name, unit, [member](auto& tick) -> auto& { return tick.sample.*member; });
  });
}

}  // namespace

void write_session_header(hid_t file, const SessionHeader& session) {
  hdf5::write_strings(file, "/session/devices", session.devices);
  std::vector<double> settings;
  for (const ServoSettings& servo : session.servo) {
    const auto numbers = numbers_of(servo);
    settings.insert(settings.end(), numbers.begin(), numbers.end());
  }
  hdf5::write_array<double>(file, "/session/servo_settings", settings);
}

std::vector<hdf5::Column> tick_columns(hid_t file, std::size_t tool) {
  std::vector<hdf5::Column> columns;
  const ServoTick none;
  for_each_field_of_tick([&](const char* name, const char* unit, auto field) {
    using Numbers = decltype(to_numbers(field(none)));
    const std::size_t components = Numbers{}.size();
    columns.push_back(hdf5::Column::create<typename Numbers::value_type>(
        file, tick_group(tool) + name, components == 1 ? -1 : static_cast<std::int64_t>(components),
        ticks_per_chunk, unit));
  });
  return columns;
}

void append_tick(std::vector<hdf5::Column>& columns, const ServoTick& tick) {
  std::size_t column = 0;
  for_each_field_of_tick([&](const char*, const char*, auto field) {
    const auto numbers = to_numbers(field(tick));
    columns[column++].append(numbers.data());
  });
}

void write_session_histograms(hid_t file, std::span<const Histogram> histograms) {
  std::vector<std::string> names;
  std::vector<double> bins, quantiles;
  std::vector<std::int64_t> counts;
  for (const Histogram& histogram : histograms) {
    names.push_back(histogram.name);
    bins.push_back(histogram.bin_s);
    quantiles.insert(quantiles.end(), {histogram.median_s, histogram.p99_s, histogram.max_s});
    for (const std::uint64_t count : histogram.counts) counts.push_back(static_cast<std::int64_t>(count));
  }
  hdf5::write_strings(file, "/session/histograms/names", names);
  hdf5::write_array<double>(file, "/session/histograms/bin_s", bins, "s");
  hdf5::write_array<double>(file, "/session/histograms/quantiles_s", quantiles, "s");
  hdf5::write_array<std::int64_t>(file, "/session/histograms/counts", counts);
}

namespace {

std::vector<ServoTick> read_ticks(hdf5::Reader& file, std::size_t tool) {
  std::vector<std::int64_t> count = {hdf5::Reader::any};
  file.array<std::uint64_t>(tick_group(tool) + "number", count);
  std::vector<ServoTick> ticks;
  for_each_field_of_tick([&](const char* name, const char*, auto field) {
    using Numbers = decltype(to_numbers(field(std::declval<const ServoTick&>())));
    const std::size_t components = Numbers{}.size();
    std::vector<std::int64_t> shape = count;
    if (components > 1) shape.push_back(static_cast<std::int64_t>(components));
    const auto numbers = file.array<typename Numbers::value_type>(tick_group(tool) + name, shape);
    ticks.resize(static_cast<std::size_t>(count[0]));  // only now is it known that the file holds so many
    for (std::size_t i = 0; i < ticks.size(); ++i) from_numbers(&numbers[i * components], field(ticks[i]));
  });
  return ticks;
}

void read_histograms(hdf5::Reader& file, SessionData& session) {
  const std::vector<std::string> names = file.strings("/session/histograms/names");
  const auto count = static_cast<std::int64_t>(names.size());
  constexpr auto bins = static_cast<std::int64_t>(Histogram::bins);
  const auto widths = file.array<double>("/session/histograms/bin_s", {count});
  const auto quantiles = file.array<double>("/session/histograms/quantiles_s", {3 * count});
  const auto counts = file.array<std::int64_t>("/session/histograms/counts", {bins * count});
  for (std::size_t i = 0; i < names.size(); ++i) {
    Histogram histogram;
    histogram.name = names[i];
    histogram.bin_s = widths[i];
    for (std::size_t b = 0; b < Histogram::bins; ++b)
      histogram.counts[b] = static_cast<std::uint64_t>(counts[i * Histogram::bins + b]);
    histogram.median_s = quantiles[3 * i];
    histogram.p99_s = quantiles[3 * i + 1];
    histogram.max_s = quantiles[3 * i + 2];
    session.histograms.push_back(histogram);
  }
}

}  // namespace

void read_session(hdf5::Reader& file, RunData& run) {
  if (!file.exists("/session")) return;
  SessionHeader header;
  SessionData session;
  const std::int64_t tools = run.header.tool_count();
  header.devices = file.strings("/session/devices");
  if (static_cast<std::int64_t>(header.devices.size()) != tools)
    file.refuse("/session/devices", "does not name one device a tool");
  const auto settings = file.array<double>("/session/servo_settings", {settings_count * tools});
  for (std::size_t tool = 0; tool < header.devices.size(); ++tool) {
    header.servo.push_back(settings_of(&settings[tool * settings_count]));
    session.ticks.push_back(read_ticks(file, tool));
  }
  for (const char* name : {"session/due_s", "session/read_s", "session/published_s"}) {
    const Series* series = run.find(name);
    if (series == nullptr || series->components != 1)
      file.refuse(std::string("/series/") + name, "is not one number a step");
  }
  read_histograms(file, session);
  run.header.session = std::move(header);
  run.session = std::move(session);
}

}  // namespace sulcus
