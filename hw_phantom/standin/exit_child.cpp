// A session on the stand-in, in real time, that ends as its argument says while the motors push: for
// exit_test.cpp.
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <exception>

#include "hw_phantom/emergency.h"
#include "hw_phantom/standin_access.h"

int main(int, char** argv) {
  using namespace sulcus;
  const char* ending = argv[1];
  standin_control().reset(false);
  PhantomSettings settings;
  settings.library = standin_path();
  settings.safety.soft_start_s = 0.01;
  settings.safety.watchdog_s = 1e6;  // the last command would stay
  settings.skip_disable = std::strcmp(ending, "skip_disable") == 0;
  static const auto device = make_phantom_device(settings);
  device->open();
  device->calibrate();
  device->arm();
  device->write({{0.5, 0, 0}, Vec3::Zero(), 1e9});
  while (observe().force_N[0] < 0.4) settings.clock.sleep_s(0.001);

  standin::Faults faults{};
  faults.abort_on_disable = settings.skip_disable;
  standin_control().set_faults(&faults);
  if (std::strcmp(ending, "exit") == 0 || settings.skip_disable) return 0;
  if (std::strcmp(ending, "abort") == 0) std::abort();
  if (std::strcmp(ending, "terminate") == 0) std::terminate();
  if (std::strcmp(ending, "segv") == 0) std::raise(SIGSEGV);
  if (std::strcmp(ending, "int") == 0) std::raise(SIGINT);
  if (std::strcmp(ending, "term") == 0) std::raise(SIGTERM);
  return 99;
}
