// Replaces the global operator new of the test program that links it. In a file of its own, so that the
// compiler does not see both halves of a pair at once and mistake them for a mismatch.
#include "engine/scene/allocation_count.h"

#include <malloc.h>

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<long> allocations{0}, held{0};

void* counted(void* p) {
  ++allocations;
  if (p == nullptr) throw std::bad_alloc();
  held += static_cast<long>(malloc_usable_size(p));
  return p;
}

void give_back(void* p) {
  held -= static_cast<long>(malloc_usable_size(p));
  std::free(p);
}

}  // namespace

long sulcus::allocation_count() {
  return allocations;
}

long sulcus::bytes_held() {
  return held;
}

void* operator new(std::size_t size) {
  return counted(std::malloc(size));
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  const auto a = static_cast<std::size_t>(alignment);
  return counted(std::aligned_alloc(a, (size + a - 1) / a * a));
}
// Of std::stable_sort's buffer; left to the address sanitizer, it would be no pair with the delete below.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  void* p = std::malloc(size);
  return p == nullptr ? p : counted(p);
}
void operator delete(void* p) noexcept {
  give_back(p);
}
void operator delete(void* p, std::size_t) noexcept {
  give_back(p);
}
void operator delete(void* p, std::align_val_t) noexcept {
  give_back(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  give_back(p);
}
