// Hand motions from a table of comma-separated values.
#pragma once

#include <iosfwd>
#include <string>

#include "device_sim/scripted.h"

namespace sulcus {

// First line, exactly: time_s,x_m,y_m,z_m,qs,qx,qy,qz with or without ,buttons at its end. Then one sample a
// line: seconds (strictly increasing), metres, a unit quaternion body -> world, a bit mask (decimal). Empty
// lines and lines that begin with # are passed over; decimal points whatever the locale; \r\n is accepted.
//
// Resampling: between two samples the position is linear in time and the rotation a slerp along the shorter
// arc; the velocities are those of the segment (constant in it); buttons are those of the earlier sample.
// Nothing is filtered.
//
// Throws InputError with file and line, EnvironmentError if the file cannot be opened.
ScriptedTrajectory read_trajectory_csv(const std::string& file);
ScriptedTrajectory read_trajectory_csv(std::istream& in, const std::string& name);

}  // namespace sulcus
