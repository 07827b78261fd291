// Contacts inside an embedded volume whose answers are known.
#include <gtest/gtest.h>

#include <random>

#include "engine/contact/embedded.h"
#include "engine/fem/test_meshes.h"

namespace sulcus {
namespace {

// A block of 24 x 24 x 24 voxels of 1 mm, cells of 6 mm; above z = 12 mm another label, as a choice cut off
// by a pair.
struct Block {
  LabelMap map;
  SeparationPairs pairs;
  EmbeddingMesh mesh;
  DistanceField distance;
  std::vector<VoxelBox> owned;
  std::vector<double> positions;

  explicit Block(bool cut) {
    map = box_map(24, 24, 24, 1e-3);
    for (int k = 12; k < 24; ++k) {
      for (int j = 0; j < 24; ++j) {
        for (int i = 0; i < 24; ++i) map.labels[map.index(i, j, k)] = 2;
      }
    }
    if (cut) pairs = make_separation_pairs({{1, 2}});
    EmbeddingOptions options;
    options.size_m = 5e-3;  // cells of 5 voxels: the cut runs through the middle of cells
    mesh = build_embedding(map, pairs, options);
    distance = build_distance_field(map, pairs);
    owned = find_owned_voxels(map, mesh);
    positions = flat_positions(mesh);
  }

  std::vector<Contact> contacts(const std::vector<Vec3>& vertices) const {
    ContactSearch search;
    std::vector<Contact> found;
    find_embedded_contacts({map, pairs, distance, mesh, owned}, positions, {}, 0, vertices, Mat3::Identity(),
                           Vec3::Zero(), search, found);
    return found;
  }
};

TEST(EmbeddedContact, PointOutsideTouchesNothing) {
  const Block block(false);
  EXPECT_TRUE(block.contacts({{0.012, 0.012, 0.025}, {-0.001, 0.01, 0.01}, {0.1, 0.1, 0.1}}).empty());
}

TEST(EmbeddedContact, PointInsideIsProjectedToTheNearestFace) {
  const Block block(false);
  const auto contacts = block.contacts({{0.012, 0.012, 0.0225}, {0.0015, 0.012, 0.012}});
  ASSERT_EQ(contacts.size(), 2u);
  EXPECT_NEAR(contacts[0].depth_m, 0.0015, 1e-6);
  EXPECT_LT((contacts[0].normal - Vec3(0, 0, 1)).norm(), 1e-6);
  EXPECT_LT((contacts[0].gap - Vec3(0, 0, -0.0015)).norm(), 1e-6);
  EXPECT_NEAR(contacts[1].depth_m, 0.0015, 1e-6);
  EXPECT_LT((contacts[1].normal - Vec3(-1, 0, 0)).norm(), 1e-6);
}

TEST(EmbeddedContact, AClosedFissurePushesEachSideItsOwnWay) {
  const Block block(true);
  const auto contacts = block.contacts({{0.0118, 0.0122, 0.0112}, {0.0118, 0.0122, 0.0128}});
  ASSERT_EQ(contacts.size(), 2u);
  EXPECT_LT((contacts[0].normal - Vec3(0, 0, 1)).norm(), 1e-6);   // below the cut: the surface is above
  EXPECT_LT((contacts[1].normal - Vec3(0, 0, -1)).norm(), 1e-6);  // above the cut: the surface is below
  EXPECT_NEAR(contacts[0].depth_m, 0.0008, 1e-6);
  EXPECT_NEAR(contacts[1].depth_m, 0.0008, 1e-6);
  // and each is carried by a tetrahedron of its own copy
  EXPECT_EQ(block.mesh.cell_label[static_cast<std::size_t>(contacts[0].tet / block.mesh.tets_per_cell)], 1);
  EXPECT_EQ(block.mesh.cell_label[static_cast<std::size_t>(contacts[1].tet / block.mesh.tets_per_cell)], 2);
}

TEST(EmbeddedContact, AnOpenedFissureIsEmpty) {
  Block block(true);
  // lift the upper half by 4 mm
  std::vector<bool> upper(block.mesh.rest_positions.size(), false);
  for (std::size_t c = 0; c < block.mesh.cell_nodes.size(); ++c) {
    if (block.mesh.cell_label[c] != 2) continue;
    for (std::int32_t node : block.mesh.cell_nodes[c]) upper[static_cast<std::size_t>(node)] = true;
  }
  for (std::size_t n = 0; n < upper.size(); ++n) block.positions[3 * n + 2] += upper[n] ? 0.004 : 0;
  EXPECT_TRUE(block.contacts({{0.0118, 0.0122, 0.014}}).empty());
  const auto contacts = block.contacts({{0.0118, 0.0122, 0.0112}, {0.0118, 0.0122, 0.0172}});
  ASSERT_EQ(contacts.size(), 2u);
  EXPECT_GT(contacts[0].normal[2], 0.999);
  EXPECT_LT(contacts[1].normal[2], -0.999);
}

TEST(EmbeddedContact, SurfacePointAndGapMeetAtTheVertex) {
  const std::uint64_t seed = 21;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Block block(true);
  for (double& x : block.positions) x += uniform(random, -0.0005, 0.0005);
  std::vector<Vec3> vertices;
  for (int i = 0; i < 3000; ++i) {
    vertices.emplace_back(uniform(random, -0.002, 0.026), uniform(random, -0.002, 0.026),
                          uniform(random, -0.002, 0.026));
  }
  const auto contacts = block.contacts(vertices);
  EXPECT_GT(contacts.size(), 1500u);
  for (const Contact& contact : contacts) {
    Vec3 surface = Vec3::Zero();
    double sum = 0;
    for (std::size_t c = 0; c < 4; ++c) {
      const auto n = static_cast<std::size_t>(block.mesh.tets[static_cast<std::size_t>(contact.tet)][c]);
      surface += contact.weights[c] *
                 Vec3(block.positions[3 * n], block.positions[3 * n + 1], block.positions[3 * n + 2]);
      sum += contact.weights[c];
    }
    EXPECT_NEAR(sum, 1, 1e-12);
    EXPECT_LT((surface + contact.gap - vertices[static_cast<std::size_t>(contact.vertex)]).norm(), 1e-15);
    EXPECT_NEAR(contact.normal.norm(), 1, 1e-12);
    EXPECT_LT(contact.gap.dot(contact.normal), 0);
    EXPECT_GT(contact.depth_m, 0);
  }
}

TEST(EmbeddedContact, NotANumberTouchesNothing) {
  const Block block(false);
  EXPECT_TRUE(block.contacts({{0.012, 0.012, 0.012}, {NAN, 0, 0}}).empty());
}

}  // namespace
}  // namespace sulcus
