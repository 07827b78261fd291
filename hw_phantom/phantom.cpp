#include "hw_phantom/phantom.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <thread>

#include "hw_phantom/driver.h"
#include "hw_phantom/emergency.h"
#include "hw_phantom/phantom_servo.h"

namespace sulcus {
namespace {

constexpr double first_data_timeout_s = 2;  // for the first hundred ticks and a sound pose
constexpr double mode_timeout_s = 1;        // for the servo to switch the motors
constexpr double stop_timeout_s = 0.1;      // for the servo to send the last zero
constexpr double stale_sample_s = 0.02;
constexpr double dead_servo_s = 0.5;

// The style to calibrate with, among those that the device offers.
unsigned int chosen_style(int styles) {
  for (const unsigned int style : {hd::automatic, hd::inkwell, hd::encoder_reset}) {
    if ((static_cast<unsigned int>(styles) & style) != 0) return style;
  }
  return 0;
}

class Phantom final : public PhantomDevice {
 public:
  explicit Phantom(PhantomSettings settings) : settings_(std::move(settings)) {}
  ~Phantom() override { close(); }

  DeviceCapabilities capabilities() const override;
  DeviceState state() const override;
  void open() override;
  void calibrate() override;
  void arm() override;
  void close() noexcept override;
  DeviceError read(double time_s, DeviceSample& sample) override;
  void write(const DeviceCommand& command) override;
  bool set_servo(ServoFunction function, void* user) override;
  std::optional<double> clock_zero_s() const override { return servo_->start_s.load(); }
  void pause(bool paused) override { servo_->paused.store(paused, std::memory_order_relaxed); }
  PhantomStatus status() override;
  const PhantomIdentity& identity() const override { return identity_; }

 private:
  void expect(DeviceState state, const char* call) const;
  void describe_device(const hd::Api& api);
  double get_double(const hd::Api& api, unsigned int parameter) const;
  int get_integer(const hd::Api& api, unsigned int parameter) const;
  template <class Condition>
  bool wait(double timeout_s, Condition&& condition) const;
  std::string fault_text();

  PhantomSettings settings_;
  PhantomIdentity identity_;
  DeviceState state_ = DeviceState::closed;
  hd::Driver* driver_ = nullptr;
  hd::Handle device_ = hd::invalid_handle;
  std::unique_ptr<PhantomServo> servo_ = std::make_unique<PhantomServo>();
  ServoFunction function_ = nullptr;
  void* user_ = nullptr;
  PhantomStatus status_;
  DeviceSample newest_;
  bool have_sample_ = false;
};

DeviceCapabilities Phantom::capabilities() const {
  DeviceCapabilities c;
  c.model = identity_.model.empty() ? "phantom" : identity_.model;
  c.renders_force = true;
  c.renders_torque = servo_->renders_torque;
  c.servo_rate_Hz = settings_.rate_Hz;
  c.max_force_N = servo_->limits.max_force_N;
  c.max_torque_N_m = servo_->renders_torque ? servo_->limits.max_torque_N_m : 0;
  return c;
}

DeviceState Phantom::state() const {
  const bool faulted = state_ != DeviceState::closed && servo_->faulted.load(std::memory_order_acquire);
  return faulted ? DeviceState::faulted : state_;
}

void Phantom::expect(DeviceState expected, const char* call) const {
  if (state() == expected) return;
  throw EnvironmentError(
      "phantom: " + std::string(call) + " called in state '" + state_name(state()) + "'; expected '" +
      state_name(expected) +
      "': call open(), calibrate(), arm() once each, in this order; close() leaves a fault");
}

// Properties are read one by one; what a model does not know stays zero.
double Phantom::get_double(const hd::Api& api, unsigned int parameter) const {
  double slots[6] = {0, 0, 0, 0, 0, 0};
  api.get_double(parameter, slots);
  return hd::drain(api).count == 0 && std::isfinite(slots[0]) ? slots[0] : 0;
}

int Phantom::get_integer(const hd::Api& api, unsigned int parameter) const {
  int value = 0;
  api.get_integer(parameter, &value);
  return hd::drain(api).count == 0 ? value : 0;
}

void Phantom::describe_device(const hd::Api& api) {
  const auto text = [&](unsigned int parameter) {
    const char* value = api.get_string(parameter);
    const bool good = hd::drain(api).count == 0 && value != nullptr;
    return std::string(good ? value : "");
  };
  PhantomIdentity id;
  id.library = api.path;
  id.api_version = text(hd::api_version);
  if (!id.api_version.empty() && id.api_version.rfind("3.", 0) != 0) {
    throw hd::OpenError(hd::Failure::version, "phantom: library " + api.path + " is version " +
                                                  id.api_version + "; expected 3.x: install OpenHaptics 3.4");
  }
  id.model = text(hd::device_model);
  id.driver_version = text(hd::driver_version);
  id.vendor = text(hd::device_vendor);
  id.serial = text(hd::serial_number);
  id.firmware = get_double(api, hd::firmware_version);
  id.inputs = get_integer(api, hd::input_dof);
  id.outputs = get_integer(api, hd::output_dof);
  id.calibration_style = get_integer(api, hd::calibration_style);
  id.max_force_N = get_double(api, hd::nominal_max_force);
  id.continuous_force_N = get_double(api, hd::nominal_max_continuous_force);
  identity_ = id;

  // The user's limits, narrowed to the device's.
  PhantomServo& servo = *servo_;
  servo.limits = settings_.safety;
  for (const double told_N : {id.max_force_N, id.continuous_force_N}) {
    if (told_N > 0) servo.limits.max_force_N = std::min(servo.limits.max_force_N, told_N);
  }
  double box[6] = {0, 0, 0, 0, 0, 0};  // mm
  api.get_double(hd::usable_workspace, box);
  if (hd::drain(api).count == 0 && box[0] < box[3] && box[1] < box[4] && box[2] < box[5]) {
    servo.limits.workspace_min = servo.limits.workspace_min.cwiseMax(1e-3 * Vec3(box[0], box[1], box[2]));
    servo.limits.workspace_max = servo.limits.workspace_max.cwiseMin(1e-3 * Vec3(box[3], box[4], box[5]));
  }
  double temperatures[6] = {-1, -1, -1, -1, -1, -1};
  api.get_double(hd::motor_temperature, temperatures);
  servo.has_temperature = hd::drain(api).count == 0 && temperatures[0] >= 0;
  servo.renders_torque = id.outputs >= 6;
  servo.calibration_style = chosen_style(id.calibration_style);
  servo.has_inkwell = (id.calibration_style & hd::inkwell) != 0;

  // Encoders are reset before the scheduler starts: the user holds the arm in its reset position meanwhile.
  if (servo.calibration_style == hd::encoder_reset) api.update_calibration(hd::encoder_reset);
  hd::drain(api);
}

template <class Condition>
bool Phantom::wait(double timeout_s, Condition&& condition) const {
  const double end_s = settings_.clock.now_s() + timeout_s;
  while (!condition()) {
    if (settings_.clock.now_s() > end_s) return false;
    settings_.clock.sleep_s(0.001);
  }
  return true;
}

std::string Phantom::fault_text() {
  const PhantomStatus s = status();
  return s.last_error == 0 ? "no sound data" : hd::describe(s.last_error, s.last_error_internal);
}

void Phantom::open() {
  expect(DeviceState::closed, "open()");
  driver_ = &hd::Driver::get(settings_.library);
  servo_ = std::make_unique<PhantomServo>();
  PhantomServo& servo = *servo_;
  servo.controller = std::this_thread::get_id();
  servo.now_s = settings_.clock.now_s;
  servo.mount = settings_.mount;
  servo.nominal_interval_s = 1 / settings_.rate_Hz;
  servo.hold_button = settings_.hold_button;
  status_ = PhantomStatus();
  have_sample_ = false;
  const auto rate_Hz = static_cast<unsigned long>(std::lround(settings_.rate_Hz));
  device_ = driver_->attach(settings_.device_name, servo, rate_Hz, settings_.skip_disable,
                            settings_.clock.sleep_s, [&](hd::Handle) { describe_device(driver_->api()); });
  identity_.rate_refused = driver_->rate_refused();
  state_ = DeviceState::open;

  // Ticks, and data that make sense.
  const auto faulted = [&] { return servo.faulted.load(std::memory_order_acquire); };
  const auto sound = [&] { return have_sample_ = servo.samples.read(newest_) || have_sample_; };
  const bool come = wait(first_data_timeout_s, [&] { return faulted() || sound(); });
  if (come && !faulted()) return;
  const std::uint64_t ticks = servo.ticks.load();
  const std::string found = ticks == 0 ? "the servo does not tick" : fault_text();
  close();
  throw hd::OpenError(hd::Failure::device,
                      "phantom: device '" + identity_.model + "' gives no data within 2 s: " + found +
                          "; check cable and power, replug it, and try the vendor's diagnostic tool");
}

void Phantom::calibrate() {
  expect(DeviceState::open, "calibrate()");
  servo_->mode.store(ServoMode::calibrate, std::memory_order_release);
  const auto reached = [&] {
    return servo_->reached.load(std::memory_order_acquire) == ServoMode::calibrate;
  };
  wait(settings_.calibration_timeout_s,
       [&] { return servo_->faulted.load(std::memory_order_acquire) || forces_stopped() || reached(); });
  if (reached() && !servo_->faulted.load()) {
    state_ = DeviceState::calibrated;
    return;
  }
  if (servo_->faulted.load()) {
    throw hd::OpenError(hd::Failure::device, "phantom: lost during the calibration: " + fault_text() +
                                                 "; check cable and power, close and open the device");
  }
  servo_->mode.store(ServoMode::watch, std::memory_order_release);
  if (forces_stopped())
    throw hd::OpenError(hd::Failure::calibration, "phantom: interrupted before it was calibrated");
  const bool manual = servo_->calibration.load() == hd::needs_manual_input;
  throw hd::OpenError(hd::Failure::calibration,
                      std::string("phantom: not calibrated in time: the device ") +
                          (manual ? "waits for the user; put the stylus into the inkwell and try again"
                                  : "did not accept the update; calibrate it in the vendor's setup tool"));
}

void Phantom::arm() {
  expect(DeviceState::calibrated, "arm()");
  PhantomServo& servo = *servo_;
  stop_forces_on_signals();
  servo.function = function_;
  servo.user = user_;
  servo.start_s.store(settings_.clock.now_s(), std::memory_order_relaxed);
  servo.mode.store(ServoMode::run, std::memory_order_release);
  const bool done = wait(mode_timeout_s, [&] {
    return servo.faulted.load(std::memory_order_acquire) ||
           servo.reached.load(std::memory_order_acquire) == ServoMode::run;
  });
  if (done && !servo.faulted.load()) {
    state_ = DeviceState::armed;
    have_sample_ = false;  // of the time before
    wait(mode_timeout_s, [&] { return have_sample_ = servo.samples.read(newest_) && newest_.time_s >= 0; });
    return;
  }
  const std::string found = servo.faulted.load() ? fault_text() : "the servo does not tick";
  servo.mode.store(ServoMode::stop, std::memory_order_release);
  throw hd::OpenError(hd::Failure::device,
                      "phantom: the motors could not be switched on: " + found +
                          "; check power and the safety switch, close and open the device");
}

void Phantom::close() noexcept {
  if (state_ == DeviceState::closed) return;
  // A frame with zero force and the motors off, unless the servo has stopped already.
  servo_->mode.store(ServoMode::stop, std::memory_order_release);
  wait(stop_timeout_s, [&] {
    return servo_->faulted.load(std::memory_order_acquire) ||
           servo_->reached.load(std::memory_order_acquire) == ServoMode::stop;
  });
  driver_->detach(device_, settings_.clock.sleep_s);
  device_ = hd::invalid_handle;
  state_ = DeviceState::closed;
}

DeviceError Phantom::read(double time_s, DeviceSample& sample) {
  if (state_ != DeviceState::armed && state_ != DeviceState::running) return DeviceError::fatal;
  if (servo_->faulted.load(std::memory_order_acquire)) return DeviceError::fatal;
  if (!std::isfinite(time_s)) {
    servo_->mode.store(ServoMode::stop, std::memory_order_release);
    servo_->faulted.store(true, std::memory_order_release);
    return DeviceError::fatal;
  }
  state_ = DeviceState::running;
  have_sample_ = servo_->samples.read(newest_) || have_sample_;
  if (!have_sample_) return DeviceError::recoverable;
  sample = newest_;
  const double age_s = settings_.clock.now_s() - servo_->start_s.load() - newest_.time_s;
  if (age_s > dead_servo_s) {
    servo_->faulted.store(true, std::memory_order_release);
    return DeviceError::fatal;
  }
  return age_s > stale_sample_s ? DeviceError::recoverable : DeviceError::none;
}

void Phantom::write(const DeviceCommand& command) {
  servo_->commands.write({command, settings_.clock.now_s()});
}

bool Phantom::set_servo(ServoFunction function, void* user) {
  function_ = function;
  user_ = user;
  return true;
}

PhantomStatus Phantom::status() {
  servo_->statuses.read(status_);
  return status_;
}

}  // namespace

PhantomClock steady_clock() {
  return {[] {
            return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
          },
          [](double s) { std::this_thread::sleep_for(std::chrono::duration<double>(s)); }};
}

std::unique_ptr<PhantomDevice> make_phantom_device(PhantomSettings settings) {
  return std::make_unique<Phantom>(std::move(settings));
}

std::vector<Finding> diagnose_phantom(const PhantomSettings& settings, double watch_s) {
  std::vector<Finding> findings;
  const std::unique_ptr<PhantomDevice> device = make_phantom_device(settings);
  try {
    device->open();
  } catch (const EnvironmentError& error) {
    findings.push_back({false, error.what()});
    return findings;
  }
  const PhantomIdentity& id = device->identity();
  char line[256];
  const auto add = [&](bool good) { findings.push_back({good, line}); };
  std::snprintf(line, sizeof(line), "library %s, version %s", id.library.c_str(), id.api_version.c_str());
  add(true);
  std::snprintf(line, sizeof(line), "device %s, serial %s, driver %s, firmware %g, %d inputs, %d outputs",
                id.model.c_str(), id.serial.c_str(), id.driver_version.c_str(), id.firmware, id.inputs,
                id.outputs);
  add(id.inputs >= 3);
  const PhantomStatus before = device->status();
  const double from_s = settings.clock.now_s();
  while (settings.clock.now_s() < from_s + watch_s && !forces_stopped()) {
    settings.clock.sleep_s(std::min(0.1, from_s + watch_s - settings.clock.now_s()));
  }
  const PhantomStatus after = device->status();
  const double rate_Hz = static_cast<double>(after.ticks - before.ticks) / (settings.clock.now_s() - from_s);
  std::snprintf(line, sizeof(line),
                "servo %.0f Hz (asked for %.0f), %llu late ticks, longest interval %.1f ms", rate_Hz,
                settings.rate_Hz, static_cast<unsigned long long>(after.late_ticks - before.late_ticks),
                1e3 * after.max_interval_s);
  add(rate_Hz > 0.9 * settings.rate_Hz);
  std::snprintf(line, sizeof(line), "%llu samples not sound",
                static_cast<unsigned long long>(after.invalid_samples - before.invalid_samples));
  add(after.invalid_samples == before.invalid_samples);
  if (after.joints_known) {
    constexpr double deg = 57.29577951308232;
    const ArmAngles& a = after.joints;
    std::snprintf(
        line, sizeof(line),
        "arm: turret %.1f, thigh %.1f, elbow %.1f, gimbal %.1f %.1f %.1f degrees; an Omni's stylus would "
        "be %.1f mm and %.1f degrees from where the driver has it",
        deg * a.turret, deg * a.thigh, deg * a.elbow, deg * a.yaw, deg * a.pitch, deg * a.roll,
        1e3 * after.joints_off_m, deg * after.joints_off_rad);
    add(true);
  }
  if (id.calibration_style & hd::inkwell) {
    findings.push_back({true, after.docked ? "stylus in the inkwell" : "stylus out of the inkwell"});
  }
  try {
    device->calibrate();
    findings.push_back({true, "calibrated"});
  } catch (const EnvironmentError& error) {
    findings.push_back({false, error.what()});
  }
  device->close();
  return findings;
}

}  // namespace sulcus
