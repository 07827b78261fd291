// How the tests reach the stand-in driver: by dlopen alone, as the back-end reaches the real one.
#pragma once

#include <dlfcn.h>

#include <stdexcept>
#include <string>

#include "hw_phantom/phantom.h"
#include "hw_phantom/standin/control.h"

namespace sulcus {

inline const char* standin_path() {
  return PHANTOM_STANDINS "/standin/libHD.so";
}

inline const standin::Control& standin_control() {
  static const standin::Control* const control = [] {
    void* library = dlopen(standin_path(), RTLD_NOW | RTLD_GLOBAL);
    if (library == nullptr) throw std::runtime_error(dlerror());
    return static_cast<const standin::Control*>(dlsym(library, "standin_control"));
  }();
  return *control;
}

// Settings for a test whose time moves only when the test says so: every sleep runs the servo's ticks.
inline PhantomSettings manual_settings() {
  PhantomSettings settings;
  settings.library = standin_path();
  settings.clock = {[] { return standin_control().now_s(); }, [](double s) { standin_control().sleep(s); }};
  return settings;
}

inline standin::Observation observe(int device = 0) {
  standin::Observation seen{};
  standin_control().observe(device, &seen);
  return seen;
}

}  // namespace sulcus
