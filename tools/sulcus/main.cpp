// The sulcus command. Exit codes: 0 fine, 1 a check failed, 2 the input is wrong, 3 something in the
// environment failed.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <new>

#include "engine/numerics/error.h"
#include "tools/sulcus/build_info.h"
#include "tools/sulcus/commands.h"

namespace {

// A thread of OpenMP that waits for the others keeps its core for milliseconds, by the runtime's default.
// Where several programs share the cores, each then waits for threads that others keep from running. The
// runtime reads its settings once, as it is loaded, so the program starts itself again with a moderate one;
// what the user has set stays.
void wait_moderately(char** argv) {
  for (const char* setting : {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT"}) {
    if (std::getenv(setting) != nullptr) return;
  }
  if (setenv("GOMP_SPINCOUNT", "30000", 1) == 0) execv("/proc/self/exe", argv);
  // Without it everything works as well, if slower beside others.
}

int command_line(int argc, char** argv) {
  CLI::App app(
      "Sulcus: replay and verification of a haptic brain-retraction simulation.\n"
      "Exit codes: 0 fine, 1 a check failed, 2 the input is wrong, 3 something in the environment failed.");
  app.set_version_flag("--version", SULCUS_VERSION);
  app.require_subcommand(1);
  const CLI::Validator finite(
      [](std::string& text) {
        double value = 0;
        const bool is_finite = CLI::detail::lexical_cast(text, value) && std::isfinite(value);
        return is_finite ? std::string() : "found " + text + ", expected a finite number";
      },
      "FINITE");
  const CLI::Validator positive = CLI::PositiveNumber & finite,
                       not_negative = CLI::NonNegativeNumber & finite;
  int code = 0;

  sulcus::RunOptions run;
  auto* run_app = app.add_subcommand("run", "runs a scenario and records it");
  run_app->footer("Example: sulcus run cylinder_retraction --out /tmp/run --set /solver/tolerance=1e-5");
  run_app->add_option("SCENARIO", run.scenario, "JSON file, or a name that `sulcus list` shows")->required();
  run_app->add_option("--out", run.out, "folder for run.h5, summary.json and pictures")->required();
  run_app->add_option("--threads", run.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  run_app->add_option("--set", run.overrides, "/json/pointer=value, changes the scenario")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  run_app->add_flag("--force", run.force, "replaces an earlier run in the folder");
  run_app->add_flag("!--no-pictures", run.pictures, "renders no pictures");
  run_app->callback([&] { code = sulcus::run_command(run); });

  sulcus::StaticOptions rest;
  auto* static_app =
      app.add_subcommand("static", "finds the place of rest of a scenario without tools, and records it");
  static_app->footer("Example: sulcus static four_labels --out /tmp/rest");
  static_app->add_option("SCENARIO", rest.scenario, "JSON file, or a name that `sulcus list` shows")
      ->required();
  static_app->add_option("--out", rest.out, "folder for run.h5, summary.json and pictures")->required();
  static_app
      ->add_option("--time-s", rest.time_s, "with the motions where they are then (default: at the end)")
      ->check(not_negative);
  static_app->add_option("--threads", rest.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  static_app->add_option("--set", rest.overrides, "/json/pointer=value, changes the scenario")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  static_app->add_flag("--force", rest.force, "replaces an earlier run in the folder");
  static_app->add_flag("!--no-pictures", rest.pictures, "renders no pictures");
  static_app->callback([&] { code = sulcus::static_command(rest); });

  sulcus::WorkPrecisionOptions study;
  auto* study_app = app.add_subcommand(
      "work-precision",
      "runs a scenario with a matrix of settings: what they cost and what error they leave");
  study_app->footer(
      "Example: sulcus work-precision cylinder_retraction --vary /solver/tolerance=1e-1,1e-3 "
      "--vary /time/step_s=0.017,0.033 --out /tmp/study");
  study_app->add_option("SCENARIO", study.scenario, "JSON file, or a name that `sulcus list` shows")
      ->required();
  study_app->add_option("--vary", study.varied, "/json/pointer=value,value,...; several make a matrix")
      ->required()
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  study_app->add_option("--out", study.out, "folder for work_precision.md, .csv, .json and .png")->required();
  study_app->add_option("--set", study.overrides, "/json/pointer=value, changes the scenario for all runs")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  study_app
      ->add_option(
          "--reference", study.reference,
          "/json/pointer=value, changes the reference run (default: double precision, tolerance 1e-8, a "
          "quarter of the shortest time step, the smallest mesh size)")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  study_app->add_option("--repetitions", study.repetitions, "of each run, for the times")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  study_app->add_option("--threads", study.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  study_app->callback([&] { code = sulcus::work_precision_command(study); });

  sulcus::VerifyOptions verify;
  auto* verify_app = app.add_subcommand("verify", "checks invariants and golden outputs of a run");
  verify_app->footer("Example: sulcus verify /tmp/run --golden golden");
  verify_app->add_option("DIR", verify.run, "folder of the run")->required();
  verify_app->add_option("--golden", verify.golden, "folder of golden outputs (default: invariants only)");
  verify_app->callback([&] { code = sulcus::verify_command(verify); });

  sulcus::VerifyOptions summary;
  auto* summary_app =
      app.add_subcommand("summary", "prints the numbers and verdicts of a run as a short table");
  summary_app->footer("Example: sulcus summary /tmp/run --golden golden");
  summary_app->add_option("DIR", summary.run, "folder of the run")->required();
  summary_app->add_option("--golden", summary.golden, "folder of golden outputs (default: invariants only)");
  summary_app->callback([&] { code = sulcus::summary_command(summary.run, summary.golden); });

  sulcus::ReplayOptions replay;
  auto* replay_app = app.add_subcommand("replay", "runs again from the recorded device samples and compares");
  replay_app->footer("Example: sulcus replay /tmp/run/run.h5 --threads 1");
  replay_app->add_option("RECORDING", replay.recording, "run.h5")->required();
  replay_app->add_option("--threads", replay.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  replay_app->add_option("--lockstep", replay.lockstep,
                         "another build of sulcus: runs beside this one, until a number differs");
  replay_app->add_flag("--serve-lockstep", replay.serve)->group("");  // what the other one is told
  replay_app->callback([&] { code = sulcus::replay_command(replay); });

  sulcus::DiffOptions diff;
  auto* diff_app =
      app.add_subcommand("diff", "finds where two recordings part: step, stage, field, index, both values");
  diff_app->footer("Example: sulcus diff /tmp/before /tmp/after");
  diff_app->add_option("A", diff.a, "folder of a run, or run.h5")->required();
  diff_app->add_option("B", diff.b, "folder of a run, or run.h5")->required();
  diff_app->add_option("--threads", diff.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  diff_app->callback([&] { code = sulcus::diff_command(diff); });

  const auto add_phantom = [&positive](CLI::App* to, sulcus::PhantomOptions& phantom) {
    to->add_option("--library", phantom.library, "file of the Phantom's libHD (default: searched)");
    to->add_option("--device-name", phantom.device_name, "the Phantom's name in its driver");
    to->add_option("--calibration-timeout-s", phantom.calibration_timeout_s,
                   "for the user to dock the stylus")
        ->check(positive)
        ->capture_default_str();
  };
  sulcus::SessionOptions session;
  auto* session_app =
      app.add_subcommand("session", "runs a scenario in real time with a device, and records it");
  session_app->footer("Example: sulcus session brain_sylvian_retraction --device phantom --max-force-N 0.1");
  session_app->add_option("SCENARIO", session.scenario, "JSON file, or a name that `sulcus list` shows")
      ->required();
  session_app->add_option("--device", session.device, "who moves the tool")
      ->check(CLI::IsMember({"phantom", "scripted", "recorded"}))
      ->capture_default_str();
  session_app->add_option("--out", session.out, "folder for run.h5 (default: session_<date>_<time>)");
  session_app->add_option("--from", session.from, "recorded: run.h5, or a table (.csv, docs/devices.md)");
  session_app->add_option("--tool", session.tool,
                          "tool that a phantom or a table moves (default: the first)");
  session_app
      ->add_option("--hand", session.hand, "scripted: a hand that feels the force and follows the script")
      ->check(CLI::IsMember({"light", "firm", "alone"}));
  session_app
      ->add_option("--fault", session.faults, "name=value, spoils the device's samples (docs/devices.md)")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  session_app
      ->add_option("--filter-Hz", session.filter_Hz,
                   "cut-off of the rendered force, 0 for none (default: the scenario's output_filter_Hz)")
      ->check(not_negative);
  session_app->add_option("--duration-s", session.duration_s, "ends the session")->check(positive);
  session_app->add_option("--threads", session.threads, "threads of the engine (default: all but one)")
      ->check(CLI::Range(1, 256));
  session_app->add_option("--set", session.overrides, "/json/pointer=value, changes the scenario")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  session_app->add_flag("--force", session.force, "replaces an earlier run in the folder");
  session_app->add_flag("!--no-realtime", session.realtime,
                        "asks for no real-time priority, locks no memory");
  add_phantom(session_app, session.phantom);
  session_app->add_option("--max-force-N", session.phantom.max_force_N, "phantom: largest force on the hand")
      ->check(positive);
  session_app->add_option("--turn-deg", session.phantom.turn_deg, "phantom: turned about the scene's z axis");
  session_app->add_option("--tip-offset-mm", session.phantom.tip_offset_mm, "phantom: from gimbal to tip");
  session_app
      ->add_option("--hold-button", session.phantom.hold_button, "phantom: force only while it is down")
      ->check(CLI::Range(0, 3));
  session_app->callback([&] { code = sulcus::session_command(session); });

  sulcus::RecoverOptions recover;
  auto* recover_app =
      app.add_subcommand("recover", "makes a recording of a session or a run that was killed");
  recover_app->footer("Example: sulcus recover session_20260131_101500");
  recover_app->add_option("DIR", recover.folder, "folder of the session or run")->required();
  recover_app->add_option("--threads", recover.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  recover_app->callback([&] { code = sulcus::recover_command(recover); });

  sulcus::DeviceOptions device;
  auto* device_app = app.add_subcommand("device", "looks at devices without moving them");
  device_app->footer("Example: sulcus device --check phantom");
  device_app->add_flag("--list", device.list, "shows the kinds of devices, and whether their driver is here");
  device_app->add_option("--check", device.check, "tries everything but force")
      ->check(CLI::IsMember({"phantom"}));
  device_app->add_option("--seconds", device.watch_s, "for which the servo is watched")
      ->check(positive)
      ->capture_default_str();
  add_phantom(device_app, device.phantom);
  device_app->callback([&] { code = sulcus::device_command(device); });

  sulcus::ReportOptions report;
  auto* report_app = app.add_subcommand("report", "writes a self-contained HTML page of one or more runs");
  report_app->footer("Example: sulcus report /tmp/run --out report.html");
  report_app->add_option("DIR", report.runs, "folders of runs")->required();
  report_app->add_option("--out", report.out, "HTML file")->capture_default_str();
  report_app->add_option("--golden", report.golden, "folder of golden outputs");
  report_app->callback([&] { code = sulcus::report_command(report); });

  sulcus::MovieOptions movie;
  auto* movie_app = app.add_subcommand("movie", "makes a film of a run's frames, by ffmpeg");
  movie_app->footer("Example: sulcus movie /tmp/run/run.h5 --out run.mp4");
  movie_app->add_option("RUN", movie.run, "folder of a run, or run.h5")->required();
  movie_app->add_option("--out", movie.out, "film, .mp4 or .gif")->capture_default_str();
  movie_app->add_option("--shot", movie.shot, "picture of the scenario whose view and colours it takes");
  movie_app->callback([&] { code = sulcus::movie_command(movie); });

  sulcus::MeshOptions mesh;
  auto* mesh_app = app.add_subcommand("mesh", "meshes a label map, for a look in ParaView");
  mesh_app->footer("Example: sulcus mesh brain.nii.gz --size-mm 10 --pairs pairs.txt --out mesh.vtu");
  mesh_app->add_option("LABELMAP", mesh.label_map, "NRRD, NIfTI or MetaImage file")->required();
  mesh_app->add_option("--size-mm", mesh.size_mm, "edge of a cell, mm")->capture_default_str();
  mesh_app->add_option("--pairs", mesh.pairs, "text file of separation label pairs, two labels a line");
  mesh_app->add_option("--split", mesh.split, "tetrahedra of a cell")
      ->check(CLI::IsMember({"five", "six"}))
      ->capture_default_str();
  mesh_app->add_option("--min-island-cells", mesh.min_island_cells, "pieces of fewer cells are left out")
      ->check(not_negative);
  mesh_app->add_option("--out", mesh.out, "VTK file (.vtu)")->required();
  mesh_app->callback([&] { code = sulcus::mesh_command(mesh); });

  sulcus::ExportOptions exported;
  auto* export_app = app.add_subcommand("export-volume", "applies a recorded deformation to an image");
  export_app->footer(
      "Example: sulcus export-volume out/run.h5 --at 4.8 --like mri.nii.gz --interp linear --out open.nrrd");
  export_app->add_option("RECORDING", exported.recording, "run.h5, or the folder of a run")->required();
  export_app->add_option("--at", exported.at_s, "s; the nearest recorded frame is taken (default: the end)")
      ->check(not_negative);
  export_app->add_option("--like", exported.like,
                         "label or grey image in the space of the label map: NRRD, NIfTI, MetaImage or a "
                         "folder with a DICOM series (default: the label map)");
  export_app
      ->add_option("--out", exported.out,
                   ".nrrd, .nii, .nii.gz, .mha, .mhd; a name without ending: folder with a DICOM series")
      ->required();
  export_app->add_option("--interp", exported.interpolation, "nearest for labels, linear for grey values")
      ->check(CLI::IsMember({"nearest", "linear"}))
      ->capture_default_str();
  export_app->add_option("--overlay", exported.overlay, "a second image, <out>_<overlay>, of this quantity")
      ->check(CLI::IsMember({"max_principal_stress"}));
  export_app->add_option("--fill", exported.fill, "value of gaps and folds")->capture_default_str();
  export_app->callback([&] { code = sulcus::export_volume_command(exported); });

  sulcus::ExportSurfaceOptions surface;
  auto* surface_app =
      app.add_subcommand("export-surface", "writes the deformed surface of a set of labels as triangles");
  surface_app->footer("Example: sulcus export-surface out/run.h5 --labels 1015,1030 --out temporal.ply");
  surface_app->add_option("RECORDING", surface.recording, "run.h5, or the folder of a run")->required();
  surface_app->add_option("--at", surface.at_s, "s; the nearest recorded frame is taken (default: the end)")
      ->check(not_negative);
  surface_app->add_option("--labels", surface.labels, "the labels that are one body (default: all)")
      ->delimiter(',');
  surface_app->add_option("--out", surface.out, ".ply, .stl or .obj, in world millimetres")->required();
  surface_app
      ->add_option("--smoothing", surface.smoothing_passes,
                   "passes over the voxels' faces, each vertex kept within half a voxel")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  surface_app->callback([&] { code = sulcus::export_surface_command(surface); });

  sulcus::BlessOptions bless;
  bless.golden = SULCUS_GOLDEN_DIR;
  auto* bless_app = app.add_subcommand(
      "bless", "makes what a scenario gives now its golden output, with measured tolerances and a reason");
  bless_app->footer("Example: sulcus bless cylinder_retraction --why 'the contact stiffness was wrong'");
  bless_app->add_option("SCENARIO", bless.scenario, "JSON file, or a name that `sulcus list` shows")
      ->required();
  bless_app->add_option("--why", bless.why, "the reason, for those who review it")->required();
  bless_app->add_option("--golden", bless.golden, "folder of golden outputs")->capture_default_str();
  bless_app->add_option("--threads", bless.threads, "threads of the engine (default: all)")
      ->check(CLI::Range(1, 256));
  bless_app->callback([&] { code = sulcus::bless_command(bless); });

  sulcus::SuiteOptions suite;
  suite.scenarios = SULCUS_SCENARIO_DIR;
  suite.golden = SULCUS_GOLDEN_DIR;
  auto* suite_app = app.add_subcommand(
      "suite", "runs scenarios, replays, verifies and reports them; index.html, junit.xml, summary.md");
  suite_app->footer("Example: sulcus suite --filter '^brain_' --jobs 2 --out /tmp/suite");
  suite_app->add_option("--filter", suite.filter, "regular expression for names (default: all)");
  suite_app->add_option("--jobs", suite.jobs, "scenarios at a time (default: one a core)")
      ->check(CLI::Range(1, 256));
  suite_app->add_option("--out", suite.out, "folder for the results")->capture_default_str();
  suite_app->add_option("--scenarios", suite.scenarios, "folder of scenarios")->capture_default_str();
  suite_app->add_option("--golden", suite.golden, "folder of golden outputs; '' for statements only")
      ->capture_default_str();
  suite_app->add_flag("--force", suite.force, "replaces earlier results in the folder");
  suite_app->callback([&] { code = sulcus::suite_command(suite); });

  sulcus::FuzzOptions fuzz;
  auto* fuzz_app = app.add_subcommand("fuzz", "runs random scenarios; statements judge them");
  fuzz_app->footer("Example: sulcus fuzz --seconds 60 --seed 1000 --out /tmp/fuzz");
  fuzz_app->add_option("--seconds", fuzz.seconds, "after which no further seed is begun")
      ->check(positive)
      ->capture_default_str();
  fuzz_app->add_option("--seed", fuzz.seed, "the first seed")->capture_default_str();
  fuzz_app->add_option("--seeds", fuzz.seeds, "how many at most (default: as many as there is time for)")
      ->check(positive);
  fuzz_app->add_option("--out", fuzz.out, "folder for the scenarios that fail")->capture_default_str();
  fuzz_app->callback([&] { code = sulcus::fuzz_command(fuzz); });

  sulcus::PerfReportOptions performance;
  performance.history = SULCUS_GOLDEN_DIR "/performance";
  auto* performance_app =
      app.add_subcommand("perf-report", "draws trend lines of instruction counts and times over the commits");
  performance_app->footer("Example: sulcus perf-report --out /tmp/performance.html");
  performance_app->add_option("--history", performance.history, "folder of counts.json and times.json")
      ->capture_default_str();
  performance_app->add_option("--out", performance.out, "HTML file")->capture_default_str();
  performance_app->callback([&] { code = sulcus::perf_report_command(performance); });

  std::string scenarios = SULCUS_SCENARIO_DIR;
  auto* list_app = app.add_subcommand("list", "shows the scenarios");
  list_app->footer("Example: sulcus list");
  list_app->add_option("--dir", scenarios, "folder of scenarios")->capture_default_str();
  list_app->callback([&] { code = sulcus::list_command(scenarios); });

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  wait_moderately(argv);
  // A limit on the size of files is told as a file that cannot be written, a reader that goes away not at
  // all.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  try {
    return command_line(argc, argv);
  } catch (const sulcus::InputError& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 2;
  } catch (const sulcus::EnvironmentError& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 3;
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "error: out of memory; use a larger mesh size or a machine with more memory\n");
    return 3;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 3;
  }
}
