#include "hw_phantom/emergency.h"

#include <csignal>
#include <ctime>

#include <atomic>

namespace sulcus {
namespace {

std::atomic<bool> stopped{false};
static_assert(std::atomic<bool>::is_always_lock_free, "used in a signal handler");

extern "C" void stop_and_resume(int signal_number) {
  stop_all_forces();
  // Ten servo ticks: the zero reaches the motors even from a slow scheduler.
  timespec left{0, 10'000'000};
  while (nanosleep(&left, &left) != 0) {
  }
  struct sigaction usual {};
  usual.sa_handler = SIG_DFL;
  sigaction(signal_number, &usual, nullptr);
  raise(signal_number);
}

}  // namespace

void stop_all_forces() noexcept {
  stopped.store(true, std::memory_order_relaxed);
}
void allow_forces() noexcept {
  stopped.store(false, std::memory_order_relaxed);
}
bool forces_stopped() noexcept {
  return stopped.load(std::memory_order_relaxed);
}

void stop_forces_on_signals() noexcept {
  for (const int number : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction present {};
    if (sigaction(number, nullptr, &present) != 0) continue;
    const bool unhandled = (present.sa_flags & SA_SIGINFO) == 0 && present.sa_handler == SIG_DFL;
    if (!unhandled) continue;
    struct sigaction ours {};
    ours.sa_handler = stop_and_resume;
    sigemptyset(&ours.sa_mask);
    sigaction(number, &ours, nullptr);
  }
}

}  // namespace sulcus
