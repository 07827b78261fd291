// A recorded deformation applied to an image (thesis 2.6, 2.7.4).
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "engine/mesh/resample.h"
#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/moment.h"
#include "tools/sulcus/support.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

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
  const fs::path recording = recording_of(options.recording);
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
