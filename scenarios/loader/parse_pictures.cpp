#include "scenarios/loader/parse_pictures.h"

#include <Eigen/Geometry>
#include <set>

#include "scenarios/loader/images.h"
#include "scenarios/loader/parse_json.h"

namespace sulcus {
namespace {

ShotCamera read_camera(const json& object, const std::string& pointer, Problems& problems) {
  ShotCamera camera;
  read_mm(object, "eye_mm", camera.eye_m);
  read_mm(object, "target_mm", camera.target_m);
  read(object, "up", camera.up);
  read(object, "field_of_view_deg", camera.field_of_view_deg);
  const Vec3 view = camera.target_m - camera.eye_m;
  if (!(view.cross(camera.up).norm() > 1e-6 * view.norm() * camera.up.norm())) {
    problems.push_back(pointer + ": the camera looks along its up direction, or has no direction at all");
  }
  return camera;
}

Vec3 read_normal(const json& object, const std::string& pointer, Problems& problems) {
  const Vec3 normal = vector(object["normal"]);
  if (!(normal.norm() > 0)) problems.push_back(pointer + "/normal: found no direction; give a vector");
  return normal;
}

ShotSlice read_slice(const json& object, const std::string& pointer, Problems& problems) {
  ShotSlice slice;
  read_mm(object, "point_mm", slice.point_m);
  slice.normal = read_normal(object, pointer, problems);
  read(object, "up", slice.up);
  read_mm(object, "height_mm", slice.height_m);
  if (!(slice.normal.cross(slice.up).norm() > 1e-6 * slice.normal.norm() * slice.up.norm()))
    problems.push_back(pointer + "/up: found a direction along the normal; give one that lies in the slice");
  return slice;
}

// Colours and what they stand for.
void read_content(const json& object, const std::string& pointer, Shot& shot, Problems& problems) {
  const std::string show = object.value("show", "labels");
  if (show == "max_principal_stress") shot.show = ShotContent::max_principal_stress;
  if (show == "displacement") shot.show = ShotContent::displacement;
  for (const auto& [key, content, factor] :
       {std::tuple{"range_Pa", "max_principal_stress", 1.0}, std::tuple{"range_mm", "displacement", 0.001}}) {
    if (!object.contains(key)) continue;
    if (show != content) {
      problems.push_back(pointer + "/" + key + ": the picture shows " + show + "; drop the range, or show " +
                         content);
      continue;
    }
    shot.range = {object[key][0].get<double>() * factor, object[key][1].get<double>() * factor};
    if (!((*shot.range)[0] < (*shot.range)[1]))
      problems.push_back(pointer + "/" + key + ": expected the smaller number first");
  }
}

Shot read_shot(const json& object, const std::string& pointer, const std::optional<ShotCamera>& common,
               Scenario& scenario, Problems& problems) {
  Shot shot;
  read(object, "name", shot.name);
  read(object, "time_s", shot.time_s);
  read(object, "contacts", shot.contacts);
  read(object, "golden", shot.golden);
  read_content(object, pointer, shot, problems);
  if (object.contains("cut")) {
    shot.cut = ShotCut{Vec3::Zero(), read_normal(object["cut"], pointer + "/cut", problems)};
    read_mm(object["cut"], "point_mm", shot.cut->point_m);
  }
  if (object.contains("slice")) shot.slice = read_slice(object["slice"], pointer + "/slice", problems);
  if (shot.cut && shot.slice)
    problems.push_back(pointer + ": found both \"cut\" and \"slice\"; a picture shows one of them");
  shot.grey = object.value("image", "labels") == "grey";
  if (shot.grey && !scenario.pictures.grey)
    problems.push_back(pointer + "/image: no grey image; give one in /pictures/grey_image");
  if (shot.grey && !shot.cut && !shot.slice)
    problems.push_back(pointer + "/image: a grey image is seen in a cut or a slice; give one of them");
  if (shot.time_s > scenario.duration_s) {
    // no error, so that a run may be cut short from the command line
    scenario.warnings.push_back(pointer + "/time_s: found " + text_of(shot.time_s) + " s, the run ends at " +
                                text_of(scenario.duration_s) + " s: the picture is not taken");
  }
  if (object.contains("camera")) {
    shot.camera = read_camera(object["camera"], pointer + "/camera", problems);
  } else if (common) {
    shot.camera = *common;
  } else if (!shot.slice) {
    problems.push_back(pointer + ": no camera; give one here or in /pictures/camera");
  }
  return shot;
}

GreySource read_grey(const json& object, const std::filesystem::path& directory, Scenario& scenario,
                     Problems& problems) {
  GreySource grey;
  grey.file = directory / object["file"].get<std::string>();
  read(object, "black", grey.black);
  read(object, "white", grey.white);
  if (!(grey.black < grey.white))
    problems.push_back("/pictures/grey_image/white: expected a value above black's");
  collect(problems, "/pictures/grey_image/file", [&] {
    for (const auto& input : label_map_files(grey.file)) scenario.input_files.push_back(input);
  });
  return grey;
}

}  // namespace

void read_pictures(const json& object, const std::filesystem::path& directory, Scenario& scenario,
                   Problems& problems) {
  Pictures& pictures = scenario.pictures;
  read(object, "width", pictures.width);
  read(object, "height", pictures.height);
  read_mm(object, "arrow_mm_per_N", pictures.arrow_m_per_N);
  if (object.contains("grey_image"))
    pictures.grey = read_grey(object["grey_image"], directory, scenario, problems);
  std::optional<ShotCamera> common;
  if (object.contains("camera")) common = read_camera(object["camera"], "/pictures/camera", problems);
  std::set<std::string> names;
  for (const json& shot : object.value("shots", json::array())) {
    const std::string pointer = "/pictures/shots/" + std::to_string(pictures.shots.size());
    pictures.shots.push_back(read_shot(shot, pointer, common, scenario, problems));
    if (!names.insert(pictures.shots.back().name).second)
      problems.push_back(pointer + "/name: \"" + pictures.shots.back().name + "\" is taken");
  }
}

}  // namespace sulcus
