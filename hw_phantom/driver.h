// The one libHD of a process and its one scheduler, shared by all devices: whoever opens or closes a device
// goes through here, so that calls come in the order that the driver can stand.
#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <string>

#include "hw_phantom/emergency.h"
#include "hw_phantom/hdapi.h"

namespace sulcus::hd {

// Work of one device in one servo tick: begin frame, read, set, end frame. Runs in the driver's servo thread;
// must neither throw, allocate, lock nor wait. False: this device is done and is not called again.
struct Servo {
  virtual ~Servo() = default;
  virtual bool tick(const Api& api, Handle device) = 0;
  // True: sends zero from the next tick on, until false. Called by the controlling thread.
  virtual void rest(bool resting) noexcept = 0;
};

// In a tick, around code of Sulcus' own while the frame is open: should it crash, the frame ends with a zero
// force, and the motors of all devices go off.
class OwnCode {
 public:
  explicit OwnCode(Handle in_frame) noexcept : in_frame_(in_frame), word_(say, this) {}

 private:
  static void say(void* own_code);
  Handle in_frame_;
  LastWord word_;
};

class Driver {
 public:
  // The driver of that library (see hdapi.h), loaded at the first call and kept until the process ends. At
  // the process' end all devices are stopped (atexit). Throws OpenError.
  static Driver& get(const std::string& library);

  const Api& api() const { return api_; }
  bool rate_refused() const { return rate_refused_; }

  // Stops the servo if it runs (the others' motors get a zero first, for which it waits by `sleep_s`),
  // initiates the device (once more after a disable if the driver says that it is in use already), calls
  // `describe_device` with it (properties may be read there), and starts the servo with it. Throws OpenError;
  // a servo that ran for others runs again then.
  template <class DescribeDevice>
  Handle attach(const std::string& device_name, Servo& servo, unsigned long rate_Hz, bool skip_disable,
                void (*sleep_s)(double), DescribeDevice&& describe_device) {
    const std::scoped_lock lock(control_);
    pause(sleep_s);
    Handle device = invalid_handle;
    try {
      device = initiate(device_name);
      api_.make_current_device(device);
      describe_device(device);
      add(device, servo, skip_disable);
      resume(rate_Hz);
      return device;
    } catch (...) {
      if (device != invalid_handle && !skip_disable) api_.disable_device(device);
      resume(rate_Hz_);
      throw;
    }
  }

  // Stop scheduler, unschedule, disable the device unless it was attached with `skip_disable` (it crashes on
  // some systems), and start again for the others. The caller has sent a zero force before; the others get
  // one as in attach(). No effect if not attached.
  void detach(Handle device, void (*sleep_s)(double)) noexcept;

  // The same for all that is left; for atexit.
  void shut_down() noexcept;

 private:
  struct Slot {
    Servo* servo = nullptr;  // null: free
    Handle device = invalid_handle;
    bool skip_disable = false;
    bool done = false;  // servo thread only, while the scheduler runs
  };

  friend class OwnCode;

  static unsigned int run_tick(void* driver);
  void silence(Handle in_frame) noexcept;
  Handle initiate(const std::string& device_name);
  void add(Handle device, Servo& servo, bool skip_disable);
  void pause(void (*sleep_s)(double)) noexcept;  // zero for all, then stop
  void resume(unsigned long rate_Hz);
  void start(unsigned long rate_Hz);
  void stop() noexcept;
  void release(Slot& slot) noexcept;

  Api api_;
  std::mutex control_;         // attach and detach; never taken by the servo
  std::array<Slot, 4> slots_;  // changed only while the scheduler stands
  bool scheduled_ = false;
  bool rate_refused_ = false;
  unsigned long operation_ = 0;
  unsigned long rate_Hz_ = 1000;
};

}  // namespace sulcus::hd
