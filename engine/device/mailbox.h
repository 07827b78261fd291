// The latest value of something, handed from one thread to one other without a lock: commands to the servo,
// samples from it.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace sulcus {

// Triple buffer: the writer fills one slot, the reader holds another, the third carries the newest value
// between them. write() and read() never wait, never allocate, and a value is never torn. One writer, one
// reader thread; copying a Value must not allocate or throw. Values that were overwritten before a read are
// lost (that is meant).
template <class Value>
class Mailbox {
  static_assert(std::is_trivially_destructible_v<Value>, "a value must be plain data");

 public:
  void write(const Value& value) {
    slots_[back_].value = value;
    back_ = middle_.exchange(back_ | fresh, std::memory_order_acq_rel) & index;
  }

  // Copies the newest value; false (and `value` untouched) if nothing was written since the read before.
  bool read(Value& value) {
    if ((middle_.load(std::memory_order_relaxed) & fresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & index;
    value = slots_[front_].value;
    return true;
  }

 private:
  static constexpr std::uint32_t index = 3, fresh = 4;
  struct alignas(64) Slot {  // a cache line of its own: the threads do not disturb each other
    Value value;
  };

  std::array<Slot, 3> slots_{};
  alignas(64) std::uint32_t back_ = 0;                 // the writer's
  alignas(64) std::atomic<std::uint32_t> middle_ = 1;  // slot number, `fresh` if it was not read yet
  alignas(64) std::uint32_t front_ = 2;                // the reader's
};

}  // namespace sulcus
