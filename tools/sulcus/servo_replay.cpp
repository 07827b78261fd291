#include "tools/sulcus/servo_replay.h"

#include <bit>

namespace sulcus {
namespace {

bool same_bits(const Vec3& a, const Vec3& b) {
  for (int d = 0; d < 3; ++d) {
    if (std::bit_cast<std::uint64_t>(a[d]) != std::bit_cast<std::uint64_t>(b[d])) return false;
  }
  return true;
}

}  // namespace

CouplingSnapshot coupling_of(const Scene& scene, const State& state, std::size_t tool, double read_s) {
  const RigidBodyState body = tool_state(state, tool);
  const Tool& settings = scene.settings.tools[tool];
  CouplingSnapshot c;
  c.valid = true;
  c.time_s = read_s;
  c.tool_position = body.position;
  c.tool_orientation = body.orientation;
  c.tool_linear_velocity = linear_velocity(settings.body, body);
  c.tool_angular_velocity = angular_velocity(settings.body, body);
  c.stiffness_N_m = settings.coupling.stiffness_N_m;
  c.damping_N_s_m = settings.coupling.damping_N_s_m;
  c.rotational_stiffness_N_m_rad = settings.coupling.rotational_stiffness_N_m_rad;
  c.rotational_damping_N_m_s_rad = settings.coupling.rotational_damping_N_m_s_rad;
  return c;
}

DeviceCommand servo_command(const CouplingSnapshot& coupling, const ServoTick& tick,
                            const ServoSettings& settings, ServoState& state) {
  const auto error = static_cast<DeviceError>(tick.error);
  if (error == DeviceError::fatal || error == DeviceError::ended) {
    state = ServoState();
    return {};
  }
  DeviceSample sample = tick.sample;
  sample.time_s = tick.time_s;  // of the session, whatever clock the device has
  return render(coupling, sample, settings, state);
}

void ServoReplay::after_step(const State& state) {
  if (!run_.session) return;
  const auto tools = static_cast<std::size_t>(run_.header.tool_count());
  const double read_s = run_.find("session/read_s")->values[couplings_.size()];
  std::vector<CouplingSnapshot> row(tools);
  for (std::size_t tool = 0; tool < tools; ++tool) row[tool] = coupling_of(scene_, state, tool, read_s);
  couplings_.push_back(std::move(row));
}

ServoReplay::Outcome ServoReplay::compare() const {
  Outcome outcome;
  if (!run_.session) return outcome;
  for (std::size_t tool = 0; tool < run_.session->ticks.size(); ++tool) {
    ServoState state;
    std::uint64_t expected = 0;
    for (const ServoTick& tick : run_.session->ticks[tool]) {
      const bool gap = tick.number != expected;
      expected = tick.number + 1;
      const auto step = static_cast<std::size_t>(tick.coupling_step);
      const bool coupled = tick.coupling_step >= 1 && step <= couplings_.size();
      const DeviceCommand command = servo_command(coupled ? couplings_[step - 1][tool] : CouplingSnapshot{},
                                                  tick, run_.header.session->servo[tool], state);
      const bool same = same_bits(command.force, tick.force) && same_bits(command.torque, tick.torque);
      state = {tick.force, tick.torque};  // all that a tick leaves to the next
      if (gap) {
        ++outcome.skipped;
        continue;
      }
      ++outcome.ticks;
      if (!same && outcome.difference.empty()) {
        outcome.difference = "servo of tool " + std::to_string(tool) + ", tick " +
                             std::to_string(tick.number) + " at " + std::to_string(tick.time_s) + " s";
      }
    }
  }
  return outcome;
}

}  // namespace sulcus
