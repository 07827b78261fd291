// A session on the stand-in, in real time, that ends as its argument says while the motors push: for
// exit_test.cpp.
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <exception>

#include "hw_phantom/emergency.h"
#include "hw_phantom/standin_access.h"

namespace {

// What the servo does instead of rendering, once it is set.
std::atomic<int> servo_signal{0};

sulcus::DeviceCommand push_until_told(void*, const sulcus::DeviceSample& sample) {
  if (const int number = servo_signal.load(); number != 0) std::raise(number);
  return {{0.5, 0, 0}, sulcus::Vec3::Zero(), sample.time_s + 1};
}

// Overflows the stack: 4 kB a level.
int deeper(int levels) {
  volatile char here[4096];
  here[0] = 1;
  return levels == 0 ? 0 : deeper(levels - 1) + here[0];
}

}  // namespace

int main(int, char** argv) {
  using namespace sulcus;
  const char* ending = argv[1];
  const auto is = [&](const char* word) { return std::strcmp(ending, word) == 0; };
  standin_control().reset(false);
  PhantomSettings settings;
  settings.library = standin_path();
  settings.safety.soft_start_s = 0.01;
  settings.safety.watchdog_s = 1e6;  // the last command would stay
  settings.skip_disable = is("skip_disable");
  static const auto device = make_phantom_device(settings);
  const bool in_servo = std::strncmp(ending, "servo_", 6) == 0;
  if (in_servo) device->set_servo(push_until_told, nullptr);
  device->open();
  device->calibrate();
  device->arm();
  device->write({{0.5, 0, 0}, Vec3::Zero(), 1e9});
  while (observe().force_N[0] < 0.4) settings.clock.sleep_s(0.001);

  standin::Faults faults{};
  faults.abort_on_disable = settings.skip_disable;
  standin_control().set_faults(&faults);
  if (is("exit") || settings.skip_disable) return 0;
  if (is("abort")) std::abort();
  if (is("terminate")) std::terminate();
  if (is("segv")) std::raise(SIGSEGV);
  if (is("overflow")) return deeper(1 << 30);
  if (is("int")) std::raise(SIGINT);
  if (is("term")) std::raise(SIGTERM);
  if (is("quit")) std::raise(SIGQUIT);
  if (is("file_size")) std::raise(SIGXFSZ);
  if (is("servo_abort")) servo_signal.store(SIGABRT);
  if (is("servo_segv")) servo_signal.store(SIGSEGV);
  if (in_servo) settings.clock.sleep_s(5);
  if (is("halt")) {
    std::raise(SIGTSTP);
    // goes on here: the force comes back softly
    while (observe().force_N[0] < 0.4) settings.clock.sleep_s(0.001);
    return 0;
  }
  if (is("pipe")) {
    int ends[2];
    if (pipe(ends) != 0) return 98;
    close(ends[0]);
    return write(ends[1], "x", 1) == -1 ? 0 : 97;
  }
  return 99;
}
