// What a run of tissue that tears records beside its series: numbers and warnings.
#pragma once

#include "engine/mesh/topology.h"
#include "engine/scene/step.h"
#include "verify/recording.h"

namespace sulcus {

// What hung on hinges, over the frames that were looked at.
struct HangingRecord {
  FaceNeighbours faces;  // made at the first look
  std::int64_t most_elements = 0;
  double peak_kinetic_energy_J = 0;    // J, of the hanging elements
  double kinetic_energy_at_end_J = 0;  // J, at the last look
};
void look_at_hanging(const Scene& scene, const State& state, HangingRecord& record);

// Numbers "torn/label_<n>" (elements removed from cells of each label), "torn_voxels", "mesh_pieces_at_end",
// "loose_pieces_at_end", "hanging/..."; a warning where all is torn or pieces float.
void record_torn(const Scene& scene, const State& state, const HangingRecord& hanging, RunWriter& writer);

}  // namespace sulcus
