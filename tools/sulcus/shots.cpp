#include <algorithm>
#include <cstdio>
#include <limits>

#include "engine/mesh/resample.h"
#include "tools/sulcus/support.h"
#include "verify/png.h"
#include "verify/run_picture.h"

namespace sulcus {

void render_shots(const Scenario& scenario, const Scene& scene, const std::vector<ShotFrame>& frames,
                  const std::filesystem::path& directory) {
  if (frames.empty()) return;
  constexpr int smoothing_passes = 15;
  const auto surface_of = [&](const std::vector<std::uint8_t>& alive) {
    if (std::find(alive.begin(), alive.end(), 0) == alive.end())
      return build_embedded_surface(scene.settings.map, scene.settings.pairs, scene.mesh, smoothing_passes);
    return build_embedded_surface(without_torn_voxels(scene.settings.map, scene.mesh, alive),
                                  scene.settings.pairs, scene.mesh, smoothing_passes, alive);
  };
  EmbeddedSurface surface = surface_of(frames.front().state.alive);
  Progress progress(scenario.name + ": pictures", static_cast<std::int64_t>(frames.size()));
  for (std::size_t f = 0; f < frames.size(); ++f) {
    const auto& [shot, state] = frames[f];
    if (f > 0 && state.alive != frames[f - 1].state.alive) surface = surface_of(state.alive);
    const std::vector<double> positions = deform_surface(surface, scene.mesh, state.positions);
    std::vector<double> stress;
    RunPicture picture;
    picture.surface = &surface;
    picture.surface_positions = positions;
    for (std::size_t t = 0; t < scene.settings.tools.size(); ++t) {
      const RigidBodyState tool = tool_state(state, t);
      picture.tools.push_back(
          {&scene.settings.tools[t].surface, tool.position, tool.orientation, Vec3::Zero(), Vec3::Zero()});
    }
    for (const Obstacle& obstacle : scene.settings.obstacles) {
      picture.tools.push_back(
          {&obstacle.surface, obstacle.position, obstacle.orientation, Vec3::Zero(), Vec3::Zero()});
    }
    picture.label_colours.insert(scenario.label_colours.begin(), scenario.label_colours.end());
    if (shot.show == ShotContent::max_principal_stress) {
      stress = max_principal_stress(scene, state);
      for (std::size_t t = 0; t < stress.size(); ++t) {
        if (!state.alive[t]) stress[t] = std::numeric_limits<double>::quiet_NaN();
      }
      picture.mesh = &scene.mesh;
      picture.tet_values = stress;
      picture.bar = {"largest principal stress", "Pa", 0, 0, ColourMap::ember};
    }
    picture.camera =
        Camera{shot.camera.eye_m, shot.camera.target_m, shot.camera.up, shot.camera.field_of_view_deg};
    picture.width = scenario.pictures.width;
    picture.height = scenario.pictures.height;
    char time[32];
    std::snprintf(time, sizeof time, "%.2f s", static_cast<double>(state.step) * scenario.scene.step_s);
    picture.title = scenario.title;
    picture.subtitle = shot.name + ", " + time;
    std::replace(picture.subtitle.begin(), picture.subtitle.end(), '_', ' ');
    char number[24];
    std::snprintf(number, sizeof number, "%02zu_", f);
    write_png(render_run_picture(picture), directory / (number + shot.name + ".png"));
    progress.at(static_cast<std::int64_t>(f) + 1);
  }
}

}  // namespace sulcus
