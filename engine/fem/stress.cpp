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

namespace {

// Elastic energy of a block of 16 elements, one after the other. With the polar rotation R, |S - I|^2 is
// |F - R|^2 and tr(S - I) is R : F - 3.
void block_energies(const ElementData& elements, std::span<const double> positions,
                    std::span<const double> rotations, std::int64_t block, bool held, double* energy) {
  constexpr std::int64_t lanes = ElementData::lanes;
  double edges[9][lanes], turn[9][lanes], gradient[9][lanes], strain[lanes] = {}, trace[lanes] = {};
  const std::int32_t* nodes = &elements.nodes[static_cast<std::size_t>(block * 4 * lanes)];
  const double* rest = &elements.rest_double[static_cast<std::size_t>(block * 12 * lanes)];
  for (std::int64_t l = 0; l < lanes; ++l) {
    const std::int64_t element = std::min(block * lanes + l, elements.count - 1);
    const double* q = &rotations[static_cast<std::size_t>(4 * element)];
    const Mat3 r = rotation_matrix({q[0], q[1], q[2], q[3]});
    const double* x0 = &positions[3 * static_cast<std::size_t>(nodes[l])];
    for (int a = 1; a < 4; ++a) {
      const double* x = &positions[3 * static_cast<std::size_t>(nodes[a * lanes + l])];
      for (int i = 0; i < 3; ++i) {
        edges[3 * (a - 1) + i][l] = x[i] - x0[i];
        turn[3 * (a - 1) + i][l] = r(a - 1, i);
      }
    }
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (std::int64_t l = 0; l < lanes; ++l) {
        const double f = edges[i][l] * rest[j * lanes + l] + edges[3 + i][l] * rest[(3 + j) * lanes + l] +
                         edges[6 + i][l] * rest[(6 + j) * lanes + l];
        gradient[3 * i + j][l] = f;
        const double difference = f - turn[3 * i + j][l];
        strain[l] += difference * difference;
        trace[l] += difference * turn[3 * i + j][l];
      }
    }
  }
  // plain linear elements: R = I is not the polar rotation, and the skew part of F - I is no strain
  for (std::int64_t l = 0; !elements.linear.empty() && !held && l < lanes; ++l) {
    if (!elements.linear[static_cast<std::size_t>(block * lanes + l)]) continue;
    for (int i = 0; i < 3; ++i) {
      for (int j = i + 1; j < 3; ++j) {
        const double skew = gradient[3 * i + j][l] - gradient[3 * j + i][l];
        strain[l] -= 0.5 * skew * skew;
      }
    }
  }
  // nor is it strain where the rotation is not the polar one: take the skew part of R^T F away
  for (int i = 0; held && i < 3; ++i) {
    for (int j = i + 1; j < 3; ++j) {
      for (std::int64_t l = 0; l < lanes; ++l) {
        double skew = 0;
        for (int k = 0; k < 3; ++k)
          skew += turn[3 * k + i][l] * gradient[3 * k + j][l] - turn[3 * k + j][l] * gradient[3 * k + i][l];
        strain[l] -= 0.5 * skew * skew;
      }
    }
  }
  for (std::int64_t l = 0; l < lanes; ++l) {
    energy[l] = rest[10 * lanes + l] * strain[l] + 0.5 * rest[9 * lanes + l] * trace[l] * trace[l];
  }
}

// As elastic_energy, where each element has a weight of its own or the rotations are held.
double weighted_energy(const ElementData& elements, std::span<const double> positions,
                       std::span<const double> rotations, std::span<const std::uint8_t> alive, int threads,
                       std::span<const double> weights, bool held) {
  constexpr std::int64_t lanes = ElementData::lanes;
  const std::int64_t blocks = (elements.count + lanes - 1) / lanes;
  constexpr std::int64_t batch = 1024;  // blocks whose sums are kept at a time, without allocation
  double total = 0;
  for (std::int64_t first = 0; first < blocks; first += batch) {
    double sums[batch] = {};
    const std::int64_t last = std::min(first + batch, blocks);
#pragma omp parallel for num_threads(threads) schedule(static)
    for (std::int64_t b = first; b < last; ++b) {
      double energy[lanes];
      block_energies(elements, positions, rotations, b, held, energy);
      for (std::int64_t l = 0; l < std::min(lanes, elements.count - b * lanes); ++l) {
        if (!present(alive, b * lanes + l)) continue;
        sums[b - first] +=
            weights.empty() ? energy[l] : weights[static_cast<std::size_t>(b * lanes + l)] * energy[l];
      }
    }
    for (double sum : sums) total += sum;
  }
  return total;
}

}  // namespace

double elastic_energy(const ElementData& elements, std::span<const double> positions,
                      std::span<const double> rotations, std::span<const std::uint8_t> alive, int threads,
                      std::span<const double> weights, bool held) {
  if (held || !weights.empty())
    return weighted_energy(elements, positions, rotations, alive, threads, weights, held);
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
