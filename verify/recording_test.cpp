#include "verify/recording.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include <cmath>

#include "engine/numerics/error.h"
#include "verify/fingerprint.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

std::string message_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(Recording, ReadsBackWhatWasWritten) {
  const auto path = test::scratch_dir() / "run.h5";
  const std::uint64_t fingerprint = test::record_small_run(path);
  const RunData run = read_run(path);
  const RunHeader header = test::small_header();

  EXPECT_EQ(run.header.scenario_name, header.scenario_name);
  EXPECT_EQ(run.header.scenario_json, header.scenario_json);
  EXPECT_EQ(run.header.overrides, header.overrides);
  EXPECT_EQ(run.header.build, header.build);
  EXPECT_EQ(run.header.inputs, header.inputs);
  EXPECT_EQ(run.header.threads, header.threads);
  EXPECT_EQ(run.header.step_s, header.step_s);
  EXPECT_EQ(run.header.tool_names, header.tool_names);
  EXPECT_EQ(run.header.rest_positions, header.rest_positions);
  EXPECT_EQ(run.header.tets, header.tets);
  EXPECT_EQ(run.steps, test::run_steps);
  EXPECT_EQ(run.fingerprint(), fingerprint);
  EXPECT_EQ(run.field_names, state_field_names());

  State state = test::small_state(header);
  std::vector<std::uint64_t> hashes(state_field_names().size());
  hash_state(state, hashes);
  std::uint64_t chain = chain_hash(0, hashes);
  EXPECT_EQ(run.fingerprints[0], chain);
  std::size_t frame = 1;
  for (std::int64_t n = 0; n < run.steps; ++n) {
    const test::SmallStep step = test::advance(header, n, state);
    const auto i = static_cast<std::size_t>(n);
    hash_state(state, hashes);
    chain = chain_hash(chain, hashes);
    ASSERT_EQ(run.fingerprints[i + 1], chain);

    const DeviceSample &read = run.samples[i], &written = step.samples[0];
    ASSERT_EQ(read.sequence, written.sequence);
    ASSERT_EQ(read.time_s, written.time_s);
    ASSERT_EQ(read.interval_s, written.interval_s);
    ASSERT_EQ(read.position, written.position);
    ASSERT_EQ(read.orientation.s, written.orientation.s);
    ASSERT_EQ(read.orientation.y, written.orientation.y);
    ASSERT_EQ(read.linear_velocity, written.linear_velocity);
    ASSERT_EQ(read.angular_velocity, written.angular_velocity);
    ASSERT_EQ(read.linear_velocity_valid, written.linear_velocity_valid);
    ASSERT_EQ(read.angular_velocity_valid, written.angular_velocity_valid);
    ASSERT_EQ(read.docked, written.docked);
    ASSERT_EQ(read.buttons, written.buttons);
    ASSERT_EQ(read.force_sent, written.force_sent);
    ASSERT_EQ(read.motor_temperature, written.motor_temperature);

    const auto at = [&](const std::string& name) { return run.series.at(name).values[i]; };
    ASSERT_EQ(at("time_s"), step.report.time_s);
    ASSERT_EQ(at("solver/iterations"), step.report.iterations);
    ASSERT_EQ(at("tissue/elastic_energy_J"), step.report.elastic_energy_J);
    ASSERT_EQ(at("tools/0/max_penetration_m"), step.report.tools[0].max_penetration_m);
    ASSERT_EQ(at("stage/solve_s"), 0.003);
    ASSERT_EQ(at("stage/total_s"), 0.007);
    ASSERT_EQ(at("device/0/buttons"), written.buttons);
    ASSERT_EQ(run.series.at("tools/0/contact_force_N").values[3 * i + 2],
              step.report.tools[0].contact_force[2]);
    ASSERT_EQ(run.series.at("tools/0/position_m").values[3 * i + 2], state.tool_poses[2]);
    ASSERT_EQ(run.series.at("tools/0/orientation").values[4 * i], state.tool_poses[3]);
    ASSERT_NEAR(at("tissue/max_displacement_m"), std::abs(state.positions[14] - 0.01), 1e-16);
    if (n % 100 != 50) continue;
    EXPECT_EQ(run.frames.at(frame).step, n + 1);
    EXPECT_EQ(run.frames[frame].positions, state.positions);
    EXPECT_EQ(run.frames[frame].tool_poses, state.tool_poses);
    EXPECT_EQ(run.frames[frame].alive, state.alive);
    EXPECT_EQ(run.frames[frame].stress_Pa, (std::vector<double>{100.0, 200.0}));
    ++frame;
  }
  EXPECT_EQ(run.frames.size(), frame);
  EXPECT_TRUE(std::isnan(run.frames[0].stress_Pa[0]));
  EXPECT_EQ(run.series.at("tools/0/contact_force_N").unit, "N");
  EXPECT_EQ(run.series.at("tools/0/contact_force_N").components, 3);
  EXPECT_EQ(run.final_state.step, state.step);
  EXPECT_EQ(run.final_state.positions, state.positions);
  EXPECT_EQ(run.final_state.velocities, state.velocities);
  EXPECT_EQ(run.final_state.rotations, state.rotations);
  EXPECT_EQ(run.final_state.alive, state.alive);
  EXPECT_EQ(run.final_state.tool_momenta, state.tool_momenta);
  EXPECT_EQ(run.solver_errors.size(), 3u);
  EXPECT_EQ(run.solver_errors[1].step, 150);
  EXPECT_EQ(run.numbers.at("cells"), 1);
  EXPECT_EQ(run.warnings, (std::vector<std::string>{"label 7 is absent"}));
  ASSERT_EQ(run.events.size(), 1u);
  EXPECT_EQ(run.events[0].text, "first contact");
}

TEST(Recording, SameRunGivesTheSameFingerprintAndWallClockDoesNotEnter) {
  const auto dir = test::scratch_dir();
  EXPECT_EQ(test::record_small_run(dir / "a.h5"), test::record_small_run(dir / "b.h5"));
  const RunHeader header = test::small_header();
  State state = test::small_state(header);
  RunWriter writer(dir / "c.h5", header, state);
  for (std::int64_t n = 0; n < test::run_steps; ++n) {
    const test::SmallStep step = test::advance(header, n, state);
    writer.write_step(step.samples, step.report, state, std::vector<double>(stage_count, 9.0), 99.0);
  }
  EXPECT_EQ(writer.fingerprint(), read_run(dir / "a.h5").fingerprint());
}

TEST(Recording, KeepsWhatTheSolverBeginsWithWhereTheScenarioAsksForIt) {
  const auto dir = test::scratch_dir();
  RunHeader header = test::small_header();
  header.scenario_json = R"({"solver": {"start": "past"}})";
  State state = test::small_state(header);
  state.past_increments.assign(2 * header.rest_positions.size(), 0.25);
  state.past_impulses.assign(2 * header.rest_positions.size(), -0.5);
  RunWriter writer(dir / "run.h5", header, state);
  writer.finish(state);
  const State read = read_run(dir / "run.h5").final_state;
  EXPECT_EQ(read.past_increments, state.past_increments);
  EXPECT_EQ(read.past_impulses, state.past_impulses);

  RunWriter without(dir / "without.h5", header, state);
  state.past_increments.clear();
  EXPECT_THROW(without.finish(state), InputError);
}

TEST(Recording, StandsUnderItsNameOnlyWhenFinished) {
  const auto path = test::scratch_dir() / "run.h5";
  const RunHeader header = test::small_header();
  State state = test::small_state(header);
  std::filesystem::path partial;
  {
    RunWriter writer(path, header, state);
    partial = writer.partial_path();
    for (std::int64_t n = 0; n < 10; ++n) {
      const test::SmallStep step = test::advance(header, n, state);
      writer.write_step(step.samples, step.report, state, step.stage_s, 0);
    }
    EXPECT_FALSE(std::filesystem::exists(path));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_TRUE(std::filesystem::exists(partial));
  const std::string message = message_of([&] { read_run(partial); });
  EXPECT_NE(message.find("did not finish"), std::string::npos) << message;
}

TEST(Recording, OfNoStepNoToolAndNoFrameIsReadable) {
  const auto path = test::scratch_dir() / "run.h5";
  RunHeader header = test::small_header();
  header.tool_names.clear();
  header.overrides.clear();
  header.build.clear();
  State state = test::small_state(header);
  state.tool_poses.clear();
  state.tool_momenta.clear();
  state.filtered_forces.clear();
  RunWriter writer(path, header, state);
  writer.finish(state);
  const RunData run = read_run(path);
  EXPECT_EQ(run.steps, 0);
  EXPECT_EQ(run.fingerprints.size(), 1u);
  EXPECT_TRUE(run.samples.empty());
  EXPECT_TRUE(run.header.build.empty());
  EXPECT_TRUE(run.frames.empty());
}

// recording_elsewhere_test.py names the place and reads it.
TEST(Recording, IsKeptForOtherReaders) {
  const char* place = std::getenv("SULCUS_KEEP_RECORDING");
  const std::filesystem::path path = place != nullptr ? place : test::scratch_dir() / "run.h5";
  test::record_small_run(path);
  EXPECT_EQ(read_run(path).steps, test::run_steps);
}

TEST(Recording, WriterRefusesAStateThatDoesNotFitTheMesh) {
  const RunHeader header = test::small_header();
  State state = test::small_state(header);
  state.velocities.pop_back();
  const auto path = test::scratch_dir() / "run.h5";
  const std::string message = message_of([&] { RunWriter(path, header, state); });
  EXPECT_NE(message.find("velocities of the state has 14 numbers, expected 15"), std::string::npos)
      << message;
  RunHeader broken = header;
  broken.tets[0] = 5;
  EXPECT_THROW(RunWriter(path, broken, test::small_state(header)), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(path.parent_path()));
}

TEST(Recording, FinishedWriterRefusesMore) {
  const RunHeader header = test::small_header();
  const State state = test::small_state(header);
  RunWriter writer(test::scratch_dir() / "run.h5", header, state);
  writer.finish(state);
  EXPECT_THROW(writer.write_frame(state, 0), EnvironmentError);
  EXPECT_THROW(writer.finish(state), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
