#include "scenarios/loader/image_io.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <random>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

namespace fs = std::filesystem;

class ImageFiles : public testing::Test {
 protected:
  void SetUp() override {
    const std::string test = testing::UnitTest::GetInstance()->current_test_info()->name();
    directory_ = fs::path(testing::TempDir()) / ("sulcus_image_io_" + test + "_" + std::to_string(getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  template <class Call>
  void expect_refused(Call call, const std::string& says) const {
    try {
      call();
      FAIL() << "accepted; expected: " << says;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(says), std::string::npos) << error.what();
    }
  }

  fs::path directory_;
};

// Whole numbers from 0 to 99 in any type, in a turned geometry.
VoxelImage test_image(VoxelType type, bool mirrored = false) {
  std::mt19937_64 random(7);
  VoxelImage image;
  image.geometry.size = {7, 5, 4};
  image.geometry.spacing = {0.0011, 0.0009, 0.0025};
  image.geometry.origin = {0.0135, -0.021, 0.033};
  image.geometry.direction << 0.8, 0, 0.6, 0, 1, 0, -0.6, 0, 0.8;
  if (mirrored) image.geometry.direction.col(2) *= -1;
  image.type = type;
  visit_voxel_type(type, [&]<class T>(T) {
    std::vector<T> values(7 * 5 * 4);
    for (T& value : values) value = static_cast<T>(random() % 100);
    image.bytes.assign(reinterpret_cast<const char*>(values.data()),
                       reinterpret_cast<const char*>(values.data() + values.size()));
  });
  return image;
}

std::vector<double> values_of(const VoxelImage& image) {
  std::vector<double> values;
  visit_voxel_type(image.type, [&]<class T>(T) {
    const T* from = reinterpret_cast<const T*>(image.bytes.data());
    values.assign(from, from + image.bytes.size() / sizeof(T));
  });
  return values;
}

void expect_same_place(const ImageGeometry& a, const ImageGeometry& b) {
  EXPECT_EQ(a.size, b.size);
  EXPECT_LT((a.spacing - b.spacing).norm(), 1e-9);
  EXPECT_LT((a.origin - b.origin).norm(), 1e-8);
  EXPECT_LT((a.direction - b.direction).norm(), 1e-6);
}

TEST_F(ImageFiles, OfEveryTypeAreReadAsTheyWereWritten) {
  for (const char* name : {"a.nrrd", "a.nii.gz", "a.mha"}) {
    for (int type = 0; type < 10; ++type) {
      SCOPED_TRACE(std::string(name) + " type " + std::to_string(type));
      const VoxelImage image = test_image(static_cast<VoxelType>(type));
      write_image(directory_ / name, image);
      const VoxelImage read = read_image(directory_ / name, ImageUse::grey);
      EXPECT_EQ(read.type, image.type);
      EXPECT_EQ(read.bytes, image.bytes);
      expect_same_place(read.geometry, image.geometry);
    }
  }
}

TEST_F(ImageFiles, DicomSeriesKeepWholeNumbersExactly) {
  for (const VoxelType type : {VoxelType::uint8, VoxelType::int16, VoxelType::uint16, VoxelType::int32}) {
    SCOPED_TRACE(static_cast<int>(type));
    const fs::path folder = directory_ / ("series" + std::to_string(static_cast<int>(type)));
    const VoxelImage image = test_image(type);
    write_image(folder, image);
    const VoxelImage read = read_image(folder, ImageUse::grey);
    EXPECT_EQ(values_of(read), values_of(image));
    expect_same_place(read.geometry, image.geometry);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 4);
  }
}

TEST_F(ImageFiles, DicomSeriesKeepNegativeNumbers) {
  VoxelImage image = test_image(VoxelType::int16);
  const std::int16_t lowest = -1024;
  std::memcpy(image.bytes.data(), &lowest, sizeof lowest);
  write_image(directory_ / "series", image);
  EXPECT_EQ(values_of(read_image(directory_ / "series", ImageUse::grey)), values_of(image));
}

TEST_F(ImageFiles, DicomSeriesHoldRealNumbersToASixteenBitStep) {
  VoxelImage image = test_image(VoxelType::float32);
  float* values = reinterpret_cast<float*>(image.bytes.data());
  for (int n = 0; n < 140; ++n) values[n] = -0.3F + 0.0071F * static_cast<float>(n * n % 97);
  write_image(directory_ / "stress", image);
  const VoxelImage read = read_image(directory_ / "stress", ImageUse::grey);
  const std::vector<double> before = values_of(image), after = values_of(read);
  ASSERT_EQ(before.size(), after.size());
  double largest = 0;
  for (std::size_t n = 0; n < before.size(); ++n) largest = std::max(largest, std::abs(before[n] - after[n]));
  EXPECT_LT(largest, 0.0071 * 97 / 65535);
  EXPECT_GT(largest, 0);
}

// DICOM orders slices along their normal: a mirrored image comes back with its slices in the other order,
// every voxel at its place in the world.
TEST_F(ImageFiles, DicomSeriesOfMirroredImagesKeepEveryVoxelsPlace) {
  const VoxelImage image = test_image(VoxelType::int16, true);
  write_image(directory_ / "series", image);
  const VoxelImage read = read_image(directory_ / "series", ImageUse::grey);
  const std::vector<double> before = values_of(image), after = values_of(read);
  for (int k = 0; k < 4; ++k) {
    for (int v = 0; v < 35; ++v)
      EXPECT_EQ(before[static_cast<std::size_t>(35 * k + v)],
                after[static_cast<std::size_t>(35 * (3 - k) + v)]);
  }
  const ImageGeometry &g = image.geometry, &h = read.geometry;
  const Vec3 last = g.origin + 3 * g.spacing[2] * g.direction.col(2);
  EXPECT_LT((h.origin - last).norm(), 1e-8);
  EXPECT_LT((h.direction.col(2) + g.direction.col(2)).norm(), 1e-6);
}

TEST_F(ImageFiles, DicomSeriesThatAreIncompleteOrMixedAreRefused) {
  const VoxelImage image = test_image(VoxelType::int16);
  write_image(directory_ / "a", image);
  fs::copy_file(directory_ / "a" / "slice_0002.dcm", directory_ / "kept.dcm");
  fs::remove(directory_ / "a" / "slice_0002.dcm");
  expect_refused([&] { read_image(directory_ / "a", ImageUse::grey); }, "equal distances");
  std::ofstream(directory_ / "a" / "slice_0002.dcm") << std::string(300, 'x');
  EXPECT_THROW(read_image(directory_ / "a", ImageUse::grey), InputError);
  fs::remove(directory_ / "a" / "slice_0002.dcm");
  VoxelImage other = image;
  other.bytes[0] = 1;
  write_image(directory_ / "b", other);
  fs::copy_file(directory_ / "b" / "slice_0002.dcm", directory_ / "a" / "slice_0002.dcm");
  expect_refused([&] { read_image(directory_ / "a", ImageUse::grey); }, "2 DICOM series");
  fs::create_directory(directory_ / "none");
  expect_refused([&] { read_image(directory_ / "none", ImageUse::grey); }, "0 DICOM series");
}

TEST_F(ImageFiles, DicomSeriesAreNotWrittenOverOthersNorBeyondSixteenBits) {
  VoxelImage image = test_image(VoxelType::int32);
  std::ofstream(directory_ / "taken") << "x";
  expect_refused([&] { write_image(directory_ / "taken", image); }, "not an empty folder");
  fs::create_directory(directory_ / "full");
  std::ofstream(directory_ / "full" / "x") << "x";
  expect_refused([&] { write_image(directory_ / "full", image); }, "not an empty folder");
  const std::int32_t large = 70000;
  std::memcpy(image.bytes.data(), &large, sizeof large);
  expect_refused([&] { write_image(directory_ / "series", image); }, "beyond 16 bits");
  EXPECT_FALSE(fs::exists(directory_ / "series"));
  EXPECT_FALSE(fs::exists(directory_ / ".series.tmp"));
}

// NIfTI's scl_slope: refused for labels, applied to grey values.
TEST_F(ImageFiles, GreyValuesAreRescaledAsTheHeaderSays) {
  const VoxelImage image = test_image(VoxelType::int16);
  write_image(directory_ / "a.nii", image);
  std::fstream file(directory_ / "a.nii", std::ios::binary | std::ios::in | std::ios::out);
  const float slope = 0.5F, shift = 10;
  file.seekp(112);
  file.write(reinterpret_cast<const char*>(&slope), 4);
  file.write(reinterpret_cast<const char*>(&shift), 4);
  file.close();
  const VoxelImage read = read_image(directory_ / "a.nii", ImageUse::grey);
  const std::vector<double> stored = values_of(image), values = values_of(read);
  ASSERT_EQ(values.size(), stored.size());
  for (std::size_t n = 0; n < values.size(); ++n) EXPECT_DOUBLE_EQ(values[n], 0.5 * stored[n] + 10);
  expect_refused([&] { read_image(directory_ / "a.nii", ImageUse::labels); }, "scl_slope");
}

}  // namespace
}  // namespace sulcus
