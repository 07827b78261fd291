#include "engine/contact/rigid_distance.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

struct Triangle {
  Vec3 a, b, c;
};

// Nearest point of a triangle, by the region of its plane that the point projects to.
double squared_distance(const Triangle& t, const Vec3& p) {
  const Vec3 ab = t.b - t.a, ac = t.c - t.a, ap = p - t.a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return ap.squaredNorm();
  const Vec3 bp = p - t.b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return bp.squaredNorm();
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (ap - d1 / (d1 - d3) * ab).squaredNorm();
  const Vec3 cp = p - t.c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return cp.squaredNorm();
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (ap - d2 / (d2 - d6) * ac).squaredNorm();
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    return (bp - (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (t.c - t.b)).squaredNorm();
  }
  const double scale = 1 / (va + vb + vc);
  return (ap - vb * scale * ab - vc * scale * ac).squaredNorm();
}

struct Box {
  Vec3 low, high;
};

Box bounding_box(const ToolSurface& surface) {
  Box box{surface.vertices.front(), surface.vertices.front()};
  for (const Vec3& v : surface.vertices) {
    box.low = box.low.cwiseMin(v);
    box.high = box.high.cwiseMax(v);
  }
  return box;
}

// The grid while it is made: the nearest triangle so far of each value.
struct Nearest {
  RigidDistance& field;
  std::vector<Triangle> triangles;
  std::vector<std::int32_t> triangle;  // -1: none yet
  std::vector<double> squared;

  std::size_t index(int i, int j, int k) const {
    return static_cast<std::size_t>((k * field.size[1] + j) * field.size[0] + i);
  }
  Vec3 point(int i, int j, int k) const { return field.origin + field.spacing_m * Vec3(i, j, k); }
  void offer(int i, int j, int k, std::int32_t number) {
    const std::size_t at = index(i, j, k);
    if (triangle[at] == number) return;
    const double distance = squared_distance(triangles[static_cast<std::size_t>(number)], point(i, j, k));
    if (triangle[at] >= 0 && !(distance < squared[at])) return;
    triangle[at] = number;
    squared[at] = distance;
  }
};

// Values within a spacing and a half of a triangle's box hear of it.
void rasterise(Nearest& nearest) {
  const RigidDistance& field = nearest.field;
  for (std::size_t n = 0; n < nearest.triangles.size(); ++n) {
    const Triangle& t = nearest.triangles[n];
    const Vec3 low = (t.a.cwiseMin(t.b).cwiseMin(t.c) - field.origin) / field.spacing_m;
    const Vec3 high = (t.a.cwiseMax(t.b).cwiseMax(t.c) - field.origin) / field.spacing_m;
    int from[3], to[3];
    for (int a = 0; a < 3; ++a) {
      from[a] = std::max(static_cast<int>(low[a] - 0.5), 0);
      to[a] = std::min(static_cast<int>(high[a] + 2), field.size[static_cast<std::size_t>(a)] - 1);
    }
    for (int k = from[2]; k <= to[2]; ++k) {
      for (int j = from[1]; j <= to[1]; ++j) {
        for (int i = from[0]; i <= to[0]; ++i) nearest.offer(i, j, k, static_cast<std::int32_t>(n));
      }
    }
  }
}

// Each value hears of the nearest triangles of its neighbours, in sweeps along all eight diagonals.
void sweep(Nearest& nearest) {
  const Index3& size = nearest.field.size;
  for (int round = 0; round < 16; ++round) {
    const int di = round & 1 ? -1 : 1, dj = round & 2 ? -1 : 1, dk = round & 4 ? -1 : 1;
    const auto start = [](int d, int count) { return d > 0 ? 0 : count - 1; };
    for (int k = start(dk, size[2]); k >= 0 && k < size[2]; k += dk) {
      for (int j = start(dj, size[1]); j >= 0 && j < size[1]; j += dj) {
        for (int i = start(di, size[0]); i >= 0 && i < size[0]; i += di) {
          const auto hear = [&](int a, int b, int c) {
            if (a < 0 || b < 0 || c < 0 || a >= size[0] || b >= size[1] || c >= size[2]) return;
            const std::int32_t number = nearest.triangle[nearest.index(a, b, c)];
            if (number >= 0) nearest.offer(i, j, k, number);
          };
          hear(i - di, j, k);
          hear(i, j - dj, k);
          hear(i, j, k - dk);
          hear(i - di, j - dj, k - dk);
        }
      }
    }
  }
}

// Makes the values inside negative: along every grid line in x, between odd and even crossings. Lines are
// moved by an odd fraction of the spacing so that they meet neither edges nor corners.
void sign(Nearest& nearest) {
  RigidDistance& field = nearest.field;
  std::vector<std::vector<double>> crossings(static_cast<std::size_t>(field.size[1]) *
                                             static_cast<std::size_t>(field.size[2]));
  const double shift_y = 1.2345e-4 * field.spacing_m, shift_z = 2.7183e-4 * field.spacing_m;
  for (const Triangle& t : nearest.triangles) {
    const Vec3 low = t.a.cwiseMin(t.b).cwiseMin(t.c), high = t.a.cwiseMax(t.b).cwiseMax(t.c);
    const auto line = [&](double x, int axis) {
      return static_cast<int>(std::floor((x - field.origin[axis]) / field.spacing_m));
    };
    for (int k = std::max(line(low[2], 2), 0); k <= std::min(line(high[2], 2) + 1, field.size[2] - 1); ++k) {
      for (int j = std::max(line(low[1], 1), 0); j <= std::min(line(high[1], 1) + 1, field.size[1] - 1);
           ++j) {
        const double y = field.origin[1] + j * field.spacing_m + shift_y;
        const double z = field.origin[2] + k * field.spacing_m + shift_z;
        const auto area = [&](const Vec3& p, const Vec3& q) {
          return (q[1] - p[1]) * (z - p[2]) - (q[2] - p[2]) * (y - p[1]);
        };
        const double wc = area(t.a, t.b), wa = area(t.b, t.c), wb = area(t.c, t.a);
        const bool inside = (wa > 0 && wb > 0 && wc > 0) || (wa < 0 && wb < 0 && wc < 0);
        if (!inside) continue;
        crossings[static_cast<std::size_t>(k * field.size[1] + j)].push_back(
            (wa * t.a[0] + wb * t.b[0] + wc * t.c[0]) / (wa + wb + wc));
      }
    }
  }
  for (int k = 0; k < field.size[2]; ++k) {
    for (int j = 0; j < field.size[1]; ++j) {
      auto& line = crossings[static_cast<std::size_t>(k * field.size[1] + j)];
      std::sort(line.begin(), line.end());
      std::size_t passed = 0;
      for (int i = 0; i < field.size[0]; ++i) {
        while (passed < line.size() && line[passed] <= field.origin[0] + i * field.spacing_m) ++passed;
        const std::size_t at = nearest.index(i, j, k);
        const double distance = std::sqrt(nearest.squared[at]);
        field.distance_m[at] = static_cast<float>(passed % 2 ? -distance : distance);
      }
    }
  }
}

}  // namespace

double distance_spacing(const ToolSurface& surface) {
  const Box box = bounding_box(surface);
  const Vec3 extent = box.high - box.low;
  return std::max(std::min(extent.minCoeff() / 6, extent.maxCoeff() / 60), extent.maxCoeff() / 200);
}

RigidDistance build_rigid_distance(const ToolSurface& surface, double spacing_m) {
  if (surface.vertices.empty() || surface.triangles.empty()) {
    throw InputError("tool: its surface has no triangles; contact by surface nodes needs a closed surface");
  }
  const Box box = bounding_box(surface);
  RigidDistance field;
  field.spacing_m = spacing_m;
  double values = 0;
  do {
    values = 1;
    for (int a = 0; a < 3; ++a) {
      const double count = std::ceil((box.high[a] - box.low[a]) / field.spacing_m) + 5;
      field.size[static_cast<std::size_t>(a)] = static_cast<int>(std::min(count, 1e6));
      values *= count;
    }
    if (values > 1e6) field.spacing_m *= 1.25;
  } while (values > 1e6);
  for (int a = 0; a < 3; ++a) {  // the tool in the middle of the grid
    field.origin[a] = 0.5 * (box.low[a] + box.high[a]) -
                      0.5 * (field.size[static_cast<std::size_t>(a)] - 1) * field.spacing_m;
  }
  const auto count = static_cast<std::size_t>(field.size[0]) * static_cast<std::size_t>(field.size[1]) *
                     static_cast<std::size_t>(field.size[2]);
  field.distance_m.assign(count, 0.0F);
  Nearest nearest{field, {}, std::vector<std::int32_t>(count, -1), std::vector<double>(count, 0.0)};
  for (const auto& t : surface.triangles) {
    nearest.triangles.push_back({surface.vertices[static_cast<std::size_t>(t[0])],
                                 surface.vertices[static_cast<std::size_t>(t[1])],
                                 surface.vertices[static_cast<std::size_t>(t[2])]});
  }
  rasterise(nearest);
  sweep(nearest);
  sign(nearest);
  return field;
}

double sample(const RigidDistance& field, const Vec3& body_point, Vec3* gradient) {
  const Vec3 place = (body_point - field.origin) / field.spacing_m;
  int at[3];
  double part[3];
  for (int a = 0; a < 3; ++a) {
    const int last = field.size[static_cast<std::size_t>(a)] - 1;
    if (!(place[a] >= 0 && place[a] <= last)) {
      if (gradient != nullptr) gradient->setZero();
      return field.spacing_m;
    }
    at[a] = std::min(static_cast<int>(place[a]), last - 1);
    part[a] = place[a] - at[a];
  }
  const auto value = [&](int i, int j, int k) {
    return static_cast<double>(field.distance_m[static_cast<std::size_t>(
        ((at[2] + k) * field.size[1] + at[1] + j) * field.size[0] + at[0] + i)]);
  };
  double x[2][2], slope_x[2][2];
  for (int k = 0; k < 2; ++k) {
    for (int j = 0; j < 2; ++j) {
      const double v0 = value(0, j, k), v1 = value(1, j, k);
      x[k][j] = v0 + part[0] * (v1 - v0);
      slope_x[k][j] = v1 - v0;
    }
  }
  const double y0 = x[0][0] + part[1] * (x[0][1] - x[0][0]), y1 = x[1][0] + part[1] * (x[1][1] - x[1][0]);
  if (gradient != nullptr) {
    const double sx0 = slope_x[0][0] + part[1] * (slope_x[0][1] - slope_x[0][0]);
    const double sx1 = slope_x[1][0] + part[1] * (slope_x[1][1] - slope_x[1][0]);
    const double sy0 = x[0][1] - x[0][0], sy1 = x[1][1] - x[1][0];
    *gradient = Vec3(sx0 + part[2] * (sx1 - sx0), sy0 + part[2] * (sy1 - sy0), y1 - y0) / field.spacing_m;
  }
  return y0 + part[2] * (y1 - y0);
}

}  // namespace sulcus
