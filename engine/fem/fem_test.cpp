// Cases of the corotational tetrahedra: numbers from closed forms and finite differences.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <random>

#include "engine/fem/assembly.h"
#include "engine/fem/rotation.h"
#include "engine/fem/stress.h"
#include "engine/fem/test_meshes.h"

namespace sulcus {
namespace {

constexpr double h = 0.01;  // s

struct Body {
  EmbeddingMesh mesh;
  ElementData elements;
  Sparsity sparsity;
  std::vector<double> positions, velocities, rotations;

  explicit Body(EmbeddingMesh m, Material material = {2000, 0.45, 1000}) : mesh(std::move(m)) {
    const std::vector<std::int32_t> numbers(mesh.tets.size(), 0);
    elements = build_elements(mesh, std::span(&material, 1), numbers);
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
    assemble_elements<Real>(elements, sparsity, coefficients, mesh.rest_positions, positions, velocities, {},
                            rotations, system);
    const std::vector<std::uint8_t> free_node(mesh.rest_positions.size(), 1);
    finish_rows<Real>(sparsity, free_node, system);
    return system;
  }

  // Elastic force at the present positions: the part of the step that looks ahead is switched off by v = 0.
  std::vector<double> force() {
    auto system = assemble<double>({h, {}});
    std::vector<double> forces(positions.size());
    elastic_forces<double>(elements, system, forces);
    return forces;
  }

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

Mat3 random_matrix(std::mt19937_64& random, double size) {
  Mat3 m;
  for (int i = 0; i < 9; ++i) m(i / 3, i % 3) = uniform(random, -size, size);
  return m;
}

Mat3 random_rotation(std::mt19937_64& random) {
  Vec3 axis(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
  return rotation_matrix(quaternion_from_rotation_vector(axis / axis.norm() * uniform(random, 0, 3.1)));
}

Mat3 reference_polar(const Mat3& f) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 u = svd.matrixU();
  const Mat3 v = svd.matrixV();
  if ((u * v.transpose()).determinant() < 0) u.col(2) = -u.col(2);
  return u * v.transpose();
}

double trace_of_product(const Mat3& r, const Mat3& f) {
  return (r.transpose() * f).trace();
}

TEST(PolarRotation, AgreesWithADoubleSvdOnEveryKindOfGradient) {
  const std::uint64_t seed = 11;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (int trial = 0; trial < 200000; ++trial) {
    const Mat3 q = random_rotation(random);
    const Mat3 v = random_rotation(random);
    Vec3 s(uniform(random, 0.1, 2), uniform(random, 0.1, 2), uniform(random, 0.1, 2));
    switch (trial % 8) {
      case 1:
        s[2] = -s[2];
        break;  // inverted
      case 2:
        s[2] = 0;
        break;  // rank 2
      case 3:
        s[1] = s[2] = 0;
        break;  // rank 1
      case 4:
        s = Vec3::Zero();
        break;  // rank 0
      case 5:
        s = Vec3::Constant(s[0]);
        break;  // repeated
      case 6:
        s[1] = s[0] * (1 + 1e-9);
        s[2] = 1e-7 * s[0];
        break;  // nearly flat
      case 7:
        s[2] = -s[1] * (1 - 1e-7);
        break;  // nearly singular choice of R
      default:
        break;
    }
    const Mat3 f = q * s.asDiagonal() * v.transpose();
    const Mat3 start = random_rotation(random);
    const SignedSvd svd_start = signed_svd(start);
    const Mat3 start_rotation = svd_start.u * svd_start.v.transpose();
    const Eigen::Quaterniond sq(start_rotation);
    const Mat3 r = rotation_matrix(polar_rotation(f, {sq.w(), sq.x(), sq.y(), sq.z()}));
    ASSERT_LT((r.transpose() * r - Mat3::Identity()).norm(), 1e-13);
    ASSERT_NEAR(r.determinant(), 1, 1e-13);
    // R need not be unique: what it must do is maximise tr(R^T F)
    ASSERT_NEAR(trace_of_product(r, f), trace_of_product(reference_polar(f), f), 2e-12 * (1 + f.norm()))
        << trial;
    if (trial % 8 == 0 || trial % 8 == 5) {
      ASSERT_LT((r - reference_polar(f)).norm(), 1e-11) << trial;
    }
  }
}

TEST(PolarRotation, KeepsTheOldRotationOfACollapsedElement) {
  const Quaternion start = quaternion_from_rotation_vector({0.5, -0.2, 1.0});
  const Mat3 r = rotation_matrix(polar_rotation(Mat3::Zero(), start));
  EXPECT_LT((r - rotation_matrix(start)).norm(), 1e-14);
  Mat3 nonsense = Mat3::Identity();
  nonsense(1, 1) = NAN;
  EXPECT_EQ(polar_rotation(nonsense, start).s, start.s);
}

TEST(SignedSvdTest, GivesFBackAndMarksInversion) {
  const std::uint64_t seed = 12;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (int trial = 0; trial < 5000; ++trial) {
    const Mat3 f = random_matrix(random, 1);
    const SignedSvd svd = signed_svd(f);
    EXPECT_LT((svd.u * svd.s.asDiagonal() * svd.v.transpose() - f).norm(), 1e-13);
    EXPECT_EQ(svd.s[2] < 0, f.determinant() < 0);
    EXPECT_GE(svd.s[0], svd.s[1]);
    EXPECT_GE(svd.s[1], std::fabs(svd.s[2]) - 1e-14);
  }
}

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

TEST(Elements, ForceOfARigidRotationVanishes) {
  for (double angle : {0.1, 1.0, 3.1}) {
    Body body(box_mesh(5, 5, 5, 0.02));
    body.deform(rotation_matrix(quaternion_from_rotation_vector(Vec3(1, 2, -1) / std::sqrt(6.0) * angle)));
    for (double& x : body.positions) x += 0.3;
    for (double f : body.force()) EXPECT_LT(std::fabs(f), 1e-12);
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

TEST(Elements, PatchOfUniformStrainHasNoInteriorForce) {
  Body body(box_mesh(4, 4, 4, 0.01));
  Mat3 f;
  f << 1.05, 0.02, 0.01, 0.02, 0.97, -0.01, 0.01, -0.01, 1.02;
  body.deform(rotation_matrix(quaternion_from_rotation_vector({0.4, 0.2, -0.7})) * f);
  const std::vector<double> force = body.force();
  for (std::size_t n = 0; n < body.mesh.rest_positions.size(); ++n) {
    const Vec3& x = body.mesh.rest_positions[n];
    const bool interior = x.minCoeff() > 0.005 && x.maxCoeff() < 0.035;
    if (!interior) continue;
    for (std::size_t d = 0; d < 3; ++d) EXPECT_LT(std::fabs(force[3 * n + d]), 1e-14);
  }
}

TEST(Elements, UniaxialBarCarriesTheExactForce) {
  // 0.02 x 0.02 x 0.1 m, 10 % stretch, sides free: F = E A eps, lateral strain -nu eps (law linear in nominal
  // stress)
  Body body(box_mesh(2, 2, 10, 0.01));
  body.deform(Vec3(1 - 0.045, 1 - 0.045, 1.1).asDiagonal());
  const std::vector<double> force = body.force();
  double end = 0;
  for (std::size_t n = 0; n < body.mesh.rest_positions.size(); ++n) {
    const Vec3& x = body.mesh.rest_positions[n];
    if (x[2] > 0.0999) end += force[3 * n + 2];
    if (x[2] > 0.001 && x[2] < 0.099) {
      for (std::size_t d = 0; d < 3; ++d) EXPECT_LT(std::fabs(force[3 * n + d]), 1e-14);
    }
  }
  EXPECT_NEAR(end, 0.08, 1e-13);
}

// The whole matrix A, dense, from the sliced storage.
Eigen::MatrixXd dense(const Body& body, const SystemMatrix<double>& system) {
  const auto n = static_cast<Eigen::Index>(3 * body.mesh.rest_positions.size());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  for (std::int64_t chunk = 0; chunk < body.sparsity.chunks; ++chunk) {
    for (int l = 0; l < 16; ++l) {
      const std::int32_t row = body.sparsity.node_of_slot[static_cast<std::size_t>(chunk * 16 + l)];
      if (row < 0) continue;
      for (int k = 0; k < 9; ++k) {
        a(3 * row + k / 3, 3 * row + k % 3) +=
            system.diagonal[static_cast<std::size_t>((chunk * 9 + k) * 16 + l)];
      }
      for (std::int64_t e = body.sparsity.chunk_start[static_cast<std::size_t>(chunk)];
           e < body.sparsity.chunk_start[static_cast<std::size_t>(chunk) + 1]; ++e) {
        const std::int32_t other = body.sparsity.node_of_slot[static_cast<std::size_t>(
            body.sparsity.column[static_cast<std::size_t>(e * 16 + l)])];
        for (int k = 0; k < 9; ++k) {
          a(3 * row + k / 3, 3 * other + k % 3) +=
              system.values[static_cast<std::size_t>((e * 9 + k) * 16 + l)];
        }
      }
    }
  }
  return a;
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
  Body body(box_mesh(5, 4, 3, 0.01));
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
      EXPECT_EQ(system.forces, expected.forces) << isa_name(isa) << threads;
    }
  }
}

TEST(Assembly, GivesTheSameBitsOnEveryInstructionSetAndThreadCount) {
  expect_same_bits_everywhere<float>();
  expect_same_bits_everywhere<double>();
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
