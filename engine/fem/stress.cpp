#include "engine/fem/stress.h"

#include <omp.h>

#include <Eigen/LU>
#include <algorithm>

#include "engine/fem/kernels.h"
#include "engine/fem/rotation.h"
#include "engine/numerics/team.h"

namespace sulcus {
namespace {

double rest_value(const ElementData& elements, std::int64_t element, int component) {
  constexpr std::int64_t lanes = ElementData::lanes;
  return elements
      .rest_double[static_cast<std::size_t>((element / lanes * 12 + component) * lanes + element % lanes)];
}

bool present(std::span<const std::uint8_t> alive, std::int64_t element) {
  return alive.empty() || alive[static_cast<std::size_t>(element)] != 0;
}

}  // namespace

Mat3 deformation_gradient(const ElementData& elements, std::span<const Vec3> rest,
                          std::span<const double> positions, std::int64_t element) {
  constexpr std::int64_t lanes = ElementData::lanes;
  Vec3 displacement[4];
  for (int a = 0; a < 4; ++a) {
    const auto node = static_cast<std::size_t>(
        elements.nodes[static_cast<std::size_t>((element / lanes * 4 + a) * lanes + element % lanes)]);
    displacement[a] =
        Vec3(positions[3 * node], positions[3 * node + 1], positions[3 * node + 2]) - rest[node];
  }
  Mat3 f = Mat3::Identity();
  for (int a = 1; a < 4; ++a) {
    const Vec3 g(rest_value(elements, element, 3 * a - 3), rest_value(elements, element, 3 * a - 2),
                 rest_value(elements, element, 3 * a - 1));
    f += (displacement[a] - displacement[0]) * g.transpose();
  }
  return f;
}

double elastic_energy(const ElementData& elements, std::span<const double> positions,
                      std::span<const double> rotations, std::span<const std::uint8_t> alive, int threads) {
  constexpr std::int64_t batch = 1024;  // blocks whose sums are kept at a time, without allocation
  double sums[batch];
  EnergyPass pass;
  pass.count = elements.count;
  pass.nodes = elements.nodes.data();
  pass.rest = elements.rest_double.data();
  pass.positions = positions.data();
  pass.rotations = rotations.data();
  pass.alive = alive.empty() ? nullptr : alive.data();
  pass.linear = elements.linear.empty() ? nullptr : elements.linear.data();
  const auto kernel = fem_kernels<double>(widest_isa()).energy_pass;
  const std::int64_t blocks = (elements.count + ElementData::lanes - 1) / ElementData::lanes;
  double total = 0;
  for (std::int64_t first = 0; first < blocks; first += batch) {
    const std::int64_t count = std::min(batch, blocks - first);
#pragma omp parallel num_threads(threads) firstprivate(pass)
    {
      const Range own = share(count, omp_get_thread_num(), threads);
      pass.sums = sums + own.first;
      kernel(pass, first + own.first, first + own.last);
    }
    for (std::int64_t b = 0; b < count; ++b) total += sums[b];
  }
  return total;
}

std::vector<double> largest_principal_stress(const ElementData& elements, std::span<const Vec3> rest,
                                             std::span<const double> positions,
                                             std::span<const std::uint8_t> alive) {
  std::vector<double> stress(static_cast<std::size_t>(elements.count), 0.0);
#pragma omp parallel for schedule(static)
  for (std::int64_t e = 0; e < elements.count; ++e) {
    if (!present(alive, e)) continue;
    const Vec3 s = signed_svd(deformation_gradient(elements, rest, positions, e)).s;
    const double volume = rest_value(elements, e, 11);
    const double lambda = rest_value(elements, e, 9) / volume;
    const double mu = rest_value(elements, e, 10) / volume;
    stress[static_cast<std::size_t>(e)] = 2 * mu * (s[0] - 1) + lambda * (s[0] + s[1] + s[2] - 3);
  }
  return stress;
}

std::int64_t count_inverted_elements(const ElementData& elements, std::span<const Vec3> rest,
                                     std::span<const double> positions, std::span<const std::uint8_t> alive) {
  std::int64_t inverted = 0;
  for (std::int64_t e = 0; e < elements.count; ++e) {
    if (present(alive, e) && !(deformation_gradient(elements, rest, positions, e).determinant() > 0))
      ++inverted;
  }
  return inverted;
}

}  // namespace sulcus
