// Compiled once for each instruction set; see CMakeLists.txt.
#include "engine/fracture/kernels.h"

#include "engine/numerics/lanes.h"

namespace sulcus::SULCUS_ISA_NAMESPACE {
namespace {

constexpr int lanes = 16;

enum class Bound { tensile, absolute };

template <Bound bound>
void stress_bounds(const StressBoundPass& pass, std::int64_t first, std::int64_t last) {
  using V = Lanes<float>;
  const auto four = [&](std::int32_t node) {
    return load<Four<double>>(pass.positions + 3 * static_cast<std::int64_t>(node));
  };
  const auto three = [&](std::int32_t node) {
    const double* x = pass.positions + 3 * static_cast<std::int64_t>(node);
    return Four<double>{x[0], x[1], x[2], 0};
  };
  std::int32_t in_order[lanes];
  for (int l = 0; l < lanes; ++l) in_order[l] = l;
  for (std::int64_t w = first; w < last; ++w) {
    const std::int64_t block = pass.wanted[w];
    // edges of the deformed elements, x_a - x_0
    alignas(64) float edges[3][lanes][4];
    const std::int32_t* nodes = pass.nodes + block * 4 * lanes;
    const auto fill = [&](const auto& place) {
      for (int l = 0; l < lanes; ++l) {
        const Four<double> x0 = place(nodes[l]);
        for (int a = 0; a < 3; ++a)
          store(edges[a][l], __builtin_convertvector(place(nodes[(a + 1) * lanes + l]) - x0, Four<float>));
      }
    };
    std::int32_t largest = 0;  // behind the last node there is no fourth number
    for (int k = 0; k < 4 * lanes; ++k) largest = nodes[k] > largest ? nodes[k] : largest;
    if (largest + 1 == pass.nodes_count) {
      fill(three);
    } else {
      fill(four);
    }
    const float* rest = pass.rest + block * 12 * lanes;
    for (int l = 0; l < lanes; l += lane_count<float>) {
      const auto component = [&](int c) { return load<V>(rest + c * lanes + l); };
      V d[3][3], f[3][3];
      for (int a = 0; a < 3; ++a) gather<float>(&edges[a][0][0], 4, in_order + l, d[a][0], d[a][1], d[a][2]);
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j)
          f[i][j] = d[0][i] * component(j) + d[1][i] * component(3 + j) + d[2][i] * component(6 + j);
      }
      const auto c = [&](int i, int j) { return f[0][i] * f[0][j] + f[1][i] * f[1][j] + f[2][i] * f[2][j]; };
      const V c00 = c(0, 0), c11 = c(1, 1), c22 = c(2, 2), c01 = c(0, 1), c12 = c(1, 2), c20 = c(2, 0);
      const V volume = component(11);
      const V lambda = component(9) / volume, mu = component(10) / volume;
      const V shear = 2.0F * (c01 * c01 + c12 * c12 + c20 * c20);
      if constexpr (bound == Bound::tensile) {
        const V trace = c00 + c11 + c22, mean = trace / 3.0F;
        const V d0 = c00 - mean, d1 = c11 - mean, d2 = c22 - mean;
        const V spread = square_root<float>((d0 * d0 + d1 * d1 + d2 * d2 + shear) * (2.0F / 3.0F));
        store(pass.bounds + block * lanes + l, mu * (mean + spread - 1.0F) + lambda * (trace - 3.0F) * 0.5F);
      } else {
        const V d0 = c00 - 1.0F, d1 = c11 - 1.0F, d2 = c22 - 1.0F;
        const V strain = square_root<float>(d0 * d0 + d1 * d1 + d2 * d2 + shear);
        const V det = f[0][0] * (f[1][1] * f[2][2] - f[1][2] * f[2][1]) -
                      f[0][1] * (f[1][0] * f[2][2] - f[1][2] * f[2][0]) +
                      f[0][2] * (f[1][0] * f[2][1] - f[1][1] * f[2][0]);
        alignas(64) float numbers[lane_count<float>], dets[lane_count<float>];
        store(numbers, (2.0F * mu + 1.7320509F * lambda) * strain);
        store(dets, det);
        for (int k = 0; k < lane_count<float>; ++k) {
          pass.bounds[block * lanes + l + k] = dets[k] > 0 ? numbers[k] : __builtin_inff();
        }
      }
    }
  }
}

}  // namespace

FractureKernels fracture_table() {
  return {stress_bounds<Bound::tensile>, stress_bounds<Bound::absolute>};
}

}  // namespace sulcus::SULCUS_ISA_NAMESPACE
