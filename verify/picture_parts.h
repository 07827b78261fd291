// The parts of render_picture, for verify/picture*.cpp alone: scene -> eye space -> raster -> hollows ->
// average -> text.
#pragma once

#include <cstdint>
#include <vector>

#include "verify/picture.h"

namespace sulcus::picture {

// Axes of the eye: x right, y up, z towards the viewer. Throws InputError for a camera that looks nowhere.
struct EyeFrame {
  Mat3 rotation;  // world -> eye
  Vec3 eye;       // m, world
  Vec3 to_eye(const Vec3& world) const { return rotation * (world - eye); }
};
EyeFrame eye_frame(const Camera& camera);

// A mesh in eye space with three corners of its own a triangle.
struct EyeMesh {
  std::vector<float> positions;       // [9*triangles], m
  std::vector<float> normals;         // [9*triangles], unit
  std::vector<std::uint8_t> colours;  // [9*triangles], sRGB
  Finish finish = Finish::plain;
  bool clipped = false;
  Colour cut_colour{};
  bool section_only = false, on_cut = false;
};
EyeMesh to_eye(const PictureMesh& mesh,
               const EyeFrame& frame);  // throws InputError for arrays that do not fit

struct EyeLines {
  std::vector<float> positions;  // [6*segments], m
  Colour colour{};
  float width = 1;  // sub-pixels
  float opacity = 1;
  bool clipped = false;
};

PictureMesh sphere_mesh(const PictureSphere& sphere);
PictureMesh arrow_mesh(const PictureArrow& arrow);

// Sub-pixels, rows from the bottom (as OpenGL has them).
struct Raster {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;
  std::vector<float> depth;  // m along the view axis; 0: background
};

struct RasterScene {
  int width = 0, height = 0;  // sub-pixels
  float tan_half_view = 0;    // of the height
  float near_m = 0, far_m = 0;
  std::vector<EyeMesh> meshes;
  std::vector<EyeMesh> marks;  // shine through what hides them
  std::vector<EyeLines> lines;
  bool has_clip = false;
  std::array<float, 4> clip{};  // eye space: keeps dot(clip.xyz, x) + clip.w >= 0
  Colour background_centre{}, background_edge{};
};

// Throws EnvironmentError if OSMesa refuses or is not llvmpipe.
Raster rasterise(const RasterScene& scene);

// Darkens places that lie deeper than what surrounds them within radius_m. Cost: some 0.1 s a million
// sub-pixels.
void darken_hollows(Raster& raster, float tan_half_view, float radius_m);

// Mean of sampling x sampling sub-pixels, rounded, rows turned to run from the top.
Image average_down(const Raster& raster, int sampling);

// Title, legend and colour bar over the finished image. Throws EnvironmentError without the font.
void draw_texts(const PictureScene& scene, Image& image);

}  // namespace sulcus::picture
