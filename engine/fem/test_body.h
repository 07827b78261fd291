// For tests: a body with its state, its matrix and its forces, by the engine's own assembly.
#pragma once

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <map>

#include "engine/fem/assembly.h"
#include "engine/fem/rotation.h"
#include "engine/fem/stress.h"
#include "engine/fem/test_meshes.h"

namespace sulcus {

struct Body {
  EmbeddingMesh mesh;
  ElementData elements;
  Sparsity sparsity;
  std::vector<double> positions, velocities, rotations;

  explicit Body(EmbeddingMesh m, Material material = {2000, 0.45, 1000})
      : Body(m, {material}, std::vector<std::int32_t>(m.tets.size(), 0)) {}

  Body(EmbeddingMesh m, const std::vector<Material>& materials,
       const std::vector<std::int32_t>& material_of_tet)
      : mesh(std::move(m)) {
    elements = build_elements(mesh, materials, material_of_tet);
    sparsity = build_sparsity(mesh);
    positions = flat_positions(mesh);
    velocities.assign(positions.size(), 0.0);
    rotations.assign(4 * mesh.tets.size(), 0.0);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) rotations[4 * t] = 1;
  }

  void deform(const Mat3& f) {
    for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
      const Vec3 x = f * mesh.rest_positions[n];
      for (std::size_t d = 0; d < 3; ++d) positions[3 * n + d] = x[static_cast<Eigen::Index>(d)];
    }
  }

  template <class Real>
  SystemMatrix<Real> assemble(StepCoefficients coefficients, Isa isa = widest_isa(), int threads = 1) {
    auto system = make_system_matrix<Real>(elements, sparsity, isa, threads);
    const std::vector<std::uint8_t> free_node(mesh.rest_positions.size(), 1);
    assemble_elements<Real>(elements, sparsity, coefficients, mesh.rest_positions, positions, velocities, {},
                            free_node, rotations, system);
    return system;
  }

  // Elastic force at the present positions: the part of the step that looks ahead is switched off by v = 0.
  std::vector<double> force() { return assemble<double>({0.01, {}}).node_forces; }

  double energy() {
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      const Quaternion q = polar_rotation(
          deformation_gradient(elements, mesh.rest_positions, positions, static_cast<std::int64_t>(t)), {});
      rotations[4 * t] = q.s;
      rotations[4 * t + 1] = q.x;
      rotations[4 * t + 2] = q.y;
      rotations[4 * t + 3] = q.z;
    }
    return elastic_energy(elements, positions, rotations, {}, 1);
  }
};

inline Mat3 random_matrix(std::mt19937_64& random, double size) {
  Mat3 m;
  for (int i = 0; i < 9; ++i) m(i / 3, i % 3) = uniform(random, -size, size);
  return m;
}

inline Mat3 random_rotation(std::mt19937_64& random) {
  Vec3 axis(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
  return rotation_matrix(quaternion_from_rotation_vector(axis / axis.norm() * uniform(random, 0, 3.1)));
}

// Calls entry(row, column, value) for every entry of the step's matrix A, from the sliced storage.
template <class Entry>
void for_each_entry(const Sparsity& sparsity, const SystemMatrix<double>& system, const Entry& entry) {
  for (std::int64_t slot = 0; slot < sparsity.chunks * 16; ++slot) {
    const std::int64_t chunk = slot / 16, l = slot % 16;
    const std::int32_t row = sparsity.node_of_slot[static_cast<std::size_t>(slot)];
    if (row < 0) continue;
    const auto block = [&](std::int32_t column, const double* planes) {
      for (int k = 0; k < 9; ++k) entry(3 * row + k / 3, 3 * column + k % 3, planes[16 * k]);
    };
    block(row, &system.diagonal[static_cast<std::size_t>(chunk * 144 + l)]);
    for (std::int64_t e = sparsity.chunk_start[static_cast<std::size_t>(chunk)];
         e < sparsity.chunk_start[static_cast<std::size_t>(chunk) + 1]; ++e) {
      if (sparsity.block[static_cast<std::size_t>(e * 16 + l)] < 0) continue;  // padding
      const std::int32_t other = sparsity.column[static_cast<std::size_t>(e * 16 + l)];
      block(sparsity.node_of_slot[static_cast<std::size_t>(other)],
            &system.values[static_cast<std::size_t>(e * 144 + l)]);
    }
  }
}

inline Eigen::MatrixXd dense(const Body& body, const SystemMatrix<double>& system) {
  const auto n = static_cast<Eigen::Index>(body.positions.size());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  for_each_entry(body.sparsity, system, [&](int i, int j, double value) { a(i, j) += value; });
  return a;
}

// The stiffness K at the present positions: the step's matrix without its mass, over h^2.
inline Eigen::SparseMatrix<double> stiffness(Body& body) {
  const double step_s = 1e3;  // long, so that the mass costs no digits
  const auto system = body.assemble<double>({step_s, {}});
  const auto n = static_cast<Eigen::Index>(body.positions.size());
  std::vector<Eigen::Triplet<double>> entries;
  for_each_entry(body.sparsity, system, [&](int i, int j, double value) {
    if (i == j) value -= body.elements.node_mass[static_cast<std::size_t>(i / 3)];
    entries.emplace_back(i, j, value / (step_s * step_s));
  });
  Eigen::SparseMatrix<double> k(n, n);
  k.setFromTriplets(entries.begin(), entries.end());
  return k;
}

// Solves K u = f for a body in its rest shape with the prescribed displacements; returns u and the forces
// that hold it, K u.
struct Solution {
  Eigen::VectorXd u, force;
};

inline Solution solve(Body& body, const std::map<int, double>& prescribed, const Eigen::VectorXd& load) {
  const Eigen::SparseMatrix<double> k = stiffness(body);
  std::vector<int> place(static_cast<std::size_t>(k.rows()), -1);
  int free = 0;
  Solution s{Eigen::VectorXd::Zero(k.rows()), {}};
  for (int i = 0; i < k.rows(); ++i) {
    const auto held = prescribed.find(i);
    if (held == prescribed.end()) {
      place[static_cast<std::size_t>(i)] = free++;
    } else {
      s.u[i] = held->second;
    }
  }
  const Eigen::VectorXd rest = load - k * s.u;
  Eigen::VectorXd b(free);
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < k.cols(); ++j) {
    const int column = place[static_cast<std::size_t>(j)];
    if (column < 0) continue;
    b[column] = rest[j];
    for (Eigen::SparseMatrix<double>::InnerIterator it(k, j); it; ++it) {
      const int row = place[static_cast<std::size_t>(it.row())];
      if (row >= 0) entries.emplace_back(row, column, it.value());
    }
  }
  Eigen::SparseMatrix<double> reduced(free, free);
  reduced.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(reduced);
  const Eigen::VectorXd x = factor.solve(b);
  for (int i = 0; i < k.rows(); ++i) {
    if (place[static_cast<std::size_t>(i)] >= 0) s.u[i] = x[place[static_cast<std::size_t>(i)]];
  }
  s.force = k * s.u;
  return s;
}

}  // namespace sulcus
