// The frames of a recording as VTK and ParaView read them: the group /VTKHDF (layout "VTKHDF", unstructured
// grid with steps), made of links and virtual datasets, so that no number is stored twice. Used by
// recording_write.cpp alone.
#pragma once

#include <span>

#include "verify/hdf5_file.h"
#include "verify/recording.h"

namespace sulcus {

// After the frames: frame_times_s [frames], at least one. Throws hdf5::Failure.
void write_vtk_group(hid_t file, const RunHeader& header, std::span<const double> frame_times_s);

}  // namespace sulcus
