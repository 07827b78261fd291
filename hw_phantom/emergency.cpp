#include "hw_phantom/emergency.h"

#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <ctime>

namespace sulcus {
namespace {

std::atomic<bool> stopped{false}, halted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "used in a signal handler");

using Word = void (*)(void* user);
thread_local constinit Word last_word = nullptr;
thread_local constinit void* last_word_user = nullptr;

constexpr int crashes[] = {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGSYS, SIGTRAP};
constexpr int endings[] = {SIGINT,  SIGTERM, SIGHUP,  SIGQUIT,   SIGALRM, SIGUSR1, SIGUSR2,
                           SIGXCPU, SIGXFSZ, SIGPROF, SIGVTALRM, SIGIO,   SIGPWR};
constexpr int halts[] = {SIGTSTP, SIGTTIN, SIGTTOU};

// Ten servo ticks: the zero reaches the motors even from a slow scheduler.
void give_the_servo_time() {
  timespec left{0, 10'000'000};
  while (nanosleep(&left, &left) != 0) {
  }
}

void take_the_usual_course(int signal_number) {
  struct sigaction usual {};
  usual.sa_handler = SIG_DFL;
  sigaction(signal_number, &usual, nullptr);
  raise(signal_number);
}

extern "C" void stop_and_end(int signal_number) {
  stop_all_forces();
  if (last_word != nullptr) {
    // Should the driver not come back from this, the alarm ends the process.
    struct sigaction usual {};
    usual.sa_handler = SIG_DFL;
    sigaction(SIGALRM, &usual, nullptr);
    alarm(1);
    const Word say = last_word;
    last_word = nullptr;
    say(last_word_user);
  }
  give_the_servo_time();
  take_the_usual_course(signal_number);
}

extern "C" void stop_and_halt(int) {
  halted.store(true, std::memory_order_relaxed);
  give_the_servo_time();
  kill(getpid(), SIGSTOP);  // returns when the process goes on
  halted.store(false, std::memory_order_relaxed);
}

void set_where_unhandled(int signal_number, void (*handler)(int), int flags) {
  struct sigaction present {};
  if (sigaction(signal_number, nullptr, &present) != 0) return;
  const bool unhandled = (present.sa_flags & SA_SIGINFO) == 0 && present.sa_handler == SIG_DFL;
  if (!unhandled) return;
  struct sigaction ours {};
  ours.sa_handler = handler;
  ours.sa_flags = flags;
  sigemptyset(&ours.sa_mask);
  sigaction(signal_number, &ours, nullptr);
}

// One such stack: for the first thread that asks and has none.
void give_this_thread_a_signal_stack() {
  static std::atomic_flag given = ATOMIC_FLAG_INIT;
  alignas(16) static char memory[1 << 16];
  stack_t present{};
  if (sigaltstack(nullptr, &present) != 0 || (present.ss_flags & SS_DISABLE) == 0 || given.test_and_set())
    return;
  stack_t ours{};
  ours.ss_sp = memory;
  ours.ss_size = sizeof memory;
  sigaltstack(&ours, nullptr);
}

}  // namespace

void stop_all_forces() noexcept {
  stopped.store(true, std::memory_order_relaxed);
}
void allow_forces() noexcept {
  stopped.store(false, std::memory_order_relaxed);
}
bool forces_stopped() noexcept {
  return stopped.load(std::memory_order_relaxed) || halted.load(std::memory_order_relaxed);
}

void stop_forces_on_signals() noexcept {
  give_this_thread_a_signal_stack();
  for (const int number : crashes) set_where_unhandled(number, stop_and_end, SA_ONSTACK);
  for (const int number : endings) set_where_unhandled(number, stop_and_end, 0);
  for (const int number : halts) set_where_unhandled(number, stop_and_halt, SA_RESTART);
  set_where_unhandled(SIGPIPE, SIG_IGN, 0);
}

void keep_signals_from_this_thread() noexcept {
  sigset_t blocked;
  sigemptyset(&blocked);
  // Only what people and shells send: the driver may need others for itself.
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGTSTP, SIGTTIN, SIGTTOU})
    sigaddset(&blocked, number);
  pthread_sigmask(SIG_BLOCK, &blocked, nullptr);
}

LastWord::LastWord(Word say, void* user) noexcept {
  last_word_user = user;
  last_word = say;
}
LastWord::~LastWord() {
  last_word = nullptr;
}

}  // namespace sulcus
