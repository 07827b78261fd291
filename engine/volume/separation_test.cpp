#include "engine/volume/separation.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/numerics/error.h"
#include "engine/volume/label_map.h"

namespace sulcus {
namespace {

TEST(SeparationPairs, AreOrderedSortedAndUnique) {
  const SeparationPairs pairs = make_separation_pairs({{5, 2}, {1, 9}, {2, 5}, {9, 1}, {3, 4}});
  const std::vector<std::pair<std::int32_t, std::int32_t>> expected{{1, 9}, {2, 5}, {3, 4}};
  EXPECT_EQ(pairs.pairs, expected);
}

TEST(SeparationPairs, ConnectWhatIsLabelledAndNoPair) {
  const SeparationPairs pairs = make_separation_pairs({{2, 5}});
  EXPECT_TRUE(pairs.contains(5, 2));
  EXPECT_FALSE(pairs.connected(2, 5));
  EXPECT_FALSE(pairs.connected(5, 2));
  EXPECT_TRUE(pairs.connected(2, 3));
  EXPECT_TRUE(pairs.connected(2, 2));
  EXPECT_FALSE(pairs.connected(0, 0));
  EXPECT_FALSE(pairs.connected(0, 2));
}

TEST(SeparationPairs, RefuseEqualAndEmptyLabels) {
  EXPECT_THROW(make_separation_pairs({{3, 3}}), InputError);
  EXPECT_THROW(make_separation_pairs({{0, 3}}), InputError);
  EXPECT_THROW(make_separation_pairs({{3, 0}}), InputError);
}

LabelMap one_voxel() {
  LabelMap map;
  map.size = {1, 1, 1};
  map.labels = {1};
  return map;
}

TEST(LabelMap, WorldAndVoxelAreInverse) {
  LabelMap map = one_voxel();
  map.spacing = {1e-3, 2e-3, 5e-3};
  map.origin = {0.1, -0.2, 0.3};
  map.direction << 0, 0, 1, 1, 0, 0, 0, -1, 0;
  const Vec3 voxel(3.25, -1.5, 7);
  const Vec3 back = map.to_voxel(map.to_world(voxel));
  for (int a = 0; a < 3; ++a) EXPECT_NEAR(back[a], voxel[a], 1e-12);
  EXPECT_NEAR(map.to_world({0, 0, 1})[0] - map.origin[0], 5e-3, 1e-15);
}

TEST(LabelMap, CheckRefusesWhatCannotBeAnImage) {
  EXPECT_NO_THROW(check_label_map(one_voxel()));
  LabelMap map = one_voxel();
  map.size = {1, 0, 1};
  EXPECT_THROW(check_label_map(map), InputError);
  map = one_voxel();
  map.size = {2, 1, 1};
  EXPECT_THROW(check_label_map(map), InputError);
  map = one_voxel();
  map.size = {1 << 20, 1 << 20, 1 << 20};
  EXPECT_THROW(check_label_map(map), InputError);
  for (const double spacing : {0.0, -1e-3, 1e-9, 10.0, std::nan("")}) {
    map = one_voxel();
    map.spacing[1] = spacing;
    EXPECT_THROW(check_label_map(map), InputError) << spacing;
  }
  map = one_voxel();
  map.direction(0, 1) = 0.1;  // sheared
  EXPECT_THROW(check_label_map(map), InputError);
  map = one_voxel();
  map.direction.setZero();
  EXPECT_THROW(check_label_map(map), InputError);
  map = one_voxel();
  map.origin[2] = std::nan("");
  EXPECT_THROW(check_label_map(map), InputError);
}

}  // namespace
}  // namespace sulcus
