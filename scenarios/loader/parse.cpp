#include "scenarios/loader/parse.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <set>

#include "engine/numerics/error.h"
#include "engine/volume/separation.h"
#include "scenarios/loader/devices.h"
#include "scenarios/loader/parse_json.h"
#include "scenarios/loader/parse_label_map.h"
#include "scenarios/loader/parse_pictures.h"
#include "scenarios/loader/parse_tools.h"

namespace sulcus {

namespace {

std::optional<std::int32_t> label_of_key(const std::string& key, const std::string& pointer,
                                         Problems& problems) {
  std::int32_t label = 0;
  const auto result = std::from_chars(key.data(), key.data() + key.size(), label);
  if (result.ec == std::errc() && label != 0) return label;
  problems.push_back(pointer + "/" + key + ": found the label " + key +
                     ", expected a whole number within 32 bits, not 0");
  return std::nullopt;
}

void read_material(const json& object, const RayleighDamping& scene_damping, Material& material) {
  read(object, "youngs_modulus_Pa", material.youngs_modulus_Pa);
  read(object, "poisson_ratio", material.poisson_ratio);
  read(object, "density_kg_m3", material.density_kg_m3);
  read(object, "fracture_threshold_Pa", material.fracture_threshold_Pa);
  if (object.contains("law")) {
    material.law = object["law"].get<std::string>() == "linear" ? Law::linear : Law::corotated;
  }
  if (!object.contains("rayleigh_alpha_1_s") && !object.contains("rayleigh_beta_s")) return;
  if (!material.damping) material.damping = scene_damping;
  read(object, "rayleigh_alpha_1_s", material.damping->alpha_1_s);
  read(object, "rayleigh_beta_s", material.damping->beta_s);
}

void read_tissue(const json& object, Scenario& scenario, Problems& problems) {
  SceneDescription& scene = scenario.scene;
  read(object, "rayleigh_alpha_1_s", scene.damping.alpha_1_s);
  read(object, "rayleigh_beta_s", scene.damping.beta_s);
  read_material(part(object, "default"), scene.damping, scene.material);
  for (const auto& member : part(object, "labels").items()) {
    const auto label = label_of_key(member.key(), "/tissue/labels", problems);
    if (!label) continue;
    Material material = scene.material;
    read_material(member.value(), scene.damping, material);
    scene.materials[*label] = material;
    if (member.value().value("prevails", false)) scenario.prevailing_labels.push_back(*label);
  }
  read(object, "gravity_m_s2", scene.gravity);
}

void read_mesh(const json& object, EmbeddingOptions& options) {
  read_mm(object, "size_mm", options.size_m);
  options.split = object.value("split", "five") == "six" ? TetSplit::six : TetSplit::five;
  read(object, "superimpose", options.superimpose);
  read(object, "min_island_cells", options.min_island_cells);
}

NodeRegion read_region(const json& object, const std::string& pointer, Problems& problems) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  NodeRegion region{Vec3::Constant(-infinity), Vec3::Constant(infinity), {}, pointer};
  read(object, "labels", region.labels);
  int regions = 0;
  if (object.contains("box_mm")) {
    ++regions;
    read_mm(object["box_mm"], "min", region.min_m);
    read_mm(object["box_mm"], "max", region.max_m);
    check_box(region.min_m, region.max_m, pointer + "/box_mm", problems);
  }
  for (const char* key : {"below_mm", "above_mm"}) {
    if (!object.contains(key)) continue;
    ++regions;
    const Eigen::Index axis = object[key]["axis"].get<std::string>()[0] - 'x';
    const double value_m = object[key]["value"].get<double>() / 1000;
    (key[0] == 'b' ? region.max_m : region.min_m)[axis] = value_m;
  }
  if (regions > 1 || (regions == 0 && region.labels.empty())) {
    problems.push_back(
        pointer + ": found " + std::to_string(regions) +
        " regions, expected exactly one of box_mm, below_mm, above_mm (none is needed beside labels)");
  }
  return region;
}

void read_motions(const json& list, Scenario& scenario, Problems& problems) {
  std::set<std::string> names;
  for (const json& object : list) {
    const std::string pointer = "/boundary/motions/" + std::to_string(scenario.motions.size());
    MotionRegion motion;
    read(object, "name", motion.name);
    if (!names.insert(motion.name).second)
      problems.push_back(pointer + "/name: \"" + motion.name + "\" is taken");
    motion.nodes = read_region(object, pointer, problems);
    read_mm(object, "centre_mm", motion.centre_m);
    motion.script = read_script(object["waypoints"], "shift_mm",
                                static_cast<double>(scenario.steps()) * scenario.scene.step_s,
                                pointer + "/waypoints", problems);
    scenario.motions.push_back(std::move(motion));
  }
}

void read_boundary(const json& object, Scenario& scenario, Problems& problems) {
  std::size_t number = 0;
  for (const json& region : object.value("fixed", json::array())) {
    scenario.fixed.push_back(read_region(region, "/boundary/fixed/" + std::to_string(number++), problems));
  }
  number = 0;
  for (const json& spring : object.value("springs", json::array())) {
    SpringRegion springs{read_region(spring, "/boundary/springs/" + std::to_string(number++), problems)};
    read(spring, "stiffness_N_m", springs.stiffness_N_m);
    read(spring, "damping_N_s_m", springs.damping_N_s_m);
    scenario.springs.push_back(springs);
  }
  number = 0;
  for (const json& load : object.value("forces", json::array())) {
    ForceRegion region{read_region(load, "/boundary/forces/" + std::to_string(number++), problems)};
    region.force_N = vector(load["force_N"]);
    scenario.forces.push_back(region);
  }
  number = 0;
  for (const json& plane : object.value("planes", json::array())) {
    PlaneRegion region{read_region(plane, "/boundary/planes/" + std::to_string(number++), problems)};
    region.axis = plane["axis"].get<std::string>()[0] - 'x';
    scenario.planes.push_back(region);
  }
  read_motions(object.value("motions", json::array()), scenario, problems);
}

void read_initial(const json& object, Scenario& scenario) {
  InitialDeformation& initial = scenario.initial.emplace();
  if (object.contains("deformation_gradient")) {
    for (Eigen::Index i = 0; i < 9; ++i)
      initial.gradient(i / 3, i % 3) =
          object["deformation_gradient"][static_cast<std::size_t>(i)].get<double>();
  }
  read_mm(object, "centre_mm", initial.centre_m);
}

void read_fracture(const json& object, Scenario& scenario, Problems& problems) {
  FractureSettings& fracture = scenario.scene.fracture.emplace();
  fracture.criterion = object.value("criterion", "tensile") == "tensile"
                           ? FractureCriterion::tensile
                           : FractureCriterion::largest_absolute;
  read(object, "steps_above", fracture.steps_above);
  read(object, "avoid_singularities", fracture.avoid_singularities);
  read(object, "remove_detached", fracture.remove_detached);
  bool can_tear = std::isfinite(scenario.scene.material.fracture_threshold_Pa);
  for (const auto& entry : scenario.scene.materials)
    can_tear = can_tear || std::isfinite(entry.second.fracture_threshold_Pa);
  if (!can_tear) {
    problems.push_back(
        "/fracture: no material has a fracture_threshold_Pa, so nothing can tear; give one in /tissue, or "
        "leave "
        "/fracture out");
  }
  if (!scenario.scene.tools.empty() && scenario.scene.detection == ContactDetection::embedded_vertices) {
    problems.push_back(
        "/contact/detection: embedded_vertices does not follow torn tissue; use \"surface_nodes\" in scenes "
        "that "
        "fracture");
  }
}

void read_solver(const json& object, Scenario& scenario) {
  SolverSettings& solver = scenario.scene.solver;
  solver.precision = object.value("precision", "single") == "double" ? Precision::double_precision
                                                                     : Precision::single_precision;
  const std::string preconditioner = object.value("preconditioner", "auto");
  solver.preconditioner = preconditioner == "block_jacobi" ? Preconditioner::block_jacobi
                          : preconditioner == "multigrid"  ? Preconditioner::multigrid
                                                           : Preconditioner::automatic;
  const std::string start = object.value("start", "velocity");
  solver.first_guess = start == "rest"   ? FirstGuess::rest
                       : start == "past" ? FirstGuess::past
                                         : FirstGuess::velocity;
  read(object, "tolerance", solver.tolerance);
  read(object, "max_iterations", solver.max_iterations);
  read(object, "velocity_floor_m_s", solver.velocity_floor_m_s);
  read(object, "measure_error_every_steps", scenario.measure_error_every_steps);
}

void read_time(const json& object, Scenario& scenario, Problems& problems) {
  read(object, "step_s", scenario.scene.step_s);
  read(object, "duration_s", scenario.duration_s);
  const double steps = scenario.duration_s / scenario.scene.step_s;
  if (scenario.steps() < 1) problems.push_back("/time: the duration is less than half a step");
  if (steps > 1e8) problems.push_back("/time: the run would take more than 100 million steps");
  const double run_s = static_cast<double>(scenario.steps()) * scenario.scene.step_s;
  if (std::abs(run_s - scenario.duration_s) > 1e-6 * scenario.duration_s) {
    scenario.warnings.push_back("/time/duration_s: " + text_of(scenario.duration_s) +
                                " s is no whole number of steps; the run lasts " + text_of(run_s) + " s");
  }
}

bool is_measure_of_tissue(const std::string& what) {
  return what == "least_position_mm" || what == "opening_mm" || what == "displacement_mm" ||
         what == "drift_mm" || what == "path_force_N";
}

void read_measures(const json& list, Scenario& scenario, Problems& problems) {
  for (const json& object : list) {
    const std::string pointer = "/checks/measures/" + std::to_string(scenario.checks.measures.size());
    MeasureBounds measure;
    read(object, "what", measure.what);
    read(object, "tool", measure.tool);
    read(object, "path", measure.path);
    read(object, "from_s", measure.from_s);
    read(object, "to_s", measure.to_s);
    read(object, "above_Hz", measure.above_Hz);
    read(object, "within_rad", measure.within_rad);
    read(object, "along", measure.along);
    read(object, "at_least", measure.at_least);
    read(object, "at_most", measure.at_most);
    const auto is_named = [&](const Tool& tool) { return tool.name == measure.tool; };
    const std::vector<Tool>& tools = scenario.scene.tools;
    const auto& motions = scenario.motions;
    const auto is_path = [&](const MotionRegion& motion) { return motion.name == measure.path; };
    if (measure.what != "path_force_N" && !measure.path.empty())
      problems.push_back(pointer + "/path: this is no measure of a path; leave it out");
    if (is_measure_of_tissue(measure.what)) {
      if (!measure.tool.empty())
        problems.push_back(pointer + "/tool: this is no measure of a tool; leave it out");
      if (measure.what == "path_force_N" && std::none_of(motions.begin(), motions.end(), is_path))
        problems.push_back(pointer + "/path: found \"" + measure.path + "\", expected the name of a motion");
    } else if (std::none_of(tools.begin(), tools.end(), is_named)) {
      problems.push_back(pointer + "/tool: found \"" + measure.tool + "\", expected the name of a tool");
    }
    if (!measure.at_least && !measure.at_most)
      problems.push_back(pointer + ": it has no bound; give at_least, at_most or both");
    if (!(measure.along.norm() > 0)) problems.push_back(pointer + "/along: the direction has no length");
    scenario.checks.measures.push_back(std::move(measure));
  }
}

void read_checks(const json& object, Scenario& scenario, Problems& problems) {
  Checks& checks = scenario.checks;
  read_mm(object, "max_penetration_mm", checks.max_penetration_m);
  read(object, "max_force_N", checks.max_force_N);
  read(object, "min_peak_force_N", checks.min_peak_force_N);
  read_mm(object, "min_peak_displacement_mm", checks.min_peak_displacement_m);
  read_mm(object, "returns_to_rest_mm", checks.returns_to_rest_m);
  read(object, "solver_error", checks.max_solver_error);
  read(object, "max_residual", checks.max_residual);
  read(object, "max_inverted_elements", checks.max_inverted_elements);
  read(object, "min_torn_elements", checks.min_torn_elements);
  read(object, "max_torn_elements", checks.max_torn_elements);
  read(object, "labels_stay", checks.labels_stay);
  read(object, "max_kinetic_energy_uJ", checks.max_kinetic_energy_J);
  read(object, "converged_share", checks.min_converged_share);
  read(object, "energy_growth", checks.max_energy_growth);
  read(object, "max_hanging_elements", checks.max_hanging_elements);
  read(object, "min_hanging_energy_uJ", checks.min_hanging_energy_J);
  read(object, "pieces_at_start", checks.pieces_at_start);
  read(object, "pieces_at_end", checks.pieces_at_end);
  read(object, "contact_expected", checks.contact_expected);
  read_measures(object.value("measures", json::array()), scenario, problems);
  if (checks.min_hanging_energy_J) *checks.min_hanging_energy_J *= 1e-6;
  if (checks.max_kinetic_energy_J) *checks.max_kinetic_energy_J *= 1e-6;
  if (checks.max_solver_error && scenario.measure_error_every_steps == 0) {
    scenario.warnings.push_back(
        "/checks/solver_error: nothing is measured, because /solver/measure_error_every_steps is 0");
  }
}

void read_colours(const json& object, Scenario& scenario, Problems& problems) {
  for (const auto& member : object.items()) {
    const auto label = label_of_key(member.key(), "/label_colours", problems);
    const unsigned long colour = std::stoul(member.value().get<std::string>().substr(1), nullptr, 16);
    if (label) {
      scenario.label_colours[*label] = {static_cast<std::uint8_t>(colour >> 16),
                                        static_cast<std::uint8_t>(colour >> 8 & 255),
                                        static_cast<std::uint8_t>(colour & 255)};
    }
  }
}

void read_golden(const json& object, GoldenSettings& golden) {
  read(object, "kept", golden.kept);
  read(object, "picture_conformity", golden.picture_conformity);
  read(object, "picture_block_distance", golden.picture_block_distance);
}

}  // namespace

std::string list_problems(const std::string& place, const std::vector<std::string>& problems) {
  if (problems.size() == 1) return place + ": " + problems.front();
  std::string text = place + ": " + std::to_string(problems.size()) + " errors";
  for (const std::string& problem : problems) text += "\n  " + problem;
  return text;
}

Scenario parse_scenario(const json& document, const std::string& place,
                        const std::filesystem::path& directory) {
  Scenario scenario;
  Problems problems;
  read(document, "name", scenario.name);
  read(document, "title", scenario.title);
  read(document, "description", scenario.description);
  std::string missing;
  read_label_map(document["label_map"], directory, scenario, missing, problems);
  collect(problems, "/separation_pairs", [&] {
    std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
    read(document, "separation_pairs", pairs);
    scenario.scene.pairs = make_separation_pairs(std::move(pairs));
  });
  read_mesh(document["mesh"], scenario.scene.embedding);
  read_tissue(part(document, "tissue"), scenario, problems);
  if (document["mesh"].value("filling", "whole_cells") == "shares") {
    scenario.scene.filling = ElementFilling::shares;
    if (!scenario.prevailing_labels.empty()) {
      problems.push_back("/mesh/filling: \"shares\" and materials that prevail exclude each other; drop one");
    }
  }
  read_time(document["time"], scenario, problems);
  read_boundary(part(document, "boundary"), scenario, problems);
  if (document.contains("initial")) read_initial(document["initial"], scenario);
  read_tools(document.value("tools", json::array()), directory, scenario, problems);
  read_contact(part(document, "contact"), scenario.scene);
  read_obstacles(document.value("obstacles", json::array()), directory, scenario, problems);
  if (document.contains("fracture")) read_fracture(document["fracture"], scenario, problems);
  read_solver(part(document, "solver"), scenario);
  read(part(document, "record"), "frame_every_steps", scenario.frame_every_steps);
  read(part(document, "record"), "energy_ledger", scenario.scene.ledger);
  read_checks(part(document, "checks"), scenario, problems);
  read_pictures(part(document, "pictures"), directory, scenario, problems);
  read_colours(part(document, "label_colours"), scenario, problems);
  read_golden(part(document, "golden"), scenario.golden);
  if (!problems.empty()) throw InputError(list_problems(place, problems));
  if (!missing.empty()) throw MissingData(place + ": " + missing);
  json resolved = document;  // to be read again from anywhere
  if (const auto* file = std::get_if<std::filesystem::path>(&scenario.map_source))
    resolved["label_map"]["file"] = file->lexically_normal().string();
  if (scenario.pictures.grey)
    resolved["pictures"]["grey_image"]["file"] = scenario.pictures.grey->file.lexically_normal().string();
  for (const char* list : {"tools", "obstacles"}) {
    if (!resolved.contains(list)) continue;
    for (json& body : resolved[list]) {
      const auto make_absolute = [&](json& file) {
        file = (directory / file.get<std::string>()).lexically_normal().string();
      };
      if (body["shape"].contains("mesh")) make_absolute(body["shape"]["mesh"]["file"]);
      if (body.contains("device") && body["device"].contains("recorded"))
        make_absolute(body["device"]["recorded"]["file"]);
    }
  }
  scenario.resolved_json = resolved.dump(2) + "\n";
  return scenario;
}

}  // namespace sulcus
