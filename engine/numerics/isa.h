// Instruction sets. The hot kernels are compiled once for each of these and chosen at run time; all give the
// same bits, since none uses fused multiply-add and no result depends on the width of a register.
#pragma once

namespace sulcus {

enum class Isa { sse2, avx2, avx512 };

Isa widest_isa();               // of this processor
const char* isa_name(Isa isa);  // "sse2", "avx2", "avx512"

// The one of three functions that was compiled for an instruction set. Choose the function, then call it: to
// call one that was compiled for another machine would already be wrong.
template <class Function>
Function* compiled_for(Isa isa, Function* sse2, Function* avx2, Function* avx512) {
  return isa == Isa::avx512 ? avx512 : isa == Isa::avx2 ? avx2 : sse2;
}

}  // namespace sulcus
