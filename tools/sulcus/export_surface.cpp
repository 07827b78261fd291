// The surface of a set of labels as a recorded deformation left it.
#include <algorithm>
#include <cstdio>

#include "engine/mesh/resample.h"
#include "engine/mesh/surface.h"
#include "engine/numerics/error.h"
#include "engine/volume/label_operations.h"
#include "scenarios/loader/mesh_files.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/moment.h"
#include "verify/check.h"

namespace sulcus {
namespace fs = std::filesystem;

int export_surface_command(const ExportSurfaceOptions& options) {
  check_surface_name(options.out);
  const fs::path recording = recording_of(options.recording);
  const RunData run = read_run(recording);
  const Moment moment = nearest_moment(recording, run, options.at_s);
  const Scene scene = recorded_scene(recording, run);
  LabelMap map = without_torn_voxels(scene.settings.map, scene.mesh, moment.state.alive);
  for (std::int32_t label : options.labels) {
    if (std::find(map.labels.begin(), map.labels.end(), label) != map.labels.end()) continue;
    throw InputError("--labels: no voxel of " + recording.string() + " has label " + std::to_string(label) +
                     " and is held by an element; `sulcus summary` and the label map tell which there are");
  }
  if (!options.labels.empty()) keep_labels(map, options.labels);
  const EmbeddedSurface surface = build_embedded_surface(map, scene.settings.pairs, scene.mesh,
                                                         options.smoothing_passes, moment.state.alive);
  const std::vector<double> positions = deform_surface(surface, scene.mesh, moment.state.positions);
  write_file_atomically(options.out, surface_file(options.out, positions, surface.triangles));
  std::printf("%s: %zu triangles, %zu vertices at %.4g s\n", options.out.c_str(), surface.triangles.size(),
              positions.size() / 3, moment.time_s);
  return 0;
}

}  // namespace sulcus
