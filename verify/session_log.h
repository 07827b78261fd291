// The log of a session or a run while it goes on: append-only, so that a process that is killed at any moment
// leaves all that was written before. By `sulcus recover`, of a session also at its end, it becomes a
// recording (recording.h). In a run, which has time, every step goes to the file at once (write_now). In a
// session the threads of servo and engine hand their records over through rings (record_ring.h) and never
// wait; a thread of the log's own writes what came to the disk, in chunks with a hash each, fifty times a
// second. A chunk is whole or it does not count. What stands in a ring's way is counted and told, never
// silent. The file: docs/recording-format.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/scene/state.h"
#include "verify/recording.h"
#include "verify/session.h"

namespace sulcus {

inline constexpr std::uint32_t session_log_version = 4;

struct SessionLogSizes {
  std::size_t tick_bytes = std::size_t{1} << 22;  // ring of each servo: some ten seconds
  std::size_t step_bytes = std::size_t{1} << 23;  // of the engine: minutes
  std::size_t states = 6;                         // whole states that may wait
  bool own_thread = true;                         // false: writes only in write_now() and finish()
};

class SessionLog {
 public:
  // Writes header and initial state, then starts the writing thread. Throws
  // EnvironmentError if the file cannot be written.
  SessionLog(std::filesystem::path path, const RunHeader& header, const State& initial,
             const SessionLogSizes& sizes = {});
  ~SessionLog();  // ends the thread; the file stays
  SessionLog(const SessionLog&) = delete;
  SessionLog& operator=(const SessionLog&) = delete;

  // By the servo of that tool. False: no room, the tick is lost and counted. Neither allocates nor waits.
  bool push_tick(std::size_t tool, const ServoTick& tick) noexcept;

  // By the engine's thread. False: no room. Without a step nothing after it can be run again, so the session
  // has to end; a state may be left out.
  bool push_step(std::int64_t step, std::span<const DeviceSample> samples, const SessionStep& times,
                 const StepRow& row);
  bool push_state(const State& state);
  void push_event(std::int64_t step, const std::string& text);
  void push_number(const std::string& name, double value);
  void push_warning(const std::string& text);
  void push_solver_error(std::int64_t step, double error);

  // Without a thread of its own: everything pushed so far goes to the file. Throws EnvironmentError if it
  // cannot be written.
  void write_now();

  std::uint64_t lost_ticks() const;  // of all tools
  std::uint64_t lost_states() const;
  bool failed() const;  // the writing thread could not write; the session has to end

  // Writes what is left and marks the log as ended. Throws EnvironmentError, with the place and the reason,
  // if anything could not be written.
  void finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Throws InputError if the file is missing, no log, of another version, or cut before its first chunk ended.
RunHeader read_session_log_header(const std::filesystem::path& log);

// What turns a log into a recording besides the log itself.
struct SessionEngine {
  std::function<void(State& state, std::span<const DeviceSample> samples)> advance;  // one step
  std::function<void(const State& state, RunWriter& writer)> note_end;               // numbers of the end
};

struct RecoveredSession {
  std::int64_t steps = 0;
  bool ended = false;               // by finish(); false: the process died
  std::uint64_t ignored_bytes = 0;  // after the last complete chunk
};

// Writes the recording. The log keeps whole states only now and then: the last steps are run again to get the
// final one, and must come to the recorded hashes. Throws InputError as above, if they do not, or if the log
// is still being written,
// EnvironmentError if the recording cannot be written. The log stays.
RecoveredSession record_session_log(const std::filesystem::path& log, const std::filesystem::path& recording,
                                    const SessionEngine& engine);

}  // namespace sulcus
