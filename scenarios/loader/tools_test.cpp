#include "scenarios/loader/tools.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <set>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double pi = 3.14159265358979323846;

// Closed, oriented, of the sphere's topology, centred, outward.
void expect_good_tool(const ToolSurface& surface) {
  std::set<std::pair<int, int>> half_edges;
  std::set<int> used;
  for (const auto& triangle : surface.triangles) {
    for (int corner = 0; corner < 3; ++corner) {
      const int a = triangle[static_cast<std::size_t>(corner)],
                b = triangle[static_cast<std::size_t>((corner + 1) % 3)];
      EXPECT_NE(a, b);
      EXPECT_TRUE(half_edges.insert({a, b}).second) << "half-edge " << a << " " << b << " twice";
      used.insert(a);
    }
    const Vec3& p = surface.vertices[static_cast<std::size_t>(triangle[0])];
    const Vec3& q = surface.vertices[static_cast<std::size_t>(triangle[1])];
    const Vec3& r = surface.vertices[static_cast<std::size_t>(triangle[2])];
    EXPECT_GT((q - p).cross(r - p).norm(), 1e-12) << "flat triangle";
  }
  for (const auto& [a, b] : half_edges)
    EXPECT_TRUE(half_edges.count({b, a})) << "open edge " << a << " " << b;
  EXPECT_EQ(used.size(), surface.vertices.size());
  const auto vertices = static_cast<int>(surface.vertices.size());
  const auto edges = static_cast<int>(half_edges.size()) / 2;
  EXPECT_EQ(vertices - edges + static_cast<int>(surface.triangles.size()), 2);

  const SolidMoments moments = solid_moments(surface);
  EXPECT_GT(moments.volume_m3, 0);
  EXPECT_LT(moments.centre_m.norm(), 1e-12);
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Mat3>(moments.inertia_m5).eigenvalues()[0], 0);
}

Vec3 extent(const ToolSurface& surface) {
  Vec3 low = surface.vertices[0], high = low;
  for (const Vec3& vertex : surface.vertices) {
    low = low.cwiseMin(vertex);
    high = high.cwiseMax(vertex);
  }
  return high - low;
}

TEST(ToolSurfaces, AreClosedOrientedAndCentred) {
  for (const double bend : {-1.5, -0.2, 0.0, 1e-7, 0.3, 2.5}) {
    SCOPED_TRACE(bend);
    expect_good_tool(retractor_surface({.bend_rad = bend}));
  }
  expect_good_tool(
      retractor_surface({.length_m = 0.02, .width_m = 0.0199, .thickness_m = 0.0198, .bend_rad = 0}));
  for (int subdivisions = 0; subdivisions <= 4; ++subdivisions)
    expect_good_tool(sphere_surface({0.005, subdivisions}));
  expect_good_tool(box_surface({Vec3(0.01, 0.02, 0.003), 0.002}));
  expect_good_tool(box_surface({Vec3(0.01, 0.02, 0.003), 1}));
  expect_good_tool(capsule_surface({0.003, 0.040}));
  expect_good_tool(capsule_surface({0.003, 0.00601}));
}

TEST(ToolSurfaces, RetractorHasTheSizeOfTheThesis) {
  const ToolSurface surface = retractor_surface({});
  EXPECT_EQ(surface.vertices.size(), 712u);
  EXPECT_EQ(surface.triangles.size(), 1420u);
}

TEST(ToolSurfaces, StraightRetractorKeepsItsMeasures) {
  const Vec3 size =
      extent(retractor_surface({.length_m = 0.07, .width_m = 0.01, .thickness_m = 0.002, .bend_rad = 0}));
  EXPECT_NEAR(size[0], 0.01, 1e-12);
  EXPECT_NEAR(size[1], 0.002, 1e-12);
  EXPECT_NEAR(size[2], 0.07, 1e-12);
}

TEST(ToolSurfaces, PositiveBendTurnsTheTipToPlusY) {
  const ToolSurface surface = retractor_surface({.bend_rad = 0.4});
  const Vec3 tip = surface.vertices.front(), middle = Vec3(0, 0, 0), handle = surface.vertices.back();
  EXPECT_LT(tip[2], -0.035);
  EXPECT_GT(handle[2], 0.035);
  EXPECT_GT(tip[1], middle[1]);
  EXPECT_NEAR(tip[1], handle[1], 1e-9);
}

TEST(ToolSurfaces, MomentsOfTheBoxAreExact) {
  const Vec3 size(0.01, 0.02, 0.03);
  const SolidMoments moments = solid_moments(box_surface({size, 0.004}));
  const double volume = size.prod();
  EXPECT_NEAR(moments.volume_m3 / volume, 1, 1e-12);
  EXPECT_NEAR(moments.inertia_m5(0, 0) / (volume / 12 * (size[1] * size[1] + size[2] * size[2])), 1, 1e-12);
  EXPECT_NEAR(moments.inertia_m5(2, 2) / (volume / 12 * (size[0] * size[0] + size[1] * size[1])), 1, 1e-12);
  EXPECT_NEAR(moments.inertia_m5(0, 1) / moments.inertia_m5(0, 0), 0, 1e-12);
}

TEST(ToolSurfaces, FineSphereApproachesTheBall) {
  const double radius = 0.005, volume = 4.0 / 3 * pi * radius * radius * radius;
  const double coarse = 1 - solid_moments(sphere_surface({radius, 2})).volume_m3 / volume;
  const double fine = 1 - solid_moments(sphere_surface({radius, 3})).volume_m3 / volume;
  EXPECT_GT(fine, 0);
  EXPECT_LT(fine, 0.015);
  EXPECT_NEAR(coarse / fine, 4, 0.3);  // second order in the edge length
  EXPECT_EQ(sphere_surface({radius, 3}).vertices.size(), 642u);
}

TEST(ToolSurfaces, CapsuleHasItsLength) {
  const Vec3 size = extent(capsule_surface({0.003, 0.04}));
  EXPECT_NEAR(size[2], 0.04, 1e-12);
  EXPECT_NEAR(size[0], 0.006, 1e-12);
}

TEST(ToolSurfaces, ImpossibleSizesAreRefused) {
  EXPECT_THROW(retractor_surface({.length_m = 0}), InputError);
  EXPECT_THROW(retractor_surface({.length_m = NAN}), InputError);
  EXPECT_THROW(retractor_surface({.thickness_m = 0.02}), InputError);
  EXPECT_THROW(retractor_surface({.length_m = 0.01}), InputError);
  EXPECT_THROW(retractor_surface({.bend_rad = 3.2}), InputError);
  EXPECT_THROW(sphere_surface({0.005, 9}), InputError);
  EXPECT_THROW(sphere_surface({-1, 2}), InputError);
  EXPECT_THROW(box_surface({Vec3(0.01, 0, 0.01), 0.002}), InputError);
  EXPECT_THROW(box_surface({Vec3(1, 1, 1), 1e-5}), InputError);
  EXPECT_THROW(capsule_surface({0.01, 0.02}), InputError);
}

}  // namespace
}  // namespace sulcus
