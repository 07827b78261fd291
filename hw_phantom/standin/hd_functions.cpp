// The driver's C interface, as the stand-in gives it: strict where the real one is strict.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <iterator>

#include "hw_phantom/standin/standin.h"

#define HD_EXPORT extern "C" __attribute__((visibility("default")))

using namespace sulcus;
using namespace sulcus::standin;

namespace {

enum class Type { boolean, integer, real, text };

struct ParameterType {
  unsigned int parameter;
  Type type;
};

constexpr ParameterType parameter_types[] = {
    {hd::current_buttons, Type::integer},    {hd::current_inkwell_switch, Type::boolean},
    {hd::current_velocity, Type::real},      {hd::current_transform, Type::real},
    {hd::api_version, Type::text},           {hd::device_model, Type::text},
    {hd::driver_version, Type::text},        {hd::device_vendor, Type::text},
    {hd::serial_number, Type::text},         {hd::firmware_version, Type::real},
    {hd::usable_workspace, Type::real},      {hd::input_dof, Type::integer},
    {hd::output_dof, Type::integer},         {hd::calibration_style, Type::integer},
    {hd::nominal_max_force, Type::real},     {hd::nominal_max_continuous_force, Type::real},
    {hd::motor_temperature, Type::real},     {hd::current_force, Type::real},
    {hd::current_torque, Type::real},        {hd::current_joint_angles, Type::real},
    {hd::current_gimbal_angles, Type::real},
};

// The device to ask; null, with the error pushed, if parameter, type or device are wrong.
SimulatedDevice* asked(World& w, unsigned int parameter, Type type) {
  const auto known = std::find_if(std::begin(parameter_types), std::end(parameter_types),
                                  [&](const ParameterType& p) { return p.parameter == parameter; });
  const bool of_joints = parameter == hd::current_joint_angles || parameter == hd::current_gimbal_angles;
  const bool unknown = known == std::end(parameter_types) ||
                       (parameter == hd::motor_temperature && w.faults.no_temperature) ||
                       (of_joints && w.faults.no_joints);
  if (unknown) {
    push(w, 0x0100);
    return nullptr;
  }
  if (known->type != type) {
    push(w, 0x0103);
    return nullptr;
  }
  return current_device(w);
}

bool docked(const World& w) {
  return w.tick <= w.faults.docked_ticks && w.faults.docked_ticks > 0;
}

}  // namespace

HD_EXPORT hd::Handle hdInitDevice(const char* name) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  const Faults& f = w.faults;
  if (f.garbage_handle) return 0x12345678;
  if (f.init_error != 0 && (f.init_errors == 0 || w.inits_failed < f.init_errors)) {
    ++w.inits_failed;
    push(w, f.init_error, f.init_error_internal);
    return hd::invalid_handle;
  }
  for (hd::Handle h = 0; h < device_count; ++h) {
    if (std::strcmp(name == nullptr ? device_names[0] : name, device_names[h]) != 0) continue;
    SimulatedDevice& device = w.devices[h];
    if (device.initialised) {
      push(w, hd::already_initiated);
      return hd::invalid_handle;
    }
    const Motion motion = device.motion;
    const Observation seen = device.seen;
    device = SimulatedDevice();
    device.motion = motion;
    device.seen = seen;
    device.initialised = true;
    device.dead_joints = f.needs_decimal_point && std::strtod("1.5", nullptr) != 1.5;
    ++device.seen.inits;
    w.current = h;
    sample(w, device);
    return h;
  }
  push(w, hd::device_fault);
  return hd::invalid_handle;
}

HD_EXPORT void hdDisableDevice(hd::Handle h) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (w.faults.abort_on_disable) std::abort();
  if (h >= device_count || !w.devices[h].initialised) return push(w, 0x0104);
  w.devices[h].initialised = false;
  w.devices[h].enabled.clear();
  ++w.devices[h].seen.disables;
  if (w.current == h) w.current = hd::invalid_handle;
  if (w.log != nullptr && h == 0) w.log->disabled = 1;
}

HD_EXPORT void hdMakeCurrentDevice(hd::Handle h) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (h >= device_count || !w.devices[h].initialised) return push(w, 0x0104);
  w.current = h;
}

HD_EXPORT hd::Handle hdGetCurrentDevice(void) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  return w.current;
}

HD_EXPORT void hdBeginFrame(hd::Handle h) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (h >= device_count || !w.devices[h].initialised) return push(w, 0x0104);
  w.current = h;
  SimulatedDevice& device = w.devices[h];
  if (device.frame_open || (w.tick > 0 && device.frame_tick == w.tick)) return push(w, 0x0400);
  device.frame_open = true;
  device.frame_tick = w.tick;
  sample(w, device);
}

HD_EXPORT void hdEndFrame(hd::Handle h) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (h >= device_count || !w.devices[h].frame_open || w.current != h) return push(w, 0x0401);
  w.devices[h].frame_open = false;
  finish_frame(w, w.devices[h]);
}

HD_EXPORT hd::ErrorRecord hdGetError(void) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (w.errors.empty()) return {0, 12345, 67890};  // without an error only the code has a meaning
  const hd::ErrorRecord newest = w.errors.back();
  w.errors.pop_back();
  return newest;
}

HD_EXPORT const char* hdGetErrorString(unsigned int) {
  return "stand-in error";
}

HD_EXPORT void hdEnable(unsigned int capability) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  SimulatedDevice* device = current_device(w);
  if (device == nullptr || (capability == hd::force_output && w.faults.motors_stay_off)) return;
  device->enabled.insert(capability);
}

HD_EXPORT void hdDisable(unsigned int capability) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (SimulatedDevice* device = current_device(w)) device->enabled.erase(capability);
}

HD_EXPORT hd::Boolean hdIsEnabled(unsigned int capability) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  const SimulatedDevice* device = current_device(w);
  return device != nullptr && device->enabled.count(capability) != 0;
}

HD_EXPORT void hdGetBooleanv(unsigned int parameter, hd::Boolean* out) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (asked(w, parameter, Type::boolean) != nullptr) *out = docked(w) ? 0 : 1;
}

HD_EXPORT void hdGetIntegerv(unsigned int parameter, int* out) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (asked(w, parameter, Type::integer) == nullptr) return;
  const Faults& f = w.faults;
  if (parameter == hd::current_buttons) {
    const bool glitch = w.tick >= f.glitch_from && w.tick < f.glitch_from + f.glitch_ticks;
    *out = glitch ? f.buttons ^ 1 : f.buttons;
  }
  if (parameter == hd::input_dof) *out = 6;
  if (parameter == hd::output_dof) *out = f.output_dof != 0 ? f.output_dof : 3;
  if (parameter == hd::calibration_style) *out = hd::inkwell;
}

HD_EXPORT void hdGetDoublev(unsigned int parameter, double* out) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  const SimulatedDevice* device = asked(w, parameter, Type::real);
  if (device == nullptr) return;
  const auto give = [&](const auto& values) { std::copy(std::begin(values), std::end(values), out); };
  const double box[6] = {-210, -110, -85, 210, 205, 130};
  switch (parameter) {
    case hd::current_transform:
      return give(device->transform);
    case hd::current_joint_angles:
      return give(device->joints);
    case hd::current_gimbal_angles:
      return give(device->gimbals);
    case hd::current_velocity:
      return give(device->velocity);
    case hd::current_force:
      return give(device->force);
    case hd::current_torque:
      return give(device->torque);
    case hd::usable_workspace:
      return give(box);
    case hd::nominal_max_force:
      *out = 3.3;
      return;
    case hd::nominal_max_continuous_force:
      *out = 0.88;
      return;
    case hd::firmware_version:
      *out = 192;
      return;
    case hd::motor_temperature: {
      const double t =
          std::max(0.0, w.faults.temperature - w.faults.temperature_fall * static_cast<double>(w.tick));
      std::fill(out, out + 3, t);
      return;
    }
    default:
      return;
  }
}

HD_EXPORT const char* hdGetString(unsigned int parameter) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (parameter == hd::api_version) return w.faults.old_version ? "2.0.1" : "3.4.0";
  if (asked(w, parameter, Type::text) == nullptr) return "";
  switch (parameter) {
    case hd::device_model:
      return "PHANTOM Omni";
    case hd::driver_version:
      return "stand-in";
    case hd::device_vendor:
      return "Sulcus";
    default:
      return "0";
  }
}

HD_EXPORT void hdSetDoublev(unsigned int parameter, const double* in) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  SimulatedDevice* device = asked(w, parameter, Type::real);
  if (device == nullptr) return;
  if (!device->frame_open) {
    ++device->seen.sets_outside_frames;
    return push(w, 0x0402);
  }
  if (parameter == hd::current_force) std::copy(in, in + 3, device->force);
  if (parameter == hd::current_torque) std::copy(in, in + 3, device->torque);
  device->force_set = true;
}

HD_EXPORT unsigned int hdCheckCalibration(void) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  const SimulatedDevice* device = current_device(w);
  return device != nullptr ? calibration(w, *device) : static_cast<unsigned int>(hd::needs_manual_input);
}

HD_EXPORT void hdUpdateCalibration(unsigned int style) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  SimulatedDevice* device = current_device(w);
  if (device == nullptr) return;
  if (style != hd::inkwell || !w.running) return push(w, 0x0300);
  if (calibration(w, *device) == hd::needs_update) device->updated = true;
}

HD_EXPORT void hdStartScheduler(void) {
  start(world());
}
HD_EXPORT void hdStopScheduler(void) {
  stop(world());
}

HD_EXPORT void hdSetSchedulerRate(unsigned long hz) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  if (w.faults.refuse_rate || hz < 100 || hz > 8000) push(w, 0x0101);
}

HD_EXPORT unsigned long hdScheduleAsynchronous(hd::Callback function, void* user, unsigned short priority) {
  World& w = world();
  std::unique_lock lock(w.mutex);
  const unsigned long operation = w.next_operation++;
  if (w.servo_thread == std::this_thread::get_id()) {  // from within a tick: at once
    lock.unlock();
    if (function(user) == hd::callback_done) return operation;
    lock.lock();
  }
  w.callbacks.push_back({operation, function, user, priority});
  return operation;
}

HD_EXPORT void hdUnschedule(unsigned long operation) {
  World& w = world();
  const std::scoped_lock lock(w.mutex);
  const auto removed = std::erase_if(w.callbacks, [&](const auto& c) { return c.operation == operation; });
  if (removed == 0) push(w, 0x0102);
}
