// A recorded deformation applied to images, by the command itself.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <random>

#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"
#include "scenarios/loader/scenario.h"
#include "tools/sulcus/commands.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

// One run for all tests: four regions in a plane, two of them pulled aside.
class ExportVolume : public testing::Test {
 protected:
  static fs::path folder() {
    return fs::temp_directory_path() / ("sulcus_export_test_" + std::to_string(getpid()));
  }
  static std::vector<std::string> overrides() {
    return {"/time/step_s=0.1", "/record/frame_every_steps=5", "/solver/measure_error_every_steps=0"};
  }
  static fs::path scenario() { return fs::path(SULCUS_SOURCE_DIR) / "scenarios/four_labels.json"; }

  static void SetUpTestSuite() {
    fs::create_directories(folder());
    RunOptions run;
    run.scenario = scenario().string();
    run.out = folder() / "run";
    run.overrides = overrides();
    run.pictures = false;
    testing::internal::CaptureStdout();
    ASSERT_EQ(run_command(run), 0);
    testing::internal::GetCapturedStdout();
  }
  static void TearDownTestSuite() { fs::remove_all(folder()); }

  static ExportOptions options(const std::string& out, double at_s) {
    ExportOptions options;
    options.recording = folder() / "run" / "run.h5";
    options.at_s = at_s;
    options.out = folder() / out;
    return options;
  }

  // What the command says.
  static std::string export_volume(const ExportOptions& options) {
    testing::internal::CaptureStdout();
    const int code = export_volume_command(options);
    const std::string output = testing::internal::GetCapturedStdout();
    EXPECT_EQ(code, 0) << output;
    return output;
  }

  static void expect_refused(const ExportOptions& options, const std::string& says) {
    try {
      export_volume_command(options);
      FAIL() << "accepted; expected: " << says;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(says), std::string::npos) << error.what();
    }
    EXPECT_FALSE(fs::exists(options.out));
  }

  // A grey image in a space of its own that covers the tissue.
  static VoxelImage grey_image() {
    std::mt19937_64 random(5);
    VoxelImage image;
    image.geometry.size = {61, 57, 3};
    image.geometry.spacing = {0.0009, 0.0008, 0.002};
    image.geometry.origin = {-0.027, 0.0227, -0.002};
    image.geometry.direction << 1, 0, 0, 0, -1, 0, 0, 0, 1;
    image.type = VoxelType::int16;
    image.bytes.resize(61 * 57 * 3 * 2);
    for (char& byte : image.bytes) byte = static_cast<char>(random());
    return image;
  }
};

TEST_F(ExportVolume, AtRestIsTheLabelMapExactly) {
  const std::string output = export_volume(options("rest.nrrd", 0));
  EXPECT_NE(output.find(" 0 gaps, 0 folded"), std::string::npos) << output;
  const LabelMap map = load_label_map(load_scenario(scenario(), overrides()));
  EXPECT_EQ(read_label_map(folder() / "rest.nrrd").labels, map.labels);
}

TEST_F(ExportVolume, AtRestIsAnyGreyImageExactly) {
  const VoxelImage image = grey_image();
  write_image(folder() / "mri.nii.gz", image);
  for (const char* interpolation : {"nearest", "linear"}) {
    for (const char* name : {"grey.mha", "grey.nii.gz", "grey_series"}) {
      ExportOptions rest = options(name, 0);
      rest.like = folder() / "mri.nii.gz";
      rest.interpolation = interpolation;
      export_volume(rest);
      const VoxelImage again = read_image(rest.out, ImageUse::grey);
      fs::remove_all(rest.out);
      EXPECT_EQ(again.type, image.type);
      if (std::string(name) == "grey_series") continue;  // mirrored: its slices are in the other order
      EXPECT_EQ(again.bytes, image.bytes) << name << interpolation;
    }
  }
}

TEST_F(ExportVolume, OpenedShowsTheGapsWithTheFillValueAndCountsThem) {
  ExportOptions open = options("open.nrrd", -1);
  open.fill = 9;
  open.overlay = "max_principal_stress";
  const std::string output = export_volume(open);
  const LabelMap map = load_label_map(load_scenario(scenario(), overrides()));
  const LabelMap moved = read_label_map(open.out);
  const auto gaps = std::count(moved.labels.begin(), moved.labels.end(), 9);
  EXPECT_GT(gaps, 50);
  EXPECT_NE(output.find(" " + std::to_string(gaps) + " gaps, 0 folded"), std::string::npos) << output;
  // Region 3 and the base between the held nodes stay where they were; the top of the fissure is open.
  const auto at = [](const LabelMap& m, int i, int j) { return m.labels[m.index(i, j, 0)]; };
  EXPECT_EQ(at(moved, 22, 8), at(map, 22, 8));
  bool opened = false;
  for (int j = 0; j < map.size[1]; ++j) opened = opened || at(moved, 22, j) == 9;
  EXPECT_TRUE(opened);
  const VoxelImage stress = read_image(folder() / "open_max_principal_stress.nrrd", ImageUse::grey);
  EXPECT_EQ(stress.type, VoxelType::float32);
  const float* values = reinterpret_cast<const float*>(stress.bytes.data());
  EXPECT_GT(*std::max_element(values, values + map.voxel_count()), 10.0F);  // Pa
}

TEST_F(ExportVolume, TakesTheNearestFrame) {
  EXPECT_NE(export_volume(options("near.mha", 0.93)).find("at 1 s"), std::string::npos);
}

TEST_F(ExportVolume, RefusesWhatItCannotDo) {
  expect_refused(options("late.nrrd", 99), "behind the end");
  expect_refused(options("picture.tif", 0), "unknown image format");
  ExportOptions fill = options("fill.nrrd", 0);
  fill.fill = 0.5;
  expect_refused(fill, "--fill");
  VoxelImage elsewhere = grey_image();
  elsewhere.geometry.origin += Vec3(1, 0, 0);  // m
  write_image(folder() / "elsewhere.nrrd", elsewhere);
  ExportOptions other = options("other.nrrd", 0);
  other.like = folder() / "elsewhere.nrrd";
  expect_refused(other, "none of its voxels");
  other.like = folder() / "absent.nrrd";
  expect_refused(other, "does not exist");
  other.recording = folder() / "absent.h5";
  EXPECT_THROW(export_volume_command(other), InputError);
}

}  // namespace
}  // namespace sulcus
