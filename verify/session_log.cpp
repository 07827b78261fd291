#include "verify/session_log.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>
#include <xxhash.h>

#include <atomic>
#include <cassert>
#include <cerrno>
#include <chrono>
#include <thread>

#include "engine/device/record_ring.h"
#include "engine/numerics/error.h"
#include "verify/session_log_format.h"

namespace sulcus {

using session_log::Kind;
using session_log::Writer;

namespace {

constexpr auto write_every = std::chrono::milliseconds(20);

std::size_t state_bytes(const State& state) {
  std::vector<std::byte> bytes;
  Writer out(bytes);
  session_log::put_state(state, out);
  return bytes.size() + 64;
}

// A record for a chunk that is put together here and not in a ring.
template <class Fill>
void append_record(std::vector<std::byte>& chunk, Kind kind, Fill&& fill) {
  std::vector<std::byte> content;
  Writer out(content);
  out.number(static_cast<std::uint32_t>(kind));
  fill(out);
  Writer(chunk).number(static_cast<std::uint32_t>(content.size()));
  chunk.insert(chunk.end(), content.begin(), content.end());
}

}  // namespace

struct SessionLog::Impl {
  Impl(std::filesystem::path path_, std::size_t tools, const SessionLogSizes& sizes, std::size_t one_state)
      : path(std::move(path_)), steps(sizes.step_bytes), states(sizes.states * one_state) {
    for (std::size_t tool = 0; tool < tools; ++tool)
      ticks.push_back(std::make_unique<RecordRing>(sizes.tick_bytes));
  }

  std::filesystem::path path;
  int file = -1;
  RecordRing steps, states;  // steps: also events, numbers, warnings
  std::vector<std::unique_ptr<RecordRing>> ticks;
  std::vector<std::byte> scratch;  // engine's thread

  std::thread thread;
  std::atomic<bool> stop{false}, failed{false};
  std::string reason;  // set before `failed`

  // Writing thread only (or before it starts and after it ended).
  std::uint64_t chunk_number = 0;
  std::vector<std::byte> chunk, tick_part, state_part;
  std::uint64_t told_ticks = 0, told_states = 0;

  std::uint64_t lost_ticks() const {
    std::uint64_t lost = 0;
    for (const auto& ring : ticks) lost += ring->lost();
    return lost;
  }
  bool write_bytes(const void* data, std::size_t size);
  void write_chunk();
  void gather();
  void run();
  void throw_if_failed() const;
  template <class Fill>
  bool push(RecordRing& ring, Kind kind, Fill&& fill);
};

bool SessionLog::Impl::write_bytes(const void* data, std::size_t size) {
  const auto* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t written = ::write(file, at, size);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      reason = written < 0 ? std::strerror(errno) : "nothing was written";
      failed.store(true, std::memory_order_release);
      return false;
    }
    at += written;
    size -= static_cast<std::size_t>(written);
  }
  return true;
}

void SessionLog::Impl::write_chunk() {
  if (failed.load(std::memory_order_relaxed) || chunk.empty()) return;
  const session_log::ChunkStart start{session_log::chunk_mark, chunk_number, chunk.size(),
                                      XXH3_64bits_withSeed(chunk.data(), chunk.size(), chunk_number)};
  ++chunk_number;
  if (write_bytes(&start, sizeof start)) write_bytes(chunk.data(), chunk.size());
  chunk.clear();
}

// Ticks are taken first and steps last, so that every tick finds its step in this chunk or before; they are
// written the other way round.
void SessionLog::Impl::gather() {
  tick_part.clear();
  state_part.clear();
  for (const auto& ring : ticks) ring->drain(tick_part);
  states.drain(state_part);
  steps.drain(chunk);
  chunk.insert(chunk.end(), state_part.begin(), state_part.end());
  chunk.insert(chunk.end(), tick_part.begin(), tick_part.end());
  if (lost_ticks() != told_ticks || states.lost() != told_states) {
    told_ticks = lost_ticks();
    told_states = states.lost();
    append_record(chunk, Kind::lost, [&](Writer& out) {
      out.number(told_ticks);
      out.number(told_states);
    });
  }
}

void SessionLog::Impl::run() {
  while (!stop.load(std::memory_order_acquire)) {
    gather();
    write_chunk();
    std::this_thread::sleep_for(write_every);
  }
}

void SessionLog::Impl::throw_if_failed() const {
  if (!failed.load()) return;
  throw EnvironmentError(path.string() + ": the log could not be written (" + reason +
                         "); what was written before is kept: free space, then `sulcus recover " +
                         path.parent_path().string() + "`");
}

SessionLog::SessionLog(std::filesystem::path path, const RunHeader& header, const State& initial,
                       const SessionLogSizes& sizes) {
  check_header(header, path.string());
  check_state_sizes(initial, header, path.string());
  impl_ = std::make_unique<Impl>(std::move(path), header.tool_names.size(), sizes, state_bytes(initial));
  Impl& log = *impl_;
  log.file = ::open(log.path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (log.file < 0)
    throw EnvironmentError(log.path.string() + ": cannot be created (" + std::strerror(errno) +
                           "); choose a place that can be written to");
  ::flock(log.file, LOCK_EX | LOCK_NB);  // says that it is being written; goes with the process
  const session_log::FileStart start{session_log::magic, session_log_version, 0};
  log.write_bytes(&start, sizeof start);
  append_record(log.chunk, Kind::header, [&](Writer& out) { session_log::put_header(header, out); });
  append_record(log.chunk, Kind::state, [&](Writer& out) { session_log::put_state(initial, out); });
  log.write_chunk();
  if (log.failed.load()) {
    ::close(log.file);
    throw EnvironmentError(log.path.string() + ": cannot be written (" + log.reason +
                           "); free space there or choose another place");
  }
  log.scratch.reserve(state_bytes(initial));
  if (sizes.own_thread) log.thread = std::thread([&log] { log.run(); });
}

SessionLog::~SessionLog() {
  impl_->stop.store(true, std::memory_order_release);
  if (impl_->thread.joinable()) impl_->thread.join();
  if (impl_->file >= 0) ::close(impl_->file);
}

bool SessionLog::push_tick(std::size_t tool, const ServoTick& tick) noexcept {
  std::array<std::byte, session_log::tick_bytes> buffer;
  std::size_t size = 0;
  const auto put = [&](const auto& numbers) {
    std::memcpy(buffer.data() + size, numbers.data(), sizeof numbers);
    size += sizeof numbers;
  };
  put(std::array{static_cast<std::uint32_t>(Kind::tick), static_cast<std::uint32_t>(tool)});
  session_log::put_tick(tick, put);
  return impl_->ticks[tool]->push(std::span(buffer).first(size));
}

template <class Fill>
bool SessionLog::Impl::push(RecordRing& ring, Kind kind, Fill&& fill) {
  scratch.clear();
  Writer out(scratch);
  out.number(static_cast<std::uint32_t>(kind));
  fill(out);
  return ring.push(scratch);
}

bool SessionLog::push_step(std::int64_t step, std::span<const DeviceSample> samples, const SessionStep& times,
                           const StepRow& row) {
  return impl_->push(impl_->steps, Kind::step, [&](Writer& out) {
    out.number(step);
    for (const double time_s : {times.due_s, times.read_s, times.published_s}) out.number(time_s);
    const auto put = [&](const auto& numbers) {
      for (const auto number : numbers) out.number(number);
    };
    for (const DeviceSample& sample : samples) session_log::put_sample(sample, put);
    out.array(std::span<const double>(row.numbers));
    out.array(std::span<const std::uint64_t>(row.hashes));
    out.array(std::span<const std::uint64_t>(row.stage_hashes));
  });
}

bool SessionLog::push_state(const State& state) {
  return impl_->push(impl_->states, Kind::state, [&](Writer& out) { session_log::put_state(state, out); });
}

void SessionLog::push_event(std::int64_t step, const std::string& text) {
  impl_->push(impl_->steps, Kind::event, [&](Writer& out) {
    out.number(step);
    out.text(text);
  });
}

void SessionLog::push_number(const std::string& name, double value) {
  impl_->push(impl_->steps, Kind::number, [&](Writer& out) {
    out.text(name);
    out.number(value);
  });
}

void SessionLog::push_warning(const std::string& text) {
  impl_->push(impl_->steps, Kind::warning, [&](Writer& out) { out.text(text); });
}

void SessionLog::push_solver_error(std::int64_t step, double error) {
  impl_->push(impl_->steps, Kind::solver_error, [&](Writer& out) {
    out.number(step);
    out.number(error);
  });
}

void SessionLog::write_now() {
  assert(!impl_->thread.joinable());
  impl_->gather();
  impl_->write_chunk();
  impl_->throw_if_failed();
}

std::uint64_t SessionLog::lost_ticks() const {
  return impl_->lost_ticks();
}
std::uint64_t SessionLog::lost_states() const {
  return impl_->states.lost();
}
bool SessionLog::failed() const {
  return impl_->failed.load(std::memory_order_acquire);
}

void SessionLog::finish() {
  Impl& log = *impl_;
  log.stop.store(true, std::memory_order_release);
  if (log.thread.joinable()) log.thread.join();
  log.gather();
  append_record(log.chunk, Kind::end, [](Writer&) {});
  log.write_chunk();
  if (!log.failed.load() && ::fsync(log.file) != 0) {
    log.reason = std::strerror(errno);
    log.failed.store(true);
  }
  ::flock(log.file, LOCK_UN);
  log.throw_if_failed();
}

}  // namespace sulcus
