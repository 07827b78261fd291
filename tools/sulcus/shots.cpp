#include "tools/sulcus/shots.h"

#include <algorithm>
#include <cstdio>
#include <limits>

#include "engine/mesh/resample.h"
#include "tools/sulcus/support.h"
#include "verify/png.h"
#include "verify/run_picture.h"

namespace sulcus {

ShotRenderer::ShotRenderer(const Scenario& scenario, const Scene& scene)
    : scenario_(scenario), scene_(scene) {}

// The tissue's surface, made again only where something has torn.
const EmbeddedSurface& ShotRenderer::surface_of(const std::vector<std::uint8_t>& alive) {
  constexpr int smoothing_passes = 15;
  if (surface_ && alive == alive_) return *surface_;
  alive_ = alive;
  const LabelMap& map = scene_.settings.map;
  if (std::find(alive.begin(), alive.end(), 0) == alive.end())
    surface_ = build_embedded_surface(map, scene_.settings.pairs, scene_.mesh, smoothing_passes);
  else
    surface_ = build_embedded_surface(without_torn_voxels(map, scene_.mesh, alive), scene_.settings.pairs,
                                      scene_.mesh, smoothing_passes, alive);
  return *surface_;
}

Image ShotRenderer::image(const Shot& shot, const State& state) {
  const EmbeddedSurface& surface = surface_of(state.alive);
  const std::vector<double> positions = deform_surface(surface, scene_.mesh, state.positions);
  std::vector<double> stress;
  RunPicture picture;
  picture.surface = &surface;
  picture.surface_positions = positions;
  for (std::size_t t = 0; t < scene_.settings.tools.size(); ++t) {
    const RigidBodyState tool = tool_state(state, t);
    picture.tools.push_back(
        {&scene_.settings.tools[t].surface, tool.position, tool.orientation, Vec3::Zero(), Vec3::Zero()});
  }
  for (const Obstacle& obstacle : scene_.settings.obstacles) {
    picture.tools.push_back(
        {&obstacle.surface, obstacle.position, obstacle.orientation, Vec3::Zero(), Vec3::Zero()});
  }
  picture.label_colours.insert(scenario_.label_colours.begin(), scenario_.label_colours.end());
  if (shot.show == ShotContent::max_principal_stress) {
    stress = max_principal_stress(scene_, state);
    for (std::size_t t = 0; t < stress.size(); ++t) {
      if (!state.alive[t]) stress[t] = std::numeric_limits<double>::quiet_NaN();
    }
    picture.mesh = &scene_.mesh;
    picture.tet_values = stress;
    picture.bar = {"largest principal stress", "Pa", 0, 0, ColourMap::ember};
  }
  picture.camera =
      Camera{shot.camera.eye_m, shot.camera.target_m, shot.camera.up, shot.camera.field_of_view_deg};
  picture.width = scenario_.pictures.width;
  picture.height = scenario_.pictures.height;
  char time[32];
  std::snprintf(time, sizeof time, "%.2f s", static_cast<double>(state.step) * scenario_.scene.step_s);
  picture.title = scenario_.title;
  picture.subtitle = shot.name + (shot.name.empty() ? "" : ", ") + time;
  std::replace(picture.subtitle.begin(), picture.subtitle.end(), '_', ' ');
  return render_run_picture(picture);
}

void render_shots(const Scenario& scenario, const Scene& scene, const std::vector<ShotFrame>& frames,
                  const std::filesystem::path& directory) {
  ShotRenderer renderer(scenario, scene);
  Progress progress(scenario.name + ": pictures", static_cast<std::int64_t>(frames.size()));
  for (std::size_t f = 0; f < frames.size(); ++f) {
    char number[24];
    std::snprintf(number, sizeof number, "%02zu_", f);
    write_png(renderer.image(frames[f].shot, frames[f].state),
              directory / (number + frames[f].shot.name + ".png"));
    progress.at(static_cast<std::int64_t>(f) + 1);
  }
}

}  // namespace sulcus
