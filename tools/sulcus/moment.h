// A moment of a recording, for what is made of one: volumes and surfaces.
#pragma once

#include <filesystem>

#include "engine/scene/scene.h"
#include "engine/scene/state.h"
#include "verify/recording.h"

namespace sulcus {

// run.h5 of a run's folder, or the file itself.
std::filesystem::path recording_of(const std::filesystem::path& path);

// The scene of a recording. Throws InputError if its label map has changed since.
Scene recorded_scene(const std::filesystem::path& recording, const RunData& run);

struct Moment {
  double time_s = 0;
  State state;  // positions and alive elements only
};

// The recorded moment nearest to the wanted one (s; negative: the end): a frame, or the end. Throws
// InputError if that lies behind the end.
Moment nearest_moment(const std::filesystem::path& recording, const RunData& run, double wanted_s);

}  // namespace sulcus
