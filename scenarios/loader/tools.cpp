#include "scenarios/loader/tools.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "engine/numerics/elementary.h"
#include "engine/numerics/error.h"

namespace sulcus {

namespace {

constexpr double pi = 3.14159265358979323846;
constexpr double max_vertices = 1e6;

void require_positive(double value, const std::string& what) {
  if (!(value > 0) || !std::isfinite(value)) {
    throw InputError("tool shape: " + what + " is " + std::to_string(value) + "; give a positive number");
  }
}

void refuse_if(bool wrong, const std::string& message) {
  if (wrong) throw InputError("tool shape: " + message);
}

// Origin to the centre of mass.
ToolSurface centred(ToolSurface surface) {
  const Vec3 centre = solid_moments(surface).centre_m;
  for (Vec3& vertex : surface.vertices) vertex -= centre;
  return surface;
}

// Joins a pole, rings of equally many vertices and another pole to a closed surface. Vertices: pole, rings,
// pole. The rings run counter-clockwise as seen from the first pole.
void join_rings(ToolSurface& surface, int rings, int around) {
  const auto at = [&](int ring, int corner) { return 1 + ring * around + corner % around; };
  const int last = 1 + rings * around;
  for (int corner = 0; corner < around; ++corner) {
    surface.triangles.push_back({0, at(0, corner), at(0, corner + 1)});
  }
  for (int ring = 0; ring + 1 < rings; ++ring) {
    for (int corner = 0; corner < around; ++corner) {
      const int a = at(ring, corner), b = at(ring, corner + 1);
      const int c = at(ring + 1, corner), d = at(ring + 1, corner + 1);
      surface.triangles.push_back({a, c, d});
      surface.triangles.push_back({a, d, b});
    }
  }
  for (int corner = 0; corner < around; ++corner) {
    surface.triangles.push_back({last, at(rings - 1, corner + 1), at(rings - 1, corner)});
  }
}

// A station of the blade: distance along the middle line from its middle, share of the full width and
// thickness.
struct Station {
  double along = 0;
  double width = 1;
  double thickness = 1;
};

// Stations from the tip (+length/2) to the handle end; the ends are half-circles seen from the broad side.
std::vector<Station> blade_stations(const RetractorShape& shape) {
  constexpr int end_rings = 9, all_rings = 71;
  const double radius = 0.5 * shape.width_m, straight = shape.length_m - shape.width_m;
  const double nose = 0.5 * shape.thickness_m;  // the thickness fades over this length
  std::vector<Station> stations;
  for (int ring = 1; ring <= end_rings; ++ring) {
    const double angle = 0.5 * pi * ring / (end_rings + 1);
    const double from_tip = radius * (1 - det_cos(angle));
    const double fade = std::max(0.0, 1 - from_tip / nose);
    stations.push_back({0.5 * shape.length_m - from_tip, det_sin(angle), std::sqrt(1 - fade * fade)});
  }
  constexpr int middle_rings = all_rings - 2 * end_rings;
  for (int ring = 0; ring < middle_rings; ++ring) {
    stations.push_back({0.5 * straight - straight * ring / (middle_rings - 1), 1, 1});
  }
  for (int ring = end_rings - 1; ring >= 0; --ring) {
    Station station = stations[static_cast<std::size_t>(ring)];
    station.along = -station.along;
    stations.push_back(station);
  }
  return stations;
}

// A point at `along` on the blade's middle line, off by x to the side and by n along the normal of the broad
// face.
Vec3 on_blade(double curvature, double along, double x, double n) {
  const double angle = curvature * along;
  const double sine = det_sin(angle), cosine = det_cos(angle);
  Vec3 middle(0, 0.5 * curvature * along * along, -along);
  if (std::abs(angle) > 1e-4) middle = {0, (1 - cosine) / curvature, -sine / curvature};
  return middle + Vec3(x, n * cosine, n * sine);
}

}  // namespace

ToolSurface retractor_surface(const RetractorShape& shape) {
  require_positive(shape.length_m, "length (m)");
  require_positive(shape.width_m, "width (m)");
  require_positive(shape.thickness_m, "thickness (m)");
  refuse_if(shape.thickness_m > shape.width_m, "the thickness of a retractor must not exceed its width");
  refuse_if(shape.width_m >= shape.length_m, "a retractor must be longer than wide");
  refuse_if(!(std::abs(shape.bend_rad) < pi), "the bend of a retractor must be less than 180 degrees");
  refuse_if(std::abs(shape.bend_rad) * shape.thickness_m > shape.length_m,
            "the retractor is too thick for its bend");

  // Cross-section, counter-clockwise as seen from the tip: 4 vertices on each broad face, one on each narrow
  // edge.
  constexpr int around = 10;
  const double curvature = shape.bend_rad / shape.length_m;
  ToolSurface surface;
  surface.vertices.push_back(on_blade(curvature, 0.5 * shape.length_m, 0, 0));
  const std::vector<Station> stations = blade_stations(shape);
  for (const Station& station : stations) {
    const double half_width = 0.5 * shape.width_m * station.width;
    const double half_thickness = 0.5 * shape.thickness_m * station.thickness;
    const double face = std::max(half_width - half_thickness, 0.5 * half_width);
    const auto add = [&](double x, double n) {
      surface.vertices.push_back(on_blade(curvature, station.along, x, n));
    };
    add(half_width, 0);
    for (int step = 0; step < 4; ++step) add(face * (1 - step / 1.5), -half_thickness);
    add(-half_width, 0);
    for (int step = 0; step < 4; ++step) add(face * (step / 1.5 - 1), half_thickness);
  }
  surface.vertices.push_back(on_blade(curvature, -0.5 * shape.length_m, 0, 0));
  join_rings(surface, static_cast<int>(stations.size()), around);
  return centred(std::move(surface));
}

ToolSurface sphere_surface(const SphereShape& shape) {
  require_positive(shape.radius_m, "radius (m)");
  refuse_if(shape.subdivisions < 0 || shape.subdivisions > 5, "a sphere has 0 to 5 subdivisions");

  // Icosahedron: two poles and two rings of five.
  ToolSurface surface;
  const double height = 1 / std::sqrt(5.0), ring = 2 / std::sqrt(5.0);
  surface.vertices.emplace_back(0, 0, -1);
  for (int corner = 0; corner < 5; ++corner) {
    const double angle = -0.4 * pi * corner;
    surface.vertices.emplace_back(ring * det_cos(angle), ring * det_sin(angle), -height);
  }
  for (int corner = 0; corner < 5; ++corner) {
    const double angle = -0.4 * pi * (corner - 0.5);
    surface.vertices.emplace_back(ring * det_cos(angle), ring * det_sin(angle), height);
  }
  surface.vertices.emplace_back(0, 0, 1);
  join_rings(surface, 2, 5);

  for (int pass = 0; pass < shape.subdivisions; ++pass) {
    std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> middles;
    const auto middle = [&](std::int32_t a, std::int32_t b) {
      const auto [entry, added] =
          middles.try_emplace(std::minmax(a, b), static_cast<std::int32_t>(surface.vertices.size()));
      if (added) {
        const Vec3 sum =
            surface.vertices[static_cast<std::size_t>(a)] + surface.vertices[static_cast<std::size_t>(b)];
        surface.vertices.push_back(sum / std::sqrt(sum.squaredNorm()));
      }
      return entry->second;
    };
    std::vector<std::array<std::int32_t, 3>> finer;
    for (const auto& [a, b, c] : surface.triangles) {
      const std::int32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    surface.triangles = std::move(finer);
  }
  for (Vec3& vertex : surface.vertices) vertex *= shape.radius_m;
  return centred(std::move(surface));
}

ToolSurface box_surface(const BoxShape& shape) {
  require_positive(shape.edge_m, "edge (m)");
  Index3 cells{};
  for (int axis = 0; axis < 3; ++axis) {
    require_positive(shape.size_m[axis], "size (m)");
    const double count = std::ceil(shape.size_m[axis] / shape.edge_m * (1 - 1e-12));
    refuse_if(count > 1000, "more than 1000 grid cells along an edge of the box; give a larger edge");
    cells[static_cast<std::size_t>(axis)] = std::max(1, static_cast<int>(count));
  }
  const double quads = 2.0 * cells[0] * cells[1] + 2.0 * cells[1] * cells[2] + 2.0 * cells[2] * cells[0];
  refuse_if(quads > max_vertices, "more than a million vertices; give a larger edge");

  ToolSurface surface;
  std::map<Index3, std::int32_t> numbers;
  const auto vertex = [&](const Index3& at) {
    const auto [entry, added] = numbers.try_emplace(at, static_cast<std::int32_t>(surface.vertices.size()));
    if (added) {
      Vec3 position;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double share = static_cast<double>(at[axis]) / cells[axis] - 0.5;
        position[static_cast<Eigen::Index>(axis)] = shape.size_m[static_cast<Eigen::Index>(axis)] * share;
      }
      surface.vertices.push_back(position);
    }
    return entry->second;
  };
  // Faces: normal along `axis`, u and v span it right-handedly.
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool far_side : {false, true}) {
      for (int a = 0; a < cells[u]; ++a) {
        for (int b = 0; b < cells[v]; ++b) {
          Index3 at{};
          at[axis] = far_side ? cells[axis] : 0;
          const auto corner = [&](int da, int db) {
            at[u] = a + da;
            at[v] = b + db;
            return vertex(at);
          };
          const std::int32_t p = corner(0, 0), q = corner(1, 0), r = corner(1, 1), s = corner(0, 1);
          if (far_side) {
            surface.triangles.insert(surface.triangles.end(), {{p, q, r}, {p, r, s}});
          } else {
            surface.triangles.insert(surface.triangles.end(), {{p, r, q}, {p, s, r}});
          }
        }
      }
    }
  }
  return centred(std::move(surface));
}

ToolSurface capsule_surface(const CapsuleShape& shape) {
  require_positive(shape.radius_m, "radius (m)");
  require_positive(shape.length_m, "length (m)");
  refuse_if(shape.length_m <= 2 * shape.radius_m, "a capsule must be longer than its two radii");
  constexpr int around = 16, cap_rings = 4;
  const double straight = shape.length_m - 2 * shape.radius_m;
  const double side = std::ceil(straight / (2 * pi * shape.radius_m / around));
  refuse_if(side * around > max_vertices, "more than a million vertices; give a larger radius");

  ToolSurface surface;
  std::vector<std::pair<double, double>> rings;  // z, radius; from the tip up
  for (int ring = 1; ring <= cap_rings; ++ring) {
    const double angle = 0.5 * pi * ring / cap_rings;
    rings.emplace_back(-0.5 * straight - shape.radius_m * det_cos(angle), shape.radius_m * det_sin(angle));
  }
  const int side_rings = static_cast<int>(side);
  for (int ring = 1; ring < side_rings; ++ring) {
    rings.emplace_back(straight * ring / side_rings - 0.5 * straight, shape.radius_m);
  }
  for (int ring = cap_rings - 1; ring >= 0; --ring) {
    const auto [z, radius] = rings[static_cast<std::size_t>(ring)];
    rings.emplace_back(-z, radius);
  }
  surface.vertices.emplace_back(0, 0, -0.5 * shape.length_m);
  for (const auto& [z, radius] : rings) {
    for (int corner = 0; corner < around; ++corner) {
      const double angle = -2 * pi * corner / around;
      surface.vertices.emplace_back(radius * det_cos(angle), radius * det_sin(angle), z);
    }
  }
  surface.vertices.emplace_back(0, 0, 0.5 * shape.length_m);
  join_rings(surface, static_cast<int>(rings.size()), around);
  return centred(std::move(surface));
}

ToolSurface torus_surface(const TorusShape& shape) {
  require_positive(shape.radius_m, "radius (m)");
  require_positive(shape.tube_radius_m, "radius of the tube (m)");
  refuse_if(shape.tube_radius_m >= shape.radius_m, "the tube of a torus must be thinner than its hole");
  constexpr int around = 64, tube = 32;
  ToolSurface surface;
  const auto at = [&](int i, int j) { return i % around * tube + j % tube; };
  for (int i = 0; i < around; ++i) {
    const double turn = 2 * pi * i / around;
    for (int j = 0; j < tube; ++j) {
      const double roll = 2 * pi * j / tube;
      const double out = shape.radius_m + shape.tube_radius_m * det_cos(roll);
      surface.vertices.emplace_back(out * det_cos(turn), out * det_sin(turn),
                                    shape.tube_radius_m * det_sin(roll));
      surface.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      surface.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return surface;
}

ToolSurface floor_surface(const FloorShape& shape) {
  require_positive(shape.size_m, "size (m)");
  const double thickness = shape.size_m / 5;
  ToolSurface surface = box_surface({Vec3(shape.size_m, shape.size_m, thickness), thickness});
  for (Vec3& vertex : surface.vertices) vertex[2] -= 0.5 * thickness;
  return surface;
}

SolidMoments solid_moments(const ToolSurface& surface) {
  // Sum over the tetrahedra of the origin and each triangle; second moments of a tetrahedron with a corner in
  // the origin: V/20 (a a^T + b b^T + c c^T + s s^T), s = a + b + c.
  double volume = 0;
  Vec3 first = Vec3::Zero();
  Mat3 second = Mat3::Zero();
  for (const auto& [i, j, k] : surface.triangles) {
    const Vec3& a = surface.vertices[static_cast<std::size_t>(i)];
    const Vec3& b = surface.vertices[static_cast<std::size_t>(j)];
    const Vec3& c = surface.vertices[static_cast<std::size_t>(k)];
    const double part = a.dot(b.cross(c)) / 6;
    const Vec3 sum = a + b + c;
    volume += part;
    first += part / 4 * sum;
    second += part / 20 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
  }
  SolidMoments moments;
  moments.volume_m3 = volume;
  moments.centre_m = first / volume;
  const Mat3 central = second - volume * moments.centre_m * moments.centre_m.transpose();
  moments.inertia_m5 = central.trace() * Mat3::Identity() - central;
  return moments;
}

}  // namespace sulcus
