#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/numerics/elementary.h"
#include "engine/numerics/quaternion.h"
#include "engine/numerics/test_random.h"

namespace sulcus {
namespace {

double ulps(double value, double expected) {
  const double unit = std::nextafter(std::fabs(expected), INFINITY) - std::fabs(expected);
  return std::fabs(value - expected) / unit;
}

TEST(Elementary, AgreesWithTheMathLibraryToAFewUlps) {
  const std::uint64_t seed = 1;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (int i = 0; i < 200000; ++i) {
    const double x = uniform(random, -20, 20);
    // near its zeros the error of sin is that of the reduced argument: absolute
    EXPECT_LE(std::min(ulps(det_sin(x), std::sin(x)), std::fabs(det_sin(x) - std::sin(x)) / 1e-18), 2) << x;
    EXPECT_LE(std::min(ulps(det_cos(x), std::cos(x)), std::fabs(det_cos(x) - std::cos(x)) / 1e-18), 2) << x;
    EXPECT_LE(ulps(det_exp(x * 30), std::exp(x * 30)), 2) << x;
    const double y = uniform(random, -20, 20);
    EXPECT_LE(ulps(det_atan2(y, x), std::atan2(y, x)), 4) << y << ' ' << x;
  }
}

TEST(Elementary, KeepsTheSpecialValues) {
  EXPECT_EQ(det_sin(0.0), 0.0);
  EXPECT_EQ(det_cos(0.0), 1.0);
  EXPECT_EQ(det_exp(0.0), 1.0);
  EXPECT_EQ(det_exp(-1000.0), 0.0);
  EXPECT_TRUE(std::isinf(det_exp(1000.0)));
  EXPECT_EQ(det_atan2(0.0, 1.0), 0.0);
  EXPECT_NEAR(det_atan2(1.0, 0.0), M_PI / 2, 1e-15);
  EXPECT_NEAR(det_atan2(-1.0, -1.0), -3 * M_PI / 4, 1e-15);
  EXPECT_TRUE(std::isnan(det_sin(1e9)));
  EXPECT_TRUE(std::isnan(det_atan2(NAN, 1.0)));
}

TEST(QuaternionTest, RotationVectorIsTheInverseOfTheExponential) {
  const std::uint64_t seed = 2;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (int i = 0; i < 10000; ++i) {
    Vec3 axis(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
    axis /= axis.norm();
    const double angle = i % 3 == 0 ? 1e-9 * i : uniform(random, 0, 3.14);
    const Quaternion q = quaternion_from_rotation_vector(axis * angle);
    EXPECT_LT((rotation_vector(q) - axis * angle).norm(), 1e-13) << angle;
    const Quaternion opposite{-q.s, -q.x, -q.y, -q.z};
    EXPECT_LT((rotation_vector(opposite) - axis * angle).norm(), 1e-13) << angle;
  }
}

TEST(QuaternionTest, ProductRotatesOneAfterTheOther) {
  const Quaternion a = quaternion_from_rotation_vector({0.3, -0.7, 0.2});
  const Quaternion b = quaternion_from_rotation_vector({-1.1, 0.4, 0.9});
  EXPECT_LT((rotation_matrix(a * b) - rotation_matrix(a) * rotation_matrix(b)).norm(), 1e-15);
  EXPECT_LT((rotation_matrix(conjugate(a)) - rotation_matrix(a).transpose()).norm(), 1e-15);
}

TEST(QuaternionTest, RotationMatrixDoesNotDependOnTheLength) {
  const Quaternion q = quaternion_from_rotation_vector({0.3, -0.7, 0.2});
  const Quaternion longer{3 * q.s, 3 * q.x, 3 * q.y, 3 * q.z};
  EXPECT_LT((rotation_matrix(q) - rotation_matrix(longer)).norm(), 1e-15);
}

TEST(QuaternionTest, NormalisingNonsenseGivesTheIdentity) {
  EXPECT_EQ(normalised({0, 0, 0, 0}).s, 1);
  EXPECT_EQ(normalised({NAN, 0, 0, 0}).s, 1);
}

}  // namespace
}  // namespace sulcus
