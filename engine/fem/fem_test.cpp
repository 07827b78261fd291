// Cases of the corotational tetrahedra: numbers from closed forms and finite differences.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>

#include "engine/fem/test_body.h"

namespace sulcus {
namespace {

constexpr double h = 0.01;  // s

TEST(Elements, ForceIsTheGradientOfTheEnergy) {
  const std::uint64_t seed = 13;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(box_mesh(2, 2, 2, 0.01));
  body.deform(random_rotation(random));
  for (double& x : body.positions) x += uniform(random, -0.001, 0.001);
  const std::vector<double> force = body.force();
  double largest = 0;
  for (double f : force) largest = std::max(largest, std::fabs(f));
  for (std::size_t i = 0; i < body.positions.size(); i += 7) {
    const double eps = 1e-7;
    const double x = body.positions[i];
    body.positions[i] = x + eps;
    const double above = body.energy();
    body.positions[i] = x - eps;
    const double below = body.energy();
    body.positions[i] = x;
    EXPECT_NEAR(force[i], (above - below) / (2 * eps), 1e-6 * largest) << i;
  }
}

TEST(Elements, ForcesAndTorquesSumToZero) {
  const std::uint64_t seed = 14;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(box_mesh(3, 3, 3, 0.01));
  for (double& x : body.positions) x += uniform(random, -0.002, 0.002);
  const std::vector<double> force = body.force();
  Vec3 sum = Vec3::Zero(), torque = Vec3::Zero();
  for (std::size_t n = 0; n < force.size() / 3; ++n) {
    const Vec3 f(force[3 * n], force[3 * n + 1], force[3 * n + 2]);
    sum += f;
    torque += Vec3(body.positions[3 * n], body.positions[3 * n + 1], body.positions[3 * n + 2]).cross(f);
  }
  EXPECT_LT(sum.norm(), 1e-14);
  EXPECT_LT(torque.norm(), 1e-15);
}

TEST(Assembly, MatrixIsTheRotatedStiffnessPlusMass) {
  const std::uint64_t seed = 15;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(box_mesh(2, 3, 2, 0.01));
  body.deform(random_rotation(random));
  for (double& x : body.positions) x += uniform(random, -0.001, 0.001);
  const RayleighDamping damping{0.7, 0.02};
  const auto system = body.assemble<double>({h, damping});
  const Eigen::MatrixXd a = dense(body, system);

  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(a.rows(), a.cols());
  const double lambda = 2000 * 0.45 / (1.45 * 0.1), mu = 2000 / 2.9;
  for (std::size_t t = 0; t < body.mesh.tets.size(); ++t) {
    const auto& tet = body.mesh.tets[t];
    Mat3 shape;
    for (int c = 0; c < 3; ++c) {
      shape.col(c) = body.mesh.rest_positions[static_cast<std::size_t>(tet[c + 1])] -
                     body.mesh.rest_positions[static_cast<std::size_t>(tet[0])];
    }
    const Mat3 inverse = shape.inverse();
    Eigen::Matrix<double, 4, 3> g;
    g.bottomRows<3>() = inverse;
    g.row(0) = -inverse.colwise().sum();
    Eigen::Matrix<double, 6, 12> b = Eigen::Matrix<double, 6, 12>::Zero();
    for (int c = 0; c < 4; ++c) {
      b(0, 3 * c) = b(3, 3 * c + 1) = b(5, 3 * c + 2) = g(c, 0);
      b(1, 3 * c + 1) = b(3, 3 * c) = b(4, 3 * c + 2) = g(c, 1);
      b(2, 3 * c + 2) = b(4, 3 * c + 1) = b(5, 3 * c) = g(c, 2);
    }
    Eigen::Matrix<double, 6, 6> d = Eigen::Matrix<double, 6, 6>::Zero();
    d.topLeftCorner<3, 3>().setConstant(lambda);
    d.diagonal() << lambda + 2 * mu, lambda + 2 * mu, lambda + 2 * mu, mu, mu, mu;
    const double* q = &body.rotations[4 * t];
    const Mat3 r = rotation_matrix({q[0], q[1], q[2], q[3]});
    Eigen::Matrix<double, 12, 12> turn = Eigen::Matrix<double, 12, 12>::Zero();
    for (int c = 0; c < 4; ++c) turn.block<3, 3>(3 * c, 3 * c) = r;
    const Eigen::Matrix<double, 12, 12> k =
        turn * (b.transpose() * d * b * (shape.determinant() / 6)) * turn.transpose();
    for (int c = 0; c < 4; ++c) {
      for (int e = 0; e < 4; ++e) {
        expected.block<3, 3>(3 * tet[c], 3 * tet[e]) +=
            (damping.beta_s * h + h * h) * k.block<3, 3>(3 * c, 3 * e);
      }
    }
  }
  for (std::size_t n = 0; n < body.mesh.rest_positions.size(); ++n) {
    for (std::size_t d = 0; d < 3; ++d) {
      expected(static_cast<Eigen::Index>(3 * n + d), static_cast<Eigen::Index>(3 * n + d)) +=
          (1 + damping.alpha_1_s * h) * body.elements.node_mass[n];
    }
  }
  EXPECT_LT((a - expected).cwiseAbs().maxCoeff(), 1e-12 * expected.cwiseAbs().maxCoeff());
  EXPECT_LT((a - a.transpose()).cwiseAbs().maxCoeff(), 1e-15);
}

TEST(Assembly, StiffnessHasExactlySixZeroModes) {
  Body body(box_mesh(2, 2, 2, 0.01));
  body.deform(rotation_matrix(quaternion_from_rotation_vector({0.4, 0.2, -0.7})));
  const auto system = body.assemble<double>({h, {}});
  Eigen::MatrixXd k = dense(body, system);
  for (Eigen::Index i = 0; i < k.rows(); ++i)
    k(i, i) -= body.elements.node_mass[static_cast<std::size_t>(i / 3)];
  const Eigen::VectorXd eigenvalues = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(k).eigenvalues();
  int zeros = 0;
  for (double e : eigenvalues) {
    EXPECT_GT(e, -1e-10 * eigenvalues.maxCoeff());
    zeros += e < 1e-8 * eigenvalues.maxCoeff();
  }
  EXPECT_EQ(zeros, 6);
}

template <class Real>
void expect_same_bits_everywhere() {
  const std::uint64_t seed = 16;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(box_mesh(9, 8, 7, 0.01));  // several tiles
  for (double& x : body.positions)
    x += uniform(random, -0.004, 0.004);  // many inverted: the fallback is used
  for (double& v : body.velocities) v = uniform(random, -0.1, 0.1);
  Body reference = body;
  const auto expected = reference.assemble<Real>({h, {0.1, 0.05}}, Isa::sse2, 1);
  for (Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
    if (isa > widest_isa()) {
      GTEST_LOG_(INFO) << "this processor has no " << isa_name(isa);
      continue;
    }
    for (int threads : {1, 2, 3, 8}) {
      Body other = body;
      const auto system = other.assemble<Real>({h, {0.1, 0.05}}, isa, threads);
      EXPECT_EQ(other.rotations, reference.rotations) << isa_name(isa) << threads;
      EXPECT_EQ(system.values, expected.values) << isa_name(isa) << threads;
      EXPECT_EQ(system.inverse, expected.inverse) << isa_name(isa) << threads;
      EXPECT_EQ(system.node_forces, expected.node_forces) << isa_name(isa) << threads;
    }
  }
}

TEST(Assembly, GivesTheSameBitsOnEveryInstructionSetAndThreadCount) {
  expect_same_bits_everywhere<float>();
  expect_same_bits_everywhere<double>();
}

TEST(Sparsity, EveryEdgeStandsInTheLanesOnceWithAllItsItemsInOrder) {
  const EmbeddingMesh mesh = box_mesh(5, 4, 3, 0.01);
  const Sparsity s = build_sparsity(mesh);
  const auto edges = static_cast<std::int32_t>(s.edges.size());
  const auto nothing = static_cast<std::int32_t>((mesh.tets.size() + 15) / 16 * 16 * 16);
  std::vector<int> seen(s.edges.size(), 0);
  for (std::size_t place = 0; place < s.lane_edges.size(); ++place) {
    const std::int32_t edge = s.lane_edges[place];
    std::vector<std::int32_t> items;
    bool ended = false;
    for (std::int32_t row = s.lane_start[place / 16]; row < s.lane_start[place / 16 + 1]; ++row) {
      const std::int32_t item = s.lane_items[static_cast<std::size_t>(16 * row) + place % 16];
      EXPECT_FALSE(ended && item != nothing);
      ended = ended || item == nothing;
      if (!ended) items.push_back(item);
    }
    if (edge == edges) {
      EXPECT_TRUE(items.empty());
      continue;
    }
    const auto e = static_cast<std::size_t>(edge);
    ++seen[e];
    EXPECT_EQ(place / Sparsity::window_edges, e / Sparsity::window_edges);
    EXPECT_EQ(items, std::vector(s.edge_items.begin() + s.edge_start[e],
                                 s.edge_items.begin() + s.edge_start[e + 1]));
  }
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), edges);
}

// Goes through a thread's part as the assembly does, and looks whether what is read is still there.
void expect_rings_hold(const ElementData& elements, const Sparsity& s, const AssemblyPlan& plan,
                       const AssemblyPlan::Part& part) {
  std::vector<std::int64_t> element_at(static_cast<std::size_t>(plan.elements()), -1);
  std::vector<std::int64_t> edge_at(static_cast<std::size_t>(plan.edges()) + 1, -1);
  const auto own = [&](std::int32_t node) {
    return node / s.window_rows >= part.first_rows && node / s.window_rows < part.last_rows;
  };
  std::int64_t edges_done = part.first_edges, rows_done = part.first_rows;
  for (std::int64_t tile = part.first_tile; tile < part.last_tile; ++tile) {
    constexpr std::int64_t size = AssemblyPlan::tile_elements;
    for (std::int64_t e = 0; e < size; ++e)
      element_at[static_cast<std::size_t>(tile % plan.ring_tiles * size + e)] = tile * size + e;
    const auto done = static_cast<std::size_t>(tile) + 1;
    for (; edges_done < plan.ready_edges[done]; ++edges_done) {
      constexpr std::int64_t window = Sparsity::window_edges;
      for (auto place = static_cast<std::size_t>(window * edges_done);
           place < static_cast<std::size_t>(window * (edges_done + 1)); ++place) {
        const auto edge = static_cast<std::size_t>(s.lane_edges[place]);
        edge_at[static_cast<std::size_t>(plan.lane_edges[place])] = static_cast<std::int64_t>(edge);
        if (edge == s.edges.size() || !(own(s.edges[edge][0]) || own(s.edges[edge][1]))) continue;
        for (std::int32_t row = s.lane_start[place / 16]; row < s.lane_start[place / 16 + 1]; ++row) {
          const auto k = static_cast<std::size_t>(16 * row) + place % 16;
          const std::int32_t item = s.lane_items[k];
          for (const bool second : {false, true}) {
            const std::int32_t there =
                plan.lane_corners[static_cast<std::size_t>(32 * row + 16 * second) + place % 16];
            if (item / 16 >= elements.count) {
              ASSERT_EQ(there / 16, plan.elements());
            } else {
              ASSERT_EQ(element_at[static_cast<std::size_t>(there / 16)], item / 16);
              ASSERT_EQ(there % 16, 4 * (second ? item % 4 : item / 4 % 4));
            }
          }
        }
      }
    }
    for (; rows_done < std::min(plan.ready_rows[done], part.last_rows); ++rows_done) {
      const std::int64_t rows = s.window_rows, chunks = rows / Sparsity::chunk_rows;
      for (std::int64_t node = rows * rows_done; node < std::min(rows * (rows_done + 1), s.nodes); ++node) {
        for (std::int32_t k = elements.incident_start[static_cast<std::size_t>(node)];
             k < elements.incident_start[static_cast<std::size_t>(node) + 1]; ++k) {
          const std::int32_t there = plan.incident[static_cast<std::size_t>(k)];
          ASSERT_EQ(element_at[static_cast<std::size_t>(there / 4)],
                    elements.incident[static_cast<std::size_t>(k)] / 4);
        }
      }
      for (std::int64_t chunk = chunks * rows_done; chunk < std::min(chunks * (rows_done + 1), s.chunks);
           ++chunk) {
        for (std::int32_t k = 16 * s.chunk_start[static_cast<std::size_t>(chunk)];
             k < 16 * s.chunk_start[static_cast<std::size_t>(chunk) + 1]; ++k) {
          const std::int32_t block = s.block[static_cast<std::size_t>(k)],
                             there = plan.block[static_cast<std::size_t>(k)];
          const auto entry = static_cast<std::size_t>(k / 16);
          ASSERT_EQ(there % 12, 0);
          if (block < 0) {
            ASSERT_EQ(there / 12, plan.edges() + 1);  // zeros
            continue;
          }
          ASSERT_EQ(edge_at[static_cast<std::size_t>(there / 12)], block / 2);
          ASSERT_EQ(plan.transposed[entry] >> k % 16 & 1, block % 2);
        }
      }
    }
  }
  EXPECT_EQ(rows_done, part.last_rows);
}

TEST(AssemblyPlan, WhatIsReadStandsInTheRingsStill) {
  const std::uint64_t seed = 19;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  EmbeddingMesh mesh = box_mesh(9, 8, 17, 0.01);
  for (int order = 0; order < 2; ++order) {
    const Body body(mesh);
    const auto tiles = (static_cast<std::int64_t>(mesh.tets.size()) + AssemblyPlan::tile_elements - 1) /
                       AssemblyPlan::tile_elements;
    for (int threads : {1, 2, 3, 8, 40}) {
      SCOPED_TRACE(threads);
      const AssemblyPlan plan = plan_assembly(body.elements, body.sparsity, threads);
      if (order == 0) {
        EXPECT_LT(plan.ring_tiles, tiles / 2);  // else the rings would be of no use
      }
      std::int64_t tile = 0, row = 0;
      for (const AssemblyPlan::Part& part : plan.parts) {
        EXPECT_EQ(part.first_tile, tile);
        EXPECT_EQ(part.first_rows, row);
        EXPECT_GE(part.last_tile, part.next);
        expect_rings_hold(body.elements, body.sparsity, plan, part);
        tile = part.next;
        row = part.last_rows;
      }
      EXPECT_EQ(tile, tiles);
      EXPECT_EQ(row, (body.sparsity.nodes + body.sparsity.window_rows - 1) / body.sparsity.window_rows);
    }
    std::shuffle(mesh.tets.begin(), mesh.tets.end(), random);  // then in no order at all
  }
}

TEST(Assembly, OfElementsInNoOrderIsTheSameForEveryThreadCount) {
  const std::uint64_t seed = 20;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  EmbeddingMesh mesh = box_mesh(9, 8, 7, 0.01);
  std::shuffle(mesh.tets.begin(), mesh.tets.end(), random);
  Body body(mesh);
  for (double& x : body.positions) x += uniform(random, -0.002, 0.002);
  Body first = body;
  const auto expected = first.assemble<double>({h, {0.1, 0.05}}, widest_isa(), 1);
  for (int threads : {2, 3, 8, 16}) {
    Body other = body;
    EXPECT_EQ(other.assemble<double>({h, {0.1, 0.05}}, widest_isa(), threads).values, expected.values)
        << threads;
  }
  EXPECT_LT((dense(body, expected) - dense(body, expected).transpose()).cwiseAbs().maxCoeff(), 1e-15);
}

TEST(Assembly, SinglePrecisionStaysCloseToDouble) {
  const std::uint64_t seed = 17;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(box_mesh(5, 4, 3, 0.01));
  body.deform(random_rotation(random));
  for (double& x : body.positions) x += uniform(random, -0.001, 0.001);
  Body other = body;
  const auto twice = body.assemble<double>({h, {0.1, 0.05}});
  const auto single = other.assemble<float>({h, {0.1, 0.05}});
  double largest = 0, difference = 0;
  for (std::size_t i = 0; i < twice.values.size(); ++i) {
    largest = std::max(largest, std::fabs(twice.values[i]));
    difference = std::max(difference, std::fabs(twice.values[i] - static_cast<double>(single.values[i])));
  }
  EXPECT_LT(difference, 1e-5 * largest);
}

TEST(Stress, PrincipalValuesFollowTheClosedForm) {
  Body body(box_mesh(1, 1, 1, 0.01));
  body.deform(rotation_matrix(quaternion_from_rotation_vector({0.4, 0.2, -0.7})) *
              Vec3(1.3, 0.877058, 0.877058).asDiagonal());
  const auto stress = largest_principal_stress(body.elements, body.mesh.rest_positions, body.positions, {});
  for (double s : stress) EXPECT_NEAR(s, 749.686, 1e-3);
  EXPECT_EQ(count_inverted_elements(body.elements, body.mesh.rest_positions, body.positions, {}), 0);
  body.deform(Vec3(1, 1, -0.5).asDiagonal());
  EXPECT_EQ(count_inverted_elements(body.elements, body.mesh.rest_positions, body.positions, {}), 5);
}

TEST(Elements, MassesSumToDensityTimesVolume) {
  Body body(box_mesh(3, 4, 5, 0.01));
  double mass = 0;
  for (double m : body.elements.node_mass) mass += m;
  EXPECT_NEAR(mass, 1000 * 60e-6, 1e-14);
}

}  // namespace
}  // namespace sulcus
