#include "verify/png.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <random>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;

Image noise(int width, int height, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Image image{width, height, {}};
  for (int i = 0; i < 3 * width * height; ++i) image.rgb.push_back(static_cast<std::uint8_t>(random() >> 56));
  return image;
}

struct Folder {
  fs::path path;
  Folder() : path(fs::temp_directory_path() / ("sulcus-png-test-" + std::to_string(::getpid()))) {
    fs::create_directories(path);
  }
  ~Folder() { fs::remove_all(path); }
};

TEST(Png, PixelsComeBackAsTheyWere) {
  std::uint64_t seed = 17;
  for (const auto& [width, height] : {std::pair{1, 1}, {7, 3}, {64, 65}, {333, 2}}) {
    SCOPED_TRACE("seed " + std::to_string(++seed));
    const Image image = noise(width, height, seed);
    const Image back = decode_png(encode_png(image), "noise");
    EXPECT_EQ(back.width, width);
    EXPECT_EQ(back.height, height);
    EXPECT_EQ(back.rgb, image.rgb);
  }
}

TEST(Png, SamePixelsGiveSameBytes) {
  const Image image = noise(50, 40, 3);
  EXPECT_EQ(encode_png(image), encode_png(image));
}

TEST(Png, FilesComeBackAndLeaveNothingElse) {
  const Folder folder;
  const Image image = noise(20, 10, 5);
  write_png(image, folder.path / "a.png");
  write_png(image, folder.path / "a.png");
  EXPECT_EQ(read_png(folder.path / "a.png").rgb, image.rgb);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path), fs::directory_iterator()), 1);
}

TEST(Png, OtherKindsAreReadAsColour) {
  // 2 x 1 pixels, grey with transparency: black, and a quarter-opaque black.
  const unsigned char bytes[] = {0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d,
                                 0x49, 0x48, 0x44, 0x52, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01,
                                 0x08, 0x04, 0x00, 0x00, 0x00, 0x5e, 0x2b, 0xb7, 0x01, 0x00, 0x00, 0x00,
                                 0x0d, 0x49, 0x44, 0x41, 0x54, 0x78, 0x9c, 0x63, 0x60, 0xf8, 0xcf, 0xe0,
                                 0x00, 0x00, 0x03, 0x42, 0x01, 0x40, 0x50, 0x60, 0xce, 0x58, 0x00, 0x00,
                                 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};
  const Image image = decode_png(std::string(reinterpret_cast<const char*>(bytes), sizeof(bytes)), "grey");
  ASSERT_EQ(image.width, 2);
  ASSERT_EQ(image.height, 1);
  EXPECT_EQ(image.rgb, (std::vector<std::uint8_t>{0, 0, 0, 191, 191, 191}));
}

TEST(Png, DamagedFilesAreRefusedWithTheirName) {
  const std::string bytes = encode_png(noise(30, 30, 7));
  std::string broken = bytes;
  broken[bytes.size() / 2] = static_cast<char>(broken[bytes.size() / 2] ^ 0x55);
  for (const std::string& bad : {std::string(), std::string("not a picture"), bytes.substr(0, 8),
                                 bytes.substr(0, bytes.size() / 2), broken}) {
    try {
      decode_png(bad, "some/place.png");
      FAIL() << "accepted " << bad.size() << " bytes";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("some/place.png"), std::string::npos) << error.what();
    }
  }
  EXPECT_THROW(read_png("/no/such/picture.png"), InputError);
}

TEST(Png, ImagesThatContradictThemselvesAreNotWritten) {
  EXPECT_THROW(encode_png(Image{}), InputError);
  EXPECT_THROW(encode_png(Image{2, 2, std::vector<std::uint8_t>(11)}), InputError);
  EXPECT_THROW(encode_png(Image{-2, -2, std::vector<std::uint8_t>(12)}), InputError);
}

TEST(Png, AMissingFolderIsTheEnvironmentsFault) {
  EXPECT_THROW(write_png(noise(2, 2, 1), "/no/such/folder/a.png"), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
