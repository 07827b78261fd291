#include "verify/picture.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/numerics/error.h"
#include "verify/picture_parts.h"

namespace sulcus {
namespace {

constexpr int largest_raster = 16384;  // sub-pixels along an axis, llvmpipe's limit

void check_size(const PictureScene& scene) {
  const bool fits = scene.width >= 1 && scene.height >= 1 && scene.supersampling >= 1 &&
                    scene.supersampling <= 8 && scene.width <= largest_raster / scene.supersampling &&
                    scene.height <= largest_raster / scene.supersampling;
  if (!fits) {
    throw InputError("a picture of " + std::to_string(scene.width) + " x " + std::to_string(scene.height) +
                     " pixels with " + std::to_string(scene.supersampling) +
                     " sub-pixels along each axis cannot be drawn; give 1 to 8 sub-pixels and at most " +
                     std::to_string(largest_raster) + " of them along each side");
  }
}

picture::EyeLines to_eye(const PictureLines& lines, const picture::EyeFrame& frame, int sampling) {
  picture::EyeLines out;
  out.colour = lines.colour;
  out.width = static_cast<float>(lines.width_px * sampling);
  out.opacity = static_cast<float>(lines.opacity);
  out.clipped = lines.clipped;
  const auto points = static_cast<std::int64_t>(lines.points.size());
  for (const auto& segment : lines.segments) {
    for (const std::int32_t p : segment) {
      if (p < 0 || p >= points) {
        throw InputError("a picture's line names point " + std::to_string(p) + " of " +
                         std::to_string(points));
      }
    }
    const Vec3& a = lines.points[static_cast<std::size_t>(segment[0])];
    const Vec3& b = lines.points[static_cast<std::size_t>(segment[1])];
    if (!a.allFinite() || !b.allFinite()) continue;
    for (const Vec3& end : {frame.to_eye(a), frame.to_eye(b)}) {
      for (int d = 0; d < 3; ++d) out.positions.push_back(static_cast<float>(end[d]));
    }
  }
  return out;
}

// Near and far plane around all that lies before the eye.
void set_depth_range(picture::RasterScene& scene) {
  float nearest = INFINITY, farthest = 0;
  const auto look = [&](const std::vector<float>& positions) {
    for (std::size_t i = 2; i < positions.size(); i += 3) {
      nearest = std::min(nearest, -positions[i]);
      farthest = std::max(farthest, -positions[i]);
    }
  };
  for (const auto& mesh : scene.meshes) look(mesh.positions);
  for (const auto& mark : scene.marks) look(mark.positions);
  for (const auto& lines : scene.lines) look(lines.positions);
  scene.far_m = farthest > 0 ? farthest * 1.01f : 1;
  scene.near_m = std::max(nearest * 0.99f, scene.far_m * 1e-3f);
  if (!(scene.near_m < scene.far_m)) scene.near_m = scene.far_m * 1e-3f;
}

picture::RasterScene to_eye(const PictureScene& scene, const picture::EyeFrame& frame) {
  picture::RasterScene out;
  out.width = scene.width * scene.supersampling;
  out.height = scene.height * scene.supersampling;
  out.tan_half_view = static_cast<float>(std::tan(scene.camera.field_of_view_deg * std::numbers::pi / 360));
  for (const PictureMesh& mesh : scene.meshes) out.meshes.push_back(picture::to_eye(mesh, frame));
  for (const PictureSphere& sphere : scene.spheres) {
    out.marks.push_back(picture::to_eye(picture::sphere_mesh(sphere), frame));
  }
  for (const PictureArrow& arrow : scene.arrows) {
    out.marks.push_back(picture::to_eye(picture::arrow_mesh(arrow), frame));
  }
  for (const PictureLines& lines : scene.lines)
    out.lines.push_back(to_eye(lines, frame, scene.supersampling));
  if (scene.clip) {
    const double length = scene.clip->normal.norm();
    if (!(length > 0) || !std::isfinite(length)) {
      throw InputError("a picture's clipping plane has no direction; give a normal of any length but zero");
    }
    const Vec3 normal = frame.rotation * scene.clip->normal / length;
    const double offset = scene.clip->normal.dot(frame.eye) / length - scene.clip->offset_m / length;
    for (int d = 0; d < 3; ++d) out.clip[static_cast<std::size_t>(d)] = static_cast<float>(normal[d]);
    out.clip[3] = static_cast<float>(offset);
    out.has_clip = true;
  }
  out.background_centre = scene.background_centre;
  out.background_edge = scene.background_edge;
  set_depth_range(out);
  return out;
}

}  // namespace

namespace picture {

Image average_down(const Raster& raster, int sampling) {
  Image image;
  image.width = raster.width / sampling;
  image.height = raster.height / sampling;
  image.rgb.resize(static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height) * 3);
  const unsigned samples = static_cast<unsigned>(sampling * sampling);
#pragma omp parallel for schedule(static)
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      unsigned sum[3] = {0, 0, 0};
      for (int sy = 0; sy < sampling; ++sy) {
        const int row = (image.height - 1 - y) * sampling + sy;
        const std::uint8_t* pixel =
            &raster.rgba[(static_cast<std::size_t>(row) * static_cast<std::size_t>(raster.width) +
                          static_cast<std::size_t>(x * sampling)) *
                         4];
        for (int sx = 0; sx < sampling; ++sx, pixel += 4) {
          for (int c = 0; c < 3; ++c) sum[c] += pixel[c];
        }
      }
      std::uint8_t* out = &image.rgb[(static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                                      static_cast<std::size_t>(x)) *
                                     3];
      for (int c = 0; c < 3; ++c) out[c] = static_cast<std::uint8_t>((sum[c] + samples / 2) / samples);
    }
  }
  return image;
}

}  // namespace picture

Image render_picture(const PictureScene& scene) {
  check_size(scene);
  const picture::EyeFrame frame = picture::eye_frame(scene.camera);
  const picture::RasterScene raster_scene = to_eye(scene, frame);
  picture::Raster raster = picture::rasterise(raster_scene);
  if (scene.occlusion) {
    // Hollows of about a tenth of what the picture shows.
    const double distance = (scene.camera.eye - scene.camera.target).norm();
    const double radius_m = 0.09 * distance * raster_scene.tan_half_view;
    picture::darken_hollows(raster, raster_scene.tan_half_view, static_cast<float>(radius_m));
  }
  Image image = picture::average_down(raster, scene.supersampling);
  picture::draw_texts(scene, image);
  return image;
}

Camera frame_points(std::span<const Vec3> points, const Vec3& direction, const Vec3& up, double aspect,
                    double field_of_view_deg, double margin) {
  Vec3 low = Vec3::Constant(INFINITY), high = Vec3::Constant(-INFINITY);
  for (const Vec3& point : points) {
    if (!point.allFinite()) continue;
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  Camera camera;
  camera.field_of_view_deg = field_of_view_deg;
  camera.up = up;
  if (!(low.array() <= high.array()).all()) return camera;
  camera.target = 0.5 * (low + high);
  double radius = 0;
  for (const Vec3& point : points) {
    if (point.allFinite()) radius = std::max(radius, (point - camera.target).norm());
  }
  if (!(radius > 0)) radius = 1e-3;
  // The narrower side of the picture decides.
  const double half = field_of_view_deg * std::numbers::pi / 360;
  const double half_angle = aspect < 1 ? std::atan(aspect * std::tan(half)) : half;
  camera.eye = camera.target - direction.normalized() * (margin * radius / std::sin(half_angle));
  return camera;
}

}  // namespace sulcus
