// Instruction sets. The hot kernels are compiled once for each of these and chosen at run time; all give the
// same bits, since none uses fused multiply-add and no result depends on the width of a register.
#pragma once

namespace sulcus {

enum class Isa { sse2, avx2, avx512 };

Isa widest_isa();               // of this processor
const char* isa_name(Isa isa);  // "sse2", "avx2", "avx512"

}  // namespace sulcus
