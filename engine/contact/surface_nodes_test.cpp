#include "engine/contact/surface_nodes.h"

#include <gtest/gtest.h>

#include "engine/contact/test_tools.h"
#include "engine/fem/test_meshes.h"

namespace sulcus {
namespace {

// A block of 6 x 6 x 6 cells of 10 mm, its corner at the origin.
struct Block {
  EmbeddingMesh mesh = box_mesh(6, 6, 6, 0.01);
  NodeStars around = build_node_stars(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
  FaceNeighbours faces = face_neighbours(mesh.tets);
  std::vector<double> positions = flat_positions(mesh);
  std::vector<std::uint8_t> alive = std::vector<std::uint8_t>(mesh.tets.size(), 1);

  BoundaryMesh view() const { return {mesh.tets, faces, around.start, around.incident}; }

  std::vector<Contact> contacts(const ToolSurface& tool, const Vec3& at, const Quaternion& turn = {}) const {
    std::vector<std::uint8_t> boundary(mesh.rest_positions.size());
    for (std::size_t n = 0; n < boundary.size(); ++n)
      boundary[n] = on_boundary(view(), alive, static_cast<std::int32_t>(n));
    std::vector<Contact> found;
    RigidBodyState pose;
    pose.position = at;
    pose.orientation = turn;
    find_node_contacts(view(), alive, boundary, positions, build_rigid_distance(tool, distance_spacing(tool)),
                       pose, 3, found);
    return found;
  }
};

TEST(Boundary, OfABlockIsItsOuterNodes) {
  const Block block;
  for (std::size_t n = 0; n < block.mesh.rest_positions.size(); ++n) {
    const Vec3& x = block.mesh.rest_positions[n];
    const bool outer = (x.array() < 1e-9).any() || (x.array() > 0.06 - 1e-9).any();
    EXPECT_EQ(on_boundary(block.view(), {}, static_cast<std::int32_t>(n)), outer);
  }
}

TEST(Boundary, FollowsRemovedElements) {
  Block block;
  std::int32_t middle = -1;  // node at the block's middle
  for (std::size_t n = 0; n < block.mesh.rest_positions.size(); ++n) {
    if ((block.mesh.rest_positions[n] - Vec3::Constant(0.03)).norm() < 1e-9)
      middle = static_cast<std::int32_t>(n);
  }
  ASSERT_GE(middle, 0);
  EXPECT_FALSE(on_boundary(block.view(), block.alive, middle));
  const auto first = static_cast<std::size_t>(block.around.start[static_cast<std::size_t>(middle)]);
  block.alive[static_cast<std::size_t>(block.around.incident[first] / 4)] = 0;
  EXPECT_TRUE(on_boundary(block.view(), block.alive, middle));
  std::fill(block.alive.begin(), block.alive.end(), std::uint8_t{0});
  EXPECT_FALSE(on_boundary(block.view(), block.alive, middle));  // nothing is left to have a boundary
}

TEST(NodeContact, ABallOnTheTopPressesNodesDown) {
  const Block block;
  const double radius = 0.03;
  const Vec3 centre(0.03, 0.03, 0.06 + radius - 0.002);
  const auto contacts = block.contacts(sphere_tool(radius), centre);
  ASSERT_EQ(contacts.size(), 5U);  // the node below the centre and its four neighbours
  for (const Contact& c : contacts) {
    const Vec3& x = block.mesh.rest_positions[static_cast<std::size_t>(c.vertex)];
    const double away = (x - centre).head<2>().norm();
    const double expected = 0.06 - (centre[2] - std::sqrt(radius * radius - away * away));
    EXPECT_EQ(c.tool, 3);
    EXPECT_LT((c.normal - Vec3(0, 0, 1)).norm(), 1e-12);
    EXPECT_NEAR(c.depth_m, expected, 2e-4);
    EXPECT_LT((c.gap + c.depth_m * c.normal).norm(), 1e-12);
    EXPECT_LT((centre + c.arm - (x + c.gap)).norm(), 1e-12);
    for (std::size_t k = 0; k < 4; ++k)
      EXPECT_EQ(c.weights[k], block.mesh.tets[static_cast<std::size_t>(c.tet)][k] == c.vertex ? 1 : 0);
  }
}

TEST(NodeContact, AThinBladePushesNodesBackToTheSideTheyCameFrom) {
  const Block block;
  for (const double sunk :
       {0.0004, 0.0008, 0.0014, 0.0019}) {  // m, past the middle of the 2 mm from the third on
    const auto contacts = block.contacts(box_tool({0.025, 0.045, 0.002}), {0.03, 0.03, 0.06 - sunk + 0.001});
    ASSERT_EQ(contacts.size(), 15U);
    for (const Contact& c : contacts) {
      EXPECT_GT(c.normal[2], 0.99);
      EXPECT_NEAR(c.depth_m, sunk, 1e-5);
    }
  }
}

TEST(NodeContact, ABladeStuckInEdgewiseGivesNoContactAlongItsWidth) {
  // upright blade, 2 mm thick along x, sunk 5 mm into the top: the way out along the top's normal is along
  // the blade
  const Block block;
  EXPECT_TRUE(block.contacts(box_tool({0.002, 0.03, 0.04}), {0.0305, 0.03, 0.06 - 0.005 + 0.02}).empty());
}

TEST(NodeContact, FollowsATurnedTool) {
  const Block block;
  const Quaternion turn = quaternion_from_rotation_vector(Vec3(0, 3.14159265358979 / 2, 0));  // x -> -z
  const auto contacts =
      block.contacts(box_tool({0.04, 0.025, 0.025}), {0.03, 0.03, 0.06 + 0.02 - 0.001}, turn);
  ASSERT_EQ(contacts.size(), 9U);
  for (const Contact& c : contacts) EXPECT_NEAR(c.depth_m, 0.001, 1e-5);
}

TEST(NodeContact, TornTissueNoLongerTouchesAndTheWallBehindItDoes) {
  Block block;
  const ToolSurface tool = box_tool({0.025, 0.025, 0.02});
  const Vec3 at(0.03, 0.03, 0.06 + 0.01 - 0.001);
  EXPECT_EQ(block.contacts(tool, at).size(), 9U);
  for (std::size_t t = 0; t < block.mesh.tets.size(); ++t) {  // the top layer is gone
    block.alive[t] = block.mesh.cell_position[t / 5][2] == 5 ? 0 : 1;
  }
  EXPECT_EQ(block.contacts(tool, at).size(), 0U);
  EXPECT_EQ(block.contacts(tool, at - Vec3(0, 0, 0.01)).size(), 9U);
}

}  // namespace
}  // namespace sulcus
