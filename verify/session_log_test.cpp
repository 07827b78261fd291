#include "verify/session_log.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <optional>
#include <random>
#include <set>
#include <thread>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;
using test::advance;

RunHeader session_header() {
  RunHeader header = test::small_header();
  header.session = SessionHeader{{"hand"}, {ServoSettings{.filter_Hz = 10}}};
  return header;
}

ServoTick tick_at(std::uint64_t number, std::int64_t coupling_step) {
  ServoTick tick;
  tick.number = number;
  tick.time_s = 1e-3 * static_cast<double>(number);
  tick.work_s = 1e-6;
  tick.coupling_step = coupling_step;
  tick.error = number % 50 == 49 ? 1 : 0;
  tick.sample.sequence = number;
  tick.sample.position = {0, 0.1, 1e-5 * static_cast<double>(number)};
  tick.sample.docked = number % 2 == 0;
  tick.force = {0.1, 0, -1e-4 * static_cast<double>(number)};
  tick.torque = {0, 1e-3, 0};
  return tick;
}

SessionEngine small_engine() {
  const RunHeader header = session_header();
  return {[header](State& state, std::span<const DeviceSample>) { advance(header, state.step, state); },
          [](const State&, RunWriter& writer) { writer.set_number("inverted_elements_at_end", 0); }};
}

struct Written {
  std::vector<std::uint64_t> chain;  // after each step
  std::vector<DeviceSample> samples;
};

// A session of `steps` steps with ten ticks each, a whole state every seven.
Written write_session(SessionLog& log, const RunHeader& header, State& state, std::int64_t steps,
                      double pause_s = 0) {
  Written written;
  StepRow row;
  std::vector<std::uint64_t> hashes(state_field_names().size());
  hash_state(state, hashes);
  written.chain.push_back(chain_hash(0, hashes));
  std::uint64_t tick = 0;
  for (std::int64_t n = 0; n < steps; ++n) {
    for (int i = 0; i < 10; ++i) log.push_tick(0, tick_at(tick++, n));
    const test::SmallStep step = advance(header, n, state);
    make_step_row(header, step.report, state, step.stage_s, 0.006, row);
    const double due_s = 0.01 * static_cast<double>(n);
    log.push_step(n, step.samples, {due_s, due_s + 1e-4, due_s + (n % 10 == 3 ? 0.011 : 0.004)}, row);
    if (state.step % 7 == 0) log.push_state(state);
    written.chain.push_back(chain_hash(written.chain.back(), row.hashes));
    written.samples.push_back(step.samples[0]);
    if (pause_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(pause_s));
  }
  return written;
}

// The whole file of a session that ended, and what was in it.
Written finished_log(const fs::path& path, std::int64_t steps, double pause_s = 0) {
  const RunHeader header = session_header();
  State state = test::small_state(header);
  SessionLog log(path, header, state);
  log.push_warning("odd");
  log.push_number("cells", 12);
  const Written written = write_session(log, header, state, steps, pause_s);
  log.push_event(steps, "over");
  log.finish();
  return written;
}

TEST(SessionLog, BecomesARecordingWithEverythingThatWasPushed) {
  const fs::path dir = test::scratch_dir();
  const Written written = finished_log(dir / "log", 300);
  EXPECT_EQ(read_session_log_header(dir / "log").scenario_json, session_header().scenario_json);
  const RecoveredSession session = record_session_log(dir / "log", dir / "run.h5", small_engine());
  EXPECT_EQ(session.steps, 300);
  EXPECT_TRUE(session.ended);
  EXPECT_EQ(session.ignored_bytes, 0u);

  const RunData run = read_run(dir / "run.h5");
  EXPECT_EQ(run.fingerprints, written.chain);
  EXPECT_EQ(run.header.inputs, session_header().inputs);
  ASSERT_TRUE(run.header.session && run.session);
  EXPECT_EQ(run.header.session->devices, std::vector<std::string>{"hand"});
  EXPECT_EQ(run.header.session->servo[0].filter_Hz, 10);
  EXPECT_EQ(run.header.session->servo[0].max_age_s, ServoSettings().max_age_s);
  ASSERT_EQ(run.samples.size(), 300u);
  EXPECT_EQ(run.samples[123].position, written.samples[123].position);
  EXPECT_EQ(run.samples[123].sequence, written.samples[123].sequence);
  ASSERT_EQ(run.session->ticks[0].size(), 3000u);
  const ServoTick &tick = run.session->ticks[0][1249], expected = tick_at(1249, 124);
  EXPECT_EQ(tick.number, expected.number);
  EXPECT_EQ(tick.time_s, expected.time_s);
  EXPECT_EQ(tick.error, 1u);
  EXPECT_EQ(tick.coupling_step, 124);
  EXPECT_EQ(tick.sample.position, expected.sample.position);
  EXPECT_EQ(tick.sample.docked, expected.sample.docked);
  EXPECT_EQ(tick.force, expected.force);
  EXPECT_EQ(tick.torque, expected.torque);
  EXPECT_EQ(run.find("session/due_s")->values[5], 0.05);
  EXPECT_EQ(run.numbers.at("session_missed_deadlines"), 30);
  EXPECT_EQ(run.numbers.at("session_ticks_lost"), 0);
  EXPECT_EQ(run.numbers.at("cells"), 12);
  EXPECT_EQ(run.warnings, std::vector<std::string>{"odd"});
  ASSERT_EQ(run.events.size(), 1u);
  EXPECT_EQ(run.events[0].text, "over");
  const auto interval = run.session->find("servo_interval_s");
  ASSERT_NE(interval, nullptr);
  EXPECT_EQ(interval->total(), 2999u);
  EXPECT_NEAR(interval->median_s, 1e-3, 1e-9);
  EXPECT_EQ(run.final_state.step, 300);
  EXPECT_EQ(run.frames.size() + static_cast<std::size_t>(run.numbers.at("session_frames_lost")),
            1u + 300 / 7);
}

// Cut anywhere: either the session had not begun, or what is whole becomes a recording of a beginning.
TEST(SessionLog, CutAnywhereGivesTheBeginning) {
  const fs::path dir = test::scratch_dir();
  const Written written = finished_log(dir / "log", 60, 0.002);  // several chunks
  const auto size = fs::file_size(dir / "log");
  std::mt19937_64 random(20260131);
  std::int64_t some = 0, none = 0;
  std::set<std::int64_t> lengths;
  for (int i = 0; i < 60; ++i) {
    const auto cut = i == 0 ? size - 1 : random() % size;
    fs::copy_file(dir / "log", dir / "cut", fs::copy_options::overwrite_existing);
    fs::resize_file(dir / "cut", cut);
    try {
      const RecoveredSession session = record_session_log(dir / "cut", dir / "run.h5", small_engine());
      const RunData run = read_run(dir / "run.h5");
      ASSERT_EQ(run.steps, session.steps);
      ASSERT_FALSE(session.ended);
      ASSERT_EQ(run.fingerprint(), written.chain[static_cast<std::size_t>(run.steps)]);
      ASSERT_TRUE(std::equal(run.fingerprints.begin(), run.fingerprints.end(), written.chain.begin()));
      for (const ServoTick& tick : run.session->ticks[0]) ASSERT_LE(tick.coupling_step, run.steps);
      ASSERT_EQ(run.events.back().step, run.steps);
      lengths.insert(run.steps);
      ++some;
    } catch (const InputError&) {
      ++none;
    }
  }
  EXPECT_GT(some, 30);
  EXPECT_GT(lengths.size(), 2u) << "the log must have several chunks";
}

TEST(SessionLog, ADamagedChunkEndsIt) {
  const fs::path dir = test::scratch_dir();
  const Written written = finished_log(dir / "log", 60, 0.002);
  std::fstream file(dir / "log", std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(fs::file_size(dir / "log") * 3 / 4));
  file.put('\x5a').put('\xa5').put('\x5a');
  file.close();
  const RecoveredSession session = record_session_log(dir / "log", dir / "run.h5", small_engine());
  EXPECT_FALSE(session.ended);
  EXPECT_GT(session.ignored_bytes, 0u);
  EXPECT_LT(session.steps, 60);
  EXPECT_EQ(read_run(dir / "run.h5").fingerprint(), written.chain[static_cast<std::size_t>(session.steps)]);
}

TEST(SessionLog, WhatIsNoLogIsRefused) {
  const fs::path dir = test::scratch_dir();
  EXPECT_THROW(read_session_log_header(dir / "absent"), InputError);
  test::write_text(dir / "text", "this is a text that is longer than the start of a log");
  EXPECT_THROW(read_session_log_header(dir / "text"), InputError);
  EXPECT_THROW(record_session_log(dir / "text", dir / "run.h5", small_engine()), InputError);
  test::write_text(dir / "short", "a text");
  try {
    read_session_log_header(dir / "short");
    ADD_FAILURE() << "a text was taken for a log";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("is no log"), std::string::npos) << error.what();
  }
  EXPECT_FALSE(fs::exists(dir / "run.h5"));
}

// A process may be killed between making the file and its first write, or within that.
TEST(SessionLog, OneThatHasHardlyBegunIsSaidToHoldNothing) {
  const fs::path dir = test::scratch_dir();
  finished_log(dir / "log", 20);
  for (const std::uintmax_t size : {0, 5, 8, 15, 16, 40, 60}) {
    fs::copy_file(dir / "log", dir / "cut", fs::copy_options::overwrite_existing);
    fs::resize_file(dir / "cut", size);
    try {
      record_session_log(dir / "cut", dir / "run.h5", small_engine());
      ADD_FAILURE() << size;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("before the first step"), std::string::npos) << error.what();
    }
  }
}

TEST(SessionLog, StepsThatDoNotRunAgainAreRefused) {
  const fs::path dir = test::scratch_dir();
  finished_log(dir / "log", 20);
  SessionEngine other = small_engine();
  other.advance = [](State& state, std::span<const DeviceSample>) {
    ++state.step;
    state.positions[0] += 1e-9;
  };
  EXPECT_THROW(record_session_log(dir / "log", dir / "run.h5", other), InputError);
  EXPECT_FALSE(fs::exists(dir / "run.h5"));
}

// A hundred thousand ticks at once, into room for thirty: nothing waits, and every one that is lost is
// counted.
TEST(SessionLog, TicksWithoutRoomAreCountedAndTold) {
  const fs::path dir = test::scratch_dir();
  const RunHeader header = session_header();
  State state = test::small_state(header);
  {
    SessionLog log(dir / "log", header, state, {.tick_bytes = 8192});
    for (std::uint64_t n = 0; n < 100000; ++n) log.push_tick(0, tick_at(n, -1));
    EXPECT_GT(log.lost_ticks(), 0u);
    log.finish();
  }
  record_session_log(dir / "log", dir / "run.h5", small_engine());
  const RunData run = read_run(dir / "run.h5");
  EXPECT_GT(run.numbers.at("session_ticks_lost"), 0);
  EXPECT_EQ(run.numbers.at("session_ticks_lost") + static_cast<double>(run.session->ticks[0].size()), 100000);
}

TEST(SessionLog, AStepWithoutRoomIsSaidAtOnce) {
  const fs::path dir = test::scratch_dir();
  const RunHeader header = session_header();
  State state = test::small_state(header);
  SessionLog log(dir / "log", header, state, {.step_bytes = 64});
  StepRow row;
  const test::SmallStep step = advance(header, 0, state);
  make_step_row(header, step.report, state, step.stage_s, 0, row);
  EXPECT_FALSE(log.push_step(0, step.samples, {}, row));
}

TEST(SessionLog, AFullDiskIsSaidAndHoldsNobodyUp) {
  const RunHeader header = session_header();
  State state = test::small_state(header);
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  try {
    SessionLog log("/dev/full", header, state);
    FAIL() << "writing to a full disk did not fail";
  } catch (const EnvironmentError& error) {
    EXPECT_NE(std::string(error.what()).find("/dev/full"), std::string::npos);
  }
}

// The process dies at a random moment, fifty times.
TEST(SessionLog, AKilledProcessLeavesWhatItWrote) {
  const fs::path dir = test::scratch_dir();
  const Written whole = finished_log(dir / "whole", 200);
  std::mt19937_64 random(8);
  std::int64_t most = 0;
  int recovered = 0;
  for (int kill_number = 0; kill_number < 50; ++kill_number) {
    fs::remove(dir / "log");
    const pid_t child = fork();
    if (child == 0) {
      const RunHeader header = session_header();
      State state = test::small_state(header);
      SessionLog log(dir / "log", header, state);
      write_session(log, header, state, 200, 0.001);
      for (;;) pause();
    }
    for (int ms = 0; ms < 20000 && !fs::exists(dir / "log"); ++ms)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 120000));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    std::optional<RecoveredSession> session;
    try {
      session = record_session_log(dir / "log", dir / "run.h5", small_engine());
    } catch (const InputError&) {  // it died before the first chunk was whole
      ASSERT_LT(fs::file_size(dir / "log"), 5000u) << kill_number;
      continue;
    }
    ++recovered;
    const RunData run = read_run(dir / "run.h5");
    ASSERT_FALSE(session->ended);
    ASSERT_EQ(run.fingerprint(), whole.chain[static_cast<std::size_t>(run.steps)]) << kill_number;
    std::uint64_t expected = 0;
    for (const ServoTick& tick : run.session->ticks[0]) {
      ASSERT_EQ(tick.number, expected++);
      ASSERT_LE(tick.coupling_step, run.steps);
    }
    most = std::max(most, run.steps);
  }
  EXPECT_GT(most, 10);
  EXPECT_GT(recovered, 40);
}

}  // namespace
}  // namespace sulcus
