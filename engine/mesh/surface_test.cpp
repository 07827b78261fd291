#include "engine/mesh/surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

LabelMap ball(int size, double radius) {
  LabelMap map = empty_map({size, size, size});
  const double middle = 0.5 * (size - 1);
  for (int k = 0; k < size; ++k) {
    for (int j = 0; j < size; ++j) {
      for (int i = 0; i < size; ++i) {
        const double square =
            (i - middle) * (i - middle) + (j - middle) * (j - middle) + (k - middle) * (k - middle);
        map.labels[map.index(i, j, k)] = square < radius * radius ? (i < middle ? 1 : 2) : 0;
      }
    }
  }
  return map;
}

double enclosed_volume(const EmbeddedSurface& surface) {
  double sum = 0;
  for (const auto& [a, b, c] : surface.triangles) {
    const Vec3 &p = surface.rest_positions[a], &q = surface.rest_positions[b], &r = surface.rest_positions[c];
    sum += p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0]) +
           p[2] * (q[0] * r[1] - q[1] * r[0]);
  }
  return sum / 6;
}

// Every directed edge has its opposite equally often: the surface has no border.
bool is_closed(const EmbeddedSurface& surface) {
  std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
  for (const auto& t : surface.triangles) {
    for (int e = 0; e < 3; ++e) {
      ++edges[{t[e], t[(e + 1) % 3]}];
      --edges[{t[(e + 1) % 3], t[e]}];
    }
  }
  for (const auto& [edge, balance] : edges) {
    if (balance != 0) return false;
  }
  return true;
}

TEST(EmbeddedSurface, IsClosedAndEnclosesTheVoxelsIfBlocky) {
  Random random(5);
  for (int trial = 0; trial < 100; ++trial) {
    LabelMap map = random_map(random, {7, 6, 5}, 3);
    map.labels[0] = 1;
    if (trial % 2) map.direction(0, 0) = -1;
    const SeparationPairs pairs = random_pairs(random, 3);
    const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 3e-3});
    const EmbeddedSurface surface = build_embedded_surface(map, pairs, mesh, 0);
    EXPECT_TRUE(is_closed(surface));
    double volume = 0;
    for (const std::int32_t label : map.labels) volume += label != 0 ? 1e-9 : 0;
    EXPECT_NEAR(enclosed_volume(surface), volume, 1e-15);
  }
}

TEST(EmbeddedSurface, HasTwoBanksWherePairsTouch) {
  const LabelMap map = ball(24, 10);
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 5e-3});
  const EmbeddedSurface surface = build_embedded_surface(map, pairs, mesh, 0);
  int bank[3] = {0, 0, 0};
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    if (surface.triangle_on_pair[t]) ++bank[surface.triangle_label[t]];
  }
  EXPECT_GT(bank[1], 500);
  EXPECT_EQ(bank[1], bank[2]);
  // No triangle mixes the two banks: each side's vertices ride on cells of its own label.
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    for (const std::int32_t v : surface.triangles[t]) {
      EXPECT_EQ(mesh.cell_label[surface.tet[v] / mesh.tets_per_cell], surface.triangle_label[t]);
    }
  }
}

TEST(EmbeddedSurface, OfABallIsSmoothAndWithinHalfAVoxel) {
  const LabelMap map = ball(48, 20);
  const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = 6e-3});
  const EmbeddedSurface blocky = build_embedded_surface(map, {}, mesh, 0);
  const EmbeddedSurface surface = build_embedded_surface(map, {}, mesh, 15);
  double error = 0, blocky_error = 0;
  for (std::size_t v = 0; v < surface.rest_positions.size(); ++v) {
    const auto radius = [](const Vec3& p) {
      return std::sqrt((p[0] - 23.5e-3) * (p[0] - 23.5e-3) + (p[1] - 23.5e-3) * (p[1] - 23.5e-3) +
                       (p[2] - 23.5e-3) * (p[2] - 23.5e-3));
    };
    error += std::abs(radius(surface.rest_positions[v]) - 20e-3);
    blocky_error += std::abs(radius(blocky.rest_positions[v]) - 20e-3);
    for (int a = 0; a < 3; ++a) {
      EXPECT_LE(std::abs(surface.rest_positions[v][a] - blocky.rest_positions[v][a]), 0.5e-3 * (1 + 1e-9));
    }
  }
  EXPECT_LT(error, 0.5 * blocky_error);
  EXPECT_TRUE(is_closed(surface));
}

TEST(EmbeddedSurface, FollowsTheNodes) {
  const LabelMap map = ball(24, 10);
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const EmbeddingMesh mesh = build_embedding(map, pairs, {.size_m = 5e-3});
  const EmbeddedSurface surface = build_embedded_surface(map, pairs, mesh, 10);
  std::vector<double> nodes, moved;
  for (const Vec3& p : mesh.rest_positions) {
    nodes.insert(nodes.end(), {p[0], p[1], p[2]});
    moved.insert(moved.end(), {2 * p[0] + p[1] + 0.1, p[1] - p[2], 3 * p[2]});
  }
  const std::vector<double> rest = deform_surface(surface, mesh, nodes),
                            after = deform_surface(surface, mesh, moved);
  for (std::size_t v = 0; v < surface.rest_positions.size(); ++v) {
    const Vec3& p = surface.rest_positions[v];
    const double expected[3] = {2 * p[0] + p[1] + 0.1, p[1] - p[2], 3 * p[2]};
    for (int a = 0; a < 3; ++a) {
      EXPECT_NEAR(rest[3 * v + a], p[a], 1e-8);  // single-precision weights
      EXPECT_NEAR(after[3 * v + a], expected[a], 1e-7);
    }
  }
}

}  // namespace
}  // namespace sulcus
