// Where a run goes while it goes on: into the recording, and step by step into a log beside it, which stays
// readable whatever happens and goes when the recording stands.
#pragma once

#include <filesystem>
#include <string>

#include "verify/recording.h"
#include "verify/session_log.h"

namespace sulcus {

class RunRecorder {
 public:
  // out/run.h5 and out/run.h5.log. All functions throw EnvironmentError if the disk refuses.
  RunRecorder(const std::filesystem::path& out, const RunHeader& header, const State& initial);

  void step(std::span<const DeviceSample> samples, const StepReport& report, const State& state,
            std::span<const double> stage_s, double total_s, std::span<const std::uint64_t> stage_hashes);
  void frame(const State& state);
  void solver_error(std::int64_t step, double error);
  void event(std::int64_t step, const std::string& text);
  void warning(const std::string& text);
  void number(const std::string& name, double value);

  RunWriter& writer() { return writer_; }  // for what the end adds; the log lacks it
  void finish(const State& final_state);   // the log is gone then

 private:
  RunHeader header_;
  std::filesystem::path log_path_;
  RunWriter writer_;
  SessionLog log_;
  StepRow row_;
};

}  // namespace sulcus
