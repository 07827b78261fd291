#include "scenarios/loader/generated.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

void require_positive(double value, const char* what) {
  if (!(value > 0) || !std::isfinite(value)) {
    throw InputError("generated label map: " + std::string(what) + " is " + std::to_string(value) +
                     " m; give a positive number");
  }
}

// An empty map around the origin, one voxel size along all axes.
LabelMap empty_map(const Vec3& size_m, double voxel_size_m) {
  require_positive(voxel_size_m, "the voxel size");
  LabelMap map;
  double voxels = 1;
  for (int axis = 0; axis < 3; ++axis) {
    require_positive(size_m[axis], "a size");
    const double count = std::floor(size_m[axis] / voxel_size_m + 0.5);
    if (count < 1) {
      throw InputError("generated label map: a size of " + std::to_string(size_m[axis] * 1e3) +
                       " mm is less than a voxel of " + std::to_string(voxel_size_m * 1e3) +
                       " mm; give a smaller voxel size");
    }
    voxels *= count;
    if (voxels > static_cast<double>(max_generated_voxels)) {
      throw InputError("generated label map: more than " + std::to_string(max_generated_voxels) +
                       " voxels; give a larger voxel size");
    }
    map.size[static_cast<std::size_t>(axis)] = static_cast<int>(count);
    map.origin[axis] = -0.5 * (count - 1) * voxel_size_m;
  }
  map.spacing = Vec3::Constant(voxel_size_m);
  map.labels.assign(static_cast<std::size_t>(voxels), 0);
  return map;
}

// label_at(centre): centre of the voxel in voxel sizes from the middle of the map (exact halves).
template <class LabelAt>
void fill(LabelMap& map, LabelAt&& label_at) {
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        const Vec3 centre(i - 0.5 * (map.size[0] - 1), j - 0.5 * (map.size[1] - 1),
                          k - 0.5 * (map.size[2] - 1));
        map.labels[map.index(i, j, k)] = label_at(centre);
      }
    }
  }
}

void require_label(std::int32_t label) {
  if (label == 0) throw InputError("generated label map: label 0 means empty; give another one");
}

}  // namespace

LabelMap generate(const CylinderThreeSegments& shape) {
  LabelMap map = empty_map({shape.length_m, shape.diameter_m, shape.diameter_m}, shape.voxel_size_m);
  if (!(shape.gap_m >= 0) || !std::isfinite(shape.gap_m) || !(shape.gap_from_y_m >= 0)) {
    throw InputError("generated label map: gap and gap_from_y must not be negative");
  }
  const double radius = 0.5 * map.size[1];
  const double gap = shape.gap_m / shape.voxel_size_m;
  const double gap_from = shape.gap_from_y_m / shape.voxel_size_m;
  fill(map, [&](const Vec3& centre) -> std::int32_t {
    const double y = centre[1], z = centre[2];
    if (y * y + z * z > radius * radius) return 0;
    if (y < 0) return 1;
    if (z < 0) return 3;
    return z < gap && y > gap_from ? 0 : 2;
  });
  return map;
}

LabelMap generate(const BoxSegment& shape) {
  require_label(shape.label);
  LabelMap map = empty_map(shape.size_m, shape.voxel_size_m);
  fill(map, [&](const Vec3&) { return shape.label; });
  return map;
}

LabelMap generate(const SphereSegment& shape) {
  require_label(shape.label);
  LabelMap map = empty_map(Vec3::Constant(shape.diameter_m), shape.voxel_size_m);
  const double radius = 0.5 * map.size[0];
  fill(map, [&](const Vec3& centre) { return centre.squaredNorm() > radius * radius ? 0 : shape.label; });
  return map;
}

LabelMap generate(const BallsSegment& shape) {
  require_label(shape.label);
  if (shape.balls.empty()) throw InputError("generated label map: there is no ball; give one at least");
  if (!(shape.blend_m >= 0) || !std::isfinite(shape.blend_m))
    throw InputError("generated label map: the blend must not be negative");
  require_positive(shape.voxel_size_m, "the voxel size");
  // in voxels: the box around all balls and their fillets, which stand out by a quarter of the blend at most
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  const double blend = shape.blend_m / shape.voxel_size_m;
  for (const auto& ball : shape.balls) {
    require_positive(ball.radius_m, "the radius of a ball");
    if (!ball.centre_m.allFinite()) throw InputError("generated label map: a ball's centre is not finite");
    const Vec3 centre = ball.centre_m / shape.voxel_size_m;
    const double reach = ball.radius_m / shape.voxel_size_m + blend / 4;
    low = low.cwiseMin(centre - Vec3::Constant(reach));
    high = high.cwiseMax(centre + Vec3::Constant(reach));
  }
  low = low.array().floor();
  high = high.array().ceil();
  LabelMap map = empty_map((high - low) * shape.voxel_size_m, shape.voxel_size_m);
  map.origin = (low + Vec3::Constant(0.5)) * shape.voxel_size_m;
  const Vec3 middle = 0.5 * (low + high);
  fill(map, [&](const Vec3& centre) {
    double distance = std::numeric_limits<double>::infinity();  // voxels, to the balls so far
    for (const auto& ball : shape.balls) {
      const double next =
          (middle + centre - ball.centre_m / shape.voxel_size_m).norm() - ball.radius_m / shape.voxel_size_m;
      const double nearer = std::min(distance, next), overlap = blend - std::abs(distance - next);
      distance = overlap > 0 ? nearer - overlap * overlap / (4 * blend) : nearer;
    }
    return distance > 0 ? 0 : shape.label;
  });
  return map;
}

LabelMap generate(const DrawnSegments& drawing) {
  std::size_t columns = 0;
  for (const std::string& row : drawing.rows) columns = std::max(columns, row.size());
  if (columns == 0)
    throw InputError("generated label map: the drawing is empty; give rows of '.' and '1' to '9'");
  const double size = drawing.voxel_size_m;
  require_positive(drawing.thickness_m, "the thickness");
  LabelMap map = empty_map(
      {static_cast<double>(columns) * size, static_cast<double>(drawing.rows.size()) * size, size}, size);
  map.spacing[2] = drawing.thickness_m;
  for (std::size_t r = 0; r < drawing.rows.size(); ++r) {
    for (std::size_t c = 0; c < drawing.rows[r].size(); ++c) {
      const char mark = drawing.rows[r][c];
      if (mark != '.' && !(mark >= '1' && mark <= '9')) {
        throw InputError("generated label map: row " + std::to_string(r + 1) + " of the drawing has '" +
                         std::string(1, mark) + "' in column " + std::to_string(c + 1) +
                         "; give '.' for empty and '1' to '9' for labels");
      }
      const int j = static_cast<int>(drawing.rows.size() - 1 - r);
      map.labels[map.index(static_cast<int>(c), j, 0)] = mark == '.' ? 0 : mark - '0';
    }
  }
  return map;
}

}  // namespace sulcus
