#include "hw_phantom/convert.h"

#include <Eigen/Geometry>
#include <cmath>

namespace sulcus {
namespace {

constexpr double metres_per_mm = 1e-3;

// The largest of the four components is taken from the diagonal (Shepperd), the others from it.
Quaternion quaternion_of(const Mat3& r) {
  const double trace = r.trace();
  Quaternion q;
  if (trace >= r(0, 0) && trace >= r(1, 1) && trace >= r(2, 2)) {
    q = {1 + trace, r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)};
  } else if (r(0, 0) >= r(1, 1) && r(0, 0) >= r(2, 2)) {
    q = {r(2, 1) - r(1, 2), 1 + 2 * r(0, 0) - trace, r(0, 1) + r(1, 0), r(0, 2) + r(2, 0)};
  } else if (r(1, 1) >= r(2, 2)) {
    q = {r(0, 2) - r(2, 0), r(0, 1) + r(1, 0), 1 + 2 * r(1, 1) - trace, r(1, 2) + r(2, 1)};
  } else {
    q = {r(1, 0) - r(0, 1), r(0, 2) + r(2, 0), r(1, 2) + r(2, 1), 1 + 2 * r(2, 2) - trace};
  }
  return normalised(q);
}

}  // namespace

bool pose_from_transform(const double (&transform)[16], StylusPose& pose) {
  Mat3 r;
  Vec3 position;
  for (int axis = 0; axis < 3; ++axis) {
    for (int row = 0; row < 3; ++row) r(row, axis) = transform[4 * axis + row];
    position[axis] = metres_per_mm * transform[12 + axis];
  }
  const double error = (r.transpose() * r - Mat3::Identity()).cwiseAbs().sum();
  const double det = r.col(0).dot(r.col(1).cross(r.col(2)));
  // Negated comparisons, so that NaN is refused.
  if (!(error < 1e-3) || !(det > 0) || !(position.squaredNorm() < 4)) return false;
  pose = {position, quaternion_of(r)};
  return true;
}

ArmAngles arm_angles(const double (&joints)[3], const double (&gimbals)[3]) {
  return {.turret = 0 - joints[0],  // 0, not -0
          .thigh = 0 - joints[1],
          .elbow = joints[1] - joints[2],
          .yaw = gimbals[0],
          .pitch = 0 - gimbals[1],
          .roll = 0 - gimbals[2]};
}

StylusPose arm_pose(const ArmAngles& angles) {
  constexpr double link_m = 0.13335;                       // upper arm and forearm alike
  const Vec3 shoulder(0, link_m - 0.11, -link_m - 0.035);  // m
  const auto turn = [](double x, double y, double z) { return quaternion_from_rotation_vector({x, y, z}); };
  const Quaternion upper = turn(0, angles.turret, 0) * turn(angles.thigh, 0, 0);
  const Quaternion fore = upper * turn(angles.elbow, 0, 0);
  return {
      shoulder + rotation_matrix(upper) * Vec3(0, 0, link_m) + rotation_matrix(fore) * Vec3(0, -link_m, 0),
      normalised(fore * turn(0, angles.yaw, 0) * turn(angles.pitch, 0, 0) * turn(0, 0, angles.roll))};
}

StylusPose to_world(const DeviceMount& mount, const StylusPose& pose) {
  const Vec3 tip = pose.position - mount.tip_offset_m * rotation_matrix(pose.orientation).col(2);
  return {mount.position + direction_to_world(mount, tip), normalised(mount.orientation * pose.orientation)};
}

Vec3 direction_to_world(const DeviceMount& mount, const Vec3& v) {
  return rotation_matrix(mount.orientation) * v;
}

Vec3 direction_from_world(const DeviceMount& mount, const Vec3& v) {
  return rotation_matrix(mount.orientation).transpose() * v;
}

}  // namespace sulcus
