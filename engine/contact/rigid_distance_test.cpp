#include "engine/contact/rigid_distance.h"

#include <gtest/gtest.h>

#include <random>

#include "engine/contact/test_tools.h"
#include "engine/numerics/error.h"
#include "engine/numerics/test_random.h"

namespace sulcus {
namespace {

double box_distance(const Vec3& half, const Vec3& p) {
  const Vec3 q = p.cwiseAbs() - half;
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

Vec3 random_point(std::mt19937_64& random, const RigidDistance& field) {
  Vec3 p;
  for (int a = 0; a < 3; ++a) {
    p[a] = field.origin[a] +
           uniform(random, 0, 0.999) * (field.size[static_cast<std::size_t>(a)] - 1) * field.spacing_m;
  }
  return p;
}

TEST(RigidDistance, OfABoxEqualsTheFormulaAtTheGridPoints) {
  const Vec3 size(0.0215, 0.002, 0.06);
  const RigidDistance field = build_rigid_distance(box_tool(size), 0.001);
  double largest = 0;
  for (int k = 0; k < field.size[2]; ++k) {
    for (int j = 0; j < field.size[1]; ++j) {
      for (int i = 0; i < field.size[0]; ++i) {
        const Vec3 p = field.origin + field.spacing_m * Vec3(i, j, k);
        const auto at = static_cast<std::size_t>((k * field.size[1] + j) * field.size[0] + i);
        largest = std::max(largest,
                           std::fabs(static_cast<double>(field.distance_m[at]) - box_distance(size / 2, p)));
      }
    }
  }
  EXPECT_LT(largest, 1e-8);
}

TEST(RigidDistance, OfASphereIsWithinTheErrorOfItsTrianglesAndOfTheInterpolation) {
  const std::uint64_t seed = 12;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  const double radius = 0.03;
  const RigidDistance field = build_rigid_distance(sphere_tool(radius), 0.001);
  for (int n = 0; n < 20000; ++n) {
    const Vec3 p = random_point(random, field);
    if (p.norm() < 0.25 * radius) continue;  // where the field bends within a spacing
    Vec3 slope;
    EXPECT_NEAR(sample(field, p, &slope), p.norm() - radius, 1.5e-4);
    EXPECT_GT(slope.dot(p.normalized()),
              0.9);  // less than 1 where the nearest triangle changes within a cell
  }
}

TEST(RigidDistance, SlopeIsTheDerivativeOfTheInterpolation) {
  const std::uint64_t seed = 3;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  const RigidDistance field = build_rigid_distance(box_tool({0.02, 0.01, 0.03}), 0.001);
  int tested = 0;
  for (int n = 0; n < 3000; ++n) {
    const Vec3 p = random_point(random, field);
    const Vec3 place = (p - field.origin) / field.spacing_m;
    if (((place.array() - place.array().floor()) < 0.01).any()) continue;  // not across a grid plane
    if (((place.array() - place.array().floor()) > 0.99).any()) continue;
    Vec3 slope, difference;
    sample(field, p, &slope);
    for (int a = 0; a < 3; ++a) {
      const double step = 1e-6;
      difference[a] =
          (sample(field, p + step * Vec3::Unit(a)) - sample(field, p - step * Vec3::Unit(a))) / (2 * step);
    }
    EXPECT_LT((slope - difference).norm(), 1e-6);
    ++tested;
  }
  EXPECT_GT(tested, 1000);
}

TEST(RigidDistance, IsPositiveOutsideItsGridAndCoarsensForAHugeTool) {
  const RigidDistance field = build_rigid_distance(box_tool({1, 1, 1}), 1e-4);
  EXPECT_LE(field.distance_m.size(), 1000000U);
  EXPECT_GT(sample(field, Vec3(5, 0, 0)), 0);
  EXPECT_LT(sample(field, Vec3::Zero()), 0);
}

TEST(RigidDistance, RefusesASurfaceWithoutTriangles) {
  EXPECT_THROW(build_rigid_distance({}, 0.001), InputError);
}

}  // namespace
}  // namespace sulcus
