// From the driver's units and frame to the scene's, and back.
#pragma once

#include "engine/numerics/quaternion.h"
#include "engine/numerics/types.h"

namespace sulcus {

// Where the device stands in the scene: world = orientation * (driver's frame, in metres) + position.
// Lengths are not scaled, so that force times way keeps its meaning.
struct DeviceMount {
  Vec3 position = Vec3::Zero();  // m, the driver's origin in the world
  Quaternion orientation = {};   // unit, driver's frame -> world
  double tip_offset_m =
      0;  // m, from gimbal centre along the stylus' -z to the point that counts (Omni: 0.039)
};

struct StylusPose {
  Vec3 position = Vec3::Zero();  // m
  Quaternion orientation = {};   // unit, stylus -> frame
};

// From a column-major 4x4 transform in mm; frame stays the driver's, position is the gimbal centre.
// False, and `pose` untouched, unless it is a proper rotation (within 1e-3) and a position within 2 m: what a
// driver gives before its first data (zeros) or after a broken read (NaN) is refused.
bool pose_from_transform(const double (&transform)[16], StylusPose& pose);

// Angles of an Omni's arm [rad], each right-handed about an axis of the link before it, all zero where the
// upper arm points along +z and the forearm hangs down: the stylus' orientation in the driver's frame is
// Ry(turret) Rx(thigh) Rx(elbow) Ry(yaw) Rx(pitch) Rz(roll).
struct ArmAngles {
  double turret = 0, thigh = 0, elbow = 0, yaw = 0, pitch = 0, roll = 0;
};

// From what the driver gives: turret + to the left, thigh + up, shin + up and absolute, that is, with the
// thigh's angle already in it; gimbal angles as in the published model.
ArmAngles arm_angles(const double (&joints)[3], const double (&gimbals)[3]);

// Where an Omni's gimbal then is: driver's frame, m. Links of 133.35 mm; of other models, and of a gimbal
// with an offset of its own, it tells nothing.
StylusPose arm_pose(const ArmAngles& angles);

StylusPose to_world(const DeviceMount& mount, const StylusPose& pose);  // position of the tip
Vec3 direction_to_world(const DeviceMount& mount, const Vec3& v);
Vec3 direction_from_world(const DeviceMount& mount, const Vec3& v);

}  // namespace sulcus
