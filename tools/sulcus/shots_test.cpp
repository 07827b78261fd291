// The views that a scenario asks for, the golden ones among them, and films.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/golden_pictures.h"
#include "tools/sulcus/process.h"
#include "tools/sulcus/test_scenario.h"
#include "verify/picture.h"
#include "verify/picture_diff.h"
#include "verify/png.h"
#include "verify/recording.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;
using nlohmann::json;

// One run for all tests: a ball pressed into a block, seen in every way at the moment of the deepest press.
class Shots : public testing::Test {
 protected:
  static fs::path folder() {
    return fs::temp_directory_path() / ("sulcus_shots_test_" + std::to_string(getpid()));
  }
  static fs::path run_dir() { return folder() / "run"; }

  static json scenario() {
    json document = json::parse(test::tiny_scenario);
    document["time"]["duration_s"] = 0.32;
    document["pictures"] = json::parse(R"({
      "width": 160, "height": 120, "arrow_mm_per_N": 200,
      "grey_image": {"file": "grey.nrrd", "black": 0, "white": 200},
      "camera": {"eye_mm": [120, -130, 90], "target_mm": [0, 0, 5]},
      "shots": [
        {"name": "labels", "time_s": 0.3},
        {"name": "stress", "time_s": 0.3, "show": "max_principal_stress"},
        {"name": "displacement", "time_s": 0.3, "show": "displacement", "golden": true},
        {"name": "contacts", "time_s": 0.3, "contacts": true},
        {"name": "cut", "time_s": 0.3, "cut": {"point_mm": [0, 0, 0], "normal": [0, -1, 0]}},
        {"name": "slice", "time_s": 0.3,
         "slice": {"point_mm": [0, 0, 5], "normal": [0, -1, 0], "up": [0, 0, 1], "height_mm": 60}},
        {"name": "grey", "time_s": 0.3, "image": "grey", "golden": true,
         "slice": {"point_mm": [0, 0, 5], "normal": [0, -1, 0], "up": [0, 0, 1], "height_mm": 60}},
        {"name": "grey_stress", "time_s": 0.3, "image": "grey", "show": "max_principal_stress",
         "slice": {"point_mm": [0, 0, 5], "normal": [0, -1, 0], "up": [0, 0, 1], "height_mm": 60}}
      ]})");
    return document;
  }

  // Grey values of 5 a millimetre along x, 100 in the middle.
  static void write_grey() {
    VoxelImage image;
    image.geometry.size = {40, 40, 40};
    image.geometry.spacing = Vec3::Constant(1e-3);
    image.geometry.origin = Vec3::Constant(-19.5e-3);
    for (std::size_t v = 0; v < 40 * 40 * 40; ++v)
      image.bytes.push_back(static_cast<char>(std::uint8_t(5 * (v % 40) + 2)));
    write_image(folder() / "grey.nrrd", image);
  }

  static void SetUpTestSuite() {
    fs::create_directories(folder());
    write_grey();
    std::ofstream(folder() / "tiny.json") << scenario().dump();
    RunOptions run;
    run.scenario = (folder() / "tiny.json").string();
    run.out = run_dir();
    testing::internal::CaptureStdout();
    ASSERT_EQ(run_command(run), 0);
    testing::internal::GetCapturedStdout();
  }
  static void TearDownTestSuite() { fs::remove_all(folder()); }

  static Image picture(const std::string& name) {
    for (const fs::path& file : picture_files(run_dir())) {
      if (file.stem().string().substr(3) == name) return read_png(file);
    }
    ADD_FAILURE() << "no picture " << name;
    return {};
  }
  static Colour pixel(const Image& image, int x, int y) {
    const auto p = static_cast<std::size_t>(3 * (y * image.width + x));
    return {image.rgb[p], image.rgb[p + 1], image.rgb[p + 2]};
  }
  static Scenario loaded(const json& document) {
    return load_scenario_text(document.dump(), "tiny.json", folder());
  }
  static void expect_refused(const std::function<void(json&)>& change, const std::string& says) {
    json document = scenario();
    change(document["pictures"]);
    try {
      loaded(document);
      ADD_FAILURE() << "not refused, expected: " << says;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(says), std::string::npos) << error.what();
    }
  }
};

TEST_F(Shots, EveryViewIsAPictureOfItsOwn) {
  const std::vector<fs::path> files = picture_files(run_dir());
  ASSERT_EQ(files.size(), 8u);
  for (std::size_t a = 0; a < files.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      EXPECT_GT(compare_pictures(read_png(files[a]), read_png(files[b]), 5).differing_fraction, 0.002)
          << files[a] << files[b];
    }
  }
}

TEST_F(Shots, ASliceCarriesTheGreyImageToWhereItsTissueIs) {
  const Image grey = picture("grey");
  // 20 mm below the middle of the picture, away from the ball: hardly moved. Half a millimetre a pixel.
  for (const int x_mm : {-15, -6, 6, 15}) {
    const Colour found = pixel(grey, 80 + 2 * x_mm, 60 + 40);
    EXPECT_NEAR(found[0], 255 * (100 + 5 * x_mm) / 200.0, 12) << x_mm;
    EXPECT_EQ(found[0], found[1]);
    EXPECT_EQ(found[0], found[2]);
  }
  const Colour outside = pixel(grey, 10, 100), tool = pixel(grey, 80, 60 - 35);
  EXPECT_GT(outside[0], 200);
  EXPECT_GT(tool[2], tool[0]);  // steel, bluish
  // stress tints tissue alone
  EXPECT_EQ(pixel(picture("grey_stress"), 10, 100), outside);
}

TEST_F(Shots, ContactsAndForceAreMarked) {
  const Image plain = picture("labels"), marked = picture("contacts");
  const PictureDifference difference = compare_pictures(plain, marked, 5);
  EXPECT_GT(difference.max_block_distance, 15);
  EXPECT_LT(difference.differing_fraction, 0.2);
}

TEST_F(Shots, WhatCannotBeShownIsRefused) {
  expect_refused([](json& p) { p["shots"][5]["cut"] = p["shots"][4]["cut"]; },
                 "/pictures/shots/5: found both");
  expect_refused([](json& p) { p["shots"][5]["slice"]["up"] = {0, 2, 0}; }, "/pictures/shots/5/slice/up");
  expect_refused([](json& p) { p["shots"][4]["cut"]["normal"] = {0, 0, 0}; }, "/pictures/shots/4/cut/normal");
  expect_refused([](json& p) { p["shots"][0]["image"] = "grey"; }, "/pictures/shots/0/image");
  expect_refused([](json& p) { p.erase("grey_image"); }, "no grey image");
  expect_refused([](json& p) { p["grey_image"]["file"] = "absent.nrrd"; }, "/pictures/grey_image/file");
  expect_refused([](json& p) { p["grey_image"]["white"] = -1; }, "/pictures/grey_image/white");
  expect_refused([](json& p) { p["shots"][0]["range_Pa"] = {0, 1}; }, "/pictures/shots/0/range_Pa");
  expect_refused([](json& p) { p["shots"][1]["range_Pa"] = {5, 1}; }, "the smaller number first");
  expect_refused([](json& p) { p["shots"][1]["range_mm"] = {0, 1}; }, "/pictures/shots/1/range_mm");
  expect_refused([](json& p) { p["shots"][1]["name"] = "labels"; }, "taken");
}

TEST_F(Shots, AreReadInSIUnits) {
  json document = scenario();
  document["pictures"]["shots"][2]["range_mm"] = {1, 20};
  const Pictures pictures = loaded(document).pictures;
  EXPECT_DOUBLE_EQ(pictures.arrow_m_per_N, 0.2);
  EXPECT_DOUBLE_EQ((*pictures.shots[2].range)[1], 0.02);
  EXPECT_DOUBLE_EQ(pictures.shots[5].slice->height_m, 0.06);
  EXPECT_DOUBLE_EQ(pictures.shots[5].slice->point_m[2], 0.005);
  EXPECT_EQ(pictures.grey->file, folder() / "grey.nrrd");
  // a recording's scenario finds the image from anywhere
  const Scenario again = load_scenario_text(loaded(document).resolved_json, "again", "/");
  EXPECT_TRUE(fs::exists(again.pictures.grey->file));
}

TEST_F(Shots, ThoseThatAskForItAreKeptAsGolden) {
  const auto kept = [&](const json& document) {
    const fs::path golden = folder() / "golden";
    fs::create_directories(golden);
    write_golden_pictures(loaded(document), run_dir(), golden);
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(golden))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  };
  using Names = std::vector<std::string>;
  EXPECT_EQ(kept(scenario()), (Names{"02_displacement.png", "06_grey.png"}));
  json none = scenario();
  for (json& shot : none["pictures"]["shots"]) shot.erase("golden");
  EXPECT_EQ(kept(none), (Names{"00_labels.png", "04_cut.png"}));
}

TEST_F(Shots, AGoldenPictureThatDiffersIsShownBesideTheRun) {
  const fs::path golden = folder() / "compared";
  fs::create_directories(golden);
  write_golden_pictures(loaded(scenario()), run_dir(), golden);
  const GoldenSettings settings;
  std::vector<Check> checks = check_pictures(run_dir(), golden, settings);
  ASSERT_EQ(checks.size(), 4u);  // two of each picture
  EXPECT_TRUE(all_passed(checks));
  EXPECT_TRUE(differing_pictures(run_dir(), golden, settings).empty());

  // a mark of 2 x 4 pixels too few in the golden one
  Image image = read_png(golden / "06_grey.png");
  for (int y = 4; y < 8; ++y) {
    for (int x = 4; x < 6; ++x) image.rgb[static_cast<std::size_t>(3 * (y * image.width + x))] = 0;
  }
  write_png(image, golden / "06_grey.png");
  checks = check_pictures(run_dir(), golden, settings);
  for (const Check& check : checks)
    EXPECT_EQ(check.passed, check.name != "golden/06_grey.png/blocks") << check_line(check);
  const std::vector<ReportPicture> shown = differing_pictures(run_dir(), golden, settings);
  ASSERT_EQ(shown.size(), 3u);
  EXPECT_EQ(shown[0].caption, "grey, golden");
  EXPECT_EQ(shown[0].image.rgb, image.rgb);
  EXPECT_EQ(pixel(shown[2].image, 4, 4)[2], 0);  // glows

  write_png(shrunk(image, 2), golden / "02_displacement.png");
  write_png(image, golden / "09_unknown.png");
  int failed = 0;
  for (const Check& check : check_pictures(run_dir(), golden, settings)) failed += !check.passed;
  EXPECT_EQ(failed, 3);  // size, blocks, missing
}

TEST_F(Shots, AFilmHasEveryFrame) {
  if (run_program({"ffprobe", "-version"}, folder() / "log") != 0)
    GTEST_SKIP() << "ffmpeg is not installed (Debian: ffmpeg), so no film is made";
  const std::size_t frames = read_run(run_dir() / "run.h5").frames.size();
  for (const char* name : {"film.mp4", "film.gif"}) {
    const fs::path film = folder() / name;
    testing::internal::CaptureStdout();
    ASSERT_EQ(movie_command({run_dir(), film, "contacts"}), 0);
    testing::internal::GetCapturedStdout();
    const fs::path said = folder() / "said";
    fs::remove(said);
    ASSERT_EQ(run_program({"ffprobe", "-v", "error", "-count_frames", "-show_entries",
                           "stream=nb_read_frames,width,height", "-of", "csv=p=0", film.string()},
                          said),
              0);
    EXPECT_EQ(last_line(said), "160,120," + std::to_string(frames)) << name;
  }
  EXPECT_THROW(movie_command({run_dir(), folder() / "film.mp4", "unknown"}), InputError);
}

}  // namespace
}  // namespace sulcus
