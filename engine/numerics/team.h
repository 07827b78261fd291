// A team of threads that works through a fixed partition of the work. Results never depend on the number of
// threads: each block of work is done whole by one thread, and partial sums are combined in the order of the
// blocks.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>

namespace sulcus {

// Barrier that spins for about two microseconds and then yields, so that it neither wastes the gain of a
// second thread nor collapses when other processes hold the cores.
class SpinBarrier {
 public:
  explicit SpinBarrier(int threads) : threads_(threads), waiting_(0), generation_(0) {}

  void wait() {
    if (threads_ == 1) return;
    const std::uint32_t generation = generation_.load(std::memory_order_relaxed);
    if (waiting_.fetch_add(1, std::memory_order_acq_rel) + 1 == threads_) {
      waiting_.store(0, std::memory_order_relaxed);
      generation_.fetch_add(1, std::memory_order_release);
      return;
    }
    int spins = 0;
    while (generation_.load(std::memory_order_acquire) == generation) {
      if (++spins < 2000) {
        __builtin_ia32_pause();
      } else {
        std::this_thread::yield();
      }
    }
  }

 private:
  const int threads_;
  alignas(64) std::atomic<int> waiting_;
  alignas(64) std::atomic<std::uint32_t> generation_;
};

// The part of [0, count) that thread `thread` of `threads` does.
struct Range {
  std::int64_t first, last;
};
inline Range share(std::int64_t count, int thread, int threads) {
  return {count * thread / threads, count * (thread + 1) / threads};
}

}  // namespace sulcus
