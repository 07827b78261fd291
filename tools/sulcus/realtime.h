// What the operating system grants to a session, and what it does not: told, never assumed.
#pragma once

#include <string>

namespace sulcus {

inline constexpr int servo_priority = 80;  // of SCHED_FIFO, above everything that is not the system's

// For the calling thread, unless it has this or more already. False: not permitted.
bool schedule_realtime(int priority);

// Keeps all memory of the process in place, now and later. Only where no limit could make a later allocation
// fail. Returns "" or why not.
std::string lock_memory();
void unlock_memory();

// Seconds of std::chrono::steady_clock.
double steady_now_s();
// Sleeps until then; returns early if a signal came.
void sleep_until_s(double steady_s);

}  // namespace sulcus
