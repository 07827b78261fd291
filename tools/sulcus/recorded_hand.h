// The hand of a tool out of a recording, for a scenario that names one.
#pragma once

#include "scenarios/loader/scenario.h"

namespace sulcus {

// At the end of step n of a run with the same time step: the sample that step n of the recording was given,
// also of a session, whose lateness is not in it. At time 0: where the recorded tool started. Throws
// InputError if the file is no sound recording, has no such tool or no step.
RecordedTrajectory recorded_hand(const HandFile& file);

}  // namespace sulcus
