// The last resort: no device gets a force any more, whatever the rest of the process does.
#pragma once

namespace sulcus {

// From now on every servo tick of every Phantom sends zero. Safe in a signal handler; cannot be taken back
// but by allow_forces() (for the next session of the same process).
void stop_all_forces() noexcept;
void allow_forces() noexcept;
bool forces_stopped() noexcept;

// Signals, from now on, where nobody handles or ignores them:
//   those that end a process (a crash, an abort, Ctrl-C, Ctrl-\, a closed terminal, a limit of the system)
//                   stop all forces, give the servo 10 ms to send the zero, and then take their usual course
//   those that halt it (Ctrl-Z)  likewise; when the process goes on, forces start softly again
//   SIGPIPE         is ignored: a reader of the program's output that goes away ends nothing
// Programs that handle SIGINT themselves call stop_all_forces() there. The calling thread gets a stack of its
// own for these handlers, so that one that overflows its stack is caught as well. Calling it again does
// nothing. SIGKILL and SIGSTOP cannot be caught.
void stop_forces_on_signals() noexcept;

// For the thread of a servo, called in it: signals that are meant for the process as a whole are handled by
// the others, since this one must go on to send the zero.
void keep_signals_from_this_thread() noexcept;

// While it lives, a crash of this thread (the servo's, which nobody would tick any more) calls say(user)
// before the process ends. Not for code of the driver itself, which might be met halfway.
class LastWord {
 public:
  LastWord(void (*say)(void* user), void* user) noexcept;
  ~LastWord();
  LastWord(const LastWord&) = delete;
  LastWord& operator=(const LastWord&) = delete;
};

}  // namespace sulcus
