// For tests and benchmarks: a body in the state that the figures of the field are measured in, twisted by 0.8
// rad and bent, bottom held, at rest otherwise, and as a choice pressed by a rigid tool on some triangles of
// its boundary; with matrix and right-hand side of its next step by the engine's own assembly.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <string>

#include "engine/contact/embedded.h"
#include "engine/fem/assembly.h"
#include "engine/solver/conjugate_gradients.h"

namespace sulcus {

struct BodySettings {
  double youngs_modulus_Pa = 1000;
  double stiff_factor = 1;  // Young's modulus of every other block of 4x4x4 cells, times that of the rest
  double poisson_ratio = 0.45;
  double step_s = 1.0 / 30;
  double beta_s = 0.1;
};

struct PressedBody {
  std::string name;
  EmbeddingMesh mesh;
  StepCoefficients step;
  ElementData elements;
  Sparsity sparsity;
  std::vector<double> positions, velocities;
  std::vector<std::uint8_t> free_node;
  ContactLaw law{0, 0, 0, true};
  std::vector<Contact> contacts;  // of one tool

  // h (b + h k): what a contact adds to the matrix is this times w_i w_j n n^T.
  double contact_weight() const {
    return step.step_s * (law.damping_N_s_m + step.step_s * law.stiffness_N_m);
  }
};

inline PressedBody make_body(std::string name, EmbeddingMesh mesh, const BodySettings& settings = {}) {
  PressedBody body;
  body.name = std::move(name);
  body.mesh = std::move(mesh);
  body.step = {settings.step_s, {0, settings.beta_s}};
  const Material soft{settings.youngs_modulus_Pa, settings.poisson_ratio, 1000};
  Material stiff = soft;
  stiff.youngs_modulus_Pa *= settings.stiff_factor;
  const Material materials[] = {soft, stiff};
  std::vector<std::int32_t> numbers(body.mesh.tets.size(), 0);
  for (std::size_t t = 0; t < numbers.size(); ++t) {
    const Index3& cell = body.mesh.cell_position[t / static_cast<std::size_t>(body.mesh.tets_per_cell)];
    numbers[t] = (cell[0] / 4 + cell[1] / 4 + cell[2] / 4) % 2;
  }
  body.elements = build_elements(body.mesh, materials, numbers);
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

// A triangle of the mesh's boundary: three corners of `tet`, and outward normal and centre at rest.
struct BoundaryTriangle {
  std::int32_t tet = 0;
  std::size_t opposite = 0;  // corner that is not in it
  Vec3 normal = Vec3::Zero(), centre = Vec3::Zero();
};

// Of the given places of the nodes [3*nodes]; in order of the tetrahedra.
inline std::vector<BoundaryTriangle> boundary_triangles(const EmbeddingMesh& mesh,
                                                        std::span<const double> positions) {
  std::map<std::array<std::int32_t, 3>, std::pair<int, BoundaryTriangle>> faces;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    for (std::size_t opposite = 0; opposite < 4; ++opposite) {
      std::array<std::int32_t, 3> corners{};
      for (std::size_t c = 0; c < 3; ++c) corners[c] = mesh.tets[t][(opposite + 1 + c) % 4];
      const Vec3 a = node_vector(positions, corners[0]), b = node_vector(positions, corners[1]),
                 c = node_vector(positions, corners[2]);
      Vec3 normal = (b - a).cross(c - a).normalized();
      if (normal.dot(node_vector(positions, mesh.tets[t][opposite]) - a) > 0) normal = -normal;
      std::sort(corners.begin(), corners.end());
      auto& [count, face] = faces[corners];
      ++count;
      face = {static_cast<std::int32_t>(t), opposite, normal, (a + b + c) / 3};
    }
  }
  std::vector<BoundaryTriangle> boundary;
  for (const auto& [corners, face] : faces) {
    if (face.first == 1) boundary.push_back(face.second);
  }
  std::sort(boundary.begin(), boundary.end(), [](const BoundaryTriangle& a, const BoundaryTriangle& b) {
    return std::pair(a.tet, a.opposite) < std::pair(b.tet, b.opposite);
  });
  return boundary;
}

// Presses along `push` (unit) on the `count` boundary triangles nearest to `point` (m, rest) that face the
// tool: one contact at each triangle's centre, 2 mm deep.
inline void press(PressedBody& body, const Vec3& point, const Vec3& push, std::size_t count,
                  double stiffness_N_m) {
  constexpr double depth_m = 2e-3;
  std::vector<double> rest;
  for (const Vec3& x : body.mesh.rest_positions) rest.insert(rest.end(), {x[0], x[1], x[2]});
  std::vector<BoundaryTriangle> triangles = boundary_triangles(body.mesh, rest);
  std::erase_if(triangles, [&](const BoundaryTriangle& t) { return t.normal.dot(push) > -0.5; });
  std::stable_sort(triangles.begin(), triangles.end(),
                   [&](const BoundaryTriangle& a, const BoundaryTriangle& b) {
                     return (a.centre - point).squaredNorm() < (b.centre - point).squaredNorm();
                   });
  triangles.resize(std::min(count, triangles.size()));
  body.law.stiffness_N_m = stiffness_N_m;
  body.contacts.clear();
  Vec3 middle = Vec3::Zero();
  for (const BoundaryTriangle& triangle : triangles) {
    Contact contact;
    contact.tet = triangle.tet;
    Vec3 centre = Vec3::Zero();
    std::array<Vec3, 3> corner;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t at = (triangle.opposite + 1 + c) % 4;
      contact.weights[at] = 1.0 / 3;
      corner[c] = node_vector(body.positions, body.mesh.tets[static_cast<std::size_t>(triangle.tet)][at]);
      centre += corner[c] / 3;
    }
    contact.normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
    const Vec3 inner = node_vector(body.positions,
                                   body.mesh.tets[static_cast<std::size_t>(triangle.tet)][triangle.opposite]);
    if (contact.normal.dot(inner - corner[0]) > 0) contact.normal = -contact.normal;
    contact.depth_m = depth_m;
    contact.gap = -depth_m * contact.normal;
    contact.arm = centre + contact.gap;
    middle += centre / static_cast<double>(triangles.size());
    body.contacts.push_back(contact);
  }
  const Vec3 centre_of_mass = middle - 0.05 * push;  // the handle is 5 cm away
  for (Contact& contact : body.contacts) contact.arm -= centre_of_mass;
}

template <class Real>
struct BodySystem {
  const PressedBody& body;
  SystemMatrix<Real> system;
  SolverWorkspace<Real> solver;
  std::vector<ToolBorder<Real>> borders;  // none without contacts
  std::vector<double> rotations, forces;  // forces: right-hand side, N s, after assemble()

  explicit BodySystem(const PressedBody& of, int threads = 1, Isa isa = widest_isa())
      : body(of),
        system(make_system_matrix<Real>(of.elements, of.sparsity, isa, threads)),
        solver(make_solver_workspace<Real>(of.sparsity, isa, threads)),
        rotations(4 * of.mesh.tets.size(), 0.0),
        forces(of.positions.size()) {
    for (std::size_t t = 0; t < of.mesh.tets.size(); ++t) rotations[4 * t] = 1;
    assemble_elements<Real>(body.elements, body.sparsity, body.step, body.mesh.rest_positions, body.positions,
                            body.velocities, {}, body.free_node, rotations, system);
    for (std::size_t i = 0; i < forces.size(); ++i) forces[i] = -body.step.step_s * system.node_forces[i];
    if (!body.contacts.empty()) add_tool();
    close_rows<Real>(body.sparsity, body.free_node, system);
    for (std::size_t n = 0; n < body.free_node.size(); ++n) {
      for (std::size_t d = 0; d < 3; ++d) solver.b[entry(n, d)] = static_cast<Real>(forces[3 * n + d]);
    }
  }

  // Rotations, matrix and inverses of the diagonal blocks once more, without contacts: what a benchmark
  // times.
  void assemble() {
    assemble_elements<Real>(body.elements, body.sparsity, body.step, body.mesh.rest_positions, body.positions,
                            body.velocities, {}, body.free_node, rotations, system);
  }

  RowMatrix<Real> matrix() const {
    return {body.sparsity.chunks, body.sparsity.chunk_start.data(), body.sparsity.column.data(),
            system.values.data(), system.diagonal.data(),           system.inverse.data()};
  }

  // Place of entry d of a node in a solver vector.
  std::size_t entry(std::size_t node, std::size_t d) const {
    const auto slot = static_cast<std::size_t>(body.sparsity.slot_of_node[node]);
    return (slot / 16 * 3 + d) * 16 + slot % 16;
  }

 private:
  using Mat36 = Eigen::Matrix<double, 3, 6>;
  using Mat6 = Eigen::Matrix<double, 6, 6>;
  using Vec6 = Eigen::Matrix<double, 6, 1>;

  // Contacts and the tool at their other side (equations.md 4): 0.1 kg, 5e-4 kg m^2, virtual coupling 1000
  // N/m and 10 N s/m, 0.1 N m/rad and 0.02 N m s/rad, at rest, its hand at its place.
  void add_tool() {
    const double h = body.step.step_s, weight = body.contact_weight();
    Mat6 c = Mat6::Zero();
    c.topLeftCorner<3, 3>() = (0.1 + h * 10 + h * h * 1000) * Mat3::Identity();
    c.bottomRightCorner<3, 3>() = (5e-4 + h * 0.02 + h * h * 0.1) * Mat3::Identity();
    Vec6 right_hand_side = Vec6::Zero();
    std::map<std::int32_t, Mat36> rows;  // by slot
    static constexpr std::size_t pairs[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
    for (const Contact& contact : body.contacts) {
      const Mat3 n = contact.normal * contact.normal.transpose();
      const Vec3& r = contact.arm;
      Mat36 jacobian = Mat36::Zero();
      jacobian.leftCols<3>() = Mat3::Identity();
      jacobian.rightCols<3>() << 0, r[2], -r[1], -r[2], 0, r[0], r[1], -r[0], 0;
      const Vec3 push = h * body.law.stiffness_N_m * (n * contact.gap);
      c += weight * (jacobian.transpose() * (n * jacobian));
      right_hand_side -= jacobian.transpose() * push;
      const auto& nodes = body.mesh.tets[static_cast<std::size_t>(contact.tet)];
      for (std::size_t k = 0; k < 4; ++k) {
        const double w = contact.weights[k];
        if (w == 0) continue;
        const auto node = static_cast<std::size_t>(nodes[k]);
        auto [row, fresh] = rows.try_emplace(body.sparsity.slot_of_node[node], Mat36::Zero());
        row->second -= (weight * w) * (n * jacobian);
        for (int i = 0; i < 3; ++i) {
          forces[3 * node + static_cast<std::size_t>(i)] += w * push[i];
          for (int j = 0; j < 3; ++j) {
            system.node_terms[16 * node + static_cast<std::size_t>(3 * i + j)] +=
                static_cast<Real>(weight * w * n(i, j));
          }
        }
      }
      for (std::size_t k = 0; k < 6; ++k) {
        const double scale = weight * contact.weights[pairs[k][0]] * contact.weights[pairs[k][1]];
        if (scale != 0) {
          add_edge_block(body.sparsity,
                         body.sparsity.tet_edges[6 * static_cast<std::size_t>(contact.tet) + k], scale * n,
                         system);
        }
      }
    }
    const Mat6 inverse = c.llt().solve(Mat6::Identity());
    const Vec6 first = inverse * right_hand_side;
    ToolBorder<Real> border;
    for (int i = 0; i < 36; ++i) border.inverse[static_cast<std::size_t>(i)] = inverse(i / 6, i % 6);
    for (const auto& [slot, b] : rows) {
      typename ToolBorder<Real>::Row row;
      row.chunk = slot / 16;
      row.offset = row.chunk * 48 + slot % 16;
      for (int i = 0; i < 18; ++i) row.b[static_cast<std::size_t>(i)] = static_cast<Real>(b(i / 6, i % 6));
      border.rows.push_back(row);
      const auto node = static_cast<std::size_t>(body.sparsity.node_of_slot[static_cast<std::size_t>(slot)]);
      const Vec3 eliminated = b * first;
      for (std::size_t d = 0; d < 3; ++d) forces[3 * node + d] -= eliminated[static_cast<Eigen::Index>(d)];
    }
    borders.push_back(std::move(border));
  }
};

// What `auto` would choose.
inline bool takes_multigrid(const PressedBody& body) {
  return multigrid_pays(body.mesh, reach_of_step(body.mesh, body.elements, body.step), body.contact_weight());
}

// The smallest number of iterations, at most `most`, for which reached(number) holds; it holds for `most` and
// for all above the first.
template <class Reached>
int fewest_iterations(int most, const Reached& reached) {
  int low = 0;
  while (most - low > 1) {
    const int middle = (low + most) / 2;
    (reached(middle) ? most : low) = middle;
  }
  return most;
}

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
