// Arrays of a number a voxel. Where the system maps memory in small pages on first touch, that mapping alone
// can cost more than all work done on the array (measured: 190 ms for 64 MiB in a virtual machine, 6 ms with
// large pages), so large arrays ask for large pages before they are touched. A wish only: results do not
// depend on it.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

namespace sulcus {

// Asks for large pages for memory that holds nothing yet, and touches it with all threads; small arrays are
// left.
void prepare_large(void* begin, std::size_t bytes);

template <class T>
std::vector<T> large_vector(std::size_t count, T value) {
  std::vector<T> array;
  array.reserve(count);
  prepare_large(array.data(), count * sizeof(T));
  array.assign(count, value);
  return array;
}

// Scratch without initial values.
template <class T>
std::unique_ptr<T[]> large_scratch(std::size_t count) {
  std::unique_ptr<T[]> array(new T[count]);
  prepare_large(array.get(), count * sizeof(T));
  return array;
}

}  // namespace sulcus
