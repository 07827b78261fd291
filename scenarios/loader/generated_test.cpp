#include "scenarios/loader/generated.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

std::map<int, int> count_labels(const LabelMap& map) {
  std::map<int, int> counts;
  for (const std::int32_t label : map.labels) ++counts[label];
  return counts;
}

TEST(GeneratedMaps, CylinderHasThreeSegmentsOfTheRightSize) {
  const LabelMap map = generate(CylinderThreeSegments{});
  EXPECT_EQ(map.size, (Index3{20, 76, 76}));
  const std::map<int, int> counts = count_labels(map);
  // A disc of 38 voxels radius has pi 38^2 = 4536 voxels, up to its rim.
  EXPECT_NEAR(counts.at(1) + counts.at(2) + counts.at(3), 20 * 4536, 20 * 40);
  EXPECT_EQ(counts.at(2), counts.at(3));
  EXPECT_EQ(counts.at(1), counts.at(2) + counts.at(3));
}

TEST(GeneratedMaps, CylinderIsCentredAndItsSegmentsLieAsDocumented) {
  const LabelMap map = generate(CylinderThreeSegments{});
  const auto label_at = [&](const Vec3& world) {
    const Vec3 voxel = map.to_voxel(world);
    return map
        .labels[map.index(static_cast<int>(std::lround(voxel[0])), static_cast<int>(std::lround(voxel[1])),
                          static_cast<int>(std::lround(voxel[2])))];
  };
  EXPECT_EQ(label_at({0, -0.02, 0.01}), 1);
  EXPECT_EQ(label_at({0, 0.02, 0.01}), 2);
  EXPECT_EQ(label_at({0, 0.02, -0.01}), 3);
  EXPECT_EQ(label_at({0, 0.0374, 0.0374}), 0);
  const Vec3 last = map.to_world(Vec3(map.size[0] - 1, map.size[1] - 1, map.size[2] - 1));
  EXPECT_LT((last + map.origin).norm(), 1e-15);
}

// Faces between voxels of labels 2 and 3.
int touching_faces(const LabelMap& map) {
  int faces = 0;
  for (int k = 0; k + 1 < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        faces += map.labels[map.index(i, j, k)] == 3 && map.labels[map.index(i, j, k + 1)] == 2;
      }
    }
  }
  return faces;
}

TEST(GeneratedMaps, SegmentsTwoAndThreeTouchAlongTheWholePlane) {
  EXPECT_EQ(touching_faces(generate(CylinderThreeSegments{})), 20 * 38);
}

TEST(GeneratedMaps, GapOfOneVoxelOpensThePlane) {
  CylinderThreeSegments shape;
  shape.gap_m = 0.001;
  EXPECT_EQ(touching_faces(generate(shape)), 0);
  EXPECT_EQ(count_labels(generate(shape)).at(2), count_labels(generate(shape)).at(3) - 20 * 38);
  shape.gap_from_y_m = 0.019;
  EXPECT_EQ(touching_faces(generate(shape)), 20 * 19);
}

TEST(GeneratedMaps, BoxIsFullAndSphereIsRound) {
  const LabelMap box = generate(BoxSegment{Vec3(0.01, 0.02, 0.03), 0.002, 7});
  EXPECT_EQ(box.size, (Index3{5, 10, 15}));
  EXPECT_EQ(count_labels(box), (std::map<int, int>{{7, 750}}));
  const LabelMap sphere = generate(SphereSegment{0.04, 0.001, 5});
  EXPECT_NEAR(count_labels(sphere).at(5), 4.0 / 3 * 3.14159265 * 8000, 150);
  EXPECT_EQ(sphere.labels.front(), 0);
}

TEST(GeneratedMaps, ImpossibleShapesAreRefused) {
  EXPECT_THROW(generate(BoxSegment{Vec3(0.01, -1, 0.01), 0.001, 1}), InputError);
  EXPECT_THROW(generate(BoxSegment{Vec3(0.01, 0.01, 0.0001), 0.001, 1}), InputError);
  EXPECT_THROW(generate(BoxSegment{Vec3(1e9, 1e9, 1e9), 1e-3, 1}), InputError);
  EXPECT_THROW(generate(BoxSegment{Vec3(1e300, 1e300, 1e300), 1e-300, 1}), InputError);
  EXPECT_THROW(generate(BoxSegment{Vec3(0.01, 0.01, 0.01), 0.001, 0}), InputError);
  EXPECT_THROW(generate(SphereSegment{NAN, 0.001, 1}), InputError);
  EXPECT_THROW(generate(CylinderThreeSegments{.gap_m = -1}), InputError);
}

TEST(GeneratedBalls, AreWhereTheyAreSaidToBeAndMeltIntoEachOther) {
  BallsSegment shape;
  shape.balls = {{Vec3(0.1, 0.02, 0), 0.01}, {Vec3(0.125, 0.02, 0), 0.01}};  // 5 mm apart
  shape.voxel_size_m = 0.0005;
  const auto volume_m3 = [&](const LabelMap& map) {
    std::int64_t voxels = 0;
    for (const std::int32_t label : map.labels) voxels += label != 0;
    return static_cast<double>(voxels) * 1.25e-10;
  };
  const auto label_at = [](const LabelMap& map, const Vec3& point) {
    const Vec3 voxel = map.to_voxel(point);
    return map
        .labels[map.index(static_cast<int>(std::lround(voxel[0])), static_cast<int>(std::lround(voxel[1])),
                          static_cast<int>(std::lround(voxel[2])))];
  };
  const double two_balls = 2 * 4.0 / 3 * 3.14159265358979 * 1e-6;
  const LabelMap apart = generate(shape);
  EXPECT_NEAR(volume_m3(apart), two_balls, 0.005 * two_balls);
  EXPECT_EQ(label_at(apart, {0.1, 0.02, 0.0095}), 1);
  EXPECT_EQ(label_at(apart, {0.1125, 0.02, 0}), 0);
  shape.blend_m = 0.02;
  const LabelMap joined = generate(shape);
  EXPECT_GT(volume_m3(joined), 1.05 * two_balls);
  EXPECT_EQ(label_at(joined, {0.1125, 0.02, 0}), 1);
  // where only one ball is near, nothing changes
  EXPECT_EQ(label_at(joined, {0.0905, 0.02, 0}), 1);
  EXPECT_EQ(label_at(joined, {0.0895, 0.02, 0}), 0);
  shape.balls.clear();
  EXPECT_THROW(generate(shape), InputError);
  shape.balls = {{Vec3::Zero(), -1.0}};
  EXPECT_THROW(generate(shape), InputError);
}

}  // namespace
}  // namespace sulcus
