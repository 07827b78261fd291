#include "tools/sulcus/run_recorder.h"

namespace sulcus {

namespace {

// The rings are emptied at every step, which may come with one whole state.
constexpr SessionLogSizes log_sizes{
    .tick_bytes = 64, .step_bytes = std::size_t{1} << 20, .states = 2, .own_thread = false};

}  // namespace

RunRecorder::RunRecorder(const std::filesystem::path& out, const RunHeader& header, const State& initial)
    : header_(header),
      log_path_(out / "run.h5.log"),
      writer_(out / "run.h5", header, initial),
      log_(log_path_, header, initial, log_sizes) {
  writer_.write_frame(initial, 0);
}

void RunRecorder::step(std::span<const DeviceSample> samples, const StepReport& report, const State& state,
                       std::span<const double> stage_s, double total_s,
                       std::span<const std::uint64_t> stage_hashes) {
  make_step_row(header_, report, state, stage_s, total_s, row_);
  row_.stage_hashes.assign(stage_hashes.begin(), stage_hashes.end());
  log_.push_step(report.step, samples, {}, row_);
  log_.write_now();
  writer_.write_row(samples, row_);
}

void RunRecorder::frame(const State& state) {
  log_.push_state(state);
  log_.write_now();
  writer_.write_frame(state, static_cast<double>(state.step) * header_.step_s);
}

void RunRecorder::solver_error(std::int64_t step, double error) {
  log_.push_solver_error(step, error);
  writer_.write_solver_error(step, error);
}

void RunRecorder::event(std::int64_t step, const std::string& text) {
  log_.push_event(step, text);
  writer_.add_event(step, text);
}

void RunRecorder::warning(const std::string& text) {
  log_.push_warning(text);
  writer_.add_warning(text);
}

void RunRecorder::number(const std::string& name, double value) {
  log_.push_number(name, value);
  writer_.set_number(name, value);
}

void RunRecorder::finish(const State& final_state) {
  writer_.finish(final_state);
  std::error_code ignored;  // a log that stays does no harm
  std::filesystem::remove(log_path_, ignored);
}

}  // namespace sulcus
