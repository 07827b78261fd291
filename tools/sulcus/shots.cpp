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

const GreyImage& ShotRenderer::grey() {
  if (!grey_) grey_ = read_grey_image(scenario_.pictures.grey->file);
  return *grey_;
}

namespace {

std::string readable(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

void add_bodies(const Scene& scene, const ShotFrame& frame, RunPicture& picture) {
  for (std::size_t t = 0; t < scene.settings.tools.size(); ++t) {
    const Tool& tool = scene.settings.tools[t];
    const RigidBodyState pose = tool_state(frame.state, t);
    picture.tools.push_back(
        {&tool.surface, readable(tool.name), pose.position, pose.orientation, Vec3::Zero(), Vec3::Zero()});
  }
  for (const Obstacle& obstacle : scene.settings.obstacles) {
    picture.tools.push_back({&obstacle.surface, readable(obstacle.name), obstacle.position,
                             obstacle.orientation, Vec3::Zero(), Vec3::Zero()});
  }
}

// Contact points on the tissue, and the force on each body from the middle of its points.
void add_contacts(const Scene& scene, const ShotFrame& frame, RunPicture& picture) {
  std::vector<Vec3> sum(picture.tools.size(), Vec3::Zero());
  std::vector<int> count(picture.tools.size(), 0);
  for (const Contact& contact : contacts_in(scene, frame.state)) {
    Vec3 point = Vec3::Zero();
    for (std::size_t c = 0; c < 4; ++c) {
      const auto node = static_cast<std::size_t>(scene.mesh.tets[static_cast<std::size_t>(contact.tet)][c]);
      point += contact.weights[c] * Eigen::Map<const Vec3>(&frame.state.positions[3 * node]);
    }
    picture.contact_points.push_back(point);
    sum[static_cast<std::size_t>(contact.tool)] += point;
    ++count[static_cast<std::size_t>(contact.tool)];
  }
  for (std::size_t t = 0; t < picture.tools.size() && t < frame.forces.size(); ++t) {
    picture.tools[t].force_N = frame.forces[t];
    picture.tools[t].force_at = count[t] > 0 ? Vec3(sum[t] / count[t]) : picture.tools[t].position;
  }
}

// Values of the nodes [nodes] that the colours stand for, and their colour bar; none for labels.
std::vector<double> values_to_show(const Scene& scene, const State& state, const Shot& shot, ColourBar& bar) {
  std::vector<double> values;
  if (shot.show == ShotContent::max_principal_stress) {
    std::vector<double> stress = max_principal_stress(scene, state);
    for (std::size_t t = 0; t < stress.size(); ++t) {
      if (!state.alive[t]) stress[t] = std::numeric_limits<double>::quiet_NaN();
    }
    values = node_means(scene.mesh, stress);
    bar = {"largest principal stress", "Pa", 0, 0, ColourMap::ember};
  } else if (shot.show == ShotContent::displacement) {
    for (std::size_t n = 0; n < scene.mesh.rest_positions.size(); ++n) {
      const Eigen::Map<const Vec3> now(&state.positions[3 * n]);
      values.push_back((now - scene.mesh.rest_positions[n]).norm());
    }
    bar = {"displacement", "m", 0, 0, ColourMap::sea};
  }
  if (shot.range) {
    bar.low = (*shot.range)[0];
    bar.high = (*shot.range)[1];
  }
  return values;
}

// Pixels of two by two of the picture's, all over a slice; of a cut, over what the tissue takes.
SectionFrame section_frame(const Shot& shot, const Pictures& pictures, std::span<const double> surface) {
  if (shot.slice) {
    SectionFrame frame = frame_section({}, shot.slice->point_m, shot.slice->normal, shot.slice->up, 1);
    frame.columns = std::max(1, pictures.width / 2);
    frame.rows = std::max(1, pictures.height / 2);
    frame.pixel_m = shot.slice->height_m / frame.rows;
    return frame;
  }
  std::vector<Vec3> points;
  for (std::size_t v = 0; v < surface.size(); v += 3)
    points.emplace_back(surface[v], surface[v + 1], surface[v + 2]);
  int least = 0;
  shot.cut->normal.cwiseAbs().minCoeff(&least);
  return frame_section(points, shot.cut->point_m, shot.cut->normal, Vec3::Unit(least),
                       std::max(pictures.width, pictures.height) / 2);
}

}  // namespace

std::vector<Vec3> contact_forces(const StepReport& report) {
  std::vector<Vec3> forces;
  for (const ToolReport& tool : report.tools) forces.push_back(tool.contact_force);
  for (const ObstacleReport& obstacle : report.obstacles) forces.push_back(obstacle.contact_force);
  return forces;
}

Image ShotRenderer::image(const ShotFrame& frame) {
  const Shot& shot = frame.shot;
  const State& state = frame.state;
  const EmbeddedSurface& surface = surface_of(state.alive);
  const std::vector<double> positions = deform_surface(surface, scene_.mesh, state.positions);
  RunPicture picture;
  picture.surface = &surface;
  picture.surface_positions = positions;
  picture.mesh = &scene_.mesh;
  add_bodies(scene_, frame, picture);
  if (shot.contacts) add_contacts(scene_, frame, picture);
  picture.label_colours.insert(scenario_.label_colours.begin(), scenario_.label_colours.end());
  const std::vector<double> values = values_to_show(scene_, state, shot, picture.bar);
  picture.node_values = values;
  if (shot.cut || shot.slice) {
    picture.section = section_frame(shot, scenario_.pictures, positions);
    picture.slice = shot.slice.has_value();
    picture.map = &scene_.settings.map;
    picture.node_positions = state.positions;
    picture.cell_edges = false;
    picture.alive = state.alive;
    if (shot.grey) {
      const GreySource& source = *scenario_.pictures.grey;
      picture.grey = GreyVolume{grey().geometry, grey().values, source.black, source.white};
    }
  }
  if (!shot.slice) {
    picture.camera =
        Camera{shot.camera.eye_m, shot.camera.target_m, shot.camera.up, shot.camera.field_of_view_deg};
  }
  picture.arrow_m_per_N = scenario_.pictures.arrow_m_per_N;
  picture.width = scenario_.pictures.width;
  picture.height = scenario_.pictures.height;
  char time[32];
  std::snprintf(time, sizeof time, "%.2f s", static_cast<double>(state.step) * scenario_.scene.step_s);
  picture.title = scenario_.title;
  picture.subtitle = readable(shot.name) + (shot.name.empty() ? "" : ", ") + time;
  return render_run_picture(picture);
}

void widen_range(const Scene& scene, const State& state, const Shot& shot,
                 std::optional<std::array<double, 2>>& range) {
  ColourBar bar;
  const std::vector<double> values = values_to_show(scene, state, shot, bar);
  if (values.empty()) return;
  set_range(bar, values);
  if (!range) range = {bar.low, bar.high};
  (*range)[0] = std::min((*range)[0], bar.low);
  (*range)[1] = std::max((*range)[1], bar.high);
}

void render_shots(const Scenario& scenario, const Scene& scene, const std::vector<ShotFrame>& frames,
                  const std::filesystem::path& directory) {
  ShotRenderer renderer(scenario, scene);
  Progress progress(scenario.name + ": pictures", static_cast<std::int64_t>(frames.size()));
  for (std::size_t f = 0; f < frames.size(); ++f) {
    char number[24];
    std::snprintf(number, sizeof number, "%02zu_", f);
    write_png(renderer.image(frames[f]), directory / (number + frames[f].shot.name + ".png"));
    progress.at(static_cast<std::int64_t>(f) + 1);
  }
}

}  // namespace sulcus
