#include "hw_phantom/hdapi.h"

#include <dlfcn.h>
#include <unistd.h>

#include <cstdlib>
#include <optional>

namespace sulcus::hd {
namespace {

struct LoadFailure {
  Failure failure;
  std::string path;
  std::string text;
};

// What to install, by a word in the loader's message.
std::string dependency_hint(const std::string& loader_text) {
  struct Hint {
    const char* word;
    const char* remedy;
  };
  constexpr Hint hints[] = {
      {"ncurses", "install ncurses 5 (on Debian: libncurses5)"},
      {"tinfo", "install tinfo 5 (on Debian: libtinfo5)"},
      {"stdscr", "install ncurses 5 (on Debian: libncurses5)"},
      {"wgetch", "install ncurses 5 (on Debian: libncurses5)"},
      {"PhantomIOLib42", "install the Touch device driver beside OpenHaptics 3.4"},
      {"PHANToMIO", "install the PHANTOM device driver beside OpenHaptics 3.0"},
      {"raw1394", "install libraw1394 (FireWire devices)"},
      {"GLIBC_", "the driver was built for a newer system; use the driver release for this one"},
  };
  for (const Hint& hint : hints) {
    if (loader_text.find(hint.word) != std::string::npos) return hint.remedy;
  }
  return "install the library that the message names, or add its folder to LD_LIBRARY_PATH";
}

template <class Function>
bool bind(void* library, const char* name, Function*& function, std::string& missing) {
  function = reinterpret_cast<Function*>(dlsym(library, name));
  if (function == nullptr && missing.empty()) missing = name;
  return function != nullptr;
}

// The name of the first symbol that is missing; empty if there is none.
std::string bind_all(Api& api) {
  std::string missing;
  bind(api.library, "hdInitDevice", api.init_device, missing);
  bind(api.library, "hdDisableDevice", api.disable_device, missing);
  bind(api.library, "hdMakeCurrentDevice", api.make_current_device, missing);
  bind(api.library, "hdGetCurrentDevice", api.get_current_device, missing);
  bind(api.library, "hdBeginFrame", api.begin_frame, missing);
  bind(api.library, "hdEndFrame", api.end_frame, missing);
  bind(api.library, "hdGetError", api.get_error, missing);
  bind(api.library, "hdGetErrorString", api.get_error_string, missing);
  bind(api.library, "hdEnable", api.enable, missing);
  bind(api.library, "hdDisable", api.disable, missing);
  bind(api.library, "hdIsEnabled", api.is_enabled, missing);
  bind(api.library, "hdGetBooleanv", api.get_boolean, missing);
  bind(api.library, "hdGetIntegerv", api.get_integer, missing);
  bind(api.library, "hdGetDoublev", api.get_double, missing);
  bind(api.library, "hdGetString", api.get_string, missing);
  bind(api.library, "hdSetDoublev", api.set_double, missing);
  bind(api.library, "hdCheckCalibration", api.check_calibration, missing);
  bind(api.library, "hdUpdateCalibration", api.update_calibration, missing);
  bind(api.library, "hdStartScheduler", api.start_scheduler, missing);
  bind(api.library, "hdStopScheduler", api.stop_scheduler, missing);
  bind(api.library, "hdSetSchedulerRate", api.set_scheduler_rate, missing);
  bind(api.library, "hdScheduleAsynchronous", api.schedule_asynchronous, missing);
  bind(api.library, "hdUnschedule", api.unschedule, missing);
  return missing;
}

std::optional<LoadFailure> try_load(const std::string& path, Api& api) {
  api.library = dlopen(path.c_str(), RTLD_NOW | RTLD_GLOBAL);
  if (api.library == nullptr) {
    const char* said = dlerror();
    const std::string text = said != nullptr ? said : "no reason given";
    // The loader starts its message with the file that it could not open: this one, or one that it needs.
    const bool itself = text.rfind(path + ": cannot open shared object file", 0) == 0;
    return LoadFailure{itself ? Failure::library_absent : Failure::dependency_absent, path, text};
  }
  api.path = path;
  const std::string missing = bind_all(api);
  if (missing.empty()) return std::nullopt;
  return LoadFailure{Failure::symbol_absent, path, missing};
}

OpenError explain(const LoadFailure& failure) {
  const std::string place = "phantom: library " + failure.path + ": ";
  if (failure.failure == Failure::symbol_absent) {
    return {failure.failure,
            place + "has no function " + failure.text +
                "; it is not libHD of OpenHaptics 3.x: install OpenHaptics 3.4 or set SULCUS_LIBHD "
                "to the right file"};
  }
  return {failure.failure,
          place + "found, but it cannot be loaded: " + failure.text + "; " + dependency_hint(failure.text)};
}

}  // namespace

std::vector<std::string> search_order(const std::string& library) {
  if (!library.empty()) return {library};
  if (const char* set = std::getenv("SULCUS_LIBHD"); set != nullptr && *set != '\0') return {set};
  const char* names[] = {"libHD.so.3.4", "libHD.so", "libHD.so.3.0", "libHD.so.3"};
  const char* folders[] = {"",
                           "/usr/lib/",
                           "/usr/lib64/",
                           "/usr/lib/x86_64-linux-gnu/",
                           "/opt/OpenHaptics/",
                           "/opt/OpenHaptics/lib/",
                           "/opt/OpenHaptics/lib64/"};
  std::vector<std::string> paths;
  for (const char* folder : folders) {
    for (const char* name : names) paths.push_back(std::string(folder) + name);
  }
  return paths;
}

Api load(const std::string& library) {
  const std::vector<std::string> paths = search_order(library);
  std::optional<LoadFailure> telling;
  for (const std::string& path : paths) {
    Api api{};
    const std::optional<LoadFailure> failure = try_load(path, api);
    if (!failure) return api;
    if (failure->failure != Failure::library_absent && !telling) telling = failure;
  }
  if (telling) throw explain(*telling);
  std::string tried;
  for (const std::string& path : paths) tried += (tried.empty() ? "" : ", ") + path;
  throw OpenError(
      Failure::library_absent,
      "phantom: driver library not found (tried " + tried +
          "); install OpenHaptics 3.4 and the Touch device driver, or set SULCUS_LIBHD to libHD.so");
}

Errors drain(const Api& api) {
  Errors errors;
  while (errors.count < 64) {
    const ErrorRecord record = api.get_error();
    if (record.code == success) break;
    errors.records[errors.count++] = record;
  }
  return errors;
}

std::string describe(unsigned int code, int internal) {
  struct Name {
    unsigned int code;
    const char* text;
  };
  constexpr Name names[] = {
      {0x0100, "unknown parameter"},
      {0x0101, "value out of range"},
      {0x0102, "not possible in this state"},
      {0x0103, "parameter read with the wrong type"},
      {0x0104, "bad device handle"},
      {0x0200, "motors too warm"},
      {0x0201, "force limit exceeded"},
      {0x0202, "force changed too fast"},
      {0x0203, "velocity limit exceeded"},
      {0x0204, "force and joint torque mixed"},
      {0x0300, "device fault or no such device"},
      {0x0301, "device already in use"},
      {0x0302, "communication lost"},
      {0x0303, "communication not configured"},
      {0x0304, "servo timer failed"},
      {0x0400, "frame begun twice"},
      {0x0401, "frame ended without begin"},
      {0x0402, "output set outside a frame"},
      {0x0500, "bad priority"},
      {0x0501, "scheduler full"},
      {0x0600, "no valid licence"},
  };
  constexpr char digits[] = "0123456789ABCDEF";
  std::string text = "0x";
  for (int shift = 12; shift >= 0; shift -= 4) text += digits[(code >> shift) & 15];
  const char* meaning = "unknown error";
  for (const Name& name : names) {
    if (name.code == code) meaning = name.text;
  }
  return text + " (" + meaning + "), internal " + std::to_string(internal);
}

OpenError open_error(const ErrorRecord& error, const std::string& device_name) {
  const std::string place = "phantom: device '" + (device_name.empty() ? "default" : device_name) +
                            "': " + describe(error.code, error.internal) + "; ";
  switch (error.code) {
    case invalid_license:
      return {Failure::licence, place + "install the licence of OpenHaptics (or its developer edition)"};
    case comm_config_error:
      return {
          Failure::configuration,
          place +
              "pair the device in the vendor's setup tool (its port may have changed: replug, then pair), "
              "check GTDD_HOME or ~/.3dsystems, and the permission of the port (group dialout for ttyACM, "
              "plugdev for FireWire, a udev rule for hidraw)"};
    case comm_error:
      return {Failure::device,
              place +
                  "check cable and power; an Ethernet device needs a link-local IPv4 address "
                  "and to be paired"};
    case already_initiated:
      return {Failure::device,
              place + "another program or an earlier run holds the device: end it, then replug"};
    default:
      return {Failure::device,
              place +
                  "connect the device and switch it on, or name it as the vendor's setup tool does "
                  "(\"Default Device\" in 3.4, \"Default PHANToM\" in 3.0)"};
  }
}

}  // namespace sulcus::hd
