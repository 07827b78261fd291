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
