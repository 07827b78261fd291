// Records of any size from one thread to one other without a lock: what the servo and the engine hand to the
// recorder, which must never hold them up.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

namespace sulcus {

// A ring of bytes. push() and drain() never wait on each other; one writer, one reader thread. A record that
// does not fit is not taken: it is counted, and the writer goes on.
class RecordRing {
 public:
  // bytes: rounded up to a power of two; touched now, so that no page is missing later.
  explicit RecordRing(std::size_t bytes) {
    std::size_t size = 64;
    while (size < bytes) size *= 2;
    bytes_.assign(size, std::byte{0});
  }

  // Takes size (32 bits) and content of the record, or nothing. Does not allocate or wait.
  bool push(std::span<const std::byte> record) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    const std::uint64_t used = head - tail_.load(std::memory_order_acquire);
    const auto size = static_cast<std::uint32_t>(record.size());
    if (record.size() > UINT32_MAX || used + sizeof size + record.size() > bytes_.size()) {
      lost_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    std::array<std::byte, sizeof size> prefix;
    std::memcpy(prefix.data(), &size, sizeof size);
    put(head, prefix);
    put(head + sizeof size, record);
    head_.store(head + sizeof size + record.size(), std::memory_order_release);
    return true;
  }

  // Appends all whole records, each behind its size, to `out`. Returns their bytes.
  std::size_t drain(std::vector<std::byte>& out) {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    const auto count = static_cast<std::size_t>(head_.load(std::memory_order_acquire) - tail);
    const std::size_t at = static_cast<std::size_t>(tail) & (bytes_.size() - 1);
    const std::size_t first = std::min(count, bytes_.size() - at);
    const auto begin = bytes_.begin() + static_cast<std::ptrdiff_t>(at);
    out.insert(out.end(), begin, begin + static_cast<std::ptrdiff_t>(first));
    out.insert(out.end(), bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(count - first));
    tail_.store(tail + count, std::memory_order_release);
    return count;
  }

  std::uint64_t lost() const { return lost_.load(std::memory_order_relaxed); }  // records not taken
  std::size_t capacity() const { return bytes_.size(); }                        // bytes

 private:
  void put(std::uint64_t position, std::span<const std::byte> data) noexcept {
    const std::size_t at = static_cast<std::size_t>(position) & (bytes_.size() - 1);
    const std::size_t first = std::min(data.size(), bytes_.size() - at);
    if (first > 0) std::memcpy(bytes_.data() + at, data.data(), first);
    if (data.size() > first) std::memcpy(bytes_.data(), data.data() + first, data.size() - first);
  }

  std::vector<std::byte> bytes_;
  alignas(64) std::atomic<std::uint64_t> head_ = 0;  // bytes ever written; the writer's
  alignas(64) std::atomic<std::uint64_t> tail_ = 0;  // bytes ever read; the reader's
  alignas(64) std::atomic<std::uint64_t> lost_ = 0;
};

}  // namespace sulcus
