#include "verify/section.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"
#include "verify/run_picture.h"

namespace sulcus {
namespace {

constexpr Colour black{0, 0, 0};

void require(bool holds, const std::string& what) {
  if (!holds) throw InputError("a section cannot be painted: " + what);
}

ImageGeometry geometry_of(const SectionFrame& frame) {
  ImageGeometry geometry;
  geometry.size = {frame.columns, frame.rows, 1};
  geometry.spacing = Vec3::Constant(frame.pixel_m);
  geometry.origin = frame.centre(0, 0);
  geometry.direction.col(0) = frame.right;
  geometry.direction.col(1) = frame.up;
  geometry.direction.col(2) = frame.normal();
  return geometry;
}

// Linear between voxel centres; not-a-number outside of the image.
double grey_at(const GreyVolume& grey, const Vec3& world) {
  const ImageGeometry& g = grey.geometry;
  const Vec3 at = (g.direction.transpose() * (world - g.origin)).cwiseQuotient(g.spacing);
  std::array<std::size_t, 3> low, high;
  Vec3 share;
  for (int a = 0; a < 3; ++a) {
    const double last = g.size[a] - 1;
    if (!(at[a] >= -0.5 && at[a] <= last + 0.5)) return NAN;
    const double inside = std::clamp(at[a], 0.0, last);
    low[a] = static_cast<std::size_t>(inside);
    high[a] = std::min(low[a] + 1, static_cast<std::size_t>(last));
    share[a] = inside - static_cast<double>(low[a]);
  }
  double sum = 0;
  for (std::size_t c = 0; c < 8; ++c) {
    double weight = 1;
    std::array<std::size_t, 3> voxel;
    for (std::size_t a = 0; a < 3; ++a) {
      const bool upper = c >> a & 1;
      weight *= upper ? share[static_cast<int>(a)] : 1 - share[static_cast<int>(a)];
      voxel[a] = upper ? high[a] : low[a];
    }
    const auto nx = static_cast<std::size_t>(g.size[0]), ny = static_cast<std::size_t>(g.size[1]);
    if (weight > 0)
      sum += weight * static_cast<double>(grey.values[voxel[0] + nx * (voxel[1] + ny * voxel[2])]);
  }
  return sum;
}

Colour grey_colour(const GreyVolume& grey, double value) {
  const double share = std::clamp((value - grey.black) / (grey.white - grey.black), 0.0, 1.0);
  const auto byte = static_cast<std::uint8_t>(std::lround(255 * share));
  return {byte, byte, byte};
}

// The nodes' values at a point of an element's rest shape.
double value_at(const SectionContent& content, std::int32_t tet, const Vec3& rest) {
  const auto& nodes = content.mesh->tets[static_cast<std::size_t>(tet)];
  const auto corner = [&](std::size_t c) -> const Vec3& {
    return content.mesh->rest_positions[static_cast<std::size_t>(nodes[c])];
  };
  Mat3 edges;
  for (std::size_t c = 1; c < 4; ++c) edges.col(static_cast<int>(c) - 1) = corner(c) - corner(0);
  const Vec3 w = edges.inverse() * (rest - corner(0));
  const auto value = [&](std::size_t c) { return content.node_values[static_cast<std::size_t>(nodes[c])]; };
  return (1 - w.sum()) * value(0) + w[0] * value(1) + w[1] * value(2) + w[2] * value(3);
}

Colour mixed(const Colour& below, const Colour& above, double opacity) {
  Colour colour;
  for (std::size_t c = 0; c < 3; ++c)
    colour[c] = static_cast<std::uint8_t>(std::lround((1 - opacity) * below[c] + opacity * above[c]));
  return colour;
}

Colour colour_of_label(const SectionContent& content, std::int32_t label) {
  const auto given = content.label_colours.find(label);
  return given == content.label_colours.end() ? label_colour(label) : given->second;
}

void check(const SectionFrame& frame, const SectionContent& content) {
  require(frame.columns >= 1 && frame.rows >= 1 && frame.pixel_m > 0, "it has no pixels");
  require(content.map && content.mesh, "it has no label map or no mesh");
  const std::size_t nodes = content.mesh->rest_positions.size();
  require(content.node_positions.size() == 3 * nodes, std::to_string(content.node_positions.size()) +
                                                          " coordinates were given for " +
                                                          std::to_string(nodes) + " nodes; give 3 a node");
  require(content.node_values.empty() || content.node_values.size() == nodes,
          std::to_string(content.node_values.size()) + " values were given for " + std::to_string(nodes) +
              " nodes; give one a node or none");
  if (!content.grey) return;
  const Index3& size = content.grey->geometry.size;
  std::size_t voxels = 1;
  for (const int n : size) voxels *= static_cast<std::size_t>(std::max(n, 0));
  require(voxels > 0 && voxels == content.grey->values.size(),
          "the grey image has " + std::to_string(voxels) + " voxels and " +
              std::to_string(content.grey->values.size()) + " values");
}

}  // namespace

Vec3 SectionFrame::normal() const {
  return right.cross(up);
}

Vec3 SectionFrame::centre(int column, int row) const {
  return middle + pixel_m * ((column - 0.5 * (columns - 1)) * right + (row - 0.5 * (rows - 1)) * up);
}

SectionFrame frame_section(std::span<const Vec3> points, const Vec3& on_plane, const Vec3& normal,
                           const Vec3& up, int most_pixels) {
  SectionFrame frame;
  const Vec3 n = normal.normalized();
  frame.right = up.cross(n).normalized();
  frame.up = n.cross(frame.right);
  Vec3 low = Vec3::Constant(INFINITY), high = Vec3::Constant(-INFINITY);
  for (const Vec3& point : points) {
    if (!point.allFinite()) continue;
    const Vec3 foot(frame.right.dot(point - on_plane), frame.up.dot(point - on_plane), 0);
    low = low.cwiseMin(foot);
    high = high.cwiseMax(foot);
  }
  frame.middle = on_plane;
  if (!(low[0] <= high[0])) return frame;
  const Vec3 extent = high - low;
  frame.middle += 0.5 * (low[0] + high[0]) * frame.right + 0.5 * (low[1] + high[1]) * frame.up;
  frame.pixel_m = std::max(extent.maxCoeff() / std::max(most_pixels, 1), 1e-9);
  frame.columns = static_cast<int>(std::ceil(extent[0] / frame.pixel_m)) + 1;
  frame.rows = static_cast<int>(std::ceil(extent[1] / frame.pixel_m)) + 1;
  return frame;
}

Section paint_section(const SectionFrame& frame, const SectionContent& content) {
  check(frame, content);
  const TissueImage tissue =
      locate_tissue(*content.map, *content.mesh, content.node_positions, content.alive, geometry_of(frame));
  Section section{frame, {}, {}};
  const auto pixels = static_cast<std::size_t>(frame.columns) * static_cast<std::size_t>(frame.rows);
  section.colours.assign(pixels, black);
  section.shown.assign(pixels, 0);
  for (std::size_t p = 0; p < pixels; ++p) {
    const std::int32_t voxel = tissue.voxel[p];
    if ((voxel == gap_voxel || voxel == background_voxel) && (!content.grey || content.tissue_only)) continue;
    section.shown[p] = 1;
    if (voxel == gap_voxel || voxel == folded_voxel) continue;
    const auto column = static_cast<int>(p % static_cast<std::size_t>(frame.columns));
    const auto row = static_cast<int>(p / static_cast<std::size_t>(frame.columns));
    const Vec3 moved(tissue.moved[p][0], tissue.moved[p][1], tissue.moved[p][2]);  // pixels
    const Vec3 rest =
        frame.centre(column, row) -
        frame.pixel_m * (moved[0] * frame.right + moved[1] * frame.up + moved[2] * frame.normal());
    Colour& colour = section.colours[p];
    if (content.grey) {
      const double value = grey_at(*content.grey, rest);
      section.shown[p] = std::isfinite(value);
      if (section.shown[p]) colour = grey_colour(*content.grey, value);
    } else {
      colour = colour_of_label(content, content.map->labels[static_cast<std::size_t>(voxel)]);
    }
    if (voxel < 0 || content.node_values.empty()) continue;
    const double value = value_at(content, tissue.tet[p], rest);
    if (!(value >= content.bar.low)) continue;
    section.shown[p] = 1;
    colour = mixed(
        colour, colour_of(content.bar.map, (value - content.bar.low) / (content.bar.high - content.bar.low)),
        content.overlay_opacity);
  }
  return section;
}

void grow_section(Section& section, int pixels) {
  const auto columns = static_cast<std::size_t>(section.frame.columns);
  const auto rows = static_cast<std::size_t>(section.frame.rows);
  for (int pass = 0; pass < pixels; ++pass) {
    const Section before = section;
    const auto take = [&](std::size_t to, std::size_t from) {
      if (section.shown[to] || !before.shown[from]) return;
      section.shown[to] = 1;
      section.colours[to] = before.colours[from];
    };
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t column = 0; column < columns; ++column) {
        const std::size_t p = row * columns + column;
        if (column > 0) take(p, p - 1);
        if (column + 1 < columns) take(p, p + 1);
        if (row > 0) take(p, p - columns);
        if (row + 1 < rows) take(p, p + columns);
      }
    }
  }
}

PictureMesh section_mesh(const Section& section, double lift_m) {
  const SectionFrame& frame = section.frame;
  PictureMesh mesh;
  mesh.finish = Finish::flat;
  const Vec3 lift = lift_m * frame.normal();
  for (int row = 0; row <= frame.rows; ++row) {
    for (int column = 0; column <= frame.columns; ++column) {
      mesh.positions.push_back(frame.centre(column, row) - 0.5 * frame.pixel_m * (frame.right + frame.up) +
                               lift);
    }
  }
  const std::int32_t stride = frame.columns + 1;
  for (std::int32_t row = 0; row < frame.rows; ++row) {
    for (std::int32_t column = 0; column < frame.columns; ++column) {
      const auto p = static_cast<std::size_t>(row * frame.columns + column);
      if (!section.shown[p]) continue;
      const std::int32_t corner = row * stride + column;
      mesh.triangles.push_back({corner, corner + 1, corner + stride + 1});
      mesh.triangles.push_back({corner, corner + stride + 1, corner + stride});
      mesh.triangle_colours.insert(mesh.triangle_colours.end(), 2, section.colours[p]);
    }
  }
  return mesh;
}

}  // namespace sulcus
