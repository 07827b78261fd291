#include "engine/volume/large_array.h"

#include <cstdint>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace sulcus {

namespace {

// Whole large pages [low, high) of a piece of memory.
constexpr std::uintptr_t page = std::uintptr_t{2} << 20;
struct Pages {
  Pages(void* begin, std::size_t bytes)
      : low((reinterpret_cast<std::uintptr_t>(begin) + page - 1) & ~(page - 1)),
        high((reinterpret_cast<std::uintptr_t>(begin) + bytes) & ~(page - 1)) {}
  std::uintptr_t low, high;
};

}  // namespace

void ask_large_pages(void* begin, std::size_t bytes) {
  const Pages pages(begin, bytes);
#if defined(__linux__) && defined(MADV_HUGEPAGE)
  if (pages.high > pages.low) {  // refusal changes speed alone
    (void)madvise(reinterpret_cast<void*>(pages.low), pages.high - pages.low, MADV_HUGEPAGE);
  }
#endif
}

void prepare_large(void* begin, std::size_t bytes) {
  ask_large_pages(begin, bytes);
  const Pages pages(begin, bytes);
  const auto count =
      pages.high > pages.low ? static_cast<std::ptrdiff_t>((pages.high - pages.low) / page) : 0;
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t p = 0; p < count; ++p) {
    *reinterpret_cast<volatile char*>(pages.low + static_cast<std::uintptr_t>(p) * page) = 0;
  }
}

}  // namespace sulcus
