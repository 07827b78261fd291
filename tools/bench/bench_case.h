// A body in the state that the figures of the field are measured in: twisted by 0.8 rad and bent, bottom
// held, at rest otherwise; E = 1000 Pa, nu = 0.45, rho = 1000 kg/m^3, h = 1/30 s, beta = 0.1 s.
#pragma once

#include <cmath>
#include <memory>
#include <string>

#include "engine/fem/assembly.h"
#include "engine/solver/conjugate_gradients.h"

namespace sulcus {

inline constexpr StepCoefficients bench_step{1.0 / 30, {0, 0.1}};

struct BenchBody {
  std::string name;
  EmbeddingMesh mesh;
  ElementData elements;
  Sparsity sparsity;
  std::vector<double> positions, velocities;
  std::vector<std::uint8_t> free_node;
};

inline BenchBody make_bench_body(std::string name, EmbeddingMesh mesh) {
  BenchBody body{std::move(name), std::move(mesh), {}, {}, {}, {}, {}};
  const Material material{1000, 0.45, 1000};
  const std::vector<std::int32_t> numbers(body.mesh.tets.size(), 0);
  body.elements = build_elements(body.mesh, std::span(&material, 1), numbers);
  body.sparsity = build_sparsity(body.mesh);
  Vec3 low = body.mesh.rest_positions.front(), high = low;
  for (const Vec3& x : body.mesh.rest_positions) {
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  const double height = high[2] - low[2];
  for (const Vec3& rest : body.mesh.rest_positions) {
    const Vec3 x = rest - low;
    const double angle = 0.8 * x[2] / height;
    const double c = std::cos(angle), s = std::sin(angle);
    body.positions.insert(body.positions.end(), {low[0] + c * x[0] - s * x[1] + 0.1 * x[2] * x[2] / height,
                                                 low[1] + s * x[0] + c * x[1], rest[2]});
    body.free_node.push_back(x[2] > 0.02 * height);
  }
  body.velocities.assign(body.positions.size(), 0.0);
  return body;
}

template <class Real>
struct BenchCase {
  const BenchBody& body;
  SystemMatrix<Real> system;
  SolverWorkspace<Real> solver;
  std::vector<double> rotations, forces;

  BenchCase(const BenchBody& of, int threads)
      : body(of),
        system(make_system_matrix<Real>(of.elements, of.sparsity, widest_isa(), threads)),
        solver(make_solver_workspace<Real>(of.sparsity, widest_isa(), threads)),
        rotations(4 * of.mesh.tets.size(), 0.0),
        forces(of.positions.size()) {
    for (std::size_t t = 0; t < of.mesh.tets.size(); ++t) rotations[4 * t] = 1;
    assemble();
    for (std::size_t n = 0; n < of.free_node.size(); ++n) {
      const auto slot = static_cast<std::size_t>(of.sparsity.slot_of_node[n]);
      for (std::size_t d = 0; d < 3; ++d) {
        solver.b[(slot / 16 * 3 + d) * 16 + slot % 16] =
            static_cast<Real>(-bench_step.step_s * forces[3 * n + d]);
      }
    }
  }

  // Rotations, matrix, right-hand side and inverses of the diagonal blocks.
  void assemble() {
    assemble_elements<Real>(body.elements, body.sparsity, bench_step, body.mesh.rest_positions,
                            body.positions, body.velocities, {}, rotations, system);
    elastic_forces<Real>(body.elements, system, forces);
    finish_rows<Real>(body.sparsity, body.free_node, system);
  }

  RowMatrix<Real> matrix() const {
    return {body.sparsity.chunks, body.sparsity.chunk_start.data(), body.sparsity.column.data(),
            system.values.data(), system.diagonal.data(),           system.inverse.data()};
  }
};

// |a - b| / |b|.
template <class Some, class Other>
double relative_difference(const Some& a, const Other& b) {
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a[i]) - static_cast<double>(b[i]);
    difference += d * d;
    size += static_cast<double>(b[i]) * static_cast<double>(b[i]);
  }
  return std::sqrt(difference / size);
}

}  // namespace sulcus
