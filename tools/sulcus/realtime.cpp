#include "tools/sulcus/realtime.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>

namespace sulcus {

bool schedule_realtime(int priority) {
  int policy = SCHED_OTHER;
  sched_param present{};
  const bool higher_already = pthread_getschedparam(pthread_self(), &policy, &present) == 0 &&
                              (policy == SCHED_FIFO || policy == SCHED_RR) &&
                              present.sched_priority >= priority;
  if (higher_already) return true;  // a driver's own choice
  sched_param parameter{};
  parameter.sched_priority = priority;
  return pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter) == 0;
}

std::string lock_memory() {
  rlimit limit{};
  const bool unlimited = getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
  if (!unlimited && geteuid() != 0) return "the limit on locked memory is too low (ulimit -l)";
  return mlockall(MCL_CURRENT | MCL_FUTURE) == 0 ? "" : std::strerror(errno);
}

void unlock_memory() {
  munlockall();
}

double steady_now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void sleep_until_s(double steady_s) {
  // the steady clock is CLOCK_MONOTONIC
  const double whole_s = std::floor(steady_s);
  const timespec until{static_cast<time_t>(whole_s), static_cast<long>((steady_s - whole_s) * 1e9)};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

}  // namespace sulcus
