// `sulcus movie`: the frames of a recording as a film, by ffmpeg.
#include <algorithm>
#include <cstdio>

#include "engine/numerics/error.h"
#include "tools/sulcus/commands.h"
#include "tools/sulcus/process.h"
#include "tools/sulcus/shots.h"
#include "tools/sulcus/support.h"
#include "tools/sulcus/temporary_folder.h"

namespace sulcus {
namespace fs = std::filesystem;
namespace {

State state_of(const RunData& run, const Frame& frame) {
  State state = run.final_state;
  state.step = frame.step;
  state.positions = frame.positions;
  state.tool_poses = frame.tool_poses;
  state.alive = frame.alive;
  return state;
}

// Of the step that led to a frame.
std::vector<Vec3> recorded_forces(const RunData& run, const Frame& frame) {
  std::vector<Vec3> forces;
  const auto add = [&](const std::string& body, std::size_t number) {
    const Series* force = run.find(body + "/" + std::to_string(number) + "/contact_force_N");
    const auto at = static_cast<std::size_t>(3 * (frame.step - 1));
    const bool there = force != nullptr && frame.step > 0 && at + 3 <= force->values.size();
    forces.push_back(there ? Vec3(force->values[at], force->values[at + 1], force->values[at + 2])
                           : Vec3::Zero());
  };
  for (std::size_t t = 0; t < run.header.tool_names.size(); ++t) add("tools", t);
  for (std::size_t o = 0; o < run.header.obstacle_names.size(); ++o) add("obstacles", o);
  return forces;
}

// Without its name, which would stand in every frame.
Shot wanted_shot(const Scenario& scenario, const std::string& name, const fs::path& recording) {
  std::string names;
  for (Shot shot : scenario.pictures.shots) {
    names += (names.empty() ? "" : ", ") + shot.name;
    if (!name.empty() && name != shot.name) continue;
    shot.name.clear();
    return shot;
  }
  if (names.empty())
    throw InputError(recording.string() +
                     ": its scenario has no pictures, so nobody knows where to look from");
  throw InputError(recording.string() + ": its scenario has no picture \"" + name + "\"; give one of " +
                   names);
}

// Frames a second, so that a second of the film is one of the run; of a film of few frames, slower.
double frames_per_second(const RunData& run) {
  const double duration_s = run.frames.back().time_s - run.frames.front().time_s;
  return duration_s > 0 ? std::clamp(static_cast<double>(run.frames.size() - 1) / duration_s, 1.0, 60.0) : 1;
}

}  // namespace

int movie_command(const MovieOptions& options) {
  const std::string kind = options.out.extension();
  if (kind != ".mp4" && kind != ".gif")
    throw InputError(options.out.string() + ": a film is a .mp4 or a .gif; give such a name with --out");
  const fs::path recording = fs::is_directory(options.run) ? options.run / "run.h5" : options.run;
  const RunData run = read_run(recording);
  const TemporaryFolder folder;
  if (run_program({"ffmpeg", "-version"}, folder.path / "log") != 0) {
    throw EnvironmentError(
        "ffmpeg, which makes the film, cannot be started; install it (Debian: ffmpeg), or look at the "
        "pictures of "
        "`sulcus report`");
  }
  Scenario scenario = load_scenario_text(run.header.scenario_json, recording.string(), ".");
  const Scene scene = make_scene(scenario);
  if (scene.node_count() != run.header.node_count() || run.frames.empty())
    throw InputError(recording.string() +
                     ": has no frames of the mesh that its scenario gives, so there is no film");

  Shot shot = wanted_shot(scenario, options.shot, recording);
  scenario.pictures.width = scenario.pictures.width / 2 * 2;  // as the codec asks
  scenario.pictures.height = scenario.pictures.height / 2 * 2;
  ShotRenderer renderer(scenario, scene);
  const auto seen = [&](std::size_t f) {
    return ShotFrame{shot, state_of(run, run.frames[f]), recorded_forces(run, run.frames[f])};
  };
  if (!shot.range) {
    std::optional<std::array<double, 2>> range;
    for (const Frame& frame : run.frames) widen_range(scene, state_of(run, frame), shot, range);
    shot.range = range;
  }
  Progress progress(scenario.name + ": frames", static_cast<std::int64_t>(run.frames.size()));
  for (std::size_t f = 0; f < run.frames.size(); ++f) {
    char name[32];
    std::snprintf(name, sizeof name, "%06zu.png", f);
    write_png(renderer.image(seen(f)), folder.path / name);
    progress.at(static_cast<std::int64_t>(f) + 1);
  }

  // written beside its place and renamed, so that nothing half-written stands under its name
  const fs::path part = options.out.parent_path() / ("." + options.out.stem().string() + ".part" + kind);
  std::vector<std::string> command = {"ffmpeg",     "-y",
                                      "-loglevel",  "error",
                                      "-framerate", std::to_string(frames_per_second(run)),
                                      "-i",         folder.path / "%06d.png"};
  if (kind == ".mp4")
    command.insert(command.end(), {"-pix_fmt", "yuv420p", "-movflags", "+faststart"});
  else
    command.insert(command.end(), {"-filter_complex", "split[a][b];[a]palettegen[p];[b][p]paletteuse"});
  command.push_back(part);
  std::error_code error;
  const int code = run_program(command, folder.path / "log");
  if (code == 0) fs::rename(part, options.out, error);
  if (code != 0 || error) {
    fs::remove(part, error);
    throw EnvironmentError(options.out.string() + ": ffmpeg could not write it (" +
                           last_line(folder.path / "log") + "); choose a place that can be written to");
  }
  std::printf("%s: %zu frames\n", options.out.c_str(), run.frames.size());
  return 0;
}

}  // namespace sulcus
