// Pictures without a display: plain data in, pixels out (OSMesa, Mesa's software rasteriser). The same data
// give the same bytes for any number of threads; across processors compare with picture_diff.
//
// World frame and metres, as the engine has them. Colours are sRGB bytes. Anti-aliasing is a finer image
// averaged down with whole numbers. Cost: about 0.2 s to start, then some 0.1 s for each million sub-pixels
// and 100,000 triangles.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/numerics/types.h"
#include "verify/png.h"

namespace sulcus {

using Colour = std::array<std::uint8_t, 3>;  // sRGB

enum class Finish : int {
  tissue,  // soft wrap-around light, moist highlight
  metal,   // brushed steel: reflects a bright sky and a dark floor
  plain,   // matt
  flat,    // the colour itself, no light
};

struct PictureMesh {
  std::vector<Vec3> positions;                         // [vertices], m
  std::vector<std::array<std::int32_t, 3>> triangles;  // counter-clockwise from outside
  std::vector<Colour> triangle_colours;                // [triangles], or empty
  std::vector<Colour> vertex_colours;                  // [vertices], or empty; goes before triangle_colours
  Colour colour{200, 200, 200};                        // if both are empty
  Finish finish = Finish::plain;
  double crease_cos = -1;  // normals are shared by triangles whose normals have a cosine above this; -1: all
  int normal_smoothing = 0;  // times that normals are averaged with their neighbours (> 0: creases do not
                             // count), so that the steps of voxels do not catch the light; positions stay
  bool clipped = false;      // cut away by the picture's clipping plane
  Colour cut_colour{120, 60, 60};  // of the inside seen through the cut (the mesh should be closed)
  bool section_only = false;       // of a clipped mesh: the cut alone
  bool on_cut = false;             // lies on the cut of the mesh before it and is drawn within that alone
};

struct PictureLines {
  std::vector<Vec3> points;                           // m
  std::vector<std::array<std::int32_t, 2>> segments;  // point numbers
  Colour colour{0, 0, 0};
  double width_px = 1;  // of the finished picture
  double opacity = 1;   // 0..1
  bool clipped = false;
};

// Arrows and spheres are marks: what hides them lets them through, paler.
struct PictureArrow {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();  // m; not drawn if equal
  double radius_m = 0.001;                      // of the shaft
  Colour colour{240, 180, 0};
};

struct PictureSphere {
  Vec3 centre = Vec3::Zero();  // m
  double radius_m = 0.001;
  Colour colour{240, 180, 0};
};

struct Camera {
  Vec3 eye{0, 0, 1}, target = Vec3::Zero(), up{0, 1, 0};  // m
  double field_of_view_deg = 30;                          // deg, of the picture's height
};

// Keeps the points x with normal . x >= offset.
struct ClipPlane {
  Vec3 normal{1, 0, 0};
  double offset_m = 0;  // m
};

// Colour maps of equal perceived steps, made from a table of 17 colours.
enum class ColourMap { sea, ember };            // dark blue - green - yellow; black - red - pale yellow
Colour colour_of(ColourMap map, double share);  // share 0..1, clamped; not-a-number gives mid grey

struct ColourBar {
  std::string title;  // "largest principal stress"
  std::string unit;   // "Pa"
  double low = 0, high = 0;
  ColourMap map = ColourMap::ember;
};

struct LegendEntry {
  Colour colour{};
  std::string text;
};

struct PictureScene {
  int width = 960, height = 720;  // pixels
  int supersampling = 3;          // sub-pixels along each axis, 1..8
  Camera camera;
  std::vector<PictureMesh> meshes;
  std::vector<PictureLines> lines;
  std::vector<PictureArrow> arrows;
  std::vector<PictureSphere> spheres;
  std::optional<ClipPlane> clip;
  Colour background_centre{250, 250, 252}, background_edge{206, 212, 222};
  bool occlusion = true;                // darkens hollows, from the depth image
  std::string title, subtitle;          // top left, UTF-8
  std::vector<LegendEntry> legend;      // bottom left
  std::optional<ColourBar> colour_bar;  // right
};

// Throws InputError for sizes of no or more than 16384 sub-pixels, colours or triangles that do not fit the
// mesh, a camera that looks nowhere; EnvironmentError if OSMesa or the font cannot be had. Coordinates that
// are not finite are left out with their triangles.
Image render_picture(const PictureScene& scene);

// Looks along `direction` so that the sphere around all the points fills the picture up to `margin`.
Camera frame_points(std::span<const Vec3> points, const Vec3& direction, const Vec3& up,
                    double aspect = 4.0 / 3.0, double field_of_view_deg = 30, double margin = 1.1);

}  // namespace sulcus
