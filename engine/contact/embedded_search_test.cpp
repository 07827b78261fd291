// The search for tool vertices in the embedded volume against brute force, in superimposed regions too; the
// sides of a closed fissure; and what the thesis' shortcut T_s = T costs.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <map>
#include <random>

#include "engine/contact/embedded.h"
#include "engine/fem/test_meshes.h"
#include "engine/numerics/quaternion.h"

namespace sulcus {
namespace {

// The cylinder of thesis 5.4.1 in small: 38 mm across, 10 mm long, voxels of 1 mm, cells of 6 mm. Segment 1
// is the half with y < 0; 2 and 3 the quarters above and below z = 0, apart by a pair though they touch.
struct Cylinder {
  LabelMap map = box_map(10, 38, 38, 1e-3);
  SeparationPairs pairs = make_separation_pairs({{2, 3}});
  EmbeddingMesh mesh;
  DistanceField distance;
  std::vector<VoxelBox> owned;
  std::vector<double> positions;

  Cylinder() {
    for (int k = 0; k < 38; ++k) {
      for (int j = 0; j < 38; ++j) {
        const double y = j - 18.5, z = k - 18.5;
        const int label = y * y + z * z > 19 * 19 ? 0 : y < 0 ? 1 : z > 0 ? 2 : 3;
        for (int i = 0; i < 10; ++i) map.labels[map.index(i, j, k)] = label;
      }
    }
    EmbeddingOptions options;
    options.size_m = 6e-3;
    mesh = build_embedding(map, pairs, options);
    distance = build_distance_field(map, pairs);
    owned = find_owned_voxels(map, mesh);
    positions = flat_positions(mesh);
  }

  template <class Map>
  void deform(Map&& where) {
    for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
      const Vec3 x = where(mesh.rest_positions[n]);
      for (std::size_t d = 0; d < 3; ++d) positions[3 * n + d] = x[static_cast<Eigen::Index>(d)];
    }
  }

  std::vector<Contact> contacts(std::span<const Vec3> vertices, ContactSearch& search) const {
    std::vector<Contact> found;
    find_embedded_contacts({map, pairs, distance, mesh, owned}, positions, {}, 0, vertices, Mat3::Identity(),
                           Vec3::Zero(), search, found);
    return found;
  }

  // Rest position that an element gives to a world point; false outside of it.
  bool to_rest(std::int32_t tet, const Vec3& p, Vec3& rest, double slack = 1e-9) const {
    const auto& nodes = mesh.tets[static_cast<std::size_t>(tet)];
    Mat3 now, before;
    for (int a = 0; a < 3; ++a) {
      const std::int32_t node = nodes[static_cast<std::size_t>(a + 1)];
      now.col(a) = node_vector(positions, node) - node_vector(positions, nodes[0]);
      before.col(a) = mesh.rest_positions[static_cast<std::size_t>(node)] -
                      mesh.rest_positions[static_cast<std::size_t>(nodes[0])];
    }
    const Vec3 w = now.inverse() * (p - node_vector(positions, nodes[0]));
    rest = mesh.rest_positions[static_cast<std::size_t>(nodes[0])] + before * w;
    return (w.array() >= -slack).all() && w.sum() <= 1 + slack;
  }

  // Of all elements that hold p, the first one whose copy owns the voxel nearest to where it carries p.
  std::int32_t home_of(const Vec3& p, std::size_t& voxel, Vec3& rest) const {
    std::int32_t home = -1;
    double nearest = 1e300;
    for (std::int32_t tet = 0; tet < static_cast<std::int32_t>(mesh.tets.size()); ++tet) {
      Vec3 carried;
      if (!to_rest(tet, p, carried)) continue;
      const Vec3 at = map.to_voxel(carried);
      Index3 middle;
      for (std::size_t a = 0; a < 3; ++a)
        middle[a] = static_cast<int>(std::floor(at[static_cast<Eigen::Index>(a)] + 0.5));
      for (int k = std::max(middle[2] - 1, 0); k <= std::min(middle[2] + 1, map.size[2] - 1); ++k) {
        for (int j = std::max(middle[1] - 1, 0); j <= std::min(middle[1] + 1, map.size[1] - 1); ++j) {
          for (int i = std::max(middle[0] - 1, 0); i <= std::min(middle[0] + 1, map.size[0] - 1); ++i) {
            const std::size_t index = map.index(i, j, k);
            const double away = (Vec3(i, j, k) - at).squaredNorm();
            if (mesh.cell_of_voxel[index] != tet / mesh.tets_per_cell || !(away < nearest)) continue;
            nearest = away;
            home = tet;
            voxel = index;
            rest = carried;
          }
        }
      }
    }
    return home;
  }
};

Vec3 random_point(std::mt19937_64& random, double margin_m) {
  return {uniform(random, -margin_m, 0.01 + margin_m), uniform(random, -margin_m, 0.038 + margin_m),
          uniform(random, -margin_m, 0.038 + margin_m)};
}

// All points of one call share a grid over their box. In a brick of 3 mm, half a cell, that grid has one
// cell: each of its points is held against all elements whose boxes meet the brick.
TEST(EmbeddedSearch, GridFindsWhatBruteForceFindsForAMillionPoints) {
  const std::uint64_t seed = 41;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Cylinder body;
  // the fissure opens by half a millimetre and the body bends: copies overlap
  body.deform([](const Vec3& x) {
    const double bend = 0.15 * (x[1] - 0.019) / 0.019;
    return Vec3(x[0] + 0.002 * bend, x[1], x[2] + 0.003 * bend * bend);
  });
  for (double& x : body.positions) x += uniform(random, -0.0006, 0.0006);
  std::vector<Vec3> points(1000000);
  std::map<std::array<int, 3>, std::vector<std::size_t>> bricks;
  for (std::size_t p = 0; p < points.size(); ++p) {
    points[p] = random_point(random, 0.002);
    std::array<int, 3> brick;
    for (std::size_t a = 0; a < 3; ++a)
      brick[a] = static_cast<int>(std::floor(points[p][static_cast<Eigen::Index>(a)] / 0.003));
    bricks[brick].push_back(p);
  }
  ContactSearch search;
  const std::vector<Contact> together = body.contacts(points, search);
  EXPECT_GT(together.size(), points.size() * 2 / 5);  // tissue fills 46 % of the box
  std::vector<const Contact*> by_grid(points.size(), nullptr);
  for (const Contact& contact : together) by_grid[static_cast<std::size_t>(contact.vertex)] = &contact;
  std::size_t found = 0;
  for (const auto& [brick, members] : bricks) {
    std::vector<Vec3> near;
    for (const std::size_t p : members) near.push_back(points[p]);
    const std::vector<Contact> brute = body.contacts(near, search);
    found += brute.size();
    for (const Contact& contact : brute) {
      const std::size_t p = members[static_cast<std::size_t>(contact.vertex)];
      ASSERT_NE(by_grid[p], nullptr) << p;
      EXPECT_EQ(by_grid[p]->tet, contact.tet) << p;
      EXPECT_EQ(by_grid[p]->depth_m, contact.depth_m) << p;
      EXPECT_EQ(by_grid[p]->weights, contact.weights) << p;
    }
  }
  EXPECT_EQ(found, together.size());
}

TEST(EmbeddedSearch, HomeIsThatOfAPlainLoopOverAllElements) {
  const std::uint64_t seed = 42;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Cylinder body;
  for (double& x : body.positions) x += uniform(random, -0.0008, 0.0008);
  std::vector<Vec3> points(3000);
  for (Vec3& p : points) p = random_point(random, 0.001);
  ContactSearch search;
  const std::vector<Contact> contacts = body.contacts(points, search);
  std::size_t next = 0, compared = 0;
  for (std::size_t p = 0; p < points.size(); ++p) {
    std::size_t voxel = 0;
    Vec3 rest;
    const bool found = next < contacts.size() && contacts[next].vertex == static_cast<std::int32_t>(p);
    if (body.home_of(points[p], voxel, rest) < 0) {
      EXPECT_FALSE(found) << p;
    } else {
      const DistanceSample sample =
          sample_distance(body.map, body.pairs, body.distance, body.map.to_voxel(rest), voxel);
      // no point within the tissue is lost
      EXPECT_EQ(found, sample.distance < 0) << p;
      if (found && sample.gradient.norm() > 1e-6) {
        EXPECT_NEAR(contacts[next].depth_m, -sample.distance, 1e-9) << p;
        ++compared;
      }
    }
    next += found;
  }
  EXPECT_EQ(next, contacts.size());
  EXPECT_GT(compared, 1000U);
}

// The body turns and stretches as a whole with its fissure closed, so that both copies lie on each other: the
// label of the voxel that was there tells the right side.
TEST(EmbeddedSearch, APointInAClosedFissureBelongsToTheRightSide) {
  const std::uint64_t seed = 43;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (int trial = 0; trial < 6; ++trial) {
    Cylinder body;
    Mat3 f = rotation_matrix(quaternion_from_rotation_vector(
        Vec3(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1))));
    for (int i = 0; i < 9; ++i) f(i / 3, i % 3) += trial == 0 ? 0 : uniform(random, -0.15, 0.15);
    body.deform([&](const Vec3& x) { return Vec3(f * x); });
    std::vector<Vec3> points;
    std::vector<int> labels;
    while (points.size() < 4000) {  // within 1.5 mm of the fissure, on either side
      // beyond the cells in which segment 1 joins both sides, and nearer to the fissure than to other faces
      const Vec3 rest(uniform(random, 0.003, 0.007), uniform(random, 0.0245, 0.034),
                      0.019 + uniform(random, -0.0015, 0.0015));
      if (std::fabs(rest[2] - 0.019) < 1e-6) continue;
      points.push_back(f * rest);
      labels.push_back(rest[2] > 0.019 ? 2 : 3);
    }
    ContactSearch search;
    const std::vector<Contact> contacts = body.contacts(points, search);
    EXPECT_GT(contacts.size(), points.size() * 95 / 100);
    for (const Contact& contact : contacts) {
      const int label = labels[static_cast<std::size_t>(contact.vertex)];
      const auto cell = static_cast<std::size_t>(contact.tet / body.mesh.tets_per_cell);
      const int own = body.mesh.cell_label[cell];
      // a cell of a quarter may be called 1 where it holds more of the half
      ASSERT_TRUE(own == label || own == 1) << label << " " << own;
      // out of the tissue is towards the fissure
      const Vec3 out = f.inverse().transpose() * Vec3(0, 0, label == 2 ? -1 : 1);
      if (contact.depth_m < 0.001) {
        EXPECT_GT(contact.normal.dot(out.normalized()), 0.7);
      }
    }
  }
}

// The thesis takes the element of the projected point as that of the vertex. How often that is wrong, and how
// far off the surface point then is, over vertices within 3 mm of the surface of a body that is deformed
// unevenly.
TEST(EmbeddedSearch, ProjectedPointHasItsOwnElement) {
  const std::uint64_t seed = 44;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Cylinder body;
  for (double& x : body.positions) x += uniform(random, -0.0008, 0.0008);
  std::vector<Vec3> points(6000);
  for (Vec3& p : points) p = random_point(random, 0.001);
  ContactSearch search;
  int others = 0, outside = 0, all = 0;
  double sum = 0, worst = 0, furthest = 0;
  for (const Contact& contact : body.contacts(points, search)) {
    if (contact.depth_m > 0.003) continue;
    const Vec3& p = points[static_cast<std::size_t>(contact.vertex)];
    std::size_t voxel = 0;
    Vec3 rest;
    const std::int32_t home = body.home_of(p, voxel, rest);
    if (home < 0) continue;
    ++all;
    // where T_s puts the surface point at rest, and where T would put that point now
    Vec3 surface_rest = Vec3::Zero(), surface = Vec3::Zero();
    for (std::size_t c = 0; c < 4; ++c) {
      const std::int32_t node = body.mesh.tets[static_cast<std::size_t>(contact.tet)][c];
      surface_rest += contact.weights[c] * body.mesh.rest_positions[static_cast<std::size_t>(node)];
      surface += contact.weights[c] * node_vector(body.positions, node);
    }
    double least = 0;
    for (const double w : contact.weights) least = std::fmin(least, w);
    outside += least < -1e-6;
    furthest = std::fmin(furthest, least);
    if (home == contact.tet) continue;
    ++others;
    const auto& nodes = body.mesh.tets[static_cast<std::size_t>(home)];
    Mat3 now, before;
    for (int a = 0; a < 3; ++a) {
      const std::int32_t node = nodes[static_cast<std::size_t>(a + 1)];
      now.col(a) = node_vector(body.positions, node) - node_vector(body.positions, nodes[0]);
      before.col(a) = body.mesh.rest_positions[static_cast<std::size_t>(node)] -
                      body.mesh.rest_positions[static_cast<std::size_t>(nodes[0])];
    }
    const Vec3 by_home =
        node_vector(body.positions, nodes[0]) +
        now * (before.inverse() *
               (surface_rest - body.mesh.rest_positions[static_cast<std::size_t>(nodes[0])]));
    const double off = (by_home - surface).norm();
    sum += off;
    worst = std::fmax(worst, off);
  }
  ASSERT_GT(all, 1000);
  std::printf(
      "T_s is another element than T for %.1f %% of %d vertices; T would put the surface point %.3f mm off "
      "in "
      "the mean, %.3f mm at worst; %.1f %% of the surface points lie a little outside of every element of "
      "their "
      "copy (smallest weight %.3f)\n",
      100.0 * others / all, all, 1e3 * sum / std::max(others, 1), 1e3 * worst, 100.0 * outside / all,
      furthest);
  EXPECT_GT(others, all / 20);
  // The surface of the smoothed distance runs beside the faces of the voxels, so a surface point may lie
  // beyond the cell that owns the voxel a quarter of a voxel further in, by that quarter: a weight of it in a
  // corner of a cell of 6 voxels, whose height is 6 / sqrt(3).
  EXPECT_GT(furthest, -0.25 * std::sqrt(3.0) / 6);
}

// A sheet of any thickness, also where the two voxels in its middle are equally deep.
TEST(EmbeddedSearch, AThinSheetIsTouchedInAllOfItAndPushedOutTheNearerWay) {
  const std::uint64_t seed = 45;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (const int thickness : {2, 3, 4, 5, 6}) {  // smoothing thins a sheet of one
    SCOPED_TRACE(thickness);
    LabelMap map = box_map(24, 24, 12, 1e-3);
    for (std::size_t v = 0; v < map.labels.size(); ++v) {
      const int k = static_cast<int>(v / (24 * 24));
      if (k < 4 || k >= 4 + thickness) map.labels[v] = 0;
    }
    EmbeddingOptions options;
    options.size_m = 6e-3;
    const EmbeddingMesh mesh = build_embedding(map, {}, options);
    const DistanceField distance = build_distance_field(map, {});
    const std::vector<VoxelBox> owned = find_owned_voxels(map, mesh);
    std::vector<Vec3> points;
    for (int p = 0; p < 2000; ++p) {
      points.push_back(map.to_world(Vec3(uniform(random, 8, 16), uniform(random, 8, 16),
                                         3.5 + uniform(random, 0.02, 0.98) * thickness)));
    }
    ContactSearch search;
    std::vector<Contact> found;
    const SeparationPairs none;
    find_embedded_contacts({map, none, distance, mesh, owned}, flat_positions(mesh), {}, 0, points,
                           Mat3::Identity(), Vec3::Zero(), search, found);
    EXPECT_EQ(found.size(), points.size());
    for (const Contact& contact : found) {
      const double below = map.to_voxel(points[static_cast<std::size_t>(contact.vertex)])[2] - 3.5;  // voxels
      const double above = thickness - below;
      EXPECT_NEAR(1e3 * contact.depth_m, std::fmin(below, above), 0.1) << below;  // smoothing: 0.03 voxel
      if (std::fabs(below - above) > 0.02) {
        EXPECT_NEAR(contact.normal[2], below < above ? -1 : 1, 1e-3) << below;
      }
    }
  }
}

}  // namespace
}  // namespace sulcus
