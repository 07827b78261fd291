#include "engine/volume/label_operations.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "engine/numerics/error.h"
#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

LabelMap row(std::vector<std::int32_t> labels) {
  LabelMap map;
  map.size = {static_cast<int>(labels.size()), 1, 1};
  map.labels = std::move(labels);
  return map;
}

TEST(LabelOperations, KeepDropAndMergeChangeExactlyTheirVoxels) {
  const std::array<std::int32_t, 3> set{7, 2, -4};
  LabelMap map = row({0, 1, 2, 7, -4, 9});
  EXPECT_EQ(keep_labels(map, set), 2);
  EXPECT_EQ(map.labels, (std::vector<std::int32_t>{0, 0, 2, 7, -4, 0}));
  map = row({0, 1, 2, 7, -4, 9});
  EXPECT_EQ(drop_labels(map, set), 3);
  EXPECT_EQ(map.labels, (std::vector<std::int32_t>{0, 1, 0, 0, 0, 9}));
  map = row({0, 1, 2, 7, -4, 9});
  EXPECT_EQ(merge_labels(map, set, 7), 2);
  EXPECT_EQ(map.labels, (std::vector<std::int32_t>{0, 1, 7, 7, 7, 9}));
}

TEST(LabelOperations, MergeRefusesEmptySpace) {
  LabelMap map = row({0, 1});
  EXPECT_THROW(merge_labels(map, std::array<std::int32_t, 1>{1}, 0), InputError);
  EXPECT_THROW(merge_labels(map, std::array<std::int32_t, 2>{1, 0}, 2), InputError);
}

LabelMap shell() {
  LabelMap map = empty_map({9, 9, 9});
  for (int k = 1; k < 8; ++k) {
    for (int j = 1; j < 8; ++j) {
      for (int i = 1; i < 8; ++i) {
        const bool wall = i == 1 || i == 7 || j == 1 || j == 7 || k == 1 || k == 7;
        map.labels[map.index(i, j, k)] = wall ? (i < 4 ? 3 : 5) : 0;
      }
    }
  }
  return map;
}

TEST(FillVoids, FillsWhatIsEnclosedWithTheLabelOfItsWall) {
  LabelMap map = shell();
  EXPECT_EQ(fill_voids(map), 125);
  EXPECT_EQ(map.labels[map.index(2, 4, 4)], 3);
  EXPECT_EQ(map.labels[map.index(6, 4, 4)], 5);
  EXPECT_EQ(map.labels[map.index(0, 4, 4)], 0);
  EXPECT_EQ(std::count(map.labels.begin(), map.labels.end(), 0), 9 * 9 * 9 - 7 * 7 * 7);
}

TEST(FillVoids, LeavesWhatIsOpen) {
  LabelMap map = shell();
  map.labels[map.index(1, 4, 4)] = 0;
  EXPECT_EQ(fill_voids(map), 0);
}

TEST(FillVoids, OfAFlatImageIgnoresItsThickness) {
  LabelMap map = empty_map({5, 5, 1});
  for (int j = 1; j < 4; ++j) {
    for (int i = 1; i < 4; ++i) map.labels[map.index(i, j, 0)] = i != 2 || j != 2;
  }
  EXPECT_EQ(fill_voids(map), 1);
  EXPECT_EQ(map.labels[map.index(2, 2, 0)], 1);
}

TEST(FillVoids, LeavesNoVoidAndNoLabelledVoxelChanged) {
  Random random(17);
  for (int trial = 0; trial < 200; ++trial) {
    const LabelMap before = random_map(random, {10, 9, 8}, 3);
    LabelMap map = before;
    const std::int64_t filled = fill_voids(map);
    std::int64_t changed = 0;
    for (std::size_t v = 0; v < map.labels.size(); ++v) {
      if (before.labels[v] != 0) {
        ASSERT_EQ(map.labels[v], before.labels[v]);
      }
      changed += map.labels[v] != before.labels[v];
    }
    EXPECT_EQ(changed, filled);
    EXPECT_EQ(fill_voids(map), 0);
  }
}

TEST(DropSmallPieces, KeepsPiecesOfTheMinimumAndCutsAtPairs) {
  LabelMap map = row({1, 1, 1, 0, 2, 2, 0, 3, 3, 4, 4, 4});
  const SeparationPairs pairs = make_separation_pairs({{3, 4}});
  EXPECT_EQ(drop_small_pieces(map, pairs, 3), 4);
  EXPECT_EQ(map.labels, (std::vector<std::int32_t>{1, 1, 1, 0, 0, 0, 0, 0, 0, 4, 4, 4}));
  EXPECT_EQ(drop_small_pieces(map, pairs, 0), 0);
}

TEST(CropToContent, KeepsWorldPositionsAndLabels) {
  LabelMap map = empty_map({9, 8, 7});
  map.spacing = {1e-3, 2e-3, 3e-3};
  map.origin = {0.1, 0.2, 0.3};
  map.direction << 0, 0, 1, 1, 0, 0, 0, -1, 0;
  map.labels[map.index(3, 4, 5)] = 6;
  map.labels[map.index(5, 4, 6)] = 8;
  LabelMap cropped = map;
  EXPECT_EQ(crop_to_content(cropped, 1), 9 * 8 * 7 - 5 * 3 * 3);
  EXPECT_EQ(cropped.size, (Index3{5, 3, 3}));
  EXPECT_EQ(cropped.labels[cropped.index(1, 1, 1)], 6);
  EXPECT_EQ(cropped.labels[cropped.index(3, 1, 2)], 8);
  const Vec3 before = map.to_world({3, 4, 5}), after = cropped.to_world({1, 1, 1});
  for (int a = 0; a < 3; ++a) EXPECT_NEAR(before[a], after[a], 1e-15);
  EXPECT_EQ(crop_to_content(cropped, 1000), 0);
  EXPECT_NO_THROW(check_label_map(cropped));
  LabelMap nothing = empty_map({3, 3, 3});
  EXPECT_THROW(crop_to_content(nothing, 0), InputError);
}

}  // namespace
}  // namespace sulcus
