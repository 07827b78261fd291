#include <cstdio>

#include "engine/numerics/error.h"
#include "hw_phantom/hdapi.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/session_devices.h"

namespace sulcus {
namespace {

void list_devices(const PhantomOptions& options) {
  std::printf("%-10s the scenario's way-points; with --hand behind a hand that feels the force\n",
              "scripted");
  std::printf("%-10s a recording (run.h5) or a table (.csv), by --from\n", "recorded");
  try {
    const hd::Api api = hd::load(options.library);
    std::printf("%-10s Phantom Omni, Touch and relatives; driver %s\n", "phantom", api.path.c_str());
  } catch (const EnvironmentError& error) {
    std::printf("%-10s Phantom Omni, Touch and relatives; not here: %s\n", "phantom", error.what());
  }
}

}  // namespace

int device_command(const DeviceOptions& options) {
  if (options.list) {
    list_devices(options.phantom);
    return 0;
  }
  if (options.check != "phantom") throw InputError("give --list, or --check phantom");
  std::fprintf(stderr, "looking at the device for %g s, with its motors off\n", options.watch_s);
  bool good = true;
  for (const Finding& finding : diagnose_phantom(phantom_settings(options.phantom), options.watch_s)) {
    std::printf("%-4s  %s\n", finding.good ? "ok" : "FAIL", finding.text.c_str());
    good = good && finding.good;
  }
  return good ? 0 : 1;
}

}  // namespace sulcus
