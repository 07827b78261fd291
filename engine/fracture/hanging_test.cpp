#include "engine/fracture/hanging.h"

#include <gtest/gtest.h>

#include "engine/fracture/test_zoo.h"

namespace sulcus {
namespace {

// With nodes first .. last held.
std::vector<std::int32_t> hanging(const StarMesh& mesh, std::size_t first, std::size_t last) {
  std::vector<std::uint8_t> held(mesh.around.start.size() - 1, 0);
  for (std::size_t n = first; n <= last; ++n) held[n] = 1;
  return hanging_elements(mesh.tets, face_neighbours(mesh.tets), mesh.alive, held);
}

TEST(Hanging, IsWhatHoldsByAVertexOrAnEdgeOnlyAndWhatFollowsIt) {
  // 0: held, 1: by a face, 2: by an edge, 3: by a face on 2, 4: by a vertex on 3, 5: loose
  const StarMesh mesh =
      star_mesh({{0, 1, 2, 3}, {1, 2, 3, 4}, {2, 4, 5, 6}, {4, 5, 6, 7}, {7, 8, 9, 10}, {11, 12, 13, 14}});
  EXPECT_EQ(hanging(mesh, 0, 0), (std::vector<std::int32_t>{2, 3, 4}));
  EXPECT_EQ(hanging(mesh, 14, 14), (std::vector<std::int32_t>{}));
}

TEST(Hanging, NothingInAWholeCubeNorAfterAvoidance) {
  const std::uint64_t seed = 8;
  SCOPED_TRACE(seed);
  Random random(seed);
  StarMesh mesh = star_cube(4, TetSplit::five);
  EXPECT_TRUE(hanging(mesh, 0, 24).empty());  // the lowest layer
  StarScratch scratch = make_star_scratch(mesh.stars());
  int without = 0;
  for (int n = 0; n < 8; ++n) {
    std::vector<std::int32_t> removed;
    for (int i = 0; i < 30; ++i) {
      const int e = random_below(random, static_cast<int>(mesh.tets.size()));
      if (mesh.alive[static_cast<std::size_t>(e)]) removed.push_back(e);
      mesh.alive[static_cast<std::size_t>(e)] = 0;
    }
    without += !hanging(mesh, 0, 24).empty();
    remove_singularities(mesh.stars(), mesh.alive, removed, scratch);
    EXPECT_TRUE(hanging(mesh, 0, 24).empty());
  }
  EXPECT_GE(without, 2);
}

}  // namespace
}  // namespace sulcus
