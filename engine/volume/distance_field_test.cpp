#include "engine/volume/distance_field.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>

#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

// Whether the face between voxel `at` and its neighbour at +1 along `axis` is a boundary; `at` may lie
// outside.
bool is_boundary(const LabelMap& map, const SeparationPairs& pairs, Index3 at, int axis) {
  const auto label = [&](const Index3& v) {
    for (int a = 0; a < 3; ++a) {
      if (v[a] < 0 || v[a] >= map.size[a]) return 0;
    }
    return static_cast<int>(map.labels[map.index(v[0], v[1], v[2])]);
  };
  const int here = label(at);
  ++at[axis];
  const int there = label(at);
  return (here != 0 || there != 0) && !pairs.connected(here, there);
}

// Distance from every voxel centre to every boundary face in turn.
std::vector<double> brute_force(const LabelMap& map, const SeparationPairs& pairs) {
  std::vector<double> nearest(map.voxel_count(), 1e30);
  for (int axis = 0; axis < 3; ++axis) {
    Index3 at;
    for (at[2] = -1; at[2] < map.size[2]; ++at[2]) {
      for (at[1] = -1; at[1] < map.size[1]; ++at[1]) {
        for (at[0] = -1; at[0] < map.size[0]; ++at[0]) {
          bool real = true;  // outside the image only along the axis itself
          for (int a = 0; a < 3; ++a) real &= a == axis || at[a] >= 0;
          if (!real || !is_boundary(map, pairs, at, axis)) continue;
          Index3 v;
          for (v[2] = 0; v[2] < map.size[2]; ++v[2]) {
            for (v[1] = 0; v[1] < map.size[1]; ++v[1]) {
              for (v[0] = 0; v[0] < map.size[0]; ++v[0]) {
                double square = 0;
                for (int a = 0; a < 3; ++a) {
                  const double offset =
                      a == axis ? std::abs(v[a] - at[a] - 0.5) : std::max(std::abs(v[a] - at[a]) - 0.5, 0.0);
                  square += offset * offset * map.spacing[a] * map.spacing[a];
                }
                double& best = nearest[map.index(v[0], v[1], v[2])];
                best = std::min(best, std::sqrt(square));
              }
            }
          }
        }
      }
    }
  }
  return nearest;
}

TEST(DistanceField, EqualsBruteForceOverAllFaces) {
  const std::uint64_t seed = 20240611;
  SCOPED_TRACE(seed);
  Random random(seed);
  for (int trial = 0; trial < 300; ++trial) {
    const Index3 size{1 + random_below(random, 12), 1 + random_below(random, 12),
                      1 + random_below(random, 12)};
    LabelMap map = random_map(random, size, 3);
    map.labels[random() % map.labels.size()] = 1;
    map.spacing = {1e-3 * (1 + random_below(random, 3)), 0.7e-3 * (1 + random_below(random, 3)), 1.3e-3};
    const SeparationPairs pairs = random_pairs(random, 3);
    const DistanceField field = build_distance_field(map, pairs, DistanceKind::voxel_faces);
    const std::vector<double> expected = brute_force(map, pairs);
    for (std::size_t v = 0; v < expected.size(); ++v) {
      ASSERT_NEAR(field.distance[v], expected[v], 4e-7 * expected[v]) << "trial " << trial << " voxel " << v;
    }
  }
}

TEST(DistanceField, IsExactFarFromAFewVoxelsInALargeImage) {
  Random random(7);
  LabelMap map = empty_map({70, 41, 53});
  for (int n = 0; n < 3; ++n) map.labels[random() % map.labels.size()] = 1 + n;
  const SeparationPairs pairs;
  const DistanceField field = build_distance_field(map, pairs, DistanceKind::voxel_faces);
  const std::vector<double> expected = brute_force(map, pairs);
  for (std::size_t v = 0; v < expected.size(); ++v)
    ASSERT_NEAR(field.distance[v], expected[v], 4e-7 * expected[v]);
}

TEST(DistanceField, IsExactAlongEachLongAxis) {
  const std::uint64_t seed = 20261127;
  SCOPED_TRACE(seed);
  Random random(seed);
  for (int trial = 0; trial < 30; ++trial) {
    Index3 size{1 + random_below(random, 6), 1 + random_below(random, 6), 1 + random_below(random, 6)};
    size[trial % 3] = 60 + random_below(random, 200);
    LabelMap map = empty_map(size);
    map.spacing = {0.9e-3, 1.1e-3, 0.5e-3 * (1 + random_below(random, 3))};
    for (int n = 1 + random_below(random, 20); n > 0; --n)
      map.labels[random() % map.labels.size()] = 1 + random_below(random, 3);
    const SeparationPairs pairs = random_pairs(random, 3);
    const DistanceField field = build_distance_field(map, pairs, DistanceKind::voxel_faces);
    const std::vector<double> expected = brute_force(map, pairs);
    for (std::size_t v = 0; v < expected.size(); ++v)
      ASSERT_NEAR(field.distance[v], expected[v], 4e-7 * expected[v]) << "trial " << trial << " voxel " << v;
  }
}

TEST(DistanceField, OfAnEmptyMapIsTheDistanceToTheBorder) {
  const LabelMap map = empty_map({5, 4, 3});
  const DistanceField field = build_distance_field(map, {});
  EXPECT_FLOAT_EQ(field.distance[map.index(0, 0, 0)], 0.5e-3F);
  EXPECT_FLOAT_EQ(field.distance[map.index(2, 1, 1)], 1.5e-3F);
}

TEST(DistanceField, IsTheSameForAnyThreadCount) {
  Random random(11);
  const LabelMap map = random_map(random, {40, 33, 21}, 4);
  const SeparationPairs pairs = make_separation_pairs({{1, 2}, {3, 4}});
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const DistanceField one = build_distance_field(map, pairs);
  for (const int count : {2, 3, 5}) {
    omp_set_num_threads(count);
    EXPECT_EQ(build_distance_field(map, pairs).distance, one.distance) << count << " threads";
  }
  omp_set_num_threads(threads);
}

// Two blocks of labels 1 and 2 that touch in the plane i = 9.5.
LabelMap two_blocks() {
  LabelMap map = empty_map({20, 15, 15});
  for (int k = 2; k < 13; ++k) {
    for (int j = 2; j < 13; ++j) {
      for (int i = 2; i < 18; ++i) map.labels[map.index(i, j, k)] = i < 10 ? 1 : 2;
    }
  }
  return map;
}

TEST(DistanceSample, IsLinearAcrossAClosedFissureSeenFromEitherSide) {
  const LabelMap map = two_blocks();
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const DistanceField field = build_distance_field(map, pairs);
  const std::size_t left = map.index(9, 7, 7), right = map.index(10, 7, 7);
  for (double i = 8; i <= 11; i += 0.125) {
    const DistanceSample from_left = sample_distance(map, pairs, field, {i, 7, 7}, left);
    EXPECT_NEAR(from_left.distance, (i - 9.5) * 1e-3, 1e-9) << i;
    EXPECT_NEAR(from_left.gradient[0], 1, 1e-5) << i;
    const DistanceSample from_right = sample_distance(map, pairs, field, {i, 7, 7}, right);
    EXPECT_NEAR(from_right.distance, (9.5 - i) * 1e-3, 1e-9) << i;
    EXPECT_NEAR(from_right.gradient[0], -1, 1e-5) << i;
  }
}

TEST(DistanceSample, GradientTurnsWithTheDirectionMatrix) {
  LabelMap map = two_blocks();
  map.direction << 0, 1, 0, 0, 0, -1, -1, 0, 0;
  const DistanceField field = build_distance_field(map, {});
  const DistanceSample sample = sample_distance(map, {}, field, {2.2, 7, 7}, map.index(2, 7, 7));
  EXPECT_NEAR(sample.distance, -0.7e-3, 1e-9);
  EXPECT_NEAR(sample.gradient[2], 1, 1e-5);  // outward is -i, and -i is +z
}

TEST(DistanceSample, IsPositiveAndGrowsBeyondTheImage) {
  LabelMap map = empty_map({3, 3, 3});
  for (auto& label : map.labels) label = 1;
  const DistanceField field = build_distance_field(map, {});
  for (const double beyond : {0.75, 1.0, 2.5}) {
    const DistanceSample sample = sample_distance(map, {}, field, {2.5 + beyond, 1, 1}, map.index(2, 1, 1));
    EXPECT_NEAR(sample.distance, beyond * 1e-3, 1e-9);
    EXPECT_NEAR(sample.gradient[0], 1, 1e-5);
  }
}

TEST(DistanceSample, GradientIsTheDerivativeOfTheDistance) {
  Random random(3);
  const LabelMap map = random_map(random, {9, 9, 9}, 3);
  const SeparationPairs pairs = make_separation_pairs({{1, 2}});
  const DistanceField field = build_distance_field(map, pairs);
  int checked = 0;
  for (int n = 0; n < 4000; ++n) {
    Vec3 point;
    for (int a = 0; a < 3; ++a)
      point[a] = random_below(random, 7) + 0.25 + 0.0005 * random_below(random, 1000);
    const std::size_t home =
        map.index(static_cast<int>(point[0]), static_cast<int>(point[1]), static_cast<int>(point[2]));
    if (map.labels[home] == 0) continue;
    ++checked;
    const DistanceSample sample = sample_distance(map, pairs, field, point, home);
    for (int a = 0; a < 3; ++a) {
      Vec3 low = point, high = point;
      low[a] -= 1e-4;
      high[a] += 1e-4;
      const double slope = (sample_distance(map, pairs, field, high, home).distance -
                            sample_distance(map, pairs, field, low, home).distance) /
                           2e-7;
      EXPECT_NEAR(sample.gradient[a], slope, 1e-6);
    }
  }
  EXPECT_GT(checked, 500);
}

}  // namespace
}  // namespace sulcus
