// A device that follows way-points: the hand motion of a scenario.
#pragma once

#include <memory>
#include <vector>

#include "device_sim/tremor.h"
#include "engine/device/device.h"

namespace sulcus {

// How the segment that ENDS at a way-point is travelled, with tau in [0, 1] the share of its time that has
// passed:
//   linear         position and rotation vector proportional to tau (slerp along the shorter arc)
//   minimum_jerk   the same path with tau replaced by 10 tau^3 - 15 tau^4 + 6 tau^5: at rest at both ends
//   hold           at the pose of the way-point before, which must be given again, exactly
//   spline         cubic Hermite curve of the position, and of the rotation vector from the segment's start.
//   Between
//                  two spline segments the velocity is that of the parabola through the way-point and its two
//                  neighbours (so it is continuous); where a run of spline segments begins or ends it is zero
enum class Path { linear, minimum_jerk, hold, spline };

struct Waypoint {
  double time_s = 0;               // s
  Vec3 position_m = Vec3::Zero();  // m
  Quaternion orientation = {};     // unit within 1 %, body -> world; normalised
  Path path = Path::minimum_jerk;  // of the segment that ends here; no meaning for the first one
  std::uint32_t buttons = 0;       // down from here to the next way-point
};

struct ScriptedTrajectory {
  std::vector<Waypoint> waypoints;  // at least one, times strictly increasing
  Tremor tremor = {};               // on top of the way; none by default
};

// Pose, velocities and buttons at a moment.
struct HandMotion {
  Vec3 position = Vec3::Zero();          // m
  Quaternion orientation = {};           // unit, body -> world
  Vec3 linear_velocity = Vec3::Zero();   // m/s, analytic
  Vec3 angular_velocity = Vec3::Zero();  // rad/s, world axes, analytic
  std::uint32_t buttons = 0;
};

// A checked trajectory, ready to be followed. Throws InputError for an empty trajectory, times that do not
// increase, numbers that are not finite, quaternions that are not unit, a hold that would move, a tremor
// without a band.
class ScriptedPath {
 public:
  explicit ScriptedPath(ScriptedTrajectory trajectory);

  double end_s() const { return trajectory_.waypoints.back().time_s; }

  // A function of time alone, without libm. Before the first way-point: at rest there; after the last: at
  // rest there. At a way-point the velocity is that of the segment that ends there (zero at the first).
  HandMotion at(double time_s) const;

 private:
  struct Tangent {
    Vec3 linear = Vec3::Zero();   // m/s
    Vec3 angular = Vec3::Zero();  // rad/s
  };

  void set_tangents();
  HandMotion along_segment(std::size_t end, double time_s) const;

  ScriptedTrajectory trajectory_;
  std::vector<Tangent> tangents_;  // [waypoints], of spline segments
  TremorTones tones_;
};

// Writes the motion into a sample; both velocities are valid.
void put(const HandMotion& motion, DeviceSample& sample);

// read() more than a nanosecond past the last way-point gives DeviceError::ended; within it, the last pose.
// Renders no force to anybody; force_sent is the command as long as it has not expired. Throws as
// ScriptedPath.
std::unique_ptr<Device> make_scripted_device(ScriptedTrajectory trajectory);

}  // namespace sulcus
