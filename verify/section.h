// A plane through the deformed tissue, painted with the labels or the grey image that lie there now, and with
// values of the mesh over them (thesis Fig. 2.19 and 5.12): the face of a cut, or a slice.
#pragma once

#include <map>
#include <span>
#include <vector>

#include "engine/mesh/resample.h"
#include "verify/picture.h"

namespace sulcus {

// A rectangle of square pixels in the world. right, up: unit, at right angles; right x up looks at the
// viewer.
struct SectionFrame {
  Vec3 middle = Vec3::Zero();  // m
  Vec3 right = Vec3::UnitX(), up = Vec3::UnitY();
  double pixel_m = 1e-3;      // m, edge of a pixel, > 0
  int columns = 1, rows = 1;  // >= 1
  Vec3 normal() const;
  Vec3 centre(int column, int row) const;  // of a pixel; rows run upwards
};

// The frame around points whose feet on the plane it has to hold, with about `most_pixels` along the longer
// side. normal and up: of any length, not along each other. Points that are not finite do not count; without
// any, one pixel.
SectionFrame frame_section(std::span<const Vec3> points, const Vec3& on_plane, const Vec3& normal,
                           const Vec3& up, int most_pixels);

struct GreyVolume {
  ImageGeometry geometry;
  std::span<const float> values;  // [voxels], i fastest
  double black = 0, white = 255;  // values drawn black and white, black < white
};

struct SectionContent {
  const LabelMap* map = nullptr;                 // required
  const EmbeddingMesh* mesh = nullptr;           // required
  std::span<const double> node_positions;        // [3*nodes], m
  std::span<const std::uint8_t> alive;           // [tets], or empty = all
  std::map<std::int32_t, Colour> label_colours;  // others: label_colour()
  std::optional<GreyVolume> grey;                // instead of labels
  bool tissue_only = false;                      // else a grey image is also shown where no tissue lies
  std::span<const double>
      node_values;             // [nodes] or empty: laid over tissue by `bar`, linear within an element
  ColourBar bar;               // values below bar.low, or not finite, are not laid over
  double overlay_opacity = 1;  // 0..1
};

// Colours of the pixels; those without anything to show (no tissue; of a grey image, outside of it) are not
// `shown`. Folded places, where tissue of several elements lies, and gaps of a grey image are black.
struct Section {
  SectionFrame frame;
  std::vector<Colour> colours;      // [columns*rows]
  std::vector<std::uint8_t> shown;  // [columns*rows]
};

// Throws InputError for arrays that do not fit each other. Cost: as locate_tissue, of the section's pixels.
Section paint_section(const SectionFrame& frame, const SectionContent& content);

// Lets what is shown grow over what is not, by as many pixels to each side.
void grow_section(Section& section, int pixels);

// Two triangles for each shown pixel (Finish::flat), lifted by `lift_m` towards the viewer.
PictureMesh section_mesh(const Section& section, double lift_m);

}  // namespace sulcus
