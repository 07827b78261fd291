#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "engine/numerics/error.h"
#include "hw_phantom/hdapi.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/session.h"
#include "tools/sulcus/session_devices.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

// Names that the vendor's set-up tool has given to devices: its files <name>.config.
std::vector<std::string> configured_phantoms() {
  std::vector<fs::path> folders = {"/usr/share/3DSystems/config"};
  if (const char* home = std::getenv("HOME"))
    folders.insert(folders.begin(), fs::path(home) / ".3dsystems/config");
  if (const char* home = std::getenv("GTDD_HOME")) folders.insert(folders.begin(), fs::path(home) / "config");
  std::vector<std::string> names;
  for (const fs::path& folder : folders) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      if (entry.path().extension() == ".config")
        names.push_back(entry.path().stem().string() + " (" + folder.string() + ")");
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

void list_devices(const PhantomOptions& options) {
  std::printf("%-10s the scenario's way-points; with --hand behind a hand that feels the force\n",
              "scripted");
  std::printf("%-10s a recording (run.h5) or a table (.csv), by --from\n", "recorded");
  std::string driver = "its driver is not here; `sulcus device --check phantom` says why";
  try {
    driver = "driver " + hd::load(options.library).path;
  } catch (const EnvironmentError&) {  // --check tells it
  }
  std::printf("%-10s Phantom Omni, Touch and relatives; %s\n", "phantom", driver.c_str());
  for (const std::string& name : configured_phantoms())
    std::printf("%-10s configured: %s\n", "", name.c_str());
}

}  // namespace

int device_command(const DeviceOptions& options) {
  if (options.list) {
    list_devices(options.phantom);
    return 0;
  }
  if (options.check != "phantom") throw InputError("give --list, or --check phantom");
  std::fprintf(stderr, "looking at the device for %g s, with its motors off\n", options.watch_s);
  const InterruptGuard interrupts;  // also then the device is left in order
  bool good = true;
  for (const Finding& finding : diagnose_phantom(phantom_settings(options.phantom), options.watch_s)) {
    std::printf("%-4s  %s\n", finding.good ? "ok" : "FAIL", finding.text.c_str());
    good = good && finding.good;
  }
  if (InterruptGuard::interrupted()) throw EnvironmentError("device: interrupted");
  return good ? 0 : 1;
}

}  // namespace sulcus
