#include "hw_phantom/phantom_servo.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "hw_phantom/emergency.h"

namespace sulcus {
namespace {

constexpr int first_sound_tick = 100;        // data before it may be anything
constexpr int settling_ticks = 100;          // after a calibration, which may make the position jump
constexpr int calibration_check_ticks = 50;  // between two looks at the calibration
constexpr int debounce_ticks = 5;
constexpr int max_invalid_run = 50;          // ticks without a sound sample until the device is given up
constexpr double force_error_window_s = 2;   // four force errors within it are a fault
constexpr double cool_temperature = 0.5;     // motors that were too warm work again below it, ...
constexpr double least_rest_s = 1;           // ... not before this, ...
constexpr double blind_rest_s = 30;          // ... and after this where the device tells no temperature
constexpr double angular_filter_s = 0.0053;  // 30 Hz, of the differentiated orientation
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

}  // namespace

bool PhantomServo::tick(const hd::Api& api, hd::Handle device) {
  if (status_.ticks == 0 && std::this_thread::get_id() != controller) keep_signals_from_this_thread();
  error_this_tick_ = false;
  api.begin_frame(device);
  const double now = now_s();
  interval_s_ = status_.ticks == 0 ? nominal_interval_s : now - last_time_s_;
  last_time_s_ = now;
  status_.max_interval_s = std::max(status_.max_interval_s, interval_s_);
  if (interval_s_ > 1.5 * nominal_interval_s) ++status_.late_ticks;
  if (interval_s_ > limits.max_interval_s) ++status_.stalls;
  ++status_.ticks;

  Reading reading = read(api);
  bool alive = survives(api) && !faulted.load(std::memory_order_acquire);
  if (status_.ticks <= first_sound_tick) reading.valid = false;
  invalid_run_ = reading.valid || status_.ticks <= first_sound_tick ? 0 : invalid_run_ + 1;
  if (!reading.valid && status_.ticks > first_sound_tick) ++status_.invalid_samples;
  if (invalid_run_ > max_invalid_run) alive = false;
  if (alive && reading.valid) read_joints(api, reading.pose);

  DeviceSample sample;
  if (!alive) faulted.store(true, std::memory_order_relaxed);
  {
    const hd::OwnCode own(device);
    debounce(reading.buttons);
    if (reading.valid) sample = make_sample(reading);
    decide(reading, sample);
  }
  send(api);
  api.end_frame(device);
  alive = survives(api) && alive;
  if (alive) alive = change_mode(api, device);
  if (!alive) fail(api, device);
  sample.force_sent = direction_to_world(mount, safety_.force);
  if (reading.valid && alive) samples.write(sample);
  statuses.write(status_);
  ticks.store(status_.ticks, std::memory_order_release);
  // After a fault some frames more, so that the zero arrives.
  return !faulted.load(std::memory_order_relaxed) || --last_ticks_ > 0;
}

PhantomServo::Reading PhantomServo::read(const hd::Api& api) const {
  Reading reading;
  // Every output starts as nonsense: a call that fails leaves it.
  double transform[16], velocity[3] = {nan, nan, nan}, temperatures[6] = {0, 0, 0, 0, 0, 0};
  std::fill(std::begin(transform), std::end(transform), nan);
  hd::Boolean inkwell_switch = 1;  // 0 = docked
  api.get_double(hd::current_transform, transform);
  api.get_double(hd::current_velocity, velocity);
  api.get_integer(hd::current_buttons, &reading.buttons);
  if (has_inkwell) api.get_boolean(hd::current_inkwell_switch, &inkwell_switch);
  if (has_temperature) api.get_double(hd::motor_temperature, temperatures);

  reading.valid = pose_from_transform(transform, reading.pose);
  reading.velocity = 1e-3 * Vec3(velocity[0], velocity[1], velocity[2]);  // mm/s
  reading.velocity_valid = reading.velocity.allFinite();
  if (!reading.velocity_valid) reading.velocity.setZero();
  reading.docked = has_inkwell && inkwell_switch == 0;
  for (const double t : temperatures) {
    reading.temperature = std::isfinite(t) ? std::max(reading.temperature, t) : 1.0;
  }
  return reading;
}

// Only while nothing but looking is done: a driver that does not know the joints must not end a session.
void PhantomServo::read_joints(const hd::Api& api, const StylusPose& pose) {
  if (!asks_joints_ || mode.load(std::memory_order_relaxed) != ServoMode::watch) return;
  double joints[3] = {nan, nan, nan}, gimbals[3] = {nan, nan, nan};
  api.get_double(hd::current_joint_angles, joints);
  api.get_double(hd::current_gimbal_angles, gimbals);
  asks_joints_ = hd::drain(api).count == 0;
  status_.joints = arm_angles(joints, gimbals);
  const StylusPose by_joints = arm_pose(status_.joints);
  status_.joints_off_m = std::sqrt((by_joints.position - pose.position).squaredNorm());
  status_.joints_off_rad =
      std::sqrt(rotation_vector(by_joints.orientation * conjugate(pose.orientation)).squaredNorm());
  status_.joints_known = asks_joints_ && std::isfinite(status_.joints_off_m + status_.joints_off_rad);
}

bool PhantomServo::survives(const hd::Api& api) {
  const hd::Errors errors = hd::drain(api);
  bool alive = true;
  for (int i = errors.count - 1; i >= 0; --i) {  // oldest first
    const hd::ErrorRecord& error = errors.records[i];
    status_.last_error = error.code;
    status_.last_error_internal = error.internal;
    error_this_tick_ = true;
    safety_ = SafetyState();  // nothing now, and a soft start
    if (!hd::is_recoverable(error.code)) {
      alive = false;
    } else if (error.code == hd::warm_motors) {
      too_warm_ = true;
      warm_error_s_ = last_time_s_;
      ++status_.force_errors;
    } else {
      ++status_.force_errors;
      std::copy(force_error_s_ + 1, force_error_s_ + 4, force_error_s_);
      force_error_s_[3] = last_time_s_;
      if (last_time_s_ - force_error_s_[0] < force_error_window_s) alive = false;
    }
  }
  return alive;
}

void PhantomServo::fail(const hd::Api& api, hd::Handle device) {
  safety_ = SafetyState();
  api.make_current_device(device);
  api.disable(hd::force_output);
  hd::drain(api);
  faulted.store(true, std::memory_order_release);
}

void PhantomServo::note(const hd::Errors& errors) {
  if (errors.count == 0) return;
  status_.last_error = errors.records[0].code;
  status_.last_error_internal = errors.records[0].internal;
}

void PhantomServo::debounce(int raw) {
  raw_button_ticks_ = raw == raw_buttons_ ? raw_button_ticks_ + 1 : 1;
  raw_buttons_ = raw;
  if (raw_button_ticks_ >= debounce_ticks) buttons_ = static_cast<std::uint32_t>(raw);
}

DeviceSample PhantomServo::make_sample(const Reading& reading) {
  const double start = start_s.load(std::memory_order_relaxed);
  if (start != sequence_start_s_) {
    sequence_start_s_ = start;
    sequence_ = 0;
  }
  // Velocities: the driver's own, and what the poses say.
  const double since_s = last_time_s_ - last_valid_s_;
  double measured_speed_m_s = 0;
  if (last_.valid && since_s > 0) {
    const Vec3 way = reading.pose.position - last_.pose.position;
    measured_speed_m_s = std::sqrt(way.squaredNorm()) / since_s;
    const Vec3 turn = rotation_vector(reading.pose.orientation * conjugate(last_.pose.orientation));
    angular_velocity_ += since_s / (since_s + angular_filter_s) * (turn / since_s - angular_velocity_);
    angular_velocity_valid_ = true;
  }
  speed_m_s_ = std::max(measured_speed_m_s, std::sqrt(reading.velocity.squaredNorm()));
  last_ = reading;
  last_valid_s_ = last_time_s_;

  const StylusPose pose = to_world(mount, reading.pose);
  DeviceSample sample;
  sample.sequence = sequence_++;
  sample.time_s = last_time_s_ - start;
  sample.interval_s = interval_s_;
  sample.position = pose.position;
  sample.orientation = pose.orientation;
  sample.angular_velocity = direction_to_world(mount, angular_velocity_);
  sample.angular_velocity_valid = angular_velocity_valid_;
  // The tip moves with the gimbal centre and turns about it.
  const Vec3 arm = -mount.tip_offset_m * rotation_matrix(pose.orientation).col(2);
  sample.linear_velocity = direction_to_world(mount, reading.velocity) + sample.angular_velocity.cross(arm);
  sample.linear_velocity_valid =
      reading.velocity_valid && (mount.tip_offset_m == 0 || angular_velocity_valid_);
  sample.docked = status_.docked = reading.docked;
  sample.buttons = buttons_;
  sample.motor_temperature = reading.temperature;
  sample.force_sent = direction_to_world(mount, safety_.force);  // by the frame before
  return sample;
}

StampedCommand PhantomServo::command_for(const DeviceSample& sample) {
  if (function != nullptr) return {function(user, sample), last_time_s_};
  commands.read(command_);
  return command_;
}

void PhantomServo::decide(const Reading& reading, const DeviceSample& sample) {
  const bool failed = faulted.load(std::memory_order_relaxed);
  const double rested_s = last_time_s_ - warm_error_s_;
  if (reading.temperature < cool_temperature && rested_s > (has_temperature ? least_rest_s : blind_rest_s))
    too_warm_ = false;
  const bool held = hold_button < 0 || (buttons_ >> hold_button & 1) != 0;
  const bool running = reached.load(std::memory_order_relaxed) == ServoMode::run &&
                       mode.load(std::memory_order_acquire) == ServoMode::run;

  SafetyInput input;
  input.permitted = running && !failed && !error_this_tick_ && !too_warm_ && !reading.docked && held &&
                    !paused.load(std::memory_order_relaxed) && !resting_.load(std::memory_order_relaxed) &&
                    !forces_stopped();
  input.pose_valid = reading.valid;
  input.position = reading.pose.position;
  input.speed_m_s = speed_m_s_;
  input.interval_s = interval_s_;
  input.temperature = reading.temperature;
  if (running && reading.valid) {
    const StampedCommand stamped = command_for(sample);
    const DeviceCommand& command = stamped.command;
    input.command_age_s = last_time_s_ - stamped.written_s;
    if (stamped.written_s > 0)
      status_.max_command_age_s = std::max(status_.max_command_age_s, input.command_age_s);
    if (sample.time_s <= command.expiry_s) {
      input.force = direction_from_world(mount, command.force);
      if (renders_torque) input.torque = direction_from_world(mount, command.torque);
      if (!renders_torque && command.torque != Vec3::Zero()) ++status_.torques_ignored;
    }
    if (!input.force.allFinite() || !input.torque.allFinite()) ++status_.commands_not_finite;
  }
  status_.reasons = limit_force(limits, input, safety_);
}

void PhantomServo::send(const hd::Api& api) const {
  const double force[3] = {safety_.force.x(), safety_.force.y(), safety_.force.z()};
  api.set_double(hd::current_force, force);
  if (renders_torque) {
    constexpr double mNm = 1e3;
    const double torque[3] = {mNm * safety_.torque.x(), mNm * safety_.torque.y(), mNm * safety_.torque.z()};
    api.set_double(hd::current_torque, torque);
  }
}

bool PhantomServo::switch_motors_on(const hd::Api& api) {
  // The driver's own guards first, the motors last; a guard that a model does not know is no obstacle.
  for (const unsigned int guard : {hd::max_force_clamping, hd::force_ramping, hd::software_force_limit,
                                   hd::software_velocity_limit, hd::software_force_impulse_limit}) {
    api.enable(guard);
  }
  hd::drain(api);
  api.enable(hd::force_output);
  const bool on = api.is_enabled(hd::force_output) == 1;
  const hd::Errors errors = hd::drain(api);
  note(errors);
  return on && errors.count == 0;
}

bool PhantomServo::change_mode(const hd::Api& api, hd::Handle device) {
  const ServoMode wanted = mode.load(std::memory_order_acquire);
  if (wanted == reached.load(std::memory_order_relaxed)) return true;
  api.make_current_device(device);
  switch (wanted) {
    case ServoMode::calibrate:
      if (!calibrate(api)) return true;
      break;
    case ServoMode::run:
      if (!switch_motors_on(api)) return false;
      break;
    case ServoMode::watch:
    case ServoMode::stop:
      // The frame that just ended sent the zero: `send` gives nothing unless both modes are `run`.
      api.disable(hd::force_output);
      hd::drain(api);
      break;
  }
  reached.store(wanted, std::memory_order_release);
  return true;
}

bool PhantomServo::calibrate(const hd::Api& api) {
  if (status_.ticks <= first_sound_tick) return false;
  if (status_.calibration == hd::calibration_ok) return last_.valid && ++settled_ticks_ >= settling_ticks;
  if (status_.ticks % calibration_check_ticks != 0) return false;
  status_.calibration = api.check_calibration();
  if (status_.calibration == hd::needs_update) api.update_calibration(calibration_style);
  settled_ticks_ = 0;
  // An update that did not work is tried again: it is not the end.
  note(hd::drain(api));
  calibration.store(status_.calibration, std::memory_order_release);
  return false;
}

}  // namespace sulcus
