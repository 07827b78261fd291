#include "engine/fem/tangent.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "engine/fem/stress.h"
#include "engine/numerics/quaternion.h"

namespace sulcus {
namespace {

Mat3 skew(const Vec3& u) {
  Mat3 m;
  m << 0, -u[2], u[1], u[2], 0, -u[0], -u[1], u[0], 0;
  return m;
}

bool positive_definite(const Mat3& m, double least) {
  return m(0, 0) > least && m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0) > least * least &&
         m.determinant() > least * least * least;
}

}  // namespace

void add_geometric_stiffness(const ElementData& elements, const Sparsity& sparsity,
                             std::span<const Vec3> rest, std::span<const double> positions,
                             std::span<const std::uint8_t> alive, std::span<const double> rotations,
                             double scale, SystemMatrix<double>& system) {
  static constexpr std::size_t corners[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
  constexpr double least_stretch = 1e-3;
  constexpr std::int64_t lanes = ElementData::lanes;
  for (std::int64_t e = 0; e < elements.count; ++e) {
    const auto at = static_cast<std::size_t>(e);
    if (!alive.empty() && !alive[at]) continue;
    if (!elements.linear.empty() && elements.linear[at]) continue;
    const auto value = [&](std::int64_t component) {
      return elements.rest_double[static_cast<std::size_t>((e / lanes * 12 + component) * lanes + e % lanes)];
    };
    const double* q = &rotations[4 * at];
    const Mat3 r = rotation_matrix({q[0], q[1], q[2], q[3]});
    const Mat3 product = r.transpose() * deformation_gradient(elements, rest, positions, e);
    const Mat3 stretch = 0.5 * (product + product.transpose());
    const double trace = stretch(0, 0) + stretch(1, 1) + stretch(2, 2);
    const Mat3 stretches = trace * Mat3::Identity() - stretch;  // of pairs of axes
    if (!positive_definite(stretches, least_stretch)) continue;
    const double lambda = value(9), mu = value(10);  // times V
    const Mat3 stress = 2 * mu * (stretch - Mat3::Identity()) + lambda * (trace - 3) * Mat3::Identity();
    const double pressure = stress(0, 0) + stress(1, 1) + stress(2, 2);
    const Mat3 c = (pressure * Mat3::Identity() - stress) * stretches.inverse();
    const Mat3 turned_c = 0.5 * scale * (r * (0.5 * (c + c.transpose())) * r.transpose());
    Mat3 turn[4];  // R [g_a]x R^T = [R g_a]x
    turn[0].setZero();
    for (int a = 1; a < 4; ++a) {
      turn[a] = skew(r * Vec3(value(3 * a - 3), value(3 * a - 2), value(3 * a - 1)));
      turn[0] -= turn[a];
    }
    for (std::size_t k = 0; k < 6; ++k) {
      const auto [a, b] = corners[k];
      Mat3 block = turn[a].transpose() * turned_c * turn[b];
      const std::int32_t edge = sparsity.tet_edges[6 * at + k];
      const auto node_a = elements.nodes[static_cast<std::size_t>(
          (e / lanes * 4 + static_cast<std::int64_t>(a)) * lanes + e % lanes)];
      if (sparsity.edges[static_cast<std::size_t>(edge)][0] != node_a) block.transposeInPlace();
      add_edge_block(sparsity, edge, block, system);
    }
  }
}

}  // namespace sulcus
