#include "verify/run_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <set>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr Colour wall_colour{198, 72, 66};  // inner tissue: fissure walls and cuts
constexpr Colour cut_colour{240, 222, 208};
constexpr Colour steel_colour{222, 226, 232};
constexpr Colour steel_section_colour{112, 124, 146};
constexpr Colour no_value_colour{120, 124, 132};
constexpr Colour force_colour{250, 178, 22};
constexpr Colour contact_colour{255, 214, 64};
constexpr Colour edge_colour{24, 30, 44};

void require(bool holds, const std::string& what) {
  if (!holds) throw InputError("a picture of a run cannot be drawn: " + what);
}

void check_run(const RunPicture& run) {
  require(run.surface != nullptr, "it has no surface");
  const EmbeddedSurface& surface = *run.surface;
  const std::size_t vertices = surface.rest_positions.size(), triangles = surface.triangles.size();
  require(run.surface_positions.size() == 3 * vertices, "the surface has " + std::to_string(vertices) +
                                                            " vertices and " +
                                                            std::to_string(run.surface_positions.size()) +
                                                            " coordinates; give 3 a vertex (deform_surface)");
  require(surface.triangle_label.size() == triangles && surface.triangle_on_pair.size() == triangles,
          "the surface's labels do not fit its triangles");
  if (!run.node_values.empty()) {
    require(
        run.mesh != nullptr && run.mesh->rest_positions.size() == run.node_values.size(),
        std::to_string(run.node_values.size()) + " values of nodes were given; give the mesh and one each");
    require(surface.tet.size() == vertices && surface.weights.size() == vertices,
            "the surface's vertices do not name their tetrahedra");
  }
  if (!run.node_positions.empty()) {
    require(run.mesh != nullptr && 3 * run.mesh->rest_positions.size() == run.node_positions.size(),
            std::to_string(run.node_positions.size()) +
                " coordinates of nodes were given; give the mesh and 3 a node");
  }
  require(!run.section || (run.mesh != nullptr && run.map != nullptr && !run.node_positions.empty()),
          "a section needs the mesh, its nodes' positions and the label map");
  require(run.section || !run.slice, "a slice needs a section");
}

std::vector<Vec3> to_points(std::span<const double> values) {
  std::vector<Vec3> points(values.size() / 3);
  for (std::size_t p = 0; p < points.size(); ++p)
    points[p] = {values[3 * p], values[3 * p + 1], values[3 * p + 2]};
  return points;
}

std::vector<double> values_on_surface(const RunPicture& run) {
  const EmbeddedSurface& surface = *run.surface;
  std::vector<double> values(surface.rest_positions.size());
  for (std::size_t v = 0; v < values.size(); ++v) {
    for (std::size_t corner = 0; corner < 4; ++corner) {
      const auto node =
          static_cast<std::size_t>(run.mesh->tets[static_cast<std::size_t>(surface.tet[v])][corner]);
      values[v] += static_cast<double>(surface.weights[v][corner]) * run.node_values[node];
    }
  }
  return values;
}

Colour colour_of_label(const RunPicture& run, std::int32_t label) {
  const auto given = run.label_colours.find(label);
  return given == run.label_colours.end() ? label_colour(label) : given->second;
}

PictureMesh tissue_mesh(const RunPicture& run, ColourBar& bar) {
  const EmbeddedSurface& surface = *run.surface;
  PictureMesh mesh;
  mesh.positions = to_points(run.surface_positions);
  mesh.triangles = surface.triangles;
  mesh.finish = Finish::tissue;
  mesh.normal_smoothing = 4;
  mesh.clipped = true;
  mesh.cut_colour = cut_colour;
  if (run.node_values.empty()) {
    for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
      mesh.triangle_colours.push_back(
          surface.triangle_on_pair[t] ? wall_colour : colour_of_label(run, surface.triangle_label[t]));
    }
    return mesh;
  }
  const std::vector<double> values = values_on_surface(run);
  set_range(bar, values);
  for (const double value : values) {
    mesh.vertex_colours.push_back(colour_of(bar.map, (value - bar.low) / (bar.high - bar.low)));
  }
  mesh.finish = Finish::plain;
  mesh.cut_colour = no_value_colour;
  return mesh;
}

PictureMesh tool_mesh(const PosedTool& tool) {
  PictureMesh mesh;
  const Mat3 rotation = rotation_matrix(tool.orientation);
  for (const Vec3& vertex : tool.surface->vertices)
    mesh.positions.push_back(tool.position + rotation * vertex);
  mesh.triangles = tool.surface->triangles;
  mesh.finish = Finish::metal;
  mesh.crease_cos = 0.75;
  mesh.colour = steel_colour;
  return mesh;
}

// The twelve edges of every cell, each once for each cell that has it.
PictureLines cell_edges(const RunPicture& run) {
  PictureLines lines;
  lines.points = to_points(run.node_positions);
  lines.colour = edge_colour;
  lines.width_px = 0.8;
  lines.opacity = 0.5;
  lines.clipped = true;
  for (const auto& nodes : run.mesh->cell_nodes) {
    for (std::size_t corner = 0; corner < 8; ++corner) {
      for (const std::size_t axis : {1u, 2u, 4u}) {
        if (corner & axis) continue;
        const std::int32_t a = nodes[corner], b = nodes[corner | axis];
        lines.segments.push_back({std::min(a, b), std::max(a, b)});
      }
    }
  }
  std::sort(lines.segments.begin(), lines.segments.end());
  lines.segments.erase(std::unique(lines.segments.begin(), lines.segments.end()), lines.segments.end());
  return lines;
}

void add_legend(const RunPicture& run, PictureScene& scene) {
  bool walls = false;
  std::set<std::int32_t> labels;
  for (std::size_t t = 0; t < run.surface->triangles.size(); ++t) {
    walls = walls || run.surface->triangle_on_pair[t];
    labels.insert(run.surface->triangle_label[t]);
  }
  if (run.node_values.empty() && !run.slice) {
    for (const auto& [label, name] : run.label_names) {
      if (labels.count(label)) scene.legend.push_back({colour_of_label(run, label), name});
    }
    if (walls) scene.legend.push_back({wall_colour, "fissure wall"});
  }
  if (run.clip && !run.section && run.node_values.empty()) scene.legend.push_back({cut_colour, "cut"});
  for (const PosedTool& tool : run.tools) {
    if (tool.force_N.norm() <= 0) continue;
    char text[32];
    std::snprintf(text, sizeof text, "%.3f N", tool.force_N.norm());
    scene.legend.push_back(
        {force_colour, "force on the " + (tool.name.empty() ? "tool" : tool.name) + ": " + text});
  }
  if (!scene.spheres.empty()) scene.legend.push_back({contact_colour, "contact"});
}

void add_tools(const RunPicture& run, double seen_m, PictureScene& scene) {
  for (const PosedTool& tool : run.tools) {
    require(tool.surface != nullptr, "a tool has no surface");
    PictureMesh mesh = tool_mesh(tool);
    if (run.slice) {
      mesh.clipped = mesh.section_only = true;
      mesh.cut_colour = steel_section_colour;
    }
    scene.meshes.push_back(std::move(mesh));
    if (tool.force_N.norm() > 0) {
      scene.arrows.push_back(
          {tool.force_at, tool.force_at + run.arrow_m_per_N * tool.force_N, 0.006 * seen_m, force_colour});
    }
  }
  for (const Vec3& point : run.contact_points)
    scene.spheres.push_back({point, 0.005 * seen_m, contact_colour});
}

// The section's picture, on the face of the cut and a little in front of it; of a slice, behind the tools.
void add_section(const RunPicture& run, const ColourBar& bar, double seen_m, PictureScene& scene) {
  SectionContent content;
  content.map = run.map;
  content.mesh = run.mesh;
  content.node_positions = run.node_positions;
  content.alive = run.alive;
  content.label_colours = run.label_colours;
  content.grey = run.grey;
  content.tissue_only = !run.slice;
  content.node_values = run.node_values;
  content.bar = bar;
  content.overlay_opacity = run.slice || run.grey ? 0.65 : 1;
  const double lift_m = 2e-4 * seen_m;
  Section section = paint_section(*run.section, content);
  // the drawn surface is smoother than the voxels: the face of the cut is painted up to its edge
  if (!run.slice) grow_section(section, 6);
  scene.meshes.push_back(section_mesh(section, run.slice ? -lift_m : lift_m));
  scene.meshes.back().on_cut = !run.slice;
  const Vec3 kept = -run.section->normal();
  scene.clip = ClipPlane{kept, kept.dot(run.section->middle)};
}

// So far away that parallel lines stay so.
Camera slice_camera(const SectionFrame& frame, int width, int height) {
  const double shown_m = frame.pixel_m * std::max(static_cast<double>(frame.rows),
                                                  static_cast<double>(frame.columns) * height / width);
  Camera camera;
  camera.target = frame.middle;
  camera.eye = frame.middle + 20 * shown_m * frame.normal();
  camera.up = frame.up;
  camera.field_of_view_deg = 2 * std::atan(0.5 / 20) * 180 / std::numbers::pi;
  return camera;
}

double unit_value(double x) {
  return std::clamp(x, 0.0, 1.0);
}

}  // namespace

Colour label_colour(std::int32_t label) {
  if (label == 0) return {160, 160, 160};
  // CIELAB of lightness 74 and low chroma around a warm middle; hue by the golden angle.
  const double hue = 0.5 + 2.399963229728653 * (static_cast<double>(label) - 1);
  const double lightness = 74, a = 6 + 20 * std::cos(hue), b = 9 + 20 * std::sin(hue);
  const double fy = (lightness + 16) / 116, fx = fy + a / 500, fz = fy - b / 200;
  const double x = 0.9505 * fx * fx * fx, y = fy * fy * fy, z = 1.089 * fz * fz * fz;
  const double linear[3] = {3.2406 * x - 1.5372 * y - 0.4986 * z, -0.9689 * x + 1.8758 * y + 0.0415 * z,
                            0.0557 * x - 0.2040 * y + 1.0570 * z};
  Colour colour;
  for (std::size_t c = 0; c < 3; ++c) {
    const double encoded = 1.055 * std::pow(unit_value(linear[c]), 1 / 2.4) - 0.055;
    colour[c] = static_cast<std::uint8_t>(std::lround(255 * unit_value(encoded)));
  }
  return colour;
}

Camera frame_run(const EmbeddedSurface& surface, double aspect) {
  return frame_points(surface.rest_positions, Vec3(-0.55, 0.75, -0.5), Vec3(0, 0, 1), aspect, 30, 1.12);
}

void set_range(ColourBar& bar, std::span<const double> values) {
  if (bar.low != bar.high) return;
  std::vector<double> finite;
  std::copy_if(values.begin(), values.end(), std::back_inserter(finite),
               [](double v) { return std::isfinite(v); });
  if (finite.empty()) {
    bar.high = bar.low + 1;
    return;
  }
  std::sort(finite.begin(), finite.end());
  bar.low = std::min(0.0, finite.front());
  bar.high = finite[std::min(finite.size() - 1, finite.size() * 995 / 1000)];
  if (!(bar.high > bar.low)) bar.high = bar.low + 1;
}

std::vector<double> node_means(const EmbeddingMesh& mesh, std::span<const double> tet_values) {
  require(mesh.tets.size() == tet_values.size(), std::to_string(tet_values.size()) +
                                                     " values of tetrahedra were given for " +
                                                     std::to_string(mesh.tets.size()));
  std::vector<double> mean(mesh.rest_positions.size(), 0), count(mesh.rest_positions.size(), 0);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (!std::isfinite(tet_values[t])) continue;
    for (const std::int32_t node : mesh.tets[t]) {
      mean[static_cast<std::size_t>(node)] += tet_values[t];
      count[static_cast<std::size_t>(node)] += 1;
    }
  }
  for (std::size_t n = 0; n < mean.size(); ++n) mean[n] = count[n] > 0 ? mean[n] / count[n] : NAN;
  return mean;
}

Image render_run_picture(const RunPicture& run) {
  check_run(run);
  PictureScene scene;
  scene.width = run.width;
  scene.height = run.height;
  scene.supersampling = run.supersampling;
  scene.camera = run.camera  ? *run.camera
                 : run.slice ? slice_camera(*run.section, run.width, run.height)
                             : frame_run(*run.surface, static_cast<double>(run.width) / run.height);
  scene.clip = run.clip;
  scene.occlusion = !run.slice;
  scene.title = run.title;
  scene.subtitle = run.subtitle;
  // Sizes of marks follow what the picture shows.
  const double seen_m = 2 * (scene.camera.eye - scene.camera.target).norm() *
                        std::tan(scene.camera.field_of_view_deg * std::numbers::pi / 360);
  ColourBar bar = run.bar;
  if (run.slice && !run.node_values.empty()) set_range(bar, run.node_values);
  if (!run.slice) scene.meshes.push_back(tissue_mesh(run, bar));
  if (run.section) add_section(run, bar, seen_m, scene);
  if (!run.node_values.empty()) scene.colour_bar = bar;
  add_tools(run, seen_m, scene);
  if (!run.node_positions.empty() && run.cell_edges) scene.lines.push_back(cell_edges(run));
  add_legend(run, scene);
  return render_picture(scene);
}

}  // namespace sulcus
