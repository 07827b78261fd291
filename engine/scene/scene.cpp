#include "engine/scene/scene.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/mesh/shares.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

[[noreturn]] void refuse(const std::string& what, double found, const std::string& expected) {
  throw InputError("scene: " + what + " is " + std::to_string(found) + "; give " + expected);
}

void check_positive(const char* what, double value) {
  if (!(value > 0) || !std::isfinite(value)) refuse(what, value, "a positive number");
}

void check_not_negative(const char* what, double value) {
  if (!(value >= 0) || !std::isfinite(value)) refuse(what, value, "zero or a positive number");
}

void check_tool(const Tool& tool) {
  const std::string name = "tool \"" + tool.name + "\": ";
  check_positive((name + "mass (kg)").c_str(), tool.body.mass_kg);
  const Mat3& inertia = tool.body.inertia_kg_m2;
  const bool definite =
      inertia.allFinite() && (inertia - inertia.transpose()).norm() <= 1e-9 * inertia.norm() &&
      inertia(0, 0) > 0 && inertia(0, 0) * inertia(1, 1) - inertia(0, 1) * inertia(1, 0) > 0 &&
      inertia.determinant() > 0;
  if (!definite) {
    throw InputError("scene: " + name +
                     "the inertia is not symmetric positive definite; give moments above zero");
  }
  check_not_negative((name + "coupling stiffness (N/m)").c_str(), tool.coupling.stiffness_N_m);
  check_not_negative((name + "coupling damping (N s/m)").c_str(), tool.coupling.damping_N_s_m);
  check_not_negative((name + "rotational coupling stiffness (N m/rad)").c_str(),
                     tool.coupling.rotational_stiffness_N_m_rad);
  check_not_negative((name + "rotational coupling damping (N m s/rad)").c_str(),
                     tool.coupling.rotational_damping_N_m_s_rad);
  check_not_negative((name + "output filter (Hz)").c_str(), tool.filter_Hz);
  check_not_negative((name + "largest force (N)").c_str(), tool.max_force_N);
  check_not_negative((name + "largest torque (N m)").c_str(), tool.max_torque_N_m);
  for (const Vec3& vertex : tool.surface.vertices) {
    if (!vertex.allFinite()) throw InputError("scene: " + name + "a vertex is not finite");
  }
}

void check_contact(const std::string& of, const ContactLaw& law) {
  check_not_negative((of + "contact stiffness (N/m)").c_str(), law.stiffness_N_m);
  check_not_negative((of + "contact damping (N s/m)").c_str(), law.damping_N_s_m);
  constexpr double stiffest_N_m = 1e7;  // tissue of 1e6 Pa and cells of 10 mm has 1e4 N/m at a node
  if (law.stiffness_N_m > stiffest_N_m)
    refuse(of + "contact stiffness (N/m)", law.stiffness_N_m,
           "at most 1e7 N/m: beyond it the step's system has no digits left");
  constexpr double most_damping_N_s_m = 1e5, most_friction = 100;
  if (law.damping_N_s_m > most_damping_N_s_m)
    refuse(of + "contact damping (N s/m)", law.damping_N_s_m,
           "at most 1e5 N s/m: beyond it the step's system has no digits left");
  if (law.friction > most_friction)
    refuse(of + "coefficient of friction", law.friction,
           "at most 100: beyond it the step's system has no digits left");
  if (!(law.anisotropy >= 0 && law.anisotropy <= 1)) {
    refuse(of + "contact anisotropy", law.anisotropy, "a number from 0 (frictionless) to 1 (isotropic)");
  }
  if (law.prescribed && (law.explicit_forces || (law.anisotropy != 0 && law.anisotropy != 1))) {
    refuse(of + "contact anisotropy of prescribed contact", law.anisotropy, "0 (slides) or 1 (sticks)");
  }
  check_not_negative((of + "coefficient of friction").c_str(), law.friction);
  check_positive((of + "speed of slip of the friction (m/s)").c_str(), law.friction_speed_m_s);
}

void check_obstacle(const Obstacle& obstacle) {
  const std::string name = "obstacle \"" + obstacle.name + "\": ";
  check_contact(name, obstacle.contact);
  if (obstacle.contact.prescribed)
    throw InputError("scene: " + name + "only tools can lead nodes; give obstacles a penalty");
  if (!obstacle.position.allFinite() || !rotation_matrix(obstacle.orientation).allFinite())
    throw InputError("scene: " + name + "its place is not finite");
  for (const Vec3& vertex : obstacle.surface.vertices) {
    if (!vertex.allFinite()) throw InputError("scene: " + name + "a vertex is not finite");
  }
}

void check(const SceneDescription& d, std::int64_t nodes) {
  check_positive("the time step (s)", d.step_s);
  check_not_negative("Rayleigh alpha (1/s)", d.damping.alpha_1_s);
  check_not_negative("Rayleigh beta (s)", d.damping.beta_s);
  check_contact("", d.contact);
  check_positive("the solver's tolerance", d.solver.tolerance);
  check_positive("the solver's iteration cap", d.solver.max_iterations);
  if (d.solver.first_guess == FirstGuess::past && (!d.motions.empty() || d.contact.prescribed))
    throw InputError(
        "scene: the solver cannot begin at the past where nodes are led (motions, prescribed contact); let "
        "it "
        "start at the velocities");
  if (!d.gravity.allFinite()) throw InputError("scene: gravity is not finite");
  for (const Tool& tool : d.tools) check_tool(tool);
  for (const Obstacle& obstacle : d.obstacles) check_obstacle(obstacle);
  const auto check_node = [&](std::int32_t node) {
    if (node < 0 || node >= nodes) refuse("a node number", node, "one below " + std::to_string(nodes));
  };
  for (std::int32_t node : d.fixed_nodes) check_node(node);
  for (const SlidingNode& sliding : d.sliding) {
    check_node(sliding.node);
    if (sliding.axis < 0 || sliding.axis > 2) refuse("the axis of a sliding node", sliding.axis, "0, 1 or 2");
    if (sliding.plane < 0 || sliding.plane >= nodes)
      refuse("the plane of a sliding node", sliding.plane, "a number from 0 on");
  }
  std::vector<std::uint8_t> taken(static_cast<std::size_t>(nodes), 0);
  for (std::int32_t node : d.fixed_nodes) taken[static_cast<std::size_t>(node)] = 1;
  for (const PrescribedMotion& motion : d.motions) {
    const std::string name = "motion \"" + motion.name + "\": ";
    if (motion.path.empty()) throw InputError("scene: " + name + "it has no path");
    for (const auto& place : motion.path) {
      if (!place.shift.allFinite() || !rotation_matrix(place.turn).allFinite()) {
        throw InputError("scene: " + name + "its path is not finite");
      }
    }
    for (std::int32_t node : motion.nodes) {
      check_node(node);
      std::uint8_t& held = taken[static_cast<std::size_t>(node)];
      if (held) {
        throw InputError("scene: " + name + "node " + std::to_string(node) +
                         " is fixed or moved already; give each node one boundary condition");
      }
      held = 1;
    }
  }
  if (d.fracture) {
    if (d.fracture->steps_above < 1 || d.fracture->steps_above > 255) {
      refuse("fracture: the number of steps above the threshold", d.fracture->steps_above, "1 to 255");
    }
    if (!d.tools.empty() && d.detection == ContactDetection::embedded_vertices) {
      throw InputError(
          "scene: contact by embedded vertices does not follow torn tissue; use surface nodes in scenes that "
          "fracture");
    }
  }
  if (!d.start_positions.empty() && d.start_positions.size() != static_cast<std::size_t>(nodes))
    refuse("the number of start positions", static_cast<double>(d.start_positions.size()),
           "one for each of the " + std::to_string(nodes) + " nodes, or none");
  for (const Vec3& position : d.start_positions) {
    if (!position.allFinite()) throw InputError("scene: a start position is not finite");
  }
  for (const NodeForce& load : d.forces) {
    check_node(load.node);
    if (!load.force_N.allFinite()) throw InputError("scene: a force on a node is not finite");
  }
  for (const NodeSpring& spring : d.springs) {
    check_node(spring.node);
    check_not_negative("a spring's stiffness (N/m)", spring.stiffness_N_m);
    check_not_negative("a spring's damping (N s/m)", spring.damping_N_s_m);
  }
}

// What the matrix holds of masses and springs on the diagonal of each node, kg.
std::vector<double> node_weights(const Scene& scene) {
  const double h = scene.settings.step_s;
  std::vector<double> weights = scene.elements.node_mass;
  for (std::size_t n = 0; n < weights.size(); ++n) {
    weights[n] += h * (scene.elements.drag_kg_s.empty() ? scene.settings.damping.alpha_1_s * weights[n]
                                                        : scene.elements.drag_kg_s[n]);
  }
  for (const NodeSpring& spring : scene.settings.springs) {
    weights[static_cast<std::size_t>(spring.node)] += h * (spring.damping_N_s_m + h * spring.stiffness_N_m);
  }
  return weights;
}

// number: of the materials by label; 0 where a label has none.
ElementContent content_of(TetShares&& shares, const std::map<std::int32_t, std::int32_t>& number) {
  ElementContent content{std::move(shares.first), std::move(shares.label), std::move(shares.share)};
  for (std::int32_t& entry : content.material) {
    const auto found = number.find(entry);
    entry = found == number.end() ? 0 : found->second;
  }
  return content;
}

// The largest factor of n n^T that a contact adds to the matrix: h (b + h k), kg.
double contact_weight(const SceneDescription& d) {
  double largest = 0;
  const auto add = [&](const ContactLaw& law) {
    if (law.prescribed || law.explicit_forces) return;
    largest = std::max(largest, d.step_s * (law.damping_N_s_m + d.step_s * law.stiffness_N_m));
  };
  if (!d.tools.empty()) add(d.contact);
  for (const Obstacle& obstacle : d.obstacles) add(obstacle.contact);
  return largest;
}

bool wants_multigrid(const Scene& scene) {
  const SceneDescription& d = scene.settings;
  if (d.solver.preconditioner != Preconditioner::automatic)
    return d.solver.preconditioner == Preconditioner::multigrid;
  return multigrid_pays(scene.mesh, reach_of_step(scene.mesh, scene.elements, {d.step_s, d.damping}),
                        contact_weight(d));
}

}  // namespace

Scene build_scene(SceneDescription description, EmbeddingMesh mesh) {
  check(description, static_cast<std::int64_t>(mesh.rest_positions.size()));
  Scene scene;
  scene.settings = std::move(description);
  scene.mesh = std::move(mesh);
  if (scene.settings.ledger) scene.settings.energies = true;
  const SceneDescription& d = scene.settings;

  // materials: number 0 is the default, then the named labels in ascending order
  std::vector<Material> materials{d.material};
  std::map<std::int32_t, std::int32_t> number;
  for (const auto& [label, material] : d.materials) {
    number[label] = static_cast<std::int32_t>(materials.size());
    materials.push_back(material);
  }
  std::vector<std::int32_t> material_of_tet(scene.mesh.tets.size(), 0);
  for (std::size_t t = 0; t < material_of_tet.size(); ++t) {
    const auto cell = t / static_cast<std::size_t>(scene.mesh.tets_per_cell);
    const auto found = number.find(scene.mesh.cell_label[cell]);
    if (found != number.end()) material_of_tet[t] = found->second;
  }
  std::optional<ElementContent> content;
  if (d.filling == ElementFilling::shares) content = content_of(tet_shares(d.map, scene.mesh), number);
  scene.elements =
      build_elements(scene.mesh, materials, material_of_tet, d.damping, content ? &*content : nullptr);
  for (std::size_t n = 0; n < scene.mesh.rest_positions.size(); ++n) {
    if (scene.elements.incident_start[n] == scene.elements.incident_start[n + 1]) {
      const Vec3& x = scene.mesh.rest_positions[n];
      throw InputError("scene: node " + std::to_string(n) + " at (" + std::to_string(1e3 * x[0]) + ", " +
                       std::to_string(1e3 * x[1]) + ", " + std::to_string(1e3 * x[2]) +
                       ") mm belongs to no element, so nothing holds it; leave it out of the mesh");
    }
  }
  scene.sparsity = build_sparsity(scene.mesh);

  scene.free_node.assign(scene.mesh.rest_positions.size(), 1);
  for (std::int32_t node : d.fixed_nodes) scene.free_node[static_cast<std::size_t>(node)] = 0;
  if (!d.sliding.empty()) scene.keeps.assign(scene.free_node.size(), {0, 0, 0});
  for (const SlidingNode& sliding : d.sliding) {
    scene.keeps[static_cast<std::size_t>(sliding.node)][static_cast<std::size_t>(sliding.axis)] = 1;
    scene.plane_count = std::max(scene.plane_count, static_cast<std::size_t>(sliding.plane) + 1);
  }
  for (const PrescribedMotion& motion : d.motions) {
    for (std::int32_t node : motion.nodes) scene.free_node[static_cast<std::size_t>(node)] = 0;
  }
  if (d.fracture) {
    scene.fracture =
        std::make_unique<const FractureData>(build_fracture_data(scene.elements, materials, material_of_tet));
  }
  if (wants_multigrid(scene)) {
    auto multigrid = build_multigrid(scene.mesh, scene.elements, scene.sparsity, {d.step_s, d.damping},
                                     node_weights(scene), scene.free_node, d.fracture.has_value());
    if (multigrid.levels > 0) scene.multigrid = std::make_unique<const Multigrid>(std::move(multigrid));
  }
  for (double mass : scene.elements.node_mass) scene.total_mass_kg += mass;
  for (const Tool& tool : d.tools) scene.filter_alpha.push_back(low_pass_alpha(tool.filter_Hz, d.step_s));
  for (const Obstacle& obstacle : d.obstacles) {
    scene.obstacle_distances.push_back(
        build_rigid_distance(obstacle.surface, distance_spacing(obstacle.surface)));
  }
  if (!d.tools.empty() && d.detection == ContactDetection::surface_nodes) {
    for (const Tool& tool : d.tools) {
      scene.tool_distances.push_back(build_rigid_distance(tool.surface, distance_spacing(tool.surface)));
    }
  } else if (!d.tools.empty()) {
    scene.distance = std::make_unique<const DistanceField>(build_distance_field(d.map, d.pairs));
    scene.owned_voxels = find_owned_voxels(d.map, scene.mesh);
  }
  if (scene.nodes_touch()) scene.faces = face_neighbours(scene.mesh.tets);
  return scene;
}

}  // namespace sulcus
