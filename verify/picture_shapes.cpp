// From the world to the eye: the camera's axes, shared normals, spheres and arrows.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/numerics/error.h"
#include "verify/picture_parts.h"

namespace sulcus::picture {
namespace {

void check_mesh(const PictureMesh& mesh) {
  const auto vertices = static_cast<std::int64_t>(mesh.positions.size());
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t v : triangle) {
      if (v < 0 || v >= vertices) {
        throw InputError("a picture's triangle names vertex " + std::to_string(v) + " of " +
                         std::to_string(vertices));
      }
    }
  }
  if (!mesh.vertex_colours.empty() && mesh.vertex_colours.size() != mesh.positions.size()) {
    throw InputError("a picture's mesh has " + std::to_string(mesh.positions.size()) + " vertices and " +
                     std::to_string(mesh.vertex_colours.size()) +
                     " vertex colours; give one a vertex or none");
  }
  if (!mesh.triangle_colours.empty() && mesh.triangle_colours.size() != mesh.triangles.size()) {
    throw InputError("a picture's mesh has " + std::to_string(mesh.triangles.size()) + " triangles and " +
                     std::to_string(mesh.triangle_colours.size()) +
                     " triangle colours; give one a triangle or none");
  }
}

// Twice the area along the normal, [triangles].
std::vector<Vec3> area_normals(const PictureMesh& mesh) {
  std::vector<Vec3> normals(mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    const Vec3& origin = mesh.positions[static_cast<std::size_t>(a)];
    normals[t] = (mesh.positions[static_cast<std::size_t>(b)] - origin)
                     .cross(mesh.positions[static_cast<std::size_t>(c)] - origin);
  }
  return normals;
}

// Triangles around each vertex, ascending: those of v are items[start[v]] .. items[start[v+1]-1].
struct VertexTriangles {
  std::vector<std::int32_t> start, items;
};

VertexTriangles triangles_around(const PictureMesh& mesh) {
  VertexTriangles around;
  around.start.assign(mesh.positions.size() + 1, 0);
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t v : triangle) ++around.start[static_cast<std::size_t>(v) + 1];
  }
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) around.start[v + 1] += around.start[v];
  around.items.resize(static_cast<std::size_t>(around.start.back()));
  std::vector<std::int32_t> next(around.start.begin(), around.start.end() - 1);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::int32_t v : mesh.triangles[t]) {
      around.items[static_cast<std::size_t>(next[static_cast<std::size_t>(v)]++)] =
          static_cast<std::int32_t>(t);
    }
  }
  return around;
}

// Area-weighted mean normal at a corner over the triangles that bend less than the crease.
Vec3 corner_normal(const std::vector<Vec3>& normals, const VertexTriangles& around, std::size_t triangle,
                   std::int32_t vertex, double crease_cos) {
  const Vec3& own = normals[triangle];
  const double own_length = own.norm();
  Vec3 sum = Vec3::Zero();
  const auto v = static_cast<std::size_t>(vertex);
  for (std::int32_t i = around.start[v]; i < around.start[v + 1]; ++i) {
    const Vec3& other = normals[static_cast<std::size_t>(around.items[static_cast<std::size_t>(i)])];
    if (crease_cos <= -1 || own.dot(other) >= crease_cos * own_length * other.norm()) sum += other;
  }
  const double length = sum.norm();
  if (length > 0) return sum / length;
  return own_length > 0 ? Vec3(own / own_length) : Vec3(0, 0, 1);
}

// Vertex normals, averaged over the triangles around as often as the mesh asks, [vertices].
std::vector<Vec3> smoothed_normals(const PictureMesh& mesh, const std::vector<Vec3>& normals,
                                   const VertexTriangles& around) {
  std::vector<Vec3> smooth(mesh.positions.size(), Vec3::Zero()), mean(normals);
  for (int pass = 0; pass <= mesh.normal_smoothing; ++pass) {
    for (std::size_t t = 0; pass > 0 && t < mesh.triangles.size(); ++t) {
      const auto& [a, b, c] = mesh.triangles[t];
      mean[t] =
          normals[t].norm() * (smooth[static_cast<std::size_t>(a)] + smooth[static_cast<std::size_t>(b)] +
                               smooth[static_cast<std::size_t>(c)]);
    }
    for (std::size_t v = 0; v < smooth.size(); ++v) {
      Vec3 sum = Vec3::Zero();
      for (std::int32_t i = around.start[v]; i < around.start[v + 1]; ++i) {
        const Vec3& share = mean[static_cast<std::size_t>(around.items[static_cast<std::size_t>(i)])];
        if (share.allFinite()) sum += share;
      }
      const double length = sum.norm();
      smooth[v] = length > 0 ? Vec3(sum / length) : Vec3(0, 0, 1);
    }
  }
  return smooth;
}

void append(std::vector<float>& values, const Vec3& v) {
  for (int d = 0; d < 3; ++d) values.push_back(static_cast<float>(v[d]));
}

std::int32_t add_ring(PictureMesh& mesh, const Vec3& centre, const Vec3& u, const Vec3& v, double radius_m,
                      int sides) {
  const auto first = static_cast<std::int32_t>(mesh.positions.size());
  for (int s = 0; s < sides; ++s) {
    const double angle = 2 * std::numbers::pi * s / sides;
    mesh.positions.push_back(centre + radius_m * (std::cos(angle) * u + std::sin(angle) * v));
  }
  return first;
}

void join_rings(PictureMesh& mesh, std::int32_t lower, std::int32_t upper, int sides) {
  for (std::int32_t s = 0; s < sides; ++s) {
    const std::int32_t next = (s + 1) % sides;
    mesh.triangles.push_back({lower + s, lower + next, upper + next});
    mesh.triangles.push_back({lower + s, upper + next, upper + s});
  }
}

}  // namespace

EyeFrame eye_frame(const Camera& camera) {
  const Vec3 back = camera.eye - camera.target;
  const Vec3 right = camera.up.cross(back);
  const bool finite = back.allFinite() && right.allFinite();
  if (!finite || back.norm() <= 0 || right.norm() <= 1e-9 * back.norm() * camera.up.norm() ||
      !(camera.field_of_view_deg > 0 && camera.field_of_view_deg < 170)) {
    throw InputError(
        "the picture's camera looks nowhere; give an eye apart from the target, an up that is not along the "
        "view, and a field of view between 0 and 170 degrees");
  }
  EyeFrame frame;
  frame.eye = camera.eye;
  const Vec3 z = back / back.norm(), x = right / right.norm();
  frame.rotation.row(0) = x;
  frame.rotation.row(1) = z.cross(x);
  frame.rotation.row(2) = z;
  return frame;
}

EyeMesh to_eye(const PictureMesh& mesh, const EyeFrame& frame) {
  check_mesh(mesh);
  const std::vector<Vec3> normals = area_normals(mesh);
  const VertexTriangles around = triangles_around(mesh);
  std::vector<Vec3> smooth;
  if (mesh.normal_smoothing > 0) smooth = smoothed_normals(mesh, normals, around);
  EyeMesh out;
  out.finish = mesh.finish;
  out.clipped = mesh.clipped;
  out.cut_colour = mesh.cut_colour;
  out.section_only = mesh.section_only;
  out.on_cut = mesh.on_cut;
  out.positions.reserve(mesh.triangles.size() * 9);
  out.normals.reserve(mesh.triangles.size() * 9);
  out.colours.reserve(mesh.triangles.size() * 9);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!normals[t].allFinite()) continue;
    for (const std::int32_t v : mesh.triangles[t]) {
      const auto vertex = static_cast<std::size_t>(v);
      append(out.positions, frame.to_eye(mesh.positions[vertex]));
      append(out.normals,
             frame.rotation *
                 (smooth.empty() ? corner_normal(normals, around, t, v, mesh.crease_cos) : smooth[vertex]));
      const Colour& colour = !mesh.vertex_colours.empty()     ? mesh.vertex_colours[vertex]
                             : !mesh.triangle_colours.empty() ? mesh.triangle_colours[t]
                                                              : mesh.colour;
      out.colours.insert(out.colours.end(), colour.begin(), colour.end());
    }
  }
  return out;
}

PictureMesh sphere_mesh(const PictureSphere& sphere) {
  constexpr int sides = 32, bands = 16;
  PictureMesh mesh;
  mesh.colour = sphere.colour;
  mesh.positions.push_back(sphere.centre - Vec3(0, 0, sphere.radius_m));
  std::int32_t below = 0;
  for (int band = 1; band < bands; ++band) {
    const double angle = std::numbers::pi * band / bands;
    const Vec3 centre = sphere.centre - Vec3(0, 0, sphere.radius_m * std::cos(angle));
    const std::int32_t ring =
        add_ring(mesh, centre, Vec3::UnitX(), Vec3::UnitY(), sphere.radius_m * std::sin(angle), sides);
    if (band == 1) {
      for (std::int32_t s = 0; s < sides; ++s)
        mesh.triangles.push_back({0, ring + (s + 1) % sides, ring + s});
    } else {
      join_rings(mesh, below, ring, sides);
    }
    below = ring;
  }
  const auto top = static_cast<std::int32_t>(mesh.positions.size());
  mesh.positions.push_back(sphere.centre + Vec3(0, 0, sphere.radius_m));
  for (std::int32_t s = 0; s < sides; ++s)
    mesh.triangles.push_back({top, below + s, below + (s + 1) % sides});
  return mesh;
}

PictureMesh arrow_mesh(const PictureArrow& arrow) {
  constexpr int sides = 24;
  PictureMesh mesh;
  mesh.colour = arrow.colour;
  mesh.crease_cos = 0.7;
  const Vec3 along = arrow.to - arrow.from;
  const double length = along.norm();
  if (!(length > 0)) return mesh;
  // Any two directions across the arrow: the axis it is least along serves as a helper.
  const Vec3 axis = along / length;
  int least = 0;
  axis.cwiseAbs().minCoeff(&least);
  const Vec3 u = axis.cross(Vec3::Unit(least)).normalized(), v = axis.cross(u);
  const double head = std::min(length, 6 * arrow.radius_m);
  const Vec3 neck = arrow.to - head * axis;
  const std::int32_t foot = add_ring(mesh, arrow.from, u, v, arrow.radius_m, sides);
  const std::int32_t shaft = add_ring(mesh, neck, u, v, arrow.radius_m, sides);
  const std::int32_t brim = add_ring(mesh, neck, u, v, 2.4 * arrow.radius_m, sides);
  join_rings(mesh, foot, shaft, sides);
  join_rings(mesh, shaft, brim, sides);
  const auto tip = static_cast<std::int32_t>(mesh.positions.size());
  mesh.positions.push_back(arrow.to);
  mesh.positions.push_back(arrow.from);
  for (std::int32_t s = 0; s < sides; ++s) {
    const std::int32_t next = (s + 1) % sides;
    mesh.triangles.push_back({brim + s, brim + next, tip});
    mesh.triangles.push_back({foot + next, foot + s, tip + 1});
  }
  return mesh;
}

}  // namespace sulcus::picture
