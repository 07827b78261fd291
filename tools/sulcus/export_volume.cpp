// A recorded deformation applied to an image (thesis 2.6, 2.7.4).
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "engine/mesh/resample.h"
#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/support.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

// The scene of a recording; refuses one whose label map has changed since.
Scene recorded_scene(const fs::path& recording, const RunData& run) {
  const Scenario scenario = load_scenario_text(run.header.scenario_json, recording.string(), ".");
  Scene scene = make_scene(scenario);
  std::vector<double> rest;
  for (const Vec3& x : scene.mesh.rest_positions) rest.insert(rest.end(), {x[0], x[1], x[2]});
  std::vector<std::int32_t> tets;
  for (const auto& tet : scene.mesh.tets) tets.insert(tets.end(), tet.begin(), tet.end());
  if (rest != run.header.rest_positions || tets != run.header.tets) {
    throw InputError(recording.string() +
                     ": the scenario in it gives another mesh than the recording has; was its label map "
                     "changed?");
  }
  return scene;
}

// The recorded moment nearest to the wanted one: a frame, or the end.
struct Moment {
  double time_s = 0;
  State state;  // positions and alive elements only
};

Moment nearest_moment(const fs::path& recording, const RunData& run, double wanted_s) {
  const double end_s = static_cast<double>(run.steps) * run.header.step_s;
  if (wanted_s < 0) wanted_s = end_s;
  if (!(wanted_s <= end_s + 0.5 * run.header.step_s)) {
    throw InputError(recording.string() + ": --at " + std::to_string(wanted_s) +
                     " lies behind the end of the run; give 0 to " + std::to_string(end_s) + " s");
  }
  Moment moment;
  moment.time_s = end_s;
  moment.state.positions = run.final_state.positions;
  moment.state.alive = run.final_state.alive;
  for (const Frame& frame : run.frames) {
    if (std::fabs(frame.time_s - wanted_s) >= std::fabs(moment.time_s - wanted_s)) continue;
    moment.time_s = frame.time_s;
    moment.state.positions = frame.positions;
    moment.state.alive = frame.alive;
  }
  return moment;
}

template <class T>
T fill_value(double fill, const fs::path& image) {
  const bool fits =
      fill >= static_cast<double>(std::numeric_limits<T>::lowest()) &&
      fill <= static_cast<double>(std::numeric_limits<T>::max()) &&
      (!std::is_integral_v<T> || (fill == std::floor(fill) && std::fabs(fill) <= 9007199254740992.0));
  if (!fits) {
    throw InputError("--fill " + std::to_string(fill) + " is no value that a voxel of " + image.string() +
                     " can have; give one of its type");
  }
  return static_cast<T>(fill);
}

VoxelImage resampled(const VoxelImage& image, const TissueImage& tissue, const ExportOptions& options) {
  VoxelImage result{image.geometry, image.type, {}};
  visit_voxel_type(image.type, [&]<class T>(T) {
    const std::span<const T> values(reinterpret_cast<const T*>(image.bytes.data()),
                                    image.bytes.size() / sizeof(T));
    const std::vector<T> moved =
        resample_image<T>(image.geometry, values, tissue,
                          options.interpolation == "linear" ? Interpolation::linear : Interpolation::nearest,
                          fill_value<T>(options.fill, options.like));
    const char* bytes = reinterpret_cast<const char*>(moved.data());
    result.bytes.assign(bytes, bytes + moved.size() * sizeof(T));
  });
  return result;
}

VoxelImage stress_image(const Scene& scene, const State& state, const TissueImage& tissue,
                   const ImageGeometry& geometry) {
  const std::vector<double> stress = max_principal_stress(scene, state);
  const std::vector<float> single(stress.begin(), stress.end());
  const std::vector<float> values = resample_tet_values(single, tissue, 0);
  const char* bytes = reinterpret_cast<const char*>(values.data());
  return {geometry, VoxelType::float32, {bytes, bytes + values.size() * sizeof(float)}};
}

// out.nii.gz -> out_max_principal_stress.nii.gz
fs::path overlay_path(fs::path out, const std::string& overlay) {
  if (out.filename().empty()) out = out.parent_path();
  const std::string name = out.filename().string();
  const std::string stem = name.substr(0, name.find('.'));
  return out.parent_path() / (stem + "_" + overlay + name.substr(stem.size()));
}

}  // namespace

int export_volume_command(const ExportOptions& options) {
  check_image_name(options.out);
  const fs::path overlay = options.overlay.empty() ? fs::path() : overlay_path(options.out, options.overlay);
  if (!overlay.empty()) check_image_name(overlay);
  const fs::path recording =
      fs::is_directory(options.recording) ? options.recording / "run.h5" : options.recording;
  const RunData run = read_run(recording);
  const Moment moment = nearest_moment(recording, run, options.at_s);
  const Scene scene = recorded_scene(recording, run);
  const VoxelImage image =
      options.like.empty() ? label_image(scene.settings.map) : read_image(options.like, ImageUse::grey);
  const TissueImage tissue = locate_tissue(scene.settings.map, scene.mesh, moment.state.positions,
                                           moment.state.alive, image.geometry);
  const VoxelImage result = resampled(image, tissue, options);
  const auto voxels = static_cast<std::int64_t>(tissue.voxel.size());
  const std::int64_t held = voxels - tissue.background_voxels - tissue.gap_voxels - tissue.folded_voxels;
  if (held == 0) {
    throw InputError(options.like.string() + ": none of its voxels lies in the tissue of " +
                     recording.string() + "; is it the image of another patient, or in another space?");
  }
  write_image(options.out, result);
  std::printf("%s: %lld voxels at %.4g s: %lld tissue, %lld background, %lld gaps, %lld folded\n",
              options.out.c_str(), static_cast<long long>(voxels), moment.time_s,
              static_cast<long long>(held), static_cast<long long>(tissue.background_voxels),
              static_cast<long long>(tissue.gap_voxels), static_cast<long long>(tissue.folded_voxels));
  if (!overlay.empty()) {
    write_image(overlay, stress_image(scene, moment.state, tissue, image.geometry));
    std::printf("%s: largest principal stress, Pa\n", overlay.c_str());
  }
  return 0;
}

}  // namespace sulcus
