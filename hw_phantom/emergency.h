// The last resort: no device gets a force any more, whatever the rest of the process does.
#pragma once

namespace sulcus {

// From now on every servo tick of every Phantom sends zero. Safe in a signal handler; cannot be taken back
// but by allow_forces() (for the next session of the same process).
void stop_all_forces() noexcept;
void allow_forces() noexcept;
bool forces_stopped() noexcept;

// Makes SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, and SIGINT, SIGTERM, SIGHUP where nobody handles them, stop
// all forces, give the servo 10 ms to send the zero, and then take their usual course. Programs that handle
// SIGINT themselves call stop_all_forces() there. Calling it again does nothing.
void stop_forces_on_signals() noexcept;

}  // namespace sulcus
