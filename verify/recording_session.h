// The part of a recording that only sessions have, "/session". Used by recording_*.cpp alone.
#pragma once

#include <span>
#include <vector>

#include "verify/hdf5_file.h"
#include "verify/recording.h"

namespace sulcus {

void write_session_header(hid_t file, const SessionHeader& session);
std::vector<hdf5::Column> tick_columns(hid_t file, std::size_t tool);
void append_tick(std::vector<hdf5::Column>& columns, const ServoTick& tick);
void write_session_histograms(hid_t file, std::span<const Histogram> histograms);

void read_session(hdf5::Reader& file, RunData& run);  // nothing for a recording without a session

}  // namespace sulcus
