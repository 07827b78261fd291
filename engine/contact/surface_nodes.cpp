#include "engine/contact/surface_nodes.h"

#include <Eigen/Geometry>
#include <cmath>

namespace sulcus {
namespace {

std::size_t at(std::int64_t number) {
  return static_cast<std::size_t>(number);
}

bool present(std::span<const std::uint8_t> alive, std::int32_t tet) {
  return tet >= 0 && (alive.empty() || alive[at(tet)] != 0);
}

// Sum of the areas of the boundary faces around a node, times their outward normals, m^2.
Vec3 boundary_area(const BoundaryMesh& mesh, std::span<const std::uint8_t> alive,
                   std::span<const double> positions, std::int32_t node) {
  Vec3 area = Vec3::Zero();
  for (std::int32_t i = mesh.start[at(node)]; i < mesh.start[at(node) + 1]; ++i) {
    const std::int32_t tet = mesh.incident[at(i)] / 4, own = mesh.incident[at(i)] % 4;
    if (!present(alive, tet)) continue;
    for (int c = 0; c < 4; ++c) {
      if (c == own || is_covered(mesh.faces, alive, 4 * tet + c)) continue;
      const auto corner = [&](int k) {
        return node_vector(positions, mesh.tets[at(tet)][face_corners[at(c)][at(k)]]);
      };
      const Vec3 x0 = corner(0);
      area += 0.5 * (corner(1) - x0).cross(corner(2) - x0);
    }
  }
  return area;
}

// Length s of the way from `from` along the unit vector `way` (body axes) until the tool is left; negative if
// there is none.
double way_out(const RigidDistance& distance, const Vec3& from, const Vec3& way) {
  const double reach =
      distance.spacing_m * (distance.size[0] + distance.size[1] + distance.size[2]);  // m, more than the tool
  const double least = 0.02 * distance.spacing_m;
  double s = 0;
  for (int tries = 0; tries < 200 && s < reach; ++tries) {
    Vec3 slope;
    const double value = sample(distance, from + s * way, &slope);
    if (value > -least) {
      const double steepness = slope.dot(way);
      if (!(steepness > 0.3 * slope.norm())) return -1;  // sideways
      return std::fmax(s - value / steepness, 0.0);
    }
    s += -value;
  }
  return -1;
}

// Whether the way out along `way` is sideways: much longer than the tool is thick at this place, as along the
// width of a blade. inside: the distance there, negative; slope: its gradient.
bool sideways(const RigidDistance& distance, const Vec3& from, double inside, const Vec3& slope,
              double depth) {
  if (depth <= -2 * inside) return false;
  const double steepness = slope.norm();
  if (!(steepness > 1e-6)) return false;
  const double opposite = way_out(distance, from, -slope / steepness);
  return opposite >= 0 && depth > 1.5 * (opposite - inside);
}

}  // namespace

bool on_boundary(const BoundaryMesh& mesh, std::span<const std::uint8_t> alive, std::int32_t node) {
  for (std::int32_t i = mesh.start[at(node)]; i < mesh.start[at(node) + 1]; ++i) {
    const std::int32_t tet = mesh.incident[at(i)] / 4, own = mesh.incident[at(i)] % 4;
    if (!present(alive, tet)) continue;
    for (int c = 0; c < 4; ++c) {
      if (c != own && !is_covered(mesh.faces, alive, 4 * tet + c)) return true;
    }
  }
  return false;
}

void find_node_contacts(const BoundaryMesh& mesh, std::span<const std::uint8_t> alive,
                        std::span<const std::uint8_t> boundary, std::span<const double> positions,
                        const RigidDistance& distance, const RigidBodyState& pose, std::int32_t tool,
                        std::vector<Contact>& contacts, WayOut way) {
  const Mat3 to_body = rotation_matrix(pose.orientation).transpose();
  const Vec3 high = distance.origin + distance.spacing_m * Vec3(distance.size[0] - 1, distance.size[1] - 1,
                                                                distance.size[2] - 1);
  for (std::size_t n = 0; n < boundary.size(); ++n) {
    if (!boundary[n]) continue;
    const auto node = static_cast<std::int32_t>(n);
    const Vec3 x = node_vector(positions, node);
    const Vec3 body = to_body * (x - pose.position);
    if (!((body.array() > distance.origin.array()).all() && (body.array() < high.array()).all())) continue;
    Vec3 slope;
    const double inside = sample(distance, body, &slope);
    if (!(inside < 0)) continue;
    Vec3 normal = way == WayOut::shortest ? Vec3(-(to_body.transpose() * slope))
                                          : boundary_area(mesh, alive, positions, node);
    const double length = std::sqrt(normal.squaredNorm());
    if (!(length > 0)) continue;
    normal /= length;
    const double depth =
        way == WayOut::shortest ? -inside / length : way_out(distance, body, to_body * -normal);
    if (!(depth > 0)) continue;
    if (way == WayOut::along_tissue_normal && sideways(distance, body, inside, slope, depth)) continue;

    Contact contact;
    contact.tool = tool;
    contact.vertex = node;
    for (std::int32_t i = mesh.start[n]; i < mesh.start[n + 1]; ++i) {
      contact.tet = mesh.incident[at(i)] / 4;
      contact.weights = {};
      contact.weights[at(mesh.incident[at(i)] % 4)] = 1;
      if (present(alive, contact.tet)) break;
    }
    contact.normal = normal;
    contact.gap = -depth * normal;
    contact.arm = x + contact.gap - pose.position;
    contact.depth_m = depth;
    contacts.push_back(contact);
  }
}

}  // namespace sulcus
