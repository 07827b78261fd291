// The state of the processor's floating-point unit that the bits depend on.
#pragma once

#include <xmmintrin.h>

namespace sulcus {

// Whether this thread rounds to nearest, keeps subnormal numbers and traps nothing: the default, which a
// library linked with -ffast-math changes silently, for all threads that start later too.
inline bool default_float_environment() {
  constexpr unsigned flags_of_past_operations = 0x3f;
  return (_mm_getcsr() & ~flags_of_past_operations) == 0x1f80;
}

}  // namespace sulcus
