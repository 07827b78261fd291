#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>
#include <xxhash.h>

#include <cerrno>
#include <deque>
#include <fstream>
#include <optional>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/session_log_format.h"

namespace sulcus {

namespace session_log {

void put_header(const RunHeader& header, Writer& out) {
  out.text(header.scenario_name);
  out.text(header.scenario_json);
  out.texts(header.overrides);
  out.map(header.build);
  out.map(header.inputs);
  out.number(static_cast<std::int32_t>(header.threads));
  out.number(header.step_s);
  out.texts(header.tool_names);
  out.texts(header.motion_names);
  out.texts(header.obstacle_names);
  out.number(static_cast<std::uint64_t>(header.plane_count));
  out.number(static_cast<std::uint8_t>(header.fractures));
  out.number(static_cast<std::uint8_t>(header.ledger));
  out.array(std::span<const double>(header.rest_positions));
  out.array(std::span<const std::int32_t>(header.tets));
  out.texts(header.stage_leaves);
  out.number(static_cast<std::uint8_t>(header.session.has_value()));
  if (!header.session) return;
  out.texts(header.session->devices);
  for (const ServoSettings& s : header.session->servo) {
    for (const double number : {s.filter_Hz, s.max_extrapolation_s, s.max_extrapolation_m,
                                s.max_extrapolation_rad, s.max_age_s, s.command_life_s})
      out.number(number);
  }
}

RunHeader get_header(Reader& in, const std::string& place) {
  RunHeader header;
  header.scenario_name = in.text();
  header.scenario_json = in.text();
  header.overrides = in.texts();
  header.build = in.map();
  header.inputs = in.map();
  header.threads = in.number<std::int32_t>();
  header.step_s = in.number<double>();
  header.tool_names = in.texts();
  header.motion_names = in.texts();
  header.obstacle_names = in.texts();
  header.plane_count = in.number<std::uint64_t>();
  header.fractures = in.number<std::uint8_t>() != 0;
  header.ledger = in.number<std::uint8_t>() != 0;
  header.rest_positions = in.array<double>();
  header.tets = in.array<std::int32_t>();
  if (header.plane_count > header.rest_positions.size()) throw Cut{};
  header.stage_leaves = in.texts();
  if (in.number<std::uint8_t>() == 0) {
    check_header(header, place);
    return header;
  }
  header.session.emplace();
  header.session->devices = in.texts();
  if (header.session->devices.size() != header.tool_names.size()) throw Cut{};
  for (std::size_t tool = 0; tool < header.tool_names.size(); ++tool) {
    ServoSettings s;
    for (double* number : {&s.filter_Hz, &s.max_extrapolation_s, &s.max_extrapolation_m,
                           &s.max_extrapolation_rad, &s.max_age_s, &s.command_life_s})
      *number = in.number<double>();
    header.session->servo.push_back(s);
  }
  check_header(header, place);
  return header;
}

}  // namespace session_log

namespace {

using session_log::Kind;

[[noreturn]] void refuse_empty(const std::string& place) {
  throw InputError(place + ": ends before the first step; there is nothing to recover");
}

// Gives the log's chunks, whole and in order, until one is not.
class LogFile {
 public:
  explicit LogFile(const std::filesystem::path& path) : place_(path.string()), file_(path, std::ios::binary) {
    std::error_code error;
    left_ = std::filesystem::file_size(path, error);
    if (!file_ || error)
      throw InputError(place_ + ": cannot be opened; give the log of a session or a run (run.h5.log)");
    session_log::FileStart start;
    if (left_ < sizeof start) {  // killed within its first write
      const auto size = static_cast<std::size_t>(left_);
      file_.read(reinterpret_cast<char*>(&start), static_cast<std::streamsize>(size));
      const auto known = static_cast<std::ptrdiff_t>(std::min(size, start.magic.size()));
      if (std::equal(start.magic.begin(), start.magic.begin() + known, session_log::magic.begin()))
        refuse_empty(place_);
    }
    if (left_ < sizeof start || !take(&start, sizeof start) || start.magic != session_log::magic)
      throw InputError(place_ + ": is no log of a session or a run; give a run.h5.log");
    if (start.version != session_log_version)
      throw InputError(place_ + ": has version " + std::to_string(start.version) + ", this program reads " +
                       std::to_string(session_log_version) + "; use the matching program");
  }

  bool next(std::vector<std::byte>& chunk) {
    session_log::ChunkStart start;
    const std::uint64_t before = left_;
    const bool whole = left_ >= sizeof start && take(&start, sizeof start) &&
                       start.mark == session_log::chunk_mark && start.number == number_ &&
                       start.bytes <= left_;
    if (whole) {
      chunk.resize(static_cast<std::size_t>(start.bytes));
      if (take(chunk.data(), chunk.size()) &&
          XXH3_64bits_withSeed(chunk.data(), chunk.size(), number_) == start.hash) {
        ++number_;
        return true;
      }
    }
    ignored_bytes_ = before;
    return false;
  }

  const std::string& place() const { return place_; }
  std::uint64_t ignored_bytes() const { return ignored_bytes_; }

 private:
  bool take(void* to, std::size_t size) {
    if (!file_.read(static_cast<char*>(to), static_cast<std::streamsize>(size))) return false;
    left_ -= size;
    return true;
  }

  std::string place_;
  std::ifstream file_;
  std::uint64_t left_ = 0, number_ = 0, ignored_bytes_ = 0;
};

// Whoever writes a log holds a lock on it as long as it lives.
bool still_written(const std::filesystem::path& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool locked = file >= 0 && ::flock(file, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  if (file >= 0) ::close(file);
  return locked;
}

// Calls visit(kind, content) for every record of a chunk.
template <class Visit>
void for_each_record(std::span<const std::byte> chunk, Visit&& visit) {
  session_log::Reader in(chunk);
  while (!in.empty()) {
    session_log::Reader record(in.take(in.number<std::uint32_t>()));
    const auto kind = static_cast<Kind>(record.number<std::uint32_t>());
    visit(kind, record);
  }
}

// Turns records into a recording, one by one.
class Transcript {
 public:
  Transcript(std::string place, std::filesystem::path recording, const SessionEngine& engine)
      : place_(std::move(place)), recording_(std::move(recording)), engine_(engine) {}

  void take(Kind kind, session_log::Reader& in) {
    if (kind == Kind::header) {
      if (header_) throw session_log::Cut{};
      header_ = session_log::get_header(in, place_);
      if (header_->session) timing_.emplace(header_->tool_names.size());
      return;
    }
    if (!header_) throw session_log::Cut{};
    if (kind == Kind::state) return take_state(in);
    if (!writer_) throw session_log::Cut{};
    switch (kind) {
      case Kind::step:
        return take_step(in);
      case Kind::tick:
        return take_tick(in);
      case Kind::event: {
        const auto step = in.number<std::int64_t>();
        return writer_->add_event(step, in.text());
      }
      case Kind::number: {
        const std::string name = in.text();
        return writer_->set_number(name, in.number<double>());
      }
      case Kind::warning:
        return writer_->add_warning(in.text());
      case Kind::solver_error: {
        const auto step = in.number<std::int64_t>();
        return writer_->write_solver_error(step, in.number<double>());
      }
      case Kind::lost:
        lost_ticks_ = in.number<std::uint64_t>();
        lost_states_ = in.number<std::uint64_t>();
        return;
      case Kind::end:
        ended_ = true;
        return;
      default:
        throw session_log::Cut{};
    }
  }

  RecoveredSession finish(std::uint64_t ignored_bytes) {
    if (!writer_) throw session_log::Cut{};
    run_to_the_end();
    if (!ended_) {
      writer_->add_event(steps_, "cut off here; recovered from its log");
    }
    engine_.note_end(newest_, *writer_);
    if (timing_) finish_session();
    writer_->finish(newest_);
    return {steps_, ended_, ignored_bytes};
  }

 private:
  void finish_session() {
    const auto number = [&](const char* name, auto value) {
      writer_->set_number(name, static_cast<double>(value));
    };
    number("session_missed_deadlines", timing_->missed_deadlines(header_->step_s));
    number("session_ticks_lost", lost_ticks_);
    number("session_ticks_missing", timing_->missing_ticks());
    number("session_frames_lost", lost_states_);
    writer_->write_histograms(timing_->histograms());
  }

  void take_state(session_log::Reader& in) {
    State state = session_log::get_state(in, *header_, place_);
    if (!writer_) writer_.emplace(recording_, *header_, state);
    writer_->write_frame(state, static_cast<double>(state.step) * header_->step_s);
    if (state.step > steps_ || state.step < newest_.step) throw session_log::Cut{};
    newest_ = std::move(state);
    while (!pending_.empty() && pending_.front().step < newest_.step) pending_.pop_front();
  }

  void take_step(session_log::Reader& in) {
    if (in.number<std::int64_t>() != steps_) throw session_log::Cut{};
    SessionStep times;
    for (double* time_s : {&times.due_s, &times.read_s, &times.published_s}) *time_s = in.number<double>();
    Pending pending{steps_, {}};
    for (std::size_t tool = 0; tool < header_->tool_names.size(); ++tool)
      pending.samples.push_back(session_log::get_sample(in));
    row_.numbers = in.array<double>();
    row_.hashes = in.array<std::uint64_t>();
    row_.stage_hashes = in.array<std::uint64_t>();
    if (row_.hashes.size() != state_field_names().size() ||
        row_.stage_hashes.size() != header_->stage_leaves.size())
      throw session_log::Cut{};
    writer_->write_row(pending.samples, row_, times);
    if (timing_) timing_->add_step(times);
    pending_.push_back(std::move(pending));
    ++steps_;
  }

  void take_tick(session_log::Reader& in) {
    const auto tool = in.number<std::uint32_t>();
    const ServoTick tick = session_log::get_tick(in);
    if (!timing_ || tool >= header_->tool_names.size() || tick.coupling_step > steps_)
      throw session_log::Cut{};
    writer_->write_tick(tool, tick);
    timing_->add_tick(tool, tick);
  }

  // From the newest whole state to the last step.
  void run_to_the_end() {
    for (const Pending& step : pending_) engine_.advance(newest_, step.samples);
    if (steps_ == 0) return;
    std::vector<std::uint64_t> hashes(row_.hashes.size());
    hash_state(newest_, hashes);
    if (hashes != row_.hashes)
      throw InputError(place_ +
                       ": its last steps, run again, do not come to the state that it tells; use the program "
                       "that recorded it, with the same input files");
  }

  struct Pending {
    std::int64_t step;
    std::vector<DeviceSample> samples;
  };

  std::string place_;
  std::filesystem::path recording_;
  const SessionEngine& engine_;
  std::optional<RunHeader> header_;
  std::optional<RunWriter> writer_;
  std::optional<SessionTiming> timing_;
  State newest_;
  std::deque<Pending> pending_;  // steps after newest_
  StepRow row_;                  // of the last step
  std::int64_t steps_ = 0;
  std::uint64_t lost_ticks_ = 0, lost_states_ = 0;
  bool ended_ = false;
};

[[noreturn]] void refuse_contents(const std::string& place) {
  throw InputError(place +
                   ": a chunk that is whole holds records that make no sense; it was not written by " +
                   "this program");
}

}  // namespace

RunHeader read_session_log_header(const std::filesystem::path& path) {
  LogFile file(path);
  std::vector<std::byte> chunk;
  if (!file.next(chunk)) refuse_empty(file.place());
  std::optional<RunHeader> header;
  try {
    for_each_record(chunk, [&](Kind kind, session_log::Reader& in) {
      if (kind == Kind::header && !header) header = session_log::get_header(in, file.place());
    });
  } catch (const session_log::Cut&) {
    refuse_contents(file.place());
  }
  if (!header) refuse_contents(file.place());
  return *header;
}

RecoveredSession record_session_log(const std::filesystem::path& path, const std::filesystem::path& recording,
                                    const SessionEngine& engine) {
  LogFile file(path);
  if (still_written(path))
    throw InputError(path.string() + ": the run or session still goes on; wait for its end, or end it");
  Transcript transcript(file.place(), recording, engine);
  std::vector<std::byte> chunk;
  bool any = false;
  try {
    while (file.next(chunk)) {
      any = true;
      for_each_record(chunk, [&](Kind kind, session_log::Reader& in) { transcript.take(kind, in); });
    }
    if (!any) refuse_empty(file.place());
    return transcript.finish(file.ignored_bytes());
  } catch (const session_log::Cut&) {
    refuse_contents(file.place());
  }
}

}  // namespace sulcus
