#include "hw_phantom/driver.h"

#include <locale.h>

#include <clocale>
#include <cstdlib>
#include <ctime>
#include <map>
#include <memory>

#include "hw_phantom/emergency.h"

namespace sulcus::hd {
namespace {

// Numbers in the driver's configuration files have decimal points: the calling thread's locale is "C"
// meanwhile, and a process locale that the driver changes is put back.
class NumberLocale {
 public:
  NumberLocale() : before_(std::setlocale(LC_NUMERIC, nullptr)), c_(newlocale(LC_ALL_MASK, "C", locale_t())) {
    if (c_ != locale_t()) thread_before_ = uselocale(c_);
  }
  ~NumberLocale() {
    if (c_ != locale_t()) {
      uselocale(thread_before_);
      freelocale(c_);
    }
    if (before_ != std::setlocale(LC_NUMERIC, nullptr)) std::setlocale(LC_NUMERIC, before_.c_str());
  }
  NumberLocale(const NumberLocale&) = delete;
  NumberLocale& operator=(const NumberLocale&) = delete;

 private:
  std::string before_;
  locale_t c_, thread_before_ = locale_t();
};

// By library as the loader knows it, whatever name it was asked for; never destroyed, as the library is never
// unloaded.
struct Registry {
  std::mutex mutex;
  std::map<void*, std::unique_ptr<Driver>> drivers;
};

thread_local constinit Driver* ticking = nullptr;  // in the servo's thread, during a tick

Registry& registry() {
  static Registry* const instance = new Registry;
  return *instance;
}

void shut_down_all() {
  stop_all_forces();
  const timespec ten_ticks{0, 10'000'000};
  nanosleep(&ten_ticks, nullptr);
  const std::scoped_lock lock(registry().mutex);
  for (auto& [library, driver] : registry().drivers) driver->shut_down();
}

}  // namespace

Driver& Driver::get(const std::string& library) {
  const NumberLocale locale;
  Api api = load(library);
  const std::scoped_lock lock(registry().mutex);
  if (registry().drivers.empty()) std::atexit(shut_down_all);
  std::unique_ptr<Driver>& driver = registry().drivers[api.library];
  if (driver == nullptr) {
    driver = std::make_unique<Driver>();
    driver->api_ = api;
  }
  return *driver;
}

Handle Driver::initiate(const std::string& device_name) {
  const NumberLocale locale;
  const char* name = device_name.empty() ? nullptr : device_name.c_str();
  drain(api_);  // errors of earlier calls are not this one's
  Handle device = api_.init_device(name);
  Errors errors = drain(api_);
  if (errors.count > 0 && errors.records[0].code == already_initiated) {
    // Left over from an earlier session of this process; a device that we hold ourselves is not taken away.
    if (device > largest_handle) device = api_.get_current_device();
    for (const Slot& slot : slots_) {
      if (slot.servo != nullptr && slot.device == device) throw open_error(errors.records[0], device_name);
    }
    if (device <= largest_handle) api_.disable_device(device);
    drain(api_);
    device = api_.init_device(name);
    errors = drain(api_);
  }
  if (errors.count > 0) throw open_error(errors.records[0], device_name);
  if (device > largest_handle) {
    throw OpenError(Failure::device, "phantom: device '" + (device_name.empty() ? "default" : device_name) +
                                         "': the driver reported success but gave the handle " +
                                         std::to_string(device) +
                                         "; replug the device and start the program again");
  }
  return device;
}

void Driver::add(Handle device, Servo& servo, bool skip_disable) {
  for (Slot& slot : slots_) {
    if (slot.servo != nullptr) continue;
    slot = {&servo, device, skip_disable, false};
    return;
  }
  throw OpenError(Failure::device, "phantom: four devices are open already; close one first");
}

void OwnCode::say(void* own_code) {
  if (ticking != nullptr) ticking->silence(static_cast<OwnCode*>(own_code)->in_frame_);
}

void Driver::silence(Handle in_frame) noexcept {
  const double zero[3] = {0, 0, 0};
  api_.set_double(current_force, zero);
  api_.end_frame(in_frame);
  for (const Slot& slot : slots_) {
    if (slot.servo == nullptr) continue;
    api_.make_current_device(slot.device);
    api_.disable(force_output);
  }
}

unsigned int Driver::run_tick(void* user) {
  Driver& driver = *static_cast<Driver*>(user);
  ticking = &driver;
  // One callback for all devices, so that the driver's current device does not change between begin and end.
  bool any = false;
  for (Slot& slot : driver.slots_) {
    if (slot.servo == nullptr || slot.done) continue;
    slot.done = !slot.servo->tick(driver.api_, slot.device);
    any = any || !slot.done;
  }
  ticking = nullptr;
  return any ? callback_continue : callback_done;
}

// The driver may leave the motors as they are while its scheduler stands.
void Driver::pause(void (*sleep_s)(double)) noexcept {
  bool any = false;
  for (const Slot& slot : slots_) {
    if (slot.servo == nullptr) continue;
    slot.servo->rest(true);
    any = true;
  }
  constexpr double ten_ticks_s = 0.01;
  if (any && scheduled_) sleep_s(ten_ticks_s);
  stop();
}

void Driver::resume(unsigned long rate_Hz) {
  for (const Slot& slot : slots_) {
    if (slot.servo != nullptr) slot.servo->rest(false);
  }
  start(rate_Hz);
}

void Driver::start(unsigned long rate_Hz) {
  bool any = false;
  for (const Slot& slot : slots_) any = any || slot.servo != nullptr;
  if (!any || scheduled_) return;
  rate_Hz_ = rate_Hz;
  api_.set_scheduler_rate(rate_Hz);
  rate_refused_ = drain(api_).count > 0;  // it goes on at its own rate
  operation_ = api_.schedule_asynchronous(run_tick, this, 32767);
  api_.start_scheduler();
  drain(api_);  // whether the servo runs is seen by its ticks, not by this
  scheduled_ = true;
}

void Driver::stop() noexcept {
  if (!scheduled_) return;
  api_.stop_scheduler();
  api_.unschedule(operation_);
  drain(api_);  // "already finished" is no error here
  scheduled_ = false;
}

void Driver::release(Slot& slot) noexcept {
  if (!slot.skip_disable) api_.disable_device(slot.device);
  drain(api_);
  slot = Slot();
}

void Driver::detach(Handle device, void (*sleep_s)(double)) noexcept {
  const std::scoped_lock lock(control_);
  for (Slot& slot : slots_) {
    if (slot.servo == nullptr || slot.device != device) continue;
    pause(sleep_s);
    release(slot);
    resume(rate_Hz_);
  }
}

void Driver::shut_down() noexcept {
  const std::scoped_lock lock(control_);
  stop();
  for (Slot& slot : slots_) {
    if (slot.servo != nullptr) release(slot);
  }
}

}  // namespace sulcus::hd
