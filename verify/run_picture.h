// The picture of a run at one moment: the tissue as its embedded surface, the walls of opened fissures in a
// tint of their own, the tools in steel, forces as arrows.
#pragma once

#include <map>

#include "engine/mesh/surface.h"
#include "engine/tool/rigid_body.h"
#include "verify/picture.h"

namespace sulcus {

struct PosedTool {
  const ToolSurface* surface = nullptr;
  Vec3 position = Vec3::Zero();  // m, centre of mass
  Quaternion orientation;
  Vec3 force_N = Vec3::Zero();   // N, on the tool; drawn from its centre of force if not zero
  Vec3 force_at = Vec3::Zero();  // m, world
};

struct RunPicture {
  const EmbeddedSurface* surface = nullptr;   // required
  std::span<const double> surface_positions;  // [3*vertices], m, as deform_surface gives
  std::vector<PosedTool> tools;
  std::vector<Vec3> contact_points;                 // m
  std::map<std::int32_t, Colour> label_colours;     // others: label_colour()
  std::map<std::int32_t, std::string> label_names;  // named ones join the legend

  // Scalar mode: colours by a value of each tetrahedron, averaged to the nodes by volume-blind mean and
  // carried to the surface. Needs mesh.
  const EmbeddingMesh* mesh = nullptr;
  std::span<const double> tet_values;  // [tets], or empty
  ColourBar bar;                       // low == high: from 0 (or the least value) to the 99.5 % quantile
  // Edges of the mesh's cells, drawn if given with mesh.
  std::span<const double> node_positions;  // [3*nodes], m, or empty

  std::optional<Camera> camera;   // default: frame_run()
  std::optional<ClipPlane> clip;  // of the tissue and of the mesh's edges
  double arrow_m_per_N = 0.02;    // m of arrow for each N
  int width = 960, height = 720;
  int supersampling = 3;
  std::string title, subtitle;
};

// A calm, always equal colour for a label: hue by the golden angle, of one lightness.
Colour label_colour(std::int32_t label);

// The camera that shows the whole tissue (rest shape) from the front right above; the same for all pictures
// of a run.
Camera frame_run(const EmbeddedSurface& surface, double aspect = 4.0 / 3.0);

// Throws InputError for arrays that do not fit each other.
Image render_run_picture(const RunPicture& run);

}  // namespace sulcus
