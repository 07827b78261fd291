// The picture of a run at one moment: the tissue as its embedded surface, the walls of opened fissures in a
// tint of their own, the tools in steel, forces as arrows; cut open, or as a slice.
#pragma once

#include <map>

#include "engine/mesh/surface.h"
#include "engine/tool/rigid_body.h"
#include "verify/section.h"

namespace sulcus {

struct PosedTool {
  const ToolSurface* surface = nullptr;
  std::string name;
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

  // Scalar mode: colours by a value of each node, carried to the surface. Needs mesh.
  const EmbeddingMesh* mesh = nullptr;
  std::span<const double> node_values;  // [nodes], or empty; not finite: grey
  ColourBar bar;                        // low == high: from 0 (or the least value) to the 99.5 % quantile
  // Edges of the mesh's cells, drawn if given with mesh.
  std::span<const double> node_positions;  // [3*nodes], m, or empty
  bool cell_edges = true;

  // The section of a cut or a slice: what lies on its normal's side is taken away, of a slice all but the
  // section and the tools' cross-sections. Needs mesh, node_positions and map.
  std::optional<SectionFrame> section;
  bool slice = false;
  const LabelMap* map = nullptr;
  std::span<const std::uint8_t> alive;  // [tets], or empty = all
  std::optional<GreyVolume> grey;       // in the section, instead of labels

  std::optional<Camera> camera;   // default: frame_run(); of a slice, what shows the whole section
  std::optional<ClipPlane> clip;  // of the tissue and of the mesh's edges, where there is no section
  double arrow_m_per_N = 0.02;    // m of arrow for each N
  int width = 960, height = 720;
  int supersampling = 3;
  std::string title, subtitle;
};

// Mean of the elements around each node [nodes]; values that are not finite do not count, a node without any
// gets not-a-number. tet_values: [tets].
std::vector<double> node_means(const EmbeddingMesh& mesh, std::span<const double> tet_values);

// The range of a colour bar that has none: from 0, or the least value, to the 99.5 % quantile of the finite
// ones.
void set_range(ColourBar& bar, std::span<const double> values);

// A calm, always equal colour for a label: hue by the golden angle, of one lightness.
Colour label_colour(std::int32_t label);

// The camera that shows the whole tissue (rest shape) from the front right above; the same for all pictures
// of a run.
Camera frame_run(const EmbeddedSurface& surface, double aspect = 4.0 / 3.0);

// Throws InputError for arrays that do not fit each other.
Image render_run_picture(const RunPicture& run);

}  // namespace sulcus
