// A small run made by hand for the tests of this room: two tetrahedra, one tool that touches, rests and
// leaves.
#pragma once

#include <filesystem>
#include <string>

#include "verify/recording.h"

namespace sulcus::test {

inline constexpr std::int64_t run_steps = 300;  // more than one chunk of the recording

RunHeader small_header();
State small_state(const RunHeader& header);  // at rest

// The inputs of write_step for step n; `state` becomes the one after it.
struct SmallStep {
  std::vector<DeviceSample> samples;
  StepReport report;
  std::vector<double> stage_s;
};
SmallStep advance(const RunHeader& header, std::int64_t n, State& state);

// Records `steps` such steps, with frames, warnings and numbers, to `path`. Returns its fingerprint.
std::uint64_t record_small_run(const std::filesystem::path& path, std::int64_t steps = run_steps);
RunData small_run(std::int64_t steps = run_steps);  // recorded and read again

// An empty directory of the running test, removed at the end of the test program.
std::filesystem::path scratch_dir();

std::string read_text(const std::filesystem::path& path);
void write_text(const std::filesystem::path& path, const std::string& text);

}  // namespace sulcus::test
