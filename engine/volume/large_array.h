// Arrays of a number a voxel. Where the system maps memory in small pages on first touch, that mapping alone
// can cost more than all work done on the array (measured: 190 ms for 64 MiB in a virtual machine, 6 ms with
// large pages), so large arrays ask for large pages before they are touched. A wish only: results do not
// depend on it.
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace sulcus {

// Asks for large pages for memory that holds nothing yet; small arrays are left.
void ask_large_pages(void* begin, std::size_t bytes);

// The same, and touches the memory with all threads.
void prepare_large(void* begin, std::size_t bytes);

template <class T>
std::vector<T> large_vector(std::size_t count, T value) {
  std::vector<T> array;
  array.reserve(count);
  prepare_large(array.data(), count * sizeof(T));
  array.assign(count, value);
  return array;
}

// A vector in large pages that leaves new elements of plain types without a value, so that those who write
// them touch the memory first.
template <class T>
struct LargeAllocator : std::allocator<T> {
  using value_type = T;
  template <class U>
  struct rebind {
    using other = LargeAllocator<U>;
  };
  T* allocate(std::size_t count) {
    T* begin = std::allocator<T>::allocate(count);
    ask_large_pages(begin, count * sizeof(T));
    return begin;
  }
  template <class U>
  void construct(U* place) {
    ::new (static_cast<void*>(place)) U;
  }
  template <class U, class... Arguments>
  void construct(U* place, Arguments&&... arguments) {
    ::new (static_cast<void*>(place)) U(std::forward<Arguments>(arguments)...);
  }
};
template <class T>
using LargeVector = std::vector<T, LargeAllocator<T>>;

}  // namespace sulcus
