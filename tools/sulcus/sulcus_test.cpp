// The command as a user meets it: whole runs, and what is said of wrong input.
#include <gtest/gtest.h>
#include <hdf5.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tools/sulcus/test_command.h"
#include "tools/sulcus/test_scenario.h"
#include "verify/recording.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

const fs::path source = SULCUS_SOURCE_DIR;
const char* const brain_map = "/usr/share/mricron/templates/jhu189.nii.gz";

using test::command;
using test::contains;
using test::fingerprint_of;
using test::read;
using test::Result;

// The tiny scenario with a rest at its end, so that all its statements can hold.
std::string resting_tiny() {
  std::string tiny = test::tiny_scenario;
  const std::string last = "{\"time_s\": 0.6, \"position_mm\": [0, 0, 27]}";
  tiny.replace(tiny.find(last), last.size(),
               "{\"time_s\": 0.5, \"position_mm\": [0, 0, 27]}, {\"time_s\": 0.6, \"path\": \"hold\"}");
  return tiny;
}

class Command : public testing::Test {
 protected:
  void SetUp() override {
    folder = fs::temp_directory_path() / ("sulcus_test_" + std::to_string(getpid()));
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  void TearDown() override { fs::remove_all(folder); }
  std::string out(const std::string& name) const { return (folder / name).string(); }

  // A run that is refused says why in one line, with this in it, and leaves nothing behind.
  void expect_refused(const std::string& arguments, int code, const std::string& says) {
    const Result result = command("run " + arguments + " --out " + out("refused"));
    EXPECT_EQ(result.code, code) << arguments << '\n' << result.output;
    EXPECT_TRUE(contains(result.output, "error: ")) << result.output;
    EXPECT_TRUE(contains(result.output, says)) << result.output;
    EXPECT_FALSE(fs::exists(folder / "refused" / "run.h5"));
    EXPECT_FALSE(fs::exists(folder / "refused" / "summary.json"));
  }

  fs::path folder;
};

// ---- whole runs

TEST_F(Command, CylinderRunsVerifiesReplaysAndReports) {
  const Result run = command("run cylinder_retraction --out " + out("run"));
  ASSERT_EQ(run.code, 0) << run.output;
  const Result verify = command("verify " + out("run") + " --golden '" + (source / "golden").string() + "'");
  EXPECT_EQ(verify.code, 0) << verify.output;
  EXPECT_TRUE(contains(verify.output, "golden/fingerprint")) << verify.output;
  EXPECT_TRUE(contains(verify.output, "golden/02_open.png") || contains(verify.output, ".png"))
      << verify.output;
  EXPECT_TRUE(fs::exists(folder / "run" / "junit.xml"));
  for (int threads : {1, 2, 3}) {
    const Result replay = command("replay " + out("run/run.h5") + " --threads " + std::to_string(threads));
    EXPECT_EQ(replay.code, 0) << replay.output;
    EXPECT_TRUE(contains(replay.output, "SAME")) << replay.output;
  }
  const Result report = command("report " + out("run") + " --out " + out("report.html"));
  EXPECT_EQ(report.code, 0) << report.output;
  EXPECT_TRUE(contains(read(folder / "report.html"), "penetration"));
  const Result again = command("run cylinder_retraction --out " + out("run"));
  EXPECT_EQ(again.code, 2) << "an existing folder must be refused";
  EXPECT_TRUE(contains(again.output, "--force")) << again.output;
}

TEST_F(Command, TissueThatTearsAllAtOnceIsExplained) {
  const Result run = command(
      "run fracture_pull --no-pictures --set /tissue/default/fracture_threshold_Pa=0.01 "
      "--set /tissue/labels/2/fracture_threshold_Pa=0.01 --set /fracture/criterion=largest_absolute "
      "--set /time/duration_s=0.4 --set /pictures/shots='[]' --out " +
      out("run"));
  EXPECT_EQ(run.code, 0) << run.output;
  EXPECT_TRUE(contains(run.output, "the whole tissue is torn")) << run.output;
  EXPECT_EQ(command("report " + out("run") + " --out " + out("report.html")).code, 0);
  EXPECT_TRUE(contains(read(folder / "report.html"), "Torn elements"));
}

// Moves the hand of a recording by a nanometre at one step, as if the engine had changed there.
void move_hand(const std::string& path, std::size_t steps, std::size_t step) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t data = H5Dopen(file, "/device/0/position_m", H5P_DEFAULT);
  ASSERT_GE(data, 0);
  std::vector<double> positions(3 * steps);
  ASSERT_GE(H5Dread(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, positions.data()), 0);
  positions[3 * step] += 1e-9;
  ASSERT_GE(H5Dwrite(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, positions.data()), 0);
  H5Dclose(data);
  H5Fclose(file);
  seal_recording(path);
}

TEST_F(Command, ReplayNamesTheFirstDifference) {
  std::ofstream(folder / "tiny.json") << test::tiny_scenario;
  ASSERT_EQ(command("run " + out("tiny.json") + " --no-pictures --out " + out("run")).code, 0);
  const std::string path = out("run/run.h5");
  move_hand(path, 60, 40);
  const Result replay = command("replay " + path);
  EXPECT_EQ(replay.code, 1) << replay.output;
  EXPECT_TRUE(
      contains(replay.output, "DIFFERS after 41 of 60 steps, first in stage sample, field device; then"))
      << replay.output;
  EXPECT_TRUE(contains(replay.output, "tool_poses")) << replay.output;
}

TEST_F(Command, DiffNamesStepStageFieldIndexValuesAndUlps) {
  std::ofstream(folder / "tiny.json") << test::tiny_scenario;
  const std::string run = "run " + out("tiny.json") + " --no-pictures --out ";
  ASSERT_EQ(command(run + out("a")).code, 0);
  ASSERT_EQ(command(run + out("b") + " --threads 1").code, 0);
  const Result same = command("diff " + out("a") + " " + out("b/run.h5"));
  EXPECT_EQ(same.code, 0) << same.output;
  EXPECT_TRUE(contains(same.output, "SAME  60 steps")) << same.output;

  ASSERT_EQ(command(run + out("c") + " --set /tissue/default/youngs_modulus_Pa=1234.5").code, 0);
  const Result other = command("diff " + out("a") + " " + out("c"));
  EXPECT_EQ(other.code, 1) << other.output;
  EXPECT_TRUE(contains(other.output, "DIFFERS after 1 of 60 steps, first in stage assembly, field "))
      << other.output;
  EXPECT_TRUE(contains(other.output, " against ")) << other.output;
  EXPECT_TRUE(contains(other.output, " ulps apart; ")) << other.output;
  EXPECT_TRUE(contains(other.output, "tools/0/contact_force_N")) << other.output;

  move_hand(out("b/run.h5"), 60, 40);
  const Result strange = command("diff " + out("a") + " " + out("b"));
  EXPECT_EQ(strange.code, 0) << "the samples themselves are not compared: " << strange.output;
}

TEST_F(Command, LockstepFindsTheFirstDifferenceOfTwoBuilds) {
  std::ofstream(folder / "tiny.json") << test::tiny_scenario;
  ASSERT_EQ(command("run " + out("tiny.json") + " --no-pictures --out " + out("run")).code, 0);
  const std::string path = out("run/run.h5"), moved = out("moved.h5");
  const Result same = command("replay " + path + " --threads 1 --lockstep " + SULCUS_COMMAND);
  EXPECT_EQ(same.code, 0) << same.output;
  EXPECT_TRUE(contains(same.output, "SAME  tiny: 60 steps of both builds")) << same.output;

  // another build is played by one that is given another recording
  fs::copy_file(path, moved);
  move_hand(moved, 60, 40);
  std::ofstream(folder / "other") << "#!/bin/sh\nshift 2\nexec '" << SULCUS_COMMAND << "' replay '" << moved
                                  << "' \"$@\"\n";
  fs::permissions(folder / "other", fs::perms::owner_all);
  const Result differs = command("replay " + path + " --threads 1 --lockstep " + out("other"));
  EXPECT_EQ(differs.code, 1) << differs.output;
  EXPECT_TRUE(contains(differs.output, "DIFFERS after 41 of 60 steps, first in stage sample, field device"))
      << differs.output;
  EXPECT_TRUE(contains(differs.output, "index 0: ")) << differs.output;
  EXPECT_TRUE(contains(differs.output, " ulps apart")) << differs.output;

  const Result nonsense = command("replay " + path + " --lockstep /bin/true");
  EXPECT_EQ(nonsense.code, 2) << nonsense.output;
  EXPECT_TRUE(contains(nonsense.output, "does not speak lockstep")) << nonsense.output;
  EXPECT_EQ(command("replay " + path + " --lockstep /no/such/program").code, 3);
}

TEST_F(Command, AShorterRunIsNotTheGoldenOne) {
  ASSERT_EQ(
      command("run cylinder_retraction --no-pictures --set /time/duration_s=1 --out " + out("run")).code, 0);
  const Result verify = command("verify " + out("run") + " --golden '" + (source / "golden").string() + "'");
  EXPECT_EQ(verify.code, 1) << verify.output;
  EXPECT_TRUE(contains(verify.output, "FAIL  golden/steps")) << verify.output;
}

TEST_F(Command, BrainGivesTheSameFingerprintWithOneThreadTwoThreadsAndTwiceInARow) {
  if (!fs::exists(brain_map)) GTEST_SKIP() << brain_map << " is missing: install the package mricron-data";
  std::string first;
  int number = 0;
  for (int threads : {1, 2, 2}) {
    const std::string name = "run" + std::to_string(number++);
    const Result run = command("run brain_sylvian_retraction --no-pictures --threads " +
                               std::to_string(threads) + " --out " + out(name));
    ASSERT_EQ(run.code, 0) << run.output;
    const std::string fingerprint = fingerprint_of(folder / name);
    ASSERT_EQ(fingerprint.size(), 16u);
    if (first.empty()) first = fingerprint;
    EXPECT_EQ(fingerprint, first) << threads;
  }
  EXPECT_TRUE(contains(read(source / "golden/brain_sylvian_retraction/golden.json"), first));
}

TEST_F(Command, MeshIsAVtkFileWithThePiecesApart) {
  std::ofstream(folder / "pairs.txt") << "# a comment\n[heading]\n35 23  # a pair\n";
  if (!fs::exists(brain_map)) GTEST_SKIP() << brain_map << " is missing: install the package mricron-data";
  const Result mesh = command(std::string("mesh ") + brain_map + " --size-mm 15 --pairs " + out("pairs.txt") +
                              " --out " + out("mesh.vtu"));
  ASSERT_EQ(mesh.code, 0) << mesh.output;
  const std::string text = read(folder / "mesh.vtu");
  EXPECT_TRUE(contains(text, "<VTKFile type=\"UnstructuredGrid\""));
  EXPECT_TRUE(contains(text, "</VTKFile>"));
  std::ofstream(folder / "bad.txt") << "35 23\n35 twenty\n";
  const Result bad =
      command(std::string("mesh ") + brain_map + " --pairs " + out("bad.txt") + " --out " + out("m.vtu"));
  EXPECT_EQ(bad.code, 2);
  EXPECT_TRUE(contains(bad.output, "bad.txt:2")) << bad.output;
  EXPECT_FALSE(fs::exists(folder / "m.vtu"));
}

// ---- the suite

TEST_F(Command, TheSuiteNamesWhatFailsAndGoesOn) {
  fs::create_directories(folder / "scenarios");
  const std::string tiny = resting_tiny();
  std::ofstream(folder / "scenarios" / "tiny.json") << tiny;
  std::string soft = tiny;
  soft.replace(soft.find("\"tiny\""), 6, "\"soft\"");
  std::ofstream(folder / "scenarios" / "soft.json") << soft;
  std::string wrong = tiny;
  wrong.replace(wrong.find("\"tiny\""), 6, "\"wrong\"");
  wrong.replace(wrong.find("size_mm"), 7, "size_cm");
  std::ofstream(folder / "scenarios" / "wrong.json") << wrong;
  const std::string arguments =
      "suite --scenarios " + out("scenarios") + " --golden '' --out " + out("suite");

  const Result good = command(arguments + " --jobs 2 --filter '^(tiny|soft)$'");
  EXPECT_EQ(good.code, 0) << good.output;
  EXPECT_TRUE(contains(good.output, "2 of 2 scenarios hold")) << good.output;
  EXPECT_TRUE(contains(read(folder / "suite" / "index.html"), "tiny/report.html"));
  EXPECT_TRUE(contains(read(folder / "suite" / "junit.xml"), "failures=\"0\""));
  EXPECT_TRUE(fs::exists(folder / "suite" / "tiny" / "report.html"));

  EXPECT_EQ(command(arguments).code, 2) << "earlier results must not be replaced silently";
  const Result bad = command(arguments + " --force");
  EXPECT_EQ(bad.code, 1) << bad.output;
  EXPECT_TRUE(contains(bad.output, "FAIL  wrong")) << bad.output;
  EXPECT_TRUE(contains(bad.output, "PASS  tiny")) << bad.output;
  EXPECT_TRUE(contains(read(folder / "suite" / "summary.md"), "size_cm"));
  EXPECT_TRUE(contains(read(folder / "suite" / "junit.xml"), "failures=\"1\""));

  EXPECT_EQ(command(arguments + " --force --filter nothing_is_called_so").code, 2);
  EXPECT_EQ(command(arguments + " --force --filter '['").code, 2);
  std::ofstream(folder / "scenarios" / "twin.json") << tiny;
  EXPECT_TRUE(contains(command(arguments + " --force").output, "both are called \"tiny\""));
}

TEST_F(Command, AMovieHasEveryFrame) {
  // ffmpeg is played by a script that counts what it is given
  fs::create_directories(folder / "bin");
  std::ofstream(folder / "bin" / "ffmpeg") << "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\n"
                                              "while [ \"$1\" != -i ]; do shift; done\n"
                                              "frames=$(ls \"$(dirname \"$2\")\" | grep -c png)\n"
                                              "for last; do :; done\necho \"$frames frames\" > \"$last\"\n";
  fs::permissions(folder / "bin" / "ffmpeg", fs::perms::owner_all);
  ASSERT_EQ(command("run circle_in_ring --set /time/duration_s=0.1 --set /pictures/width=120 "
                    "--set /pictures/height=90 --set /record/frame_every_steps=2 --set "
                    "/pictures/shots/1/time_s=0.1 --out " +
                    out("run"))
                .code,
            0);
  const std::size_t frames = read_run(folder / "run" / "run.h5").frames.size();
  const std::string path = std::getenv("PATH");
  setenv("PATH", (out("bin") + ":" + path).c_str(), 1);
  const Result film = command("movie " + out("run") + " --out " + out("film.mp4"));
  const Result strange = command("movie " + out("run") + " --out " + out("film.avi"));
  setenv("PATH", "/nowhere", 1);
  const Result missing = command("movie " + out("run") + " --out " + out("other.gif"));
  setenv("PATH", path.c_str(), 1);
  EXPECT_EQ(film.code, 0) << film.output;
  EXPECT_EQ(read(folder / "film.mp4"), std::to_string(frames) + " frames\n");
  EXPECT_GT(frames, 1u);
  EXPECT_EQ(strange.code, 2) << strange.output;
  EXPECT_EQ(missing.code, 3) << missing.output;
  EXPECT_TRUE(contains(missing.output, "install it")) << missing.output;
}

// ---- golden outputs

TEST_F(Command, AGoldenChangesWithAReasonAndFromACleanTreeOnly) {
  const std::string tiny = out("repository/tiny.json");
  fs::create_directories(folder / "repository" / "golden");
  std::ofstream(tiny) << test::tiny_scenario;
  const auto git = [&](const std::string& arguments) {
    return std::system(("git -C '" + out("repository") + "' -c user.name=a -c user.email=b " + arguments +
                        " > /dev/null 2>&1")
                           .c_str());
  };
  const std::string bless = "bless " + tiny + " --golden " + out("repository/golden");
  ASSERT_EQ(git("init"), 0);
  EXPECT_TRUE(contains(command(bless + " --why new").output, "tiny.json")) << "not committed yet";
  ASSERT_EQ(git("add ."), 0);
  ASSERT_EQ(git("commit -m tiny"), 0);
  EXPECT_EQ(command(bless).code, 2);
  const Result no_reason = command(bless + " --why ' '");
  EXPECT_EQ(no_reason.code, 2);
  EXPECT_TRUE(contains(no_reason.output, "reason")) << no_reason.output;
  // a run that breaks a statement (device and tool never rest) is no golden
  EXPECT_EQ(command(bless + " --why new").code, 1);
  EXPECT_FALSE(fs::exists(folder / "repository/golden/tiny/golden.json"));

  std::ofstream(tiny) << resting_tiny();
  EXPECT_EQ(command(bless + " --why new").code, 2) << "changed, not committed";
  ASSERT_EQ(git("commit -am rests"), 0);
  const Result good = command(bless + " --why 'a new scenario'");
  EXPECT_EQ(good.code, 0) << good.output;
  const std::string golden = read(folder / "repository/golden/tiny/golden.json");
  EXPECT_TRUE(contains(golden, "start moved by one ulp, double precision, solver tolerance / 10"));
  EXPECT_FALSE(contains(golden, "not measured"));
  EXPECT_TRUE(contains(read(folder / "repository/golden/tiny/provenance.json"), "a new scenario"));

  ASSERT_EQ(command("run " + tiny + " --out " + out("run")).code, 0);
  const std::string verify = "verify " + out("run") + " --golden " + out("repository/golden");
  EXPECT_EQ(command(verify).code, 0) << command(verify).output;
  std::ofstream(folder / "repository/golden/tiny/golden.json") << golden << " ";
  const Result touched = command(verify);
  EXPECT_EQ(touched.code, 1);
  EXPECT_TRUE(contains(touched.output, "changed without a reason: golden.json")) << touched.output;
}

// ---- help

TEST_F(Command, EveryCommandHasHelpWithAnExample) {
  for (const char* name : {"run", "verify", "replay", "report", "mesh", "bless", "list", "summary", "suite",
                           "diff", "fuzz", "movie"}) {
    const Result help = command(std::string(name) + " --help");
    EXPECT_EQ(help.code, 0) << name;
    EXPECT_TRUE(contains(help.output, std::string("Example: sulcus ") + name)) << help.output;
  }
  EXPECT_TRUE(contains(command("--help").output, "Exit codes"));
}

TEST_F(Command, ListShowsTheScenarios) {
  const Result list = command("list");
  EXPECT_EQ(list.code, 0);
  EXPECT_TRUE(contains(list.output, "brain_sylvian_retraction")) << list.output;
  EXPECT_TRUE(contains(list.output, "cylinder_retraction")) << list.output;
}

// ---- wrong input

TEST_F(Command, NonsenseOnTheCommandLineIsRefused) {
  EXPECT_EQ(command("").code, 2);
  EXPECT_EQ(command("fly").code, 2);
  EXPECT_EQ(command("run").code, 2);
  EXPECT_EQ(command("run cylinder_retraction --threads 0 --out " + out("x")).code, 2);
  EXPECT_EQ(command("verify " + out("nothing")).code, 2);
  EXPECT_EQ(command("replay " + out("nothing")).code, 2);
  EXPECT_EQ(command("mesh " + out("nothing") + " --out " + out("x.vtu")).code, 2);
}

TEST_F(Command, WrongScenariosAreRefused) {
  expect_refused("no_such_scenario", 2, "no such scenario");
  expect_refused("cylinder_retraction --set /tissue/default/youngs_modulus_Pa=-5", 2, "youngs_modulus_Pa");
  expect_refused("cylinder_retraction --set /tissue/default/youngs_modulus_Pa=soft", 2, "youngs_modulus_Pa");
  expect_refused("cylinder_retraction --set /time/duration_s=1000", 2, "duration");
  expect_refused("cylinder_retraction --set /label_map='{\"file\":\"missing.nrrd\"}'", 2, "missing.nrrd");
  std::string text = read(source / "scenarios/cylinder_retraction.json");
  const auto at = text.find("\"youngs_modulus_Pa\"");
  ASSERT_NE(at, std::string::npos);
  std::string unknown = text;
  unknown.replace(at, 19, "\"youngs_modulus_kPa\"");
  std::ofstream(folder / "unknown.json") << unknown;
  expect_refused(out("unknown.json"), 2, "youngs_modulus_Pa");  // the nearest known key
  std::ofstream(folder / "cut.json") << text.substr(0, text.size() / 2);
  expect_refused(out("cut.json"), 2, "line");
}

TEST_F(Command, PairsOfAbsentLabelsAreAWarning) {
  const Result run = command(
      "run cylinder_retraction --no-pictures --set /time/duration_s=0.2 "
      "--set /separation_pairs='[[2,3],[7,8]]' --out " +
      out("run"));
  EXPECT_EQ(run.code, 0) << run.output;
  EXPECT_TRUE(contains(run.output, "warning: ")) << run.output;
}

TEST_F(Command, PlacesThatCannotBeWrittenToAreSaid) {
  const Result run = command("run cylinder_retraction --no-pictures --out /proc/sulcus");
  EXPECT_EQ(run.code, 3) << run.output;
  EXPECT_TRUE(contains(run.output, "/proc/sulcus")) << run.output;
}

TEST_F(Command, ForceDoesNotEmptyAFolderThatIsNoRun) {
  fs::create_directories(folder / "precious");
  std::ofstream(folder / "precious" / "thesis.txt") << "years of work";
  const Result run = command("run cylinder_retraction --force --out " + out("precious"));
  EXPECT_EQ(run.code, 2) << run.output;
  EXPECT_TRUE(fs::exists(folder / "precious" / "thesis.txt"));
}

TEST_F(Command, ADamagedRecordingIsRefused) {
  ASSERT_EQ(
      command("run cylinder_retraction --no-pictures --set /time/duration_s=0.2 --out " + out("run")).code,
      0);
  fs::resize_file(folder / "run" / "run.h5", fs::file_size(folder / "run" / "run.h5") / 2);
  for (const char* name : {"verify ", "report "}) {
    const Result result = command(name + out("run"));
    EXPECT_EQ(result.code, 2) << result.output;
    EXPECT_TRUE(contains(result.output, "run.h5")) << result.output;
  }
}

// ---- places of rest, and work against precision

constexpr const char* hanging_bar = R"({
  "sulcus": 1, "name": "hanging",
  "label_map": {"generate": {"box": {"size_mm": [20, 20, 60], "voxel_size_mm": 10}}},
  "mesh": {"size_mm": 10},
  "tissue": {"gravity_m_s2": [9.81, 0, 0], "rayleigh_beta_s": 0.1},
  "boundary": {"fixed": [{"below_mm": {"axis": "z", "value": -30}}],
               "forces": [{"above_mm": {"axis": "z", "value": 30}, "force_N": [0, 0.01, 0]}]},
  "time": {"step_s": 0.1, "duration_s": 1}
})";

TEST_F(Command, FindsAPlaceOfRestAndRecordsIt) {
  std::ofstream(folder / "hanging.json") << hanging_bar;
  const std::string scenario = (folder / "hanging.json").string();
  const Result result = command("static " + scenario + " --out " + out("rest"));
  ASSERT_EQ(result.code, 0) << result.output;
  EXPECT_TRUE(contains(result.output, "fixed nodes hold with        (-0.2354, -0.01, ")) << result.output;
  const RunData run = read_run(folder / "rest" / "run.h5");
  EXPECT_LE(run.numbers.at("static/balance"), 1e-8);
  EXPECT_EQ(run.steps, 1);
  EXPECT_GT(run.find("tissue/max_displacement_m")->values[0], 0.005);
  const Result replay = command("replay " + out("rest") + "/run.h5");
  EXPECT_EQ(replay.code, 2);
  EXPECT_TRUE(contains(replay.output, "holds a place of rest")) << replay.output;
  // and what cannot rest is refused with its place, before anything is written
  const Result loose =
      command("static " + scenario + " --out " + out("loose") + " --set '/boundary/fixed=[]'");
  EXPECT_EQ(loose.code, 2);
  EXPECT_TRUE(
      contains(loose.output, "piece 1 of 1 of the mesh (24 cells around (0, 0, 0) mm) is held by nothing"))
      << loose.output;
  EXPECT_FALSE(fs::exists(folder / "loose"));
  const Result never = command("static " + scenario + " --time-s nan --out " + out("loose"));
  EXPECT_EQ(never.code, 2);
  EXPECT_TRUE(contains(never.output, "finite")) << never.output;
  // what is far beyond all numbers breaks a run off, which its exit code says
  const Result broken = command(
      "run " + scenario + " --no-pictures --set '/tissue/gravity_m_s2=[0,0,-1e300]' --out " + out("broken"));
  EXPECT_EQ(broken.code, 1);
  EXPECT_TRUE(contains(broken.output, "the run stops here")) << broken.output;
}

TEST_F(Command, MeasuresWorkAgainstPrecision) {
  std::ofstream(folder / "hanging.json") << hanging_bar;
  const std::string start =
      "work-precision " + (folder / "hanging.json").string() + " --threads 1 --repetitions 1 ";
  const Result result = command(
      start + "--vary /solver/tolerance=1e-1,1e-5 --vary /time/step_s=0.1,0.05 --out " + out("study"));
  ASSERT_EQ(result.code, 0) << result.output;
  const std::string csv = read(folder / "study" / "work_precision.csv");
  std::istringstream lines(csv);
  std::string line;
  std::getline(lines, line);
  std::vector<double> errors;
  while (std::getline(lines, line)) {
    std::istringstream cells(line);
    std::string cell;
    for (int c = 0; c < 5; ++c) std::getline(cells, cell, ',');
    errors.push_back(std::stod(cell));
  }
  ASSERT_EQ(errors.size(), 4u) << csv;
  EXPECT_LT(errors[3], errors[2]);  // a shorter step is better where the solver is good
  EXPECT_LT(errors[2], errors[0]);  // a better solver is better
  EXPECT_EQ(read(folder / "study" / "work_precision.png").substr(1, 3), "PNG");
  const Result unknown = command(start + "--vary /dt=0.1,0.2 --out " + out("unknown"));
  EXPECT_EQ(unknown.code, 2);
  EXPECT_TRUE(contains(unknown.output, "/dt")) << unknown.output;
  EXPECT_FALSE(fs::exists(folder / "unknown"));
  const Result twice =
      command(start + "--vary /time/step_s=0.1 --vary /time/step_s=0.05 --out " + out("unknown"));
  EXPECT_EQ(twice.code, 2);
  EXPECT_TRUE(contains(twice.output, "given twice")) << twice.output;
  // only one of these is what the scenario has by itself
  const Result starts = command(start + "--vary /solver/start=rest,velocity --out " + out("starts"));
  ASSERT_EQ(starts.code, 0) << starts.output;
  const std::string rows = read(folder / "starts" / "work_precision.md");
  EXPECT_FALSE(contains(rows, "**rest**")) << rows;
  EXPECT_TRUE(contains(rows, "**velocity**")) << rows;
}

}  // namespace
}  // namespace sulcus
