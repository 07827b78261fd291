#include "verify/picture_diff.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

using Rgb = std::array<std::uint8_t, 3>;

double distance(const Rgb& a, const Rgb& b) {
  return colour_distance(a.data(), b.data());
}

Image plain(int width, int height, const Rgb& colour) {
  Image image{width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(3 * width * height))};
  for (std::size_t i = 0; i < image.rgb.size(); ++i) image.rgb[i] = colour[i % 3];
  return image;
}

void set_pixel(Image& image, int x, int y, const Rgb& colour) {
  std::copy(colour.begin(), colour.end(), image.rgb.begin() + 3 * (y * image.width + x));
}

TEST(PictureDiff, DistancesAreThoseOfCielab) {
  EXPECT_EQ(distance({12, 34, 56}, {12, 34, 56}), 0);
  EXPECT_NEAR(distance({0, 0, 0}, {255, 255, 255}), 100, 0.05);
  // L*a*b* of the sRGB primaries: red 53.24 80.09 67.20, green 87.73 -86.18 83.18, blue 32.30 79.19 -107.86.
  EXPECT_NEAR(distance({255, 0, 0}, {0, 255, 0}), 170.57, 0.1);
  EXPECT_NEAR(distance({255, 0, 0}, {0, 0, 255}), 176.31, 0.1);
  EXPECT_EQ(distance({1, 2, 3}, {200, 100, 0}), distance({200, 100, 0}, {1, 2, 3}));
}

TEST(PictureDiff, OneStepOfAByteIsBelowNotice) {
  for (int v = 0; v < 255; ++v) {
    const auto low = static_cast<std::uint8_t>(v), high = static_cast<std::uint8_t>(v + 1);
    EXPECT_LT(distance({low, low, low}, {high, high, high}), 1.0) << v;
  }
}

TEST(PictureDiff, ShrinkingTakesTheMeanAndKeepsAPlainColour) {
  Image image{4, 2, {}};
  for (std::uint8_t v : {0, 100, 10, 10, 200, 100, 10, 10}) image.rgb.insert(image.rgb.end(), {v, 7, 255});
  const Image small = shrunk(image, 2);
  EXPECT_EQ(small.width, 2);
  EXPECT_EQ(small.height, 1);
  EXPECT_EQ(small.rgb, (std::vector<std::uint8_t>{100, 7, 255, 10, 7, 255}));
  EXPECT_THROW(shrunk(image, 3), InputError);
  EXPECT_THROW(shrunk(image, 0), InputError);
}

TEST(PictureDiff, EqualPicturesDoNotDiffer) {
  const Image image = plain(5, 4, {10, 200, 30});
  const PictureDifference difference = compare_pictures(image, image, 0);
  EXPECT_EQ(difference.differing_fraction, 0);
  EXPECT_EQ(difference.max_distance, 0);
  EXPECT_EQ(difference.mean_distance, 0);
}

TEST(PictureDiff, CountsThePixelsBeyondTheThreshold) {
  const Image a = plain(10, 10, {0, 0, 0});
  Image b = a;
  set_pixel(b, 3, 2, {255, 255, 255});
  set_pixel(b, 9, 9, {1, 1, 1});
  const PictureDifference loose = compare_pictures(a, b, 2.3), strict = compare_pictures(a, b, 0);
  EXPECT_DOUBLE_EQ(loose.differing_fraction, 0.01);
  EXPECT_DOUBLE_EQ(strict.differing_fraction, 0.02);
  EXPECT_NEAR(loose.max_distance, 100, 0.05);
  EXPECT_NEAR(loose.mean_distance, 1, 0.01);
}

TEST(PictureDiff, BlocksTellWhatIsMissingFromAnEdgeThatShifted) {
  // A bar of 3 x 12 pixels is 0.5 % of the picture; it is gone in b. In c the edge of a half lies a quarter
  // of a pixel further.
  Image a = plain(80, 90, {240, 240, 240});
  const Image b = a;
  for (int y = 20; y < 32; ++y) {
    for (int x = 30; x < 33; ++x) set_pixel(a, x, y, {250, 178, 22});
  }
  const PictureDifference missing = compare_pictures(a, b, 4.6);
  EXPECT_LE(missing.differing_fraction, 0.005);
  EXPECT_GT(missing.max_block_distance, 20);

  Image half = plain(80, 90, {240, 240, 240}), shifted = half;
  for (int y = 0; y < 90; ++y) {
    for (int x = 0; x < 41; ++x) {
      set_pixel(half, x, y, x < 40 ? Rgb{120, 120, 120} : Rgb{240, 240, 240});
      set_pixel(shifted, x, y, x < 40 ? Rgb{120, 120, 120} : Rgb{210, 210, 210});
    }
  }
  const PictureDifference edge = compare_pictures(half, shifted, 4.6);
  EXPECT_GT(edge.max_distance, 10);
  EXPECT_LT(edge.max_block_distance, 4);
  EXPECT_GT(edge.max_block_distance, 0);
}

TEST(PictureDiff, TheDifferencePictureGlowsWhereTheyDiffer) {
  const Image a = plain(3, 1, {100, 150, 200});
  Image b = a;
  set_pixel(b, 1, 0, {255, 0, 0});
  const Image glow = difference_picture(a, b, 2.3);
  EXPECT_EQ(glow.rgb[0], glow.rgb[1]);
  EXPECT_EQ(glow.rgb[1], glow.rgb[2]);
  EXPECT_GT(glow.rgb[3], 200);
  EXPECT_EQ(glow.rgb[5], 0);
  EXPECT_EQ(glow.rgb[6], glow.rgb[0]);
}

TEST(PictureDiff, PicturesOfOtherSizesAreNotCompared) {
  EXPECT_THROW(compare_pictures(plain(2, 3, {}), plain(3, 2, {}), 1), InputError);
  EXPECT_THROW(difference_picture(plain(2, 3, {}), plain(2, 2, {}), 1), InputError);
}

}  // namespace
}  // namespace sulcus
