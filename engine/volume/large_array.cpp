#include "engine/volume/large_array.h"

#include <cstdint>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace sulcus {

void prepare_large(void* begin, std::size_t bytes) {
  constexpr std::uintptr_t page = std::uintptr_t{2} << 20;
  const std::uintptr_t low = (reinterpret_cast<std::uintptr_t>(begin) + page - 1) & ~(page - 1);
  const std::uintptr_t high = (reinterpret_cast<std::uintptr_t>(begin) + bytes) & ~(page - 1);
  if (high <= low) return;
#if defined(__linux__) && defined(MADV_HUGEPAGE)
  (void)madvise(reinterpret_cast<void*>(low), high - low, MADV_HUGEPAGE);  // refusal changes speed alone
#endif
  const auto pages = static_cast<std::ptrdiff_t>((high - low) / page);
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t p = 0; p < pages; ++p) {
    *reinterpret_cast<volatile char*>(low + static_cast<std::uintptr_t>(p) * page) = 0;
  }
}

}  // namespace sulcus
