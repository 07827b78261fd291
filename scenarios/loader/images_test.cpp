#include "scenarios/loader/images.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "engine/numerics/error.h"
#include "scenarios/loader/generated.h"

// ITK's NIfTI writer leaks the names of its files.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions();
const char* __lsan_default_suppressions() {
  return "leak:libITKniftiio\n";
}
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_options();
const char* __lsan_default_options() {
  return "print_suppressions=0";
}

namespace sulcus {

namespace test {

// A gzip stream of that many MiB of ones.
std::string deflated_ones(int mebibytes) {
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string ones(std::size_t{1} << 20, '\1'), out(std::size_t{1} << 20, '\0');
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  for (int n = 0; n < mebibytes; ++n) {
    stream.next_in = reinterpret_cast<Bytef*>(ones.data());
    stream.avail_in = static_cast<uInt>(ones.size());
    deflate(&stream, n + 1 == mebibytes ? Z_FINISH : Z_NO_FLUSH);
  }
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

long peak_memory_kB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

}  // namespace test

namespace {

namespace fs = std::filesystem;

class LabelMapFiles : public testing::Test {
 protected:
  void SetUp() override {
    const std::string test = testing::UnitTest::GetInstance()->current_test_info()->name();
    directory_ = fs::path(testing::TempDir()) / ("sulcus_images_" + test + "_" + std::to_string(getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  fs::path write(const std::string& name, const std::string& bytes) const {
    std::ofstream(directory_ / name, std::ios::binary) << bytes;
    return directory_ / name;
  }

  // The file is refused with a message that names it and holds every one of the words.
  void expect_refused(const fs::path& path, const std::vector<std::string>& words) const {
    try {
      read_label_map(path);
      FAIL() << path << " was accepted";
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find(path.string()), std::string::npos) << message;
      for (const std::string& word : words) EXPECT_NE(message.find(word), std::string::npos) << message;
    }
  }

  fs::path directory_;
};

template <class T>
std::string bytes_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::string nrrd(const std::string& type, const std::string& sizes, const std::string& data,
                 const std::string& directions = "(1,0,0) (0,1,0) (0,0,1)",
                 const std::string& dimension = "3", const std::string& more = "encoding: raw\n") {
  return "NRRD0004\ntype: " + type + "\ndimension: " + dimension +
         "\nspace: left-posterior-superior\nsizes: " + sizes + "\nspace directions: " + directions +
         "\nendian: little\n" + more + "\n" + data;
}

// A single-file NIfTI-1 image.
struct NiftiFields {
  std::vector<short> dim = {3, 2, 3, 4, 1, 1, 1, 1};
  short datatype = 4, bits = 16;  // int16
  std::vector<float> pixdim = {1, 1, 1, 1, 1, 1, 1, 1};
  float slope = 1, shift = 0;
  std::vector<float> sform = {-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0};
};
std::string nifti(const NiftiFields& fields, const std::string& data) {
  std::string header(352, '\0');
  const auto put = [&](std::size_t at, const auto& value) {
    std::memcpy(&header[at], &value, sizeof(value));
  };
  put(0, std::int32_t{348});
  for (std::size_t axis = 0; axis < 8; ++axis) put(40 + 2 * axis, fields.dim[axis]);
  put(70, fields.datatype);
  put(72, fields.bits);
  for (std::size_t axis = 0; axis < 8; ++axis) put(76 + 4 * axis, fields.pixdim[axis]);
  put(108, 352.0F);
  put(112, fields.slope);
  put(116, fields.shift);
  header[123] = 2;  // millimetres
  put(254, short{1});
  for (std::size_t entry = 0; entry < 12; ++entry) put(280 + 4 * entry, fields.sform[entry]);
  std::memcpy(&header[344], "n+1", 4);
  return header + data;
}

std::vector<short> counting(std::size_t count) {
  std::vector<short> values(count);
  for (std::size_t entry = 0; entry < count; ++entry) values[entry] = static_cast<short>(entry);
  return values;
}

std::string meta(const std::string& type, const std::string& sizes, const std::string& data,
                 const std::string& more = "") {
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n" + more +
         "ElementSpacing = 1 1 1\nDimSize = " + sizes + "\nElementType = " + type +
         "\nElementDataFile = LOCAL\n" + data;
}

LabelMap random_map(std::uint64_t seed, std::int32_t low, std::int32_t high) {
  std::mt19937_64 random(seed);
  LabelMap map;
  map.size = {5, 4, 3};
  map.spacing = Vec3(0.001, 0.0015, 0.002);
  map.origin = Vec3(0.010, -0.020, 0.030);
  map.direction << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  for (int voxel = 0; voxel < 60; ++voxel) {
    map.labels.push_back(low +
                         static_cast<std::int32_t>(random() % static_cast<std::uint64_t>(high - low + 1)));
  }
  map.labels[0] = low;
  map.labels[1] = high;
  return map;
}

TEST_F(LabelMapFiles, AreReadAsTheyWereWritten) {
  const std::uint64_t seed = 20170401;
  RecordProperty("seed", std::to_string(seed));
  for (const char* name : {"a.nrrd", "a.nhdr", "a.nii", "a.nii.gz", "a.mha", "a.mhd"}) {
    for (const auto& [low, high] : {std::pair{0, 255}, std::pair{-3, 3000}, std::pair{0, 1 << 30}}) {
      SCOPED_TRACE(std::string(name) + " up to " + std::to_string(high));
      const LabelMap map = random_map(seed, low, high);
      write_label_map(directory_ / name, map);
      const LabelMap read = read_label_map(directory_ / name);
      if (std::string(name) == "a.nii") fs::remove(directory_ / name);
      EXPECT_EQ(read.size, map.size);
      EXPECT_EQ(read.labels, map.labels);
      EXPECT_LT((read.spacing - map.spacing).norm(), 1e-9);
      EXPECT_LT((read.origin - map.origin).norm(), 1e-8);
      EXPECT_LT((read.direction - map.direction).norm(), 1e-6);
      for (const auto& entry : fs::directory_iterator(directory_)) {
        EXPECT_NE(entry.path().extension(), ".tmp") << "left behind: " << entry.path();
      }
    }
  }
  EXPECT_EQ(label_map_files(directory_ / "a.nrrd").size(), 1u);
  EXPECT_EQ(label_map_files(directory_ / "a.mhd").size(), 2u);
  EXPECT_EQ(label_map_files(directory_ / "a.nhdr").size(), 2u);
}

TEST_F(LabelMapFiles, OfEveryIntegerTypeAreRead) {
  const std::vector<std::int32_t> expected = {1, 2, 3, 4, 5, 6, 7, 8};
  const auto check = [&](const std::string& type, const std::string& data) {
    SCOPED_TRACE(type);
    EXPECT_EQ(read_label_map(write("t.nrrd", nrrd(type, "2 2 2", data))).labels, expected);
  };
  check("int8", bytes_of(std::vector<std::int8_t>(expected.begin(), expected.end())));
  check("uint8", bytes_of(std::vector<std::uint8_t>(expected.begin(), expected.end())));
  check("int16", bytes_of(std::vector<std::int16_t>(expected.begin(), expected.end())));
  check("uint16", bytes_of(std::vector<std::uint16_t>(expected.begin(), expected.end())));
  check("int32", bytes_of(expected));
  check("uint32", bytes_of(std::vector<std::uint32_t>(expected.begin(), expected.end())));
  check("int64", bytes_of(std::vector<std::int64_t>(expected.begin(), expected.end())));
  check("uint64", bytes_of(std::vector<std::uint64_t>(expected.begin(), expected.end())));
}

TEST_F(LabelMapFiles, KeepTheirPlaceInMetres) {
  const std::string directions = "(0,2,0) (-3,0,0) (0,0,4)";
  const LabelMap map =
      read_label_map(write("p.nrrd", nrrd("int16", "2 3 4", bytes_of(counting(24)), directions, "3",
                                          "encoding: raw\nspace origin: (10,20,30)\n")));
  EXPECT_LT((map.to_world(Vec3(1, 1, 1)) - Vec3(0.007, 0.022, 0.034)).norm(), 1e-12);
  EXPECT_EQ(map.labels[map.index(1, 2, 3)], 23);
}

TEST_F(LabelMapFiles, NiftiComesInLeftPosteriorSuperior) {
  NiftiFields fields;
  fields.sform = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7};  // right-anterior-superior
  const LabelMap map = read_label_map(write("n.nii", nifti(fields, bytes_of(counting(24)))));
  EXPECT_LT((map.to_world(Vec3(1, 0, 0)) - Vec3(-0.006, -0.006, 0.007)).norm(), 1e-9);
  EXPECT_EQ(map.labels[map.index(1, 2, 3)], 23);
}

TEST_F(LabelMapFiles, NiftiWithTwoTransformsObeysTheSform) {
  NiftiFields fields;
  fields.sform = {-2, 0, 0, 5, 0, 2, 0, 6, 0, 0, 2, 7};
  std::string bytes = nifti(fields, bytes_of(counting(24)));
  bytes[252] = 2;  // a qform is set, too: no rotation, origin 0
  const LabelMap map = read_label_map(write("two.nii", bytes));
  EXPECT_LT((map.to_world(Vec3(1, 0, 0)) - Vec3(-0.003, -0.006, 0.007)).norm(), 1e-9);
  EXPECT_LT((map.spacing - Vec3::Constant(0.002)).norm(), 1e-9);
}

TEST_F(LabelMapFiles, NiftiBesideItsUnzippedTwinIsRefused) {
  write_label_map(directory_ / "a.nii.gz", random_map(1, 0, 9));
  write_label_map(directory_ / "b.nii", random_map(2, 0, 9));
  fs::rename(directory_ / "b.nii", directory_ / "a.nii");
  expect_refused(directory_ / "a.nii.gz", {"a.nii lies beside it"});
  EXPECT_EQ(read_label_map(directory_ / "a.nii").labels, random_map(2, 0, 9).labels);
}

TEST_F(LabelMapFiles, WithATrailingDimensionOfOneAreRead) {
  NiftiFields fields;
  fields.dim = {4, 2, 3, 4, 1, 1, 1, 1};
  EXPECT_EQ(read_label_map(write("n.nii", nifti(fields, bytes_of(counting(24))))).size, (Index3{2, 3, 4}));
}

TEST_F(LabelMapFiles, ThatAreMissingAreNamedWithARemedy) {
  expect_refused(directory_ / "none.nrrd", {"does not exist"});
  expect_refused("/usr/share/mricron/templates/no-such-map.nii.gz", {"mricron-data"});
  expect_refused(write("picture.png", "x"), {"unknown image format", ".nrrd"});
  expect_refused(write("empty.nii.gz", ""), {"empty"});
  fs::create_directory(directory_ / "d.nrrd");
  expect_refused(directory_ / "d.nrrd", {"not a regular file"});
  write("lost.mhd",
        "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = "
        "lost.raw\n");
  EXPECT_THROW(read_label_map(directory_ / "lost.mhd"), InputError);
}

TEST_F(LabelMapFiles, WithTheWrongNumberOfDimensionsAreRefused) {
  expect_refused(write("four.nrrd",
                       nrrd("uint8", "2 2 2 3", std::string(24, '\1'), "(1,0,0) (0,1,0) (0,0,1) none", "4")),
                 {"3"});
  NiftiFields fields;
  fields.dim = {4, 2, 3, 2, 2, 1, 1, 1};
  expect_refused(write("four.nii", nifti(fields, bytes_of(counting(24)))), {"4 dimensions"});
  fields.dim = {2, 4, 6, 1, 1, 1, 1, 1};
  expect_refused(write("two.nii", nifti(fields, bytes_of(counting(24)))), {"2 dimensions"});
}

TEST_F(LabelMapFiles, WithVectorVoxelsAreRefused) {
  expect_refused(
      write("vector.nrrd", nrrd("uint8", "3 2 2 2", std::string(24, '\1'), "none (1,0,0) (0,1,0) (0,0,1)",
                                "4", "encoding: raw\nkinds: vector domain domain domain\n")),
      {"components"});
  expect_refused(
      write("vector.mha", meta("MET_UCHAR", "2 2 2", std::string(24, '\1'), "ElementNumberOfChannels = 3\n")),
      {"components"});
}

TEST_F(LabelMapFiles, WithFloatingPointVoxelsAreRefused) {
  const std::string data = bytes_of(std::vector<float>(8, 1.0F));
  expect_refused(write("f.nrrd", nrrd("float", "2 2 2", data)), {"floating-point", "int16"});
  expect_refused(write("f.mha", meta("MET_FLOAT", "2 2 2", data)), {"floating-point"});
}

TEST_F(LabelMapFiles, WithRescaledValuesAreRefused) {
  NiftiFields fields;
  fields.slope = 0.5F;
  expect_refused(write("s.nii", nifti(fields, bytes_of(counting(24)))), {"scl_slope", "0.5"});
  fields.slope = 1;
  fields.shift = 10;
  expect_refused(write("s.nii", nifti(fields, bytes_of(counting(24)))), {"scl_inter", "10"});
  fields.slope = 0;  // not set: no rescaling
  fields.shift = 0;
  EXPECT_EQ(read_label_map(write("s.nii", nifti(fields, bytes_of(counting(24))))).labels[5], 5);
}

TEST_F(LabelMapFiles, WithLabelsBeyond32BitsAreRefused) {
  std::vector<std::int64_t> values(8, 1);
  values[5] = std::int64_t{1} << 31;
  expect_refused(write("l.nrrd", nrrd("int64", "2 2 2", bytes_of(values))), {"voxel 5", "2147483648"});
  expect_refused(
      write("u.nrrd", nrrd("uint32", "2 2 2", bytes_of(std::vector<std::uint32_t>(8, 0xffffffffU)))),
      {"4294967295"});
}

TEST_F(LabelMapFiles, WithImpossibleGeometryAreRefused) {
  const std::string data(8, '\1');
  expect_refused(write("sheared.nrrd", nrrd("uint8", "2 2 2", data, "(1,0,0) (0.5,1,0) (0,0,1)")),
                 {"orthonormal"});
  expect_refused(write("flat.nrrd", nrrd("uint8", "2 2 2", data, "(0,0,0) (0,1,0) (0,0,1)")), {"flat.nrrd"});
  expect_refused(write("huge.nrrd", nrrd("uint8", "2 2 2", data, "(1e9,0,0) (0,1,0) (0,0,1)")),
                 {"spacing", "mm"});
  expect_refused(write("nan.nrrd", nrrd("uint8", "2 2 2", data, "(nan,0,0) (0,1,0) (0,0,1)")), {"nan.nrrd"});
  NiftiFields fields;
  fields.sform = {1, 0.5F, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  expect_refused(write("sheared.nii", nifti(fields, bytes_of(counting(24)))), {"ortho"});
}

// ITK itself would not end, or end the program.
TEST_F(LabelMapFiles, WithAbsurdHeadersAreRefusedBeforeItkSeesThem) {
  const std::string data(8, '\1');
  std::string absurd = meta("MET_UCHAR", "2 2 2", data);
  absurd.replace(absurd.find("NDims = 3"), 9, "NDims = 999999999993");
  expect_refused(write("absurd.mha", absurd), {"NDims", "3 dimensions"});
  NiftiFields fields;
  fields.sform = {-1, 0, 0, std::numeric_limits<float>::quiet_NaN(), 0, -1, 0, 0, 0, 0, 1, 0};
  expect_refused(write("nan.nii", nifti(fields, bytes_of(counting(24)))), {"srow", "nan"});
}

TEST_F(LabelMapFiles, WithoutAnyLabelAreRefused) {
  expect_refused(write("zero.nrrd", nrrd("uint8", "2 2 2", std::string(8, '\0'))), {"label 0"});
  expect_refused(write("none.nrrd", nrrd("uint8", "0 2 2", "")), {"none.nrrd"});
}

TEST_F(LabelMapFiles, ThatAreTruncatedAreRefused) {
  const std::string short_data = bytes_of(counting(23));
  expect_refused(write("t.nrrd", nrrd("int16", "2 3 4", short_data)), {"48 bytes", "46 bytes"});
  expect_refused(write("t.nii", nifti({}, short_data)), {"truncated"});
  expect_refused(write("t.mha", meta("MET_SHORT", "2 3 4", short_data)), {"48 bytes", "46 bytes"});
  expect_refused(write("h.nrrd", "NRRD0004\ntype: uint8\n"), {"h.nrrd"});
  expect_refused(write("h.nii", nifti({}, "").substr(0, 200)), {"h.nii"});
  expect_refused(write("h.mha", "ObjectType = Image\nNDims = 3\n"), {"h.mha"});
}

TEST_F(LabelMapFiles, WithTruncatedCompressedDataAreRefused) {
  LabelMap map = generate(SphereSegment{});
  std::mt19937_64 random(7);
  for (std::int32_t& label : map.labels) label = static_cast<std::int32_t>(random() % 50);
  for (const char* name : {"c.nrrd", "c.nii.gz", "c.mha", "c.mhd", "c.nhdr"}) {
    SCOPED_TRACE(name);
    const fs::path path = directory_ / name;
    write_label_map(path, map);
    EXPECT_EQ(read_label_map(path).labels, map.labels);
    const fs::path data = label_map_files(path).back();
    const std::uintmax_t size = fs::file_size(data);
    for (const std::uintmax_t kept : {size * 9 / 10, size / 2}) {
      fs::resize_file(data, kept);
      expect_refused(path, {});
    }
  }
}

TEST_F(LabelMapFiles, WithDamagedCompressedDataAreRefused) {
  LabelMap map = generate(SphereSegment{});
  std::mt19937_64 random(8);
  for (std::int32_t& label : map.labels) label = static_cast<std::int32_t>(random() % 50);
  for (const char* name : {"c.nrrd", "c.nii.gz", "c.mha"}) {
    SCOPED_TRACE(name);
    const fs::path path = directory_ / name;
    write_label_map(path, map);
    std::fstream stream(path, std::ios::binary | std::ios::in | std::ios::out);
    stream.seekp(static_cast<std::streamoff>(fs::file_size(path) / 2));
    stream << std::string(200, '\x5a');
    stream.close();
    expect_refused(path, {});
  }
}

TEST_F(LabelMapFiles, ThatPromiseMoreThanTheyHoldAreRefusedBeforeMemoryIsTaken) {
  expect_refused(write("big.nrrd", nrrd("uint8", "2000 2000 2000", "x")), {"2000 x 2000 x 2000"});
  expect_refused(write("big.nrrd", nrrd("int64", "600 600 600", "x")), {"1728000000 bytes", "after 1 bytes"});
  expect_refused(write("gz.nrrd", nrrd("int64", "600 600 600", std::string(100, 'x'),
                                       "(1,0,0) (0,1,0) (0,0,1)", "3", "encoding: gzip\n")),
                 {"compressed"});
  NiftiFields fields;
  fields.dim = {3, 600, 600, 600, 1, 1, 1, 1};
  expect_refused(write("big.nii", nifti(fields, "x")), {"432000000 bytes"});
  fields.dim = {3, 32767, 32767, 32767, 1, 1, 1, 1};
  expect_refused(write("bigger.nii", nifti(fields, "x")), {"bigger.nii"});
  expect_refused(write("big.mha", meta("MET_UCHAR", "600 600 600", "x", "CompressedData = True\n")),
                 {"216000000 bytes"});
  expect_refused(write("big.mha", meta("MET_UCHAR", "2000000 2000000 2000000", "x")), {"big.mha"});
}

// A small file that inflates to 300 MB: only what the header promises is taken.
TEST_F(LabelMapFiles, ThatInflateWithoutEndTakeNoMemory) {
  const std::string huge = test::deflated_ones(300);
  EXPECT_LT(huge.size(), 400000u);
  const fs::path paths[] = {
      write("bomb.nrrd", nrrd("uint8", "2 2 2", huge, "(1,0,0) (0,1,0) (0,0,1)", "3", "encoding: gzip\n")),
      write("bomb.mha", meta("MET_UCHAR", "2 2 2", huge, "CompressedData = True\n"))};
  for (const fs::path& path : paths) {
    const long before_kB = test::peak_memory_kB();
    try {
      EXPECT_EQ(read_label_map(path).labels, std::vector<std::int32_t>(8, 1)) << path;
    } catch (const InputError&) {  // may be refused as well
    }
    EXPECT_LT(test::peak_memory_kB() - before_kB, 100 * 1000) << path;
  }
}

TEST_F(LabelMapFiles, ThatAreNotWhatTheirNameSaysAreRefused) {
  for (const char* name : {"x.nrrd", "x.nii", "x.nii.gz", "x.mha"}) {
    expect_refused(write(name, std::string(500, 'q')), {});
  }
}

TEST_F(LabelMapFiles, ThatCannotBeWrittenLeaveNothingBehind) {
  const LabelMap map = random_map(3, 0, 9);
  EXPECT_THROW(write_label_map(directory_ / "a.tif", map), InputError);
  EXPECT_THROW(write_label_map(directory_ / "no" / "such" / "a.nrrd", map), EnvironmentError);
  EXPECT_TRUE(fs::is_empty(directory_));
}

TEST(BrainMap, IsReadWithItsLabelsAndItsLeftSide) {
  const fs::path path = "/usr/share/mricron/templates/jhu189.nii.gz";
  if (!fs::exists(path)) GTEST_SKIP() << path << " is absent: apt install mricron-data";
  const LabelMap map = read_label_map(path);
  EXPECT_EQ(map.size, (Index3{157, 189, 136}));
  EXPECT_EQ(
      std::count_if(map.labels.begin(), map.labels.end(), [](std::int32_t label) { return label != 0; }),
      1771330);
  EXPECT_LT((map.spacing - Vec3::Constant(0.001)).norm(), 1e-9);
  // Label 35 is the left superior temporal gyrus: +x.
  for (int i = 0; i < 157; ++i) {
    for (int j = 0; j < 189; ++j) {
      if (map.labels[map.index(i, j, 50)] != 35) continue;
      ASSERT_GT(map.to_world(Vec3(i, j, 50))[0], 0);
    }
  }
}

}  // namespace
}  // namespace sulcus
