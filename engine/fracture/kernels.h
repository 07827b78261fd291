// The hot loop of the fracture criterion, compiled once for each instruction set (engine/numerics/isa.h).
#pragma once

#include <cstdint>

#include "engine/numerics/isa.h"

namespace sulcus {

struct StressBoundPass {
  const std::int32_t* nodes = nullptr;  // ElementData::nodes
  const float* rest = nullptr;          // ElementData::rest_single
  std::int64_t nodes_count = 0;
  const double* positions = nullptr;     // [3*nodes_count], m
  const std::int32_t* wanted = nullptr;  // blocks of 16 elements
  float* bounds = nullptr;               // [16*blocks], Pa; out, for wanted blocks
};

// Upper bounds of a stress that need neither rotation nor eigenvalues, for the wanted blocks [first,
// last). With C = F^T F, its trace t, m = t / 3 and d = |C - m I|:
//   tensile   largest principal stress <= mu (m + sqrt(2/3) d - 1) + lambda (t - 3) / 2, since s <= (s^2 + 1)
//   / 2
//             for every stretch s; lambda >= 0
//   absolute  any |principal stress| <= (2 mu + sqrt(3) lambda) |C - I|, infinite where det F <= 0
// Within a few roundings of single precision; differences of positions are formed in double.
struct FractureKernels {
  void (*tensile_bounds)(const StressBoundPass&, std::int64_t first, std::int64_t last) = nullptr;
  void (*absolute_bounds)(const StressBoundPass&, std::int64_t first, std::int64_t last) = nullptr;
};

FractureKernels fracture_kernels(Isa isa);

}  // namespace sulcus
