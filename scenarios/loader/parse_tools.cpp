#include "scenarios/loader/parse_tools.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <set>

#include "scenarios/loader/devices.h"
#include "scenarios/loader/mesh_files.h"
#include "scenarios/loader/parse_json.h"
#include "scenarios/loader/tools.h"

namespace sulcus {

namespace {

ToolSurface read_shape(const json& object, const std::filesystem::path& directory, Scenario& scenario) {
  if (object.contains("mesh")) {
    const std::filesystem::path file = directory / object["mesh"]["file"].get<std::string>();
    ToolSurface surface = read_surface(file, object["mesh"].value("unit_mm", 1.0) / 1000);
    scenario.input_files.push_back(file);
    return surface;
  }
  if (object.contains("retractor")) {
    const json& retractor = object["retractor"];
    RetractorShape shape;
    read_mm(retractor, "length_mm", shape.length_m);
    read_mm(retractor, "width_mm", shape.width_m);
    read_mm(retractor, "thickness_mm", shape.thickness_m);
    if (retractor.contains("bend_deg"))
      shape.bend_rad = retractor["bend_deg"].get<double>() * radians_per_degree;
    return retractor_surface(shape);
  }
  if (object.contains("sphere")) {
    SphereShape shape;
    read_mm(object["sphere"], "radius_mm", shape.radius_m);
    read(object["sphere"], "subdivisions", shape.subdivisions);
    return sphere_surface(shape);
  }
  if (object.contains("box")) {
    BoxShape shape;
    read_mm(object["box"], "size_mm", shape.size_m);
    read_mm(object["box"], "edge_mm", shape.edge_m);
    return box_surface(shape);
  }
  if (object.contains("torus")) {
    TorusShape shape;
    read_mm(object["torus"], "radius_mm", shape.radius_m);
    read_mm(object["torus"], "tube_radius_mm", shape.tube_radius_m);
    return torus_surface(shape);
  }
  if (object.contains("floor")) {
    FloorShape shape;
    read_mm(object["floor"], "size_mm", shape.size_m);
    return floor_surface(shape);
  }
  CapsuleShape shape;
  read_mm(object["capsule"], "radius_mm", shape.radius_m);
  read_mm(object["capsule"], "length_mm", shape.length_m);
  return capsule_surface(shape);
}

void read_inertia(const json& value, Mat3& inertia, const std::string& pointer, Problems& problems) {
  if (value.is_number()) {
    inertia = Mat3::Identity() * value.get<double>();
  } else if (value.size() == 3) {
    inertia = vector(value).asDiagonal();
  } else if (value.size() == 9) {
    for (int entry = 0; entry < 9; ++entry)
      inertia(entry / 3, entry % 3) = value[static_cast<std::size_t>(entry)];
  } else {
    problems.push_back(pointer + ": found " + std::to_string(value.size()) + " numbers, expected 1, 3 or 9");
    return;
  }
  const bool symmetric = inertia == inertia.transpose();
  if (!symmetric || !(Eigen::SelfAdjointEigenSolver<Mat3>(inertia).eigenvalues()[0] > 0)) {
    problems.push_back(pointer + ": the inertia must be symmetric and positive definite");
  }
}

void read_law(const json& object, ContactLaw& law) {
  read(object, "stiffness_N_m", law.stiffness_N_m);
  read(object, "damping_N_s_m", law.damping_N_s_m);
  read(object, "anisotropy", law.anisotropy);
  read(object, "tension_rule", law.tension_rule);
  read(object, "friction", law.friction);
  read(object, "friction_speed_m_s", law.friction_speed_m_s);
  if (object.contains("response")) {
    law.explicit_forces = object["response"] == "explicit_penalty";
    law.prescribed = object["response"] == "prescribed";
  }
}

}  // namespace

void read_tools(const json& tools, const std::filesystem::path& directory, Scenario& scenario,
                Problems& problems) {
  std::set<std::string> names;
  for (const json& object : tools) {
    const std::string pointer = "/tools/" + std::to_string(scenario.scene.tools.size());
    Tool tool;
    read(object, "name", tool.name);
    if (!names.insert(tool.name).second)
      problems.push_back(pointer + "/name: \"" + tool.name + "\" is taken");
    collect(problems, pointer + "/shape",
            [&] { tool.surface = read_shape(object["shape"], directory, scenario); });
    read(object, "mass_kg", tool.body.mass_kg);
    if (object.contains("inertia_kg_m2")) {
      read_inertia(object["inertia_kg_m2"], tool.body.inertia_kg_m2, pointer + "/inertia_kg_m2", problems);
    }
    if (object.contains("density_kg_m3")) {
      if (object.contains("mass_kg") || object.contains("inertia_kg_m2"))
        problems.push_back(pointer +
                           "/density_kg_m3: mass_kg or inertia_kg_m2 is given too; give one or the other");
      const SolidMoments moments = solid_moments(tool.surface);
      const double density = object["density_kg_m3"].get<double>();
      if (moments.volume_m3 > 0) {
        tool.body.mass_kg = density * moments.volume_m3;
        tool.body.inertia_kg_m2 = density * moments.inertia_m5;
      }
    }
    const json& coupling = part(object, "coupling");
    read(coupling, "stiffness_N_m", tool.coupling.stiffness_N_m);
    read(coupling, "damping_N_s_m", tool.coupling.damping_N_s_m);
    read(coupling, "rotational_stiffness_N_m_rad", tool.coupling.rotational_stiffness_N_m_rad);
    read(coupling, "rotational_damping_N_m_s_rad", tool.coupling.rotational_damping_N_m_s_rad);
    read(object, "output_filter_Hz", tool.filter_Hz);
    read(object["device"], "max_force_N", tool.max_force_N);
    read(object["device"], "max_torque_N_m", tool.max_torque_N_m);
    scenario.hands.push_back(read_hand(object["device"],
                                       static_cast<double>(scenario.steps()) * scenario.scene.step_s, directory,
                                       tool.name, pointer + "/device", problems));
    scenario.scene.tools.push_back(std::move(tool));
  }
}

void read_contact(const json& object, SceneDescription& scene) {
  read_law(object, scene.contact);
  scene.detection = object.value("detection", "embedded_vertices") == "surface_nodes"
                        ? ContactDetection::surface_nodes
                        : ContactDetection::embedded_vertices;
}

void read_obstacles(const json& list, const std::filesystem::path& directory, Scenario& scenario,
                    Problems& problems) {
  std::set<std::string> names;
  for (const Tool& tool : scenario.scene.tools) names.insert(tool.name);
  for (const json& object : list) {
    const std::string pointer = "/obstacles/" + std::to_string(scenario.scene.obstacles.size());
    Obstacle obstacle;
    read(object, "name", obstacle.name);
    if (!names.insert(obstacle.name).second)
      problems.push_back(pointer + "/name: \"" + obstacle.name + "\" is taken");
    collect(problems, pointer + "/shape",
            [&] { obstacle.surface = read_shape(object["shape"], directory, scenario); });
    read_mm(object, "position_mm", obstacle.position);
    Vec3 axis = Vec3::UnitZ();
    read(object, "axis", axis);
    if (!(axis.norm() > 0)) problems.push_back(pointer + "/axis: the axis has no length; give a direction");
    obstacle.orientation = quaternion_from_rotation_vector(
        axis.normalized() * (object.value("angle_deg", 0.0) * radians_per_degree));
    obstacle.contact = scenario.scene.contact;
    obstacle.contact.prescribed = false;
    read_law(part(object, "contact"), obstacle.contact);
    scenario.scene.obstacles.push_back(std::move(obstacle));
  }
}

}  // namespace sulcus
