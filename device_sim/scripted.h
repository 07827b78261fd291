// A device that follows way-points: the hand motion of a scenario.
#pragma once

#include <memory>
#include <vector>

#include "engine/device/device.h"

namespace sulcus {

// How the segment that ENDS at a way-point is travelled, with tau in [0, 1] the share of its time that has
// passed:
//   linear         position and rotation vector proportional to tau (slerp along the shorter arc)
//   minimum_jerk   the same path with tau replaced by 10 tau^3 - 15 tau^4 + 6 tau^5: at rest at both ends
//   hold           at the pose of the way-point before, which must be given again, exactly
enum class Path { linear, minimum_jerk, hold };

struct Waypoint {
  double time_s = 0;               // s
  Vec3 position_m = Vec3::Zero();  // m
  Quaternion orientation;          // unit within 1 %, body -> world; normalised
  Path path = Path::minimum_jerk;  // of the segment that ends here; no meaning for the first one
};

struct ScriptedTrajectory {
  std::vector<Waypoint> waypoints;  // at least one, times strictly increasing
};

// Pose and analytic velocities at time_s: a function of time alone, without libm. Before the first way-point
// the device rests there. At a way-point the velocity is that of the segment that ends there (zero at the
// first). read() more than a nanosecond past the last way-point gives DeviceError::ended; within it, the last
// pose. Renders no force to anybody; force_sent is the command as long as it has not expired. Throws
// InputError for an empty trajectory, times that do not increase, numbers that are not finite, quaternions
// that are not unit, a hold that would move.
std::unique_ptr<Device> make_scripted_device(ScriptedTrajectory trajectory);

}  // namespace sulcus
