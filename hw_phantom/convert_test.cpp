#include "hw_phantom/convert.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace sulcus {
namespace {

struct Draw {
  std::mt19937_64 raw;
  double operator()() { return static_cast<double>(raw() >> 11) * 0x1p-52 - 1; }  // [-1, 1)
  Quaternion rotation() { return normalised({(*this)(), (*this)(), (*this)(), (*this)()}); }
};

// Column-major, mm.
void fill_transform(const Quaternion& q, const Vec3& position_mm, double (&transform)[16]) {
  const Mat3 r = rotation_matrix(q);
  for (int axis = 0; axis < 3; ++axis) {
    for (int row = 0; row < 3; ++row) transform[4 * axis + row] = r(row, axis);
    transform[4 * axis + 3] = 0;
    transform[12 + axis] = position_mm[axis];
  }
  transform[15] = 1;
}

double difference(const Quaternion& a, const Quaternion& b) {
  return rotation_vector(a * conjugate(b)).norm();
}

TEST(Convert, PoseOfATransformIsItsRotationAndItsPositionInMetres) {
  constexpr std::uint64_t seed = 77;
  SCOPED_TRACE(seed);
  Draw draw{std::mt19937_64(seed)};
  for (int i = 0; i < 1000; ++i) {
    Quaternion q = draw.rotation();
    if (i < 4)
      q = {i == 0 ? 1. : 0., i == 1 ? 1. : 0., i == 2 ? 1. : 0., i == 3 ? 1. : 0.};  // half turns too
    const Vec3 mm(100 * draw(), 100 * draw(), 100 * draw());
    double transform[16];
    fill_transform(q, mm, transform);
    StylusPose pose;
    ASSERT_TRUE(pose_from_transform(transform, pose));
    EXPECT_LT(difference(pose.orientation, q), 1e-14);
    EXPECT_LT((pose.position - 1e-3 * mm).norm(), 1e-16);
  }
}

TEST(Convert, RefusesWhatIsNoPose) {
  double good[16];
  fill_transform({}, {1, 2, 3}, good);
  StylusPose pose;
  ASSERT_TRUE(pose_from_transform(good, pose));
  const StylusPose before = pose;
  const auto refused = [&](int entry, double value) {
    double transform[16];
    std::copy(good, good + 16, transform);
    transform[entry] = value;
    return !pose_from_transform(transform, pose);
  };
  EXPECT_TRUE(refused(0, 0));
  EXPECT_TRUE(refused(0, -1));  // a reflection
  EXPECT_TRUE(refused(0, 1.01));
  EXPECT_TRUE(refused(5, std::numeric_limits<double>::quiet_NaN()));
  EXPECT_TRUE(refused(13, std::numeric_limits<double>::quiet_NaN()));
  EXPECT_TRUE(refused(14, 5000));
  double zeros[16] = {};
  EXPECT_FALSE(pose_from_transform(zeros, pose));
  EXPECT_EQ(pose.position, before.position);
}

// Each joint moves the gimbal the way that its sign says; the user looks along -z.
TEST(Convert, JointsHaveTheSignsOfTheDriver) {
  const auto pose = [](int joint, double angle) {
    double joints[3] = {0, 0.6, 0.5}, gimbals[3] = {0, 0, 0};
    (joint < 3 ? joints[joint] : gimbals[joint - 3]) += angle;
    return arm_pose(arm_angles(joints, gimbals));
  };
  const StylusPose before = pose(0, 0);
  EXPECT_LT(pose(0, 0.1).position.x(), before.position.x() - 0.005);  // turret + left
  EXPECT_GT(pose(1, 0.1).position.y(), before.position.y() + 0.01);   // thigh + up
  EXPECT_GT(pose(2, 0.1).position.y(), before.position.y() + 0.005);  // shin + up
  // the shin is absolute: the thigh does not turn the stylus, and the elbow is the difference
  EXPECT_LT(difference(pose(1, 0.1).orientation, before.orientation), 1e-14);
  const double joints[3] = {0, 0.6, 0.5}, gimbals[3] = {0, 0, 0};
  EXPECT_NEAR(arm_angles(joints, gimbals).elbow, 0.1, 1e-15);
  const Vec3 about[3] = {{0, 0.3, 0}, {-0.3, 0, 0}, {0, 0, -0.3}};  // in the forearm's axes
  for (int g = 0; g < 3; ++g) {
    const StylusPose turned = pose(3 + g, 0.3);
    EXPECT_EQ(turned.position, before.position);
    EXPECT_LT((rotation_vector(conjugate(before.orientation) * turned.orientation) - about[g]).norm(), 1e-14);
  }
}

TEST(Convert, TipLiesAlongTheStylusBehindTheGimbal) {
  const DeviceMount mount{{1, 0, 0}, {}, 0.039};
  EXPECT_LT((to_world(mount, {{0, 0, 0.1}, {}}).position - Vec3(1, 0, 0.061)).norm(), 1e-15);
}

TEST(Convert, MountTurnsPosesAndPowerIsKept) {
  constexpr std::uint64_t seed = 78;
  SCOPED_TRACE(seed);
  Draw draw{std::mt19937_64(seed)};
  for (int i = 0; i < 100; ++i) {
    const DeviceMount mount{{draw(), draw(), draw()}, draw.rotation(), 0.04};
    const StylusPose pose{{draw(), draw(), draw()}, draw.rotation()};
    const Vec3 tip = pose.position - 0.04 * (rotation_matrix(pose.orientation) * Vec3(0, 0, 1));
    const StylusPose world = to_world(mount, pose);
    EXPECT_LT((world.position - mount.position - rotation_matrix(mount.orientation) * tip).norm(), 1e-14);
    EXPECT_LT(difference(world.orientation, mount.orientation * pose.orientation), 1e-14);
    const Vec3 force(draw(), draw(), draw()), velocity(draw(), draw(), draw());
    EXPECT_NEAR(direction_from_world(mount, force).dot(velocity),
                force.dot(direction_to_world(mount, velocity)), 1e-14);
  }
}

}  // namespace
}  // namespace sulcus
