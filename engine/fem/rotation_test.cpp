// Rotations of elements against a singular value decomposition in double precision: a million deformation
// gradients of every kind, through the scalar function and through the lanes of the kernels.
#include "engine/fem/rotation.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <random>

#include "engine/fem/test_body.h"

namespace sulcus {
namespace {

enum class Kind {
  plain,
  random,
  inverted,
  flat,
  line,
  point,
  repeated,
  nearly_flat,
  nearly_ambiguous,
  huge,
  tiny,
  mirror
};
constexpr int kinds = 12;

Vec3 stretches(Kind kind, std::mt19937_64& random) {
  const double a = uniform(random, 0.1, 2), b = uniform(random, 0.1, 2), c = uniform(random, 0.1, 2);
  switch (kind) {
    case Kind::inverted:
      return {a, b, -c};
    case Kind::flat:
      return {a, b, 0};
    case Kind::line:
      return {a, 0, 0};
    case Kind::point:
      return {0, 0, 0};
    case Kind::repeated:
      return {a, a, a};
    case Kind::nearly_flat:
      return {a, a * (1 + 1e-9), 1e-7 * a};
    case Kind::nearly_ambiguous:
      return {a, b, -b * (1 - 1e-7)};
    case Kind::huge:
      return {1e6 * a, 1e6 * b, 1e6 * c};
    case Kind::tiny:
      return {1e-6 * a, 1e-6 * b, 1e-6 * c};
    case Kind::mirror:
      return {a, a, -a};
    default:
      return {a, b, c};
  }
}

struct Gradient {
  Kind kind;
  Mat3 f;
  Quaternion start;  // of the iteration: any rotation at all
};

Gradient make_gradient(std::size_t number, std::mt19937_64& random) {
  Gradient g;
  g.kind = static_cast<Kind>(number % kinds);
  if (g.kind == Kind::random) {
    g.f = random_matrix(random, 1);
  } else {
    const Mat3 u = random_rotation(random), v = random_rotation(random);
    g.f = u * stretches(g.kind, random).asDiagonal() * v.transpose();
  }
  const double x = uniform(random, -2, 2), y = uniform(random, -2, 2), z = uniform(random, -2, 2);
  g.start = quaternion_from_rotation_vector({x, y, z});
  return g;
}

// The largest tr(R^T F) over rotations R, the rotation, and how well determined it is: s_2 + s_3 over s_1
// (signed).
struct Reference {
  double trace;
  Mat3 r;
  double certainty;
};

Reference reference(const Mat3& f) {
  const Eigen::JacobiSVD<Mat3> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 u = svd.matrixU();
  Vec3 s = svd.singularValues();
  if ((u * svd.matrixV().transpose()).determinant() < 0) {
    u.col(2) = -u.col(2);
    s[2] = -s[2];
  }
  const double certainty = s[0] > 0 ? (s[1] + s[2]) / s[0] : 0;
  return {s.sum(), u * svd.matrixV().transpose(), certainty};
}

struct Worst {
  double orthogonality = 0, trace = 0, rotation = 0;
};

// rounding: of the precision that r was computed in.
void check(const Mat3& r, const Mat3& f, double rounding, Worst& worst) {
  const Reference expected = reference(f);
  const double size = std::sqrt(f.squaredNorm());
  worst.orthogonality = std::fmax(
      worst.orthogonality, (r.transpose() * r - Mat3::Identity()).norm() + std::fabs(r.determinant() - 1));
  // R need not be unique: what it must do is maximise tr(R^T F)
  if (size > 0) worst.trace = std::fmax(worst.trace, (expected.trace - (r.transpose() * f).trace()) / size);
  if (expected.certainty > 1e4 * rounding)
    worst.rotation = std::fmax(worst.rotation, expected.certainty * (r - expected.r).norm());
}

constexpr std::size_t million = 1'000'000;

TEST(PolarRotation, AgreesWithADoubleSvdOnAMillionGradientsOfEveryKind) {
  const std::uint64_t seed = 11;
  SCOPED_TRACE(seed);
  constexpr std::size_t parts = 100;
  std::vector<Worst> worst(parts);
#pragma omp parallel for schedule(static)
  for (std::size_t part = 0; part < parts; ++part) {
    std::mt19937_64 random(seed + part);
    for (std::size_t i = 0; i < million / parts; ++i) {
      const Gradient g = make_gradient(i, random);
      check(rotation_matrix(polar_rotation(g.f, g.start)), g.f, 2e-16, worst[part]);
    }
  }
  for (const Worst& w : worst) {
    EXPECT_LT(w.orthogonality, 1e-13);
    EXPECT_LT(w.trace, 2e-12);
    EXPECT_LT(w.rotation, 1e-9);
  }
}

// Rotations [4*elements] by the kernel, of elements with a gradient each. gradients: rounded to what the
// kernel sees of them.
template <class Real>
std::vector<double> through_the_kernel(std::vector<Gradient>& gradients, Isa isa) {
  constexpr std::size_t lanes = ElementData::lanes;
  const std::size_t count = gradients.size();
  std::vector<double> rotations(4 * count);
  AlignedVector<Real> rest(12 * count), fields(32 * count), records(16 * count), forces(16 * count);
  std::vector<std::int32_t> nodes(4 * count);
  for (std::size_t e = 0; e < count; ++e) {
    Gradient& g = gradients[e];
    for (std::size_t a = 0; a < 4; ++a) {
      nodes[(e / lanes * 4 + a) * lanes + e % lanes] = static_cast<std::int32_t>(4 * e + a);
    }
    for (int i = 0; i < 3; ++i) {
      rest[(e / lanes * 12 + static_cast<std::size_t>(4 * i)) * lanes + e % lanes] = 1;
      for (int j = 0; j < 3; ++j) {  // f = I + displacements of the corners 1, 2, 3
        const Real displacement = static_cast<Real>(g.f(i, j) - (i == j));
        fields[8 * (4 * e + static_cast<std::size_t>(j) + 1) + static_cast<std::size_t>(i)] = displacement;
        g.f(i, j) = static_cast<double>(displacement + Real(i == j));
      }
    }
    const double start[4] = {g.start.s, g.start.x, g.start.y, g.start.z};
    std::copy(start, start + 4, &rotations[4 * e]);
  }
  ElementPass<Real> pass;
  pass.count = static_cast<std::int64_t>(count);
  pass.nodes = nodes.data();
  pass.rest = rest.data();
  pass.node_fields = fields.data();
  pass.rotations = rotations.data();
  pass.records = records.data();
  pass.forces = forces.data();
  fem_kernels<Real>(isa).element_pass(pass, 0, static_cast<std::int64_t>(count / lanes));
  return rotations;
}

template <class Real>
Worst worst_through_the_kernel(std::vector<Gradient> gradients, Isa isa) {
  const std::vector<double> rotations = through_the_kernel<Real>(gradients, isa);
  Worst worst;
  for (std::size_t e = 0; e < gradients.size(); ++e) {
    const double* q = &rotations[4 * e];
    check(rotation_matrix({q[0], q[1], q[2], q[3]}), gradients[e].f, sizeof(Real) == 4 ? 6e-8 : 2e-16, worst);
    if (!std::isfinite(q[0] + q[1] + q[2] + q[3])) worst.trace = INFINITY;
  }
  return worst;
}

template <class Real>
Worst million_through_the_kernel() {
  constexpr std::size_t parts = 25, count = million / 2 / parts;  // half a million in each precision
  static_assert(count % ElementData::lanes == 0);
  std::vector<Worst> worst(parts);
#pragma omp parallel for schedule(static)
  for (std::size_t part = 0; part < parts; ++part) {
    const Isa isa =
        static_cast<Isa>(std::min<int>(static_cast<int>(part % 3), static_cast<int>(widest_isa())));
    std::mt19937_64 random(100 + part);
    std::vector<Gradient> some;
    for (std::size_t e = 0; e < count; ++e) some.push_back(make_gradient(e, random));
    worst[part] = worst_through_the_kernel<Real>(std::move(some), isa);
  }
  Worst all;
  for (const Worst& w : worst) {
    all.orthogonality = std::fmax(all.orthogonality, w.orthogonality);
    all.trace = std::fmax(all.trace, w.trace);
    all.rotation = std::fmax(all.rotation, w.rotation);
  }
  return all;
}

TEST(RotationKernel, AgreesWithADoubleSvdOnAMillionGradientsOfEveryKind) {
  const Worst single = million_through_the_kernel<float>();
  EXPECT_LT(single.orthogonality, 1e-6);
  EXPECT_LT(single.trace, 2e-6);
  EXPECT_LT(single.rotation, 2e-5);
  const Worst twice = million_through_the_kernel<double>();
  EXPECT_LT(twice.orthogonality, 1e-13);
  EXPECT_LT(twice.trace, 2e-12);
  EXPECT_LT(twice.rotation, 1e-9);
}

// Strained by up to a third, and warm starts from a thousandth of a milliradian to a third of a radian away.
std::vector<Gradient> warm_gradients(std::size_t count) {
  std::mt19937_64 random(7);
  std::vector<Gradient> some;
  for (std::size_t e = 0; e < count; ++e) {
    const auto stretch = [&] { return uniform(random, 0.7, 1.3); };
    const Mat3 v = random_rotation(random);
    const double x = stretch(), y = stretch(), z = stretch();
    const Mat3 r = random_rotation(random);
    Vec3 away(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
    away *= std::pow(10.0, uniform(random, -6, -0.5)) / std::sqrt(away.squaredNorm());
    const Mat3 start = r * rotation_matrix(quaternion_from_rotation_vector({away[0], away[1], away[2]}));
    some.push_back({Kind::random, r * v * Vec3(x, y, z).asDiagonal() * v.transpose(),
                    polar_rotation(start, Quaternion{1, 0, 0, 0})});
  }
  return some;
}

TEST(RotationKernel, IsExactFromWarmStartsOfEveryDistance) {
  const Worst single = worst_through_the_kernel<float>(warm_gradients(16'000), widest_isa());
  EXPECT_LT(single.orthogonality, 1e-6);
  EXPECT_LT(single.rotation, 2e-6);
  const Worst twice = worst_through_the_kernel<double>(warm_gradients(16'000), widest_isa());
  EXPECT_LT(twice.orthogonality, 1e-14);
  EXPECT_LT(twice.rotation, 1e-14);
}

// Neighbours in a register need different numbers of steps, and which are neighbours depends on its width.
TEST(RotationKernel, GivesAnElementTheSameBitsWhateverItsNeighboursNeed) {
  std::vector<Gradient> some = warm_gradients(16'000), reversed(some.rbegin(), some.rend());
  const std::vector<double> one_way = through_the_kernel<float>(some, Isa::sse2);
  for (int isa = 0; isa <= static_cast<int>(widest_isa()); ++isa) {
    const std::vector<double> other_way = through_the_kernel<float>(reversed, static_cast<Isa>(isa));
    for (std::size_t e = 0; e < some.size(); ++e) {
      for (std::size_t k = 0; k < 4; ++k) {
        ASSERT_EQ(one_way[4 * e + k], other_way[4 * (some.size() - 1 - e) + k]) << "element " << e;
      }
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

}  // namespace
}  // namespace sulcus
