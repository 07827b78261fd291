#include <fcntl.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <cstring>
#include <limits>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/hdf5_file.h"
#include "verify/recording.h"
#include "verify/recording_fields.h"
#include "verify/recording_session.h"
#include "verify/recording_vtk.h"
#include "verify/seal.h"

namespace sulcus {

namespace {
constexpr hsize_t rows_per_chunk = 256;  // steps kept in memory before they go to the file
}

struct RunWriter::Impl {
  std::filesystem::path path, partial;
  RunHeader header;
  bool failed = false, finished = false;
  std::int64_t steps = 0;
  std::uint64_t fingerprint = 0;

  // The file is declared first, so that it closes last.
  hdf5::Handle file;
  std::vector<hdf5::Column> series, device, times;
  std::vector<std::size_t> series_components;
  std::vector<std::vector<hdf5::Column>> ticks;  // [tools], of a session
  std::vector<hdf5::Column> chain, fields, stages, frames;

  StepRow row;  // of write_step
  std::vector<double> frame_times_s;
  std::vector<SolverErrorSample> solver_errors;
  std::map<std::string, double> numbers;
  std::vector<std::string> warnings, event_texts;
  std::vector<std::int64_t> event_steps;

  void write_header();
  void write_hashes(std::span<const std::uint64_t> row);
  void write_end(const State& final_state);
  void close();

  // Runs `work`; a failure closes the file, leaves it under its partial name and becomes an EnvironmentError.
  template <class Work>
  void guarded(Work&& work) {
    if (failed || finished)
      throw EnvironmentError(partial.string() + ": nothing can be recorded any more, the recording " +
                             (failed ? "failed before" : "is finished"));
    try {
      work();
    } catch (const hdf5::Failure& failure) {
      fail(failure.what());
    } catch (const EnvironmentError& failure) {
      fail(failure.what());
    }
  }
  [[noreturn]] void fail(const std::string& reason);
};

void RunWriter::Impl::fail(const std::string& reason) {
  failed = true;
  std::error_code ignored;
  const auto space =
      std::filesystem::space(partial.parent_path().empty() ? "." : partial.parent_path(), ignored);
  const bool full = !ignored && space.available < (1 << 20);
  try {
    close();
  } catch (const hdf5::Failure&) {  // the first reason is the one to tell
  }
  throw EnvironmentError(partial.string() + ": recording failed at step " + std::to_string(steps) + " (" +
                         reason + (full ? "; the disk is full" : "") +
                         "); what was written is kept there, and a log beside it (run.h5.log) is read by "
                         "`sulcus recover`; free space or "
                         "choose another place, then run again");
}

void RunWriter::Impl::close() {
  std::string first;
  const auto close_all = [&](std::vector<hdf5::Column>& columns) {
    for (hdf5::Column& column : columns) {
      try {
        if (!failed) column.close();
      } catch (const hdf5::Failure& failure) {
        if (first.empty()) first = failure.what();
      }
    }
    columns.clear();
  };
  for (auto* columns : {&series, &device, &times, &chain, &fields, &stages, &frames}) close_all(*columns);
  for (auto& columns : ticks) close_all(columns);
  if (!file.close() && first.empty()) first = hdf5::innermost_error();
  if (!first.empty()) throw hdf5::Failure(first);
}

void RunWriter::Impl::write_header() {
  hdf5::write_attribute(file, "format", std::string("sulcus recording"));
  hdf5::write_attribute(file, "format_version", std::int64_t{recording_format_version});
  hdf5::write_attribute(file, "scenario_name", header.scenario_name);
  hdf5::write_attribute(file, "threads", std::int64_t{header.threads});
  hdf5::write_attribute(file, "step_s", header.step_s);
  const auto write_map = [&](const std::string& group, const std::map<std::string, std::string>& map) {
    std::vector<std::string> keys, values;
    for (const auto& [key, value] : map) {
      keys.push_back(key);
      values.push_back(value);
    }
    hdf5::write_strings(file, group + "/keys", keys);
    hdf5::write_strings(file, group + "/values", values);
  };
  hdf5::write_strings(file, "/header/scenario_json", std::span(&header.scenario_json, 1));
  hdf5::write_strings(file, "/header/overrides", header.overrides);
  hdf5::write_strings(file, "/header/tool_names", header.tool_names);
  hdf5::write_strings(file, "/header/motion_names", header.motion_names);
  hdf5::write_strings(file, "/header/obstacle_names", header.obstacle_names);
  write_map("/header/build", header.build);
  write_map("/header/inputs", header.inputs);
  hdf5::write_array<double>(file, "/mesh/rest_positions_m", header.rest_positions, "m");
  hdf5::write_array<std::int32_t>(file, "/mesh/tets", header.tets);
  hdf5::write_strings(file, "/fingerprint/field_names", state_field_names());
  if (!header.stage_leaves.empty())
    hdf5::write_strings(file, "/fingerprint/stage_names", header.stage_leaves);
}

void RunWriter::Impl::write_hashes(std::span<const std::uint64_t> hashes) {
  fingerprint = chain_hash(fingerprint, hashes);
  fields[0].append(hashes.data());
  chain[0].append(&fingerprint);
}

RunWriter::RunWriter(std::filesystem::path path, const RunHeader& header, const State& initial)
    : impl_(std::make_unique<Impl>()) {
  Impl& run = *impl_;
  run.path = std::move(path);
  run.partial = run.path.string() + ".part";
  run.header = header;
  check_header(header, run.path.string());
  check_state_sizes(initial, header, run.path.string());

  // By hand first: the system's reason is clearer than HDF5's.
  const int probe = ::open(run.partial.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (probe < 0)
    throw EnvironmentError(run.partial.string() + ": cannot be created (" + std::strerror(errno) +
                           "); choose a place that can be written to");
  ::close(probe);

  run.guarded([&] {
    using hdf5::Column;
    run.file = hdf5::create_file(run.partial.string());
    run.write_header();
    StepReport report;
    report.tools.resize(header.tool_names.size());
    report.motion_forces.resize(header.motion_names.size());
    report.obstacles.resize(header.obstacle_names.size());
    report.plane_forces.resize(header.plane_count);
    if (header.fractures) report.fracture.emplace();
    if (header.ledger) report.energy.emplace();
    const std::array<double, stage_count> no_times{};
    for_each_step_series(
        report, initial, header.rest_positions, no_times, 0.0,
        [&](const std::string& name, const char* unit, int components, const double*) {
          run.series.push_back(Column::create<double>(
              run.file, "/series/" + name, components == 1 ? -1 : components, rows_per_chunk, unit));
          run.series_components.push_back(static_cast<std::size_t>(components));
        });
    if (header.session) {
      for (const char* name : {"due_s", "read_s", "published_s"}) {
        run.times.push_back(Column::create<double>(run.file, std::string("/series/session/") + name, -1,
                                                   rows_per_chunk, "s"));
      }
      write_session_header(run.file, *header.session);
      for (std::size_t tool = 0; tool < header.tool_names.size(); ++tool)
        run.ticks.push_back(tick_columns(run.file, tool));
    }
    for (std::size_t tool = 0; tool < header.tool_names.size(); ++tool) {
      for_each_sample_field([&](const char* name, const char* unit, auto member) {
        const auto numbers = to_numbers(DeviceSample{}.*member);
        run.device.push_back(Column::create<typename decltype(numbers)::value_type>(
            run.file, "/device/" + std::to_string(tool) + "/" + name,
            numbers.size() == 1 ? -1 : static_cast<std::int64_t>(numbers.size()), rows_per_chunk, unit));
      });
    }
    run.chain.push_back(Column::create<std::uint64_t>(run.file, "/fingerprint/chain", -1, rows_per_chunk));
    run.fields.push_back(Column::create<std::uint64_t>(run.file, "/fingerprint/fields",
                                                       static_cast<std::int64_t>(state_field_names().size()),
                                                       rows_per_chunk));
    if (!header.stage_leaves.empty()) {
      run.stages.push_back(Column::create<std::uint64_t>(
          run.file, "/fingerprint/stages", static_cast<std::int64_t>(header.stage_leaves.size()),
          rows_per_chunk));
    }
    const auto add_frames = [&](Column column) { run.frames.push_back(std::move(column)); };
    add_frames(Column::create<std::int64_t>(run.file, "/frames/step", -1, 1));
    add_frames(Column::create<double>(run.file, "/frames/time_s", -1, 1, "s"));
    add_frames(Column::create<double>(run.file, "/frames/positions_m", 3 * header.node_count(), 1, "m"));
    add_frames(Column::create<double>(run.file, "/frames/tool_poses", 7 * header.tool_count(), 1));
    add_frames(Column::create<std::uint8_t>(run.file, "/frames/alive", header.tet_count(), 1));
    add_frames(Column::create<double>(run.file, "/frames/stress_Pa", header.tet_count(), 1, "Pa"));
    std::vector<std::uint64_t> hashes(state_field_names().size());
    hash_state(initial, hashes);
    run.write_hashes(hashes);
  });
}

RunWriter::~RunWriter() {
  if (!impl_ || impl_->failed || impl_->finished) return;
  try {
    impl_->close();
  } catch (const hdf5::Failure&) {  // the run was given up anyway
  }
}

void make_step_row(const RunHeader& header, const StepReport& report, const State& state,
                   std::span<const double> stage_s, double total_s, StepRow& row) {
  assert(stage_s.size() == static_cast<std::size_t>(stage_count));
  assert(report.motion_forces.size() == header.motion_names.size());
  assert(report.obstacles.size() == header.obstacle_names.size());
  assert(report.plane_forces.size() == header.plane_count);
  assert(report.fracture.has_value() == header.fractures);
  assert(report.energy.has_value() == header.ledger);
  row.numbers.clear();
  for_each_step_series(report, state, header.rest_positions, stage_s, total_s,
                       [&](const std::string&, const char*, int components, const double* numbers) {
                         row.numbers.insert(row.numbers.end(), numbers, numbers + components);
                       });
  row.hashes.resize(state_field_names().size());
  hash_state(state, row.hashes);
}

void RunWriter::write_step(std::span<const DeviceSample> samples, const StepReport& report,
                           const State& state, std::span<const double> stage_s, double total_s,
                           std::span<const std::uint64_t> stage_hashes) {
  Impl& run = *impl_;
  assert(report.tools.size() == samples.size());
  check_state_sizes(state, run.header, run.path.string());
  make_step_row(run.header, report, state, stage_s, total_s, run.row);
  run.row.stage_hashes.assign(stage_hashes.begin(), stage_hashes.end());
  write_row(samples, run.row);
}

void RunWriter::write_row(std::span<const DeviceSample> samples, const StepRow& row,
                          const SessionStep& times) {
  Impl& run = *impl_;
  assert(samples.size() == run.header.tool_names.size());
  run.guarded([&] {
    const double* numbers = row.numbers.data();
    std::size_t left = row.numbers.size();
    for (std::size_t i = 0; i < run.series.size(); ++i) {
      if (left < run.series_components[i]) throw hdf5::Failure("a step has too few numbers");
      run.series[i].append(numbers);
      numbers += run.series_components[i];
      left -= run.series_components[i];
    }
    std::size_t column = 0;
    for (const DeviceSample& sample : samples)
      for_each_sample_field([&](const char*, const char*, auto member) {
        const auto values = to_numbers(sample.*member);
        run.device[column++].append(values.data());
      });
    if (run.header.session) {
      run.times[0].append(&times.due_s);
      run.times[1].append(&times.read_s);
      run.times[2].append(&times.published_s);
    }
    run.write_hashes(row.hashes);
    if (row.stage_hashes.size() != run.header.stage_leaves.size())
      throw hdf5::Failure("a step has other hashes of its stages than the header says");
    for (hdf5::Column& leaves : run.stages) leaves.append(row.stage_hashes.data());
    ++run.steps;
  });
}

void RunWriter::write_tick(std::size_t tool, const ServoTick& tick) {
  Impl& run = *impl_;
  assert(tool < run.ticks.size());
  run.guarded([&] { append_tick(run.ticks[tool], tick); });
}

void RunWriter::write_histograms(std::span<const Histogram> histograms) {
  impl_->guarded([&] { write_session_histograms(impl_->file, histograms); });
}

void RunWriter::write_frame(const State& state, double time_s, std::span<const double> stress_Pa) {
  Impl& run = *impl_;
  check_state_sizes(state, run.header, run.path.string());
  const auto tets = static_cast<std::size_t>(run.header.tet_count());
  assert(stress_Pa.empty() || stress_Pa.size() == tets);
  run.guarded([&] {
    const std::vector<double> unknown(stress_Pa.empty() ? tets : 0, std::numeric_limits<double>::quiet_NaN());
    const void* rows[] = {&state.step,
                          &time_s,
                          state.positions.data(),
                          state.tool_poses.data(),
                          state.alive.data(),
                          stress_Pa.empty() ? unknown.data() : stress_Pa.data()};
    for (std::size_t i = 0; i < run.frames.size(); ++i) run.frames[i].append(rows[i]);
    run.frame_times_s.push_back(time_s);
  });
}

void RunWriter::write_solver_error(std::int64_t step, double error) {
  impl_->solver_errors.push_back({step, error});
}

void RunWriter::add_warning(const std::string& text) {
  impl_->warnings.push_back(text);
}

void RunWriter::add_event(std::int64_t step, const std::string& text) {
  impl_->event_steps.push_back(step);
  impl_->event_texts.push_back(text);
}

void RunWriter::set_number(const std::string& name, double value) {
  impl_->numbers[name] = value;
}

void RunWriter::Impl::write_end(const State& final_state) {
  std::vector<std::int64_t> error_steps;
  std::vector<double> errors;
  for (const SolverErrorSample& sample : solver_errors) {
    error_steps.push_back(sample.step);
    errors.push_back(sample.error);
  }
  hdf5::write_array<std::int64_t>(file, "/solver_error/step", error_steps);
  hdf5::write_array<double>(file, "/solver_error/error", errors);
  std::vector<std::string> names;
  std::vector<double> values;
  for (const auto& [name, value] : numbers) {
    names.push_back(name);
    values.push_back(value);
  }
  hdf5::write_strings(file, "/numbers/names", names);
  hdf5::write_array<double>(file, "/numbers/values", values);
  hdf5::write_strings(file, "/warnings", warnings);
  hdf5::write_array<std::int64_t>(file, "/events/step", event_steps);
  hdf5::write_strings(file, "/events/text", event_texts);
  for_each_field(final_state, [&](std::string_view name, auto array) {
    hdf5::write_array(file, "/final_state/" + std::string(name), array);
  });
  hdf5::write_attribute(file, "steps", steps);
  for (hdf5::Column& column : frames) column.flush();
  if (!frame_times_s.empty() && header.tet_count() > 0) write_vtk_group(file, header, frame_times_s);
}

void RunWriter::finish(const State& final_state) {
  Impl& run = *impl_;
  check_state_sizes(final_state, run.header, run.path.string());
  run.guarded([&] {
    run.write_end(final_state);
    run.close();
    write_seal(run.partial);
    if (::rename(run.partial.c_str(), run.path.c_str()) != 0)
      throw EnvironmentError(run.path.string() + ": cannot be put in place (" + std::strerror(errno) + ")");
    run.finished = true;
  });
}

std::uint64_t RunWriter::fingerprint() const {
  return impl_->fingerprint;
}
const std::filesystem::path& RunWriter::partial_path() const {
  return impl_->partial;
}

}  // namespace sulcus
