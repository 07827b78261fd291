#include "engine/scene/step.h"

#include <omp.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "engine/fem/assembly.h"
#include "engine/fem/stress.h"

namespace sulcus {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;
using Mat36 = Eigen::Matrix<double, 3, 6>;

Mat3 skew(const Vec3& u) {
  Mat3 m;
  m << 0, -u[2], u[1], u[2], 0, -u[0], -u[1], u[0], 0;
  return m;
}

// What one precision of the solver works on.
template <class Real>
struct Numbers {
  SystemMatrix<Real> system;
  SolverWorkspace<Real> solver;
  std::vector<ToolBorder<Real>> borders;  // [tools]
};

// The 6x6 part of the step's system that belongs to one tool (equations.md 4), and its right-hand side.
struct ToolSystem {
  RigidBodyState start;
  Mat3 inertia;         // world, kg m^2
  Vec6 velocity;        // v_com, omega at the start
  Vec3 misalignment;    // u, rad
  Mat3 stiffness;       // H
  Mat6 matrix;          // C
  Vec6 right_hand_side;  // of the increment
  Vec6 increment;       // solution
};

}  // namespace

struct Workspace {
  int threads = 1;
  std::unique_ptr<Numbers<float>> single;   // one of the two, as the scene's precision asks
  std::unique_ptr<Numbers<double>> twice;
  std::vector<double> forces;               // [3*nodes] N
  std::vector<double> increments;           // [3*nodes] m/s
  std::vector<Vec3> vertices;               // of one tool, world
  std::vector<Contact> contacts;            // of all tools, in order
  ContactSearch search;
  std::vector<ToolSystem> tools;
  std::vector<std::int32_t> touched;        // nodes in contact with one tool, by slot
  std::vector<std::int32_t> row_of_node;    // [nodes] -1 or number in `touched`
};

void WorkspaceDeleter::operator()(Workspace* workspace) const { delete workspace; }

namespace {

template <class Real>
std::unique_ptr<Numbers<Real>> make_numbers(const Scene& scene, int threads, Isa isa) {
  auto numbers = std::make_unique<Numbers<Real>>();
  numbers->system = make_system_matrix<Real>(scene.elements, scene.sparsity, isa, threads);
  numbers->solver = make_solver_workspace<Real>(scene.sparsity, isa, threads);
  numbers->borders.resize(scene.settings.tools.size());
  for (std::size_t t = 0; t < numbers->borders.size(); ++t) {
    numbers->borders[t].rows.reserve(4 * scene.settings.tools[t].surface.vertices.size());
  }
  return numbers;
}

Mat3 response(const ContactLaw& law, const Vec3& normal) {
  return law.anisotropy * Mat3::Identity() + (1 - law.anisotropy) * (normal * normal.transpose());
}

Vec3 node_vector(std::span<const double> values, std::int32_t node) {
  const auto n = static_cast<std::size_t>(node);
  return {values[3 * n], values[3 * n + 1], values[3 * n + 2]};
}

// Velocity of the tool's vertex minus that of the tissue's surface point.
Vec3 gap_velocity(const Contact& contact, const EmbeddingMesh& mesh, std::span<const double> velocities,
                  const Vec6& tool) {
  Vec3 rate = tool.head<3>() + tool.tail<3>().cross(contact.arm);
  const auto& nodes = mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c) rate -= contact.weights[c] * node_vector(velocities, nodes[c]);
  return rate;
}

void find_contacts(const Scene& scene, const State& state, Workspace& workspace) {
  workspace.contacts.clear();
  for (std::size_t t = 0; t < scene.settings.tools.size(); ++t) {
    const RigidBodyState tool = tool_state(state, t);
    const Mat3 rotation = rotation_matrix(tool.orientation);
    const auto& vertices = scene.settings.tools[t].surface.vertices;
    workspace.vertices.resize(vertices.size());
    for (std::size_t v = 0; v < vertices.size(); ++v) workspace.vertices[v] = tool.position + rotation * vertices[v];
    find_embedded_contacts(scene.settings.map, scene.settings.pairs, *scene.distance, scene.mesh, state.positions, {},
                           static_cast<std::int32_t>(t), workspace.vertices, tool.position, workspace.search,
                           workspace.contacts);
  }
}

// The tool's own part of the system: inertia, virtual coupling, and the lever term of the contact forces.
void assemble_tool(const Scene& scene, const DeviceSample& sample, const State& state, std::size_t t,
                   Workspace& workspace) {
  const double h = scene.settings.step_s;
  const VirtualCoupling& coupling = scene.settings.tools[t].coupling;
  const RigidBody& body = scene.settings.tools[t].body;
  const ContactLaw& law = scene.settings.contact;
  ToolSystem& tool = workspace.tools[t];
  tool.start = tool_state(state, t);
  tool.inertia = world_inertia(body, tool.start.orientation);
  tool.velocity << linear_velocity(body, tool.start), angular_velocity(body, tool.start);
  tool.misalignment = misalignment(sample.orientation, tool.start.orientation);
  tool.stiffness = misalignment_stiffness(tool.misalignment);

  const Vec3 hand_velocity = sample.linear_velocity_valid ? sample.linear_velocity : Vec3(Vec3::Zero());
  const Vec3 hand_rotation = sample.angular_velocity_valid ? sample.angular_velocity : Vec3(Vec3::Zero());
  const double linear = body.mass_kg + h * coupling.damping_N_s_m + h * h * coupling.stiffness_N_m;
  const Mat3 angular = tool.inertia + h * coupling.rotational_damping_N_m_s_rad * Mat3::Identity() +
                       h * h * coupling.rotational_stiffness_N_m_rad * tool.stiffness;

  // signed symmetric lever term G; left out where it would cost the block its definiteness
  Mat3 lever = Mat3::Zero();
  for (const Contact& contact : workspace.contacts) {
    if (contact.tool != static_cast<std::int32_t>(t)) continue;
    const Vec3 force = -law.stiffness_N_m * (response(law, contact.normal) * contact.gap);
    lever += 0.5 * (contact.arm * force.transpose() + force * contact.arm.transpose()) -
             force.dot(contact.arm) * Mat3::Identity();
  }
  const Mat3 with_lever = angular - h * h * lever;
  const bool definite = with_lever(0, 0) > 0 &&
                        with_lever(0, 0) * with_lever(1, 1) - with_lever(0, 1) * with_lever(1, 0) > 0 &&
                        with_lever.determinant() > 0;

  tool.matrix.setZero();
  tool.matrix.topLeftCorner<3, 3>() = linear * Mat3::Identity();
  tool.matrix.bottomRightCorner<3, 3>() = definite ? with_lever : angular;
  tool.right_hand_side.head<3>() =
      tool.start.linear_momentum +
      h * (coupling.stiffness_N_m * (sample.position - tool.start.position) + coupling.damping_N_s_m * hand_velocity);
  tool.right_hand_side.tail<3>() =
      tool.start.angular_momentum + h * (coupling.rotational_stiffness_N_m_rad * tool.misalignment +
                                         coupling.rotational_damping_N_m_s_rad * hand_rotation);
  tool.right_hand_side -= tool.matrix * tool.velocity;
}

// Adds the contacts to matrix, tool blocks, borders and right-hand sides.
template <class Real>
void assemble_contacts(const Scene& scene, const State& state, Numbers<Real>& numbers, Workspace& workspace) {
  const double h = scene.settings.step_s;
  const ContactLaw& law = scene.settings.contact;
  const double weight = h * (law.damping_N_s_m + h * law.stiffness_N_m);
  static constexpr int corner_pairs[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    ToolSystem& tool = workspace.tools[t];
    auto& rows = numbers.borders[t].rows;
    workspace.touched.clear();
    rows.clear();
    for (const Contact& contact : workspace.contacts) {
      if (contact.tool != static_cast<std::int32_t>(t)) continue;
      for (std::int32_t node : scene.mesh.tets[static_cast<std::size_t>(contact.tet)]) {
        std::int32_t& row = workspace.row_of_node[static_cast<std::size_t>(node)];
        if (row < 0 && scene.free_node[static_cast<std::size_t>(node)]) {
          row = 0;
          workspace.touched.push_back(node);
        }
      }
    }
    const auto slot = [&](std::int32_t node) { return scene.sparsity.slot_of_node[static_cast<std::size_t>(node)]; };
    std::sort(workspace.touched.begin(), workspace.touched.end(),
              [&](std::int32_t a, std::int32_t b) { return slot(a) < slot(b); });
    for (std::size_t r = 0; r < workspace.touched.size(); ++r) {
      const std::int32_t node = workspace.touched[r];
      workspace.row_of_node[static_cast<std::size_t>(node)] = static_cast<std::int32_t>(r);
      typename ToolBorder<Real>::Row row;
      row.chunk = slot(node) / 16;
      row.offset = row.chunk * 48 + slot(node) % 16;
      rows.push_back(row);
    }

    for (const Contact& contact : workspace.contacts) {
      if (contact.tool != static_cast<std::int32_t>(t)) continue;
      const Mat3 n = response(law, contact.normal);
      Mat36 jacobian;  // of the vertex' velocity by the tool's
      jacobian << Mat3::Identity(), -skew(contact.arm);
      const Vec3 push =
          n * (h * law.stiffness_N_m * contact.gap +
               weight * gap_velocity(contact, scene.mesh, state.velocities, tool.velocity));
      tool.matrix += weight * (jacobian.transpose() * (n * jacobian));
      tool.right_hand_side -= jacobian.transpose() * push;

      const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
      for (std::size_t c = 0; c < 4; ++c) {
        const auto node = static_cast<std::size_t>(nodes[c]);
        for (std::size_t d = 0; d < 3; ++d) {
          workspace.forces[3 * node + d] += contact.weights[c] * push[static_cast<Eigen::Index>(d)];
        }
        Real* terms = &numbers.system.node_terms[16 * node];
        for (int i = 0; i < 3; ++i) {
          for (int j = 0; j < 3; ++j) terms[3 * i + j] += static_cast<Real>(weight * contact.weights[c] * n(i, j));
        }
        if (workspace.row_of_node[node] < 0) continue;
        auto& b = rows[static_cast<std::size_t>(workspace.row_of_node[node])].b;
        const Mat36 block = (-weight * contact.weights[c]) * (n * jacobian);
        for (int i = 0; i < 3; ++i) {
          for (int j = 0; j < 6; ++j) b[static_cast<std::size_t>(6 * i + j)] += static_cast<Real>(block(i, j));
        }
      }
      for (std::size_t k = 0; k < 6; ++k) {
        const double scale = weight * contact.weights[static_cast<std::size_t>(corner_pairs[k][0])] *
                             contact.weights[static_cast<std::size_t>(corner_pairs[k][1])];
        add_edge_block(numbers.system, scene.sparsity.tet_edges[6 * static_cast<std::size_t>(contact.tet) + k],
                       scale * n);
      }
    }
    for (std::int32_t node : workspace.touched) workspace.row_of_node[static_cast<std::size_t>(node)] = -1;
  }
}

// workspace.forces becomes the right-hand side (times 1/1: already multiplied by h) without contacts.
template <class Real>
void assemble_tissue(const Scene& scene, State& state, Numbers<Real>& numbers, Workspace& workspace) {
  const double h = scene.settings.step_s;
  const StepCoefficients coefficients{h, scene.settings.damping};
  assemble_elements<Real>(scene.elements, scene.sparsity, coefficients, scene.mesh.rest_positions, state.positions,
                          state.velocities, {}, state.rotations, numbers.system);
  elastic_forces<Real>(scene.elements, numbers.system, workspace.forces);
  const double alpha = scene.settings.damping.alpha_1_s;
  const Vec3& gravity = scene.settings.gravity;
  const std::int64_t count = scene.node_count();
#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t i = 0; i < count; ++i) {
    const auto n = static_cast<std::size_t>(i);
    const double mass = scene.elements.node_mass[n];
    for (std::size_t d = 0; d < 3; ++d) {
      workspace.forces[3 * n + d] = h * (mass * (gravity[static_cast<Eigen::Index>(d)] -
                                                 alpha * state.velocities[3 * n + d]) -
                                         workspace.forces[3 * n + d]);
    }
  }
  for (const NodeSpring& spring : scene.settings.springs) {
    const auto n = static_cast<std::size_t>(spring.node);
    const double weight = h * (spring.damping_N_s_m + h * spring.stiffness_N_m);
    for (std::size_t d = 0; d < 3; ++d) {
      const double stretch = state.positions[3 * n + d] - scene.mesh.rest_positions[n][static_cast<Eigen::Index>(d)];
      workspace.forces[3 * n + d] -= h * spring.stiffness_N_m * stretch + weight * state.velocities[3 * n + d];
      numbers.system.node_terms[16 * n + 4 * d] += static_cast<Real>(weight);
    }
  }
}

template <class Real>
SolveResult solve(const Scene& scene, double tolerance, double floor_scale, Numbers<Real>& numbers,
                  Workspace& workspace) {
  // eliminate the tools: b - B C^-1 c
  auto& solver = numbers.solver;
  const std::int64_t slots = scene.sparsity.chunks * 16;
#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t slot = 0; slot < slots; ++slot) {
    const std::int32_t node = scene.sparsity.node_of_slot[static_cast<std::size_t>(slot)];
    for (std::int64_t d = 0; d < 3; ++d) {
      solver.b[static_cast<std::size_t>((slot / 16 * 3 + d) * 16 + slot % 16)] =
          node < 0 ? Real(0) : static_cast<Real>(workspace.forces[static_cast<std::size_t>(3 * node + d)]);
    }
  }
  std::array<Vec6, 8> first;  // C^-1 c, a tool
  assert(workspace.tools.size() <= first.size());
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    const Mat6 inverse = workspace.tools[t].matrix.llt().solve(Mat6::Identity());
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) numbers.borders[t].inverse[static_cast<std::size_t>(6 * i + j)] = inverse(i, j);
    }
    first[t] = inverse * workspace.tools[t].right_hand_side;
    for (const auto& row : numbers.borders[t].rows) {
      for (std::size_t i = 0; i < 3; ++i) {
        double sum = 0;
        for (std::size_t j = 0; j < 6; ++j) {
          sum += static_cast<double>(row.b[6 * i + j]) * first[t][static_cast<Eigen::Index>(j)];
        }
        solver.b[static_cast<std::size_t>(row.offset) + 16 * i] -= static_cast<Real>(sum);
      }
    }
  }

  RowMatrix<Real> matrix;
  matrix.chunks = scene.sparsity.chunks;
  matrix.chunk_start = scene.sparsity.chunk_start.data();
  matrix.column = scene.sparsity.column.data();
  matrix.values = numbers.system.values.data();
  matrix.diagonal = numbers.system.diagonal.data();
  matrix.inverse = numbers.system.inverse.data();
  const double floor = floor_scale * std::sqrt(scene.total_mass_kg);
  const SolveResult result =
      conjugate_gradients(matrix, numbers.borders, tolerance, floor, scene.settings.solver.max_iterations, solver);

#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t slot = 0; slot < slots; ++slot) {
    const std::int32_t node = scene.sparsity.node_of_slot[static_cast<std::size_t>(slot)];
    if (node < 0) continue;
    for (std::int64_t d = 0; d < 3; ++d) {
      workspace.increments[static_cast<std::size_t>(3 * node + d)] =
          static_cast<double>(solver.x[static_cast<std::size_t>((slot / 16 * 3 + d) * 16 + slot % 16)]);
    }
  }
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    Vec6 change = workspace.tools[t].right_hand_side;
    for (const auto& row : numbers.borders[t].rows) {
      for (std::size_t i = 0; i < 3; ++i) {
        const double x = static_cast<double>(solver.x[static_cast<std::size_t>(row.offset) + 16 * i]);
        for (std::size_t j = 0; j < 6; ++j) {
          change[static_cast<Eigen::Index>(j)] -= static_cast<double>(row.b[6 * i + j]) * x;
        }
      }
    }
    Vec6 increment = Vec6::Zero();
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        increment[i] += numbers.borders[t].inverse[static_cast<std::size_t>(6 * i + j)] * change[j];
      }
    }
    workspace.tools[t].increment = increment;
  }
  return result;
}

// Force of a contact on the tissue after the solve.
Vec3 contact_force(const Scene& scene, const State& state, const Contact& contact, const Workspace& workspace) {
  const ContactLaw& law = scene.settings.contact;
  const ToolSystem& tool = workspace.tools[static_cast<std::size_t>(contact.tool)];
  Vec3 rate = gap_velocity(contact, scene.mesh, state.velocities, tool.velocity + tool.increment);
  const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c) rate -= contact.weights[c] * node_vector(workspace.increments, nodes[c]);
  return response(law, contact.normal) * (law.stiffness_N_m * contact.gap +
                                          (law.damping_N_s_m + scene.settings.step_s * law.stiffness_N_m) * rate);
}

// Drops the contacts that would pull; returns whether any did.
bool drop_pulling_contacts(const Scene& scene, const State& state, Workspace& workspace, StepReport& report) {
  const auto pulls = [&](const Contact& contact) {
    if (!(contact_force(scene, state, contact, workspace).dot(contact.normal) > 0)) return false;
    ++report.tools[static_cast<std::size_t>(contact.tool)].dropped_contacts;
    return true;
  };
  const auto end = std::remove_if(workspace.contacts.begin(), workspace.contacts.end(), pulls);
  const bool any = end != workspace.contacts.end();
  workspace.contacts.erase(end, workspace.contacts.end());
  return any;
}

template <class Real>
SolveResult assemble_and_solve(const Scene& scene, std::span<const DeviceSample> samples, State& state,
                               Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer,
                               double tolerance, double floor_scale) {
  assemble_tissue(scene, state, numbers, workspace);
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) assemble_tool(scene, samples[t], state, t, workspace);
  assemble_contacts(scene, state, numbers, workspace);
  finish_rows<Real>(scene.sparsity, scene.free_node, numbers.system);
  if (observer != nullptr) observer->stage_done(Stage::assembly);
  const SolveResult result = solve(scene, tolerance, floor_scale, numbers, workspace);
  if (observer != nullptr) observer->stage_done(Stage::solve);
  return result;
}

void report_contacts(const Scene& scene, const State& state, const Workspace& workspace, StepReport& report) {
  for (const Contact& contact : workspace.contacts) {
    ToolReport& tool = report.tools[static_cast<std::size_t>(contact.tool)];
    const Vec3 force = contact_force(scene, state, contact, workspace);
    tool.contact_force -= force;
    tool.contact_torque -= contact.arm.cross(force);
    for (double weight : contact.weights) tool.tissue_force += weight * force;
    const double push = -force.dot(contact.normal);
    tool.min_push_N = tool.contacts == 0 ? push : std::fmin(tool.min_push_N, push);
    ++tool.contacts;
  }
}

void report_elastic_energy(const Scene& scene, const State& state, int threads, StepReport& report) {
  report.elastic_energy_J =
      elastic_energy(scene.elements, scene.mesh.rest_positions, state.positions, state.rotations, {}, threads);
  for (const NodeSpring& spring : scene.settings.springs) {
    const Vec3 stretch = node_vector(state.positions, spring.node) -
                         scene.mesh.rest_positions[static_cast<std::size_t>(spring.node)];
    report.elastic_energy_J += 0.5 * spring.stiffness_N_m * stretch.squaredNorm();
  }
}

void report_kinetic_energy(const Scene& scene, const State& state, StepReport& report) {
  report.kinetic_energy_J = 0;
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
    report.kinetic_energy_J +=
        0.5 * scene.elements.node_mass[n] * node_vector(state.velocities, static_cast<std::int32_t>(n)).squaredNorm();
  }
}

// x += h v and the like; returns whether all is finite.
bool update_tissue(const Scene& scene, const Workspace& workspace, State& state) {
  const double h = scene.settings.step_s;
  const std::size_t count = state.positions.size();
  bool finite = true;
  for (std::size_t i = 0; i < count; ++i) {
    state.velocities[i] += workspace.increments[i];
    state.positions[i] += h * state.velocities[i];
    finite = finite && std::isfinite(state.positions[i]);
  }
  return finite;
}

bool update_tool(const Scene& scene, const DeviceSample& sample, std::size_t t, const Workspace& workspace,
                 State& state, ToolReport& report) {
  const double h = scene.settings.step_s;
  const VirtualCoupling& coupling = scene.settings.tools[t].coupling;
  const ToolSystem& tool = workspace.tools[t];
  const Vec6 velocity = tool.velocity + tool.increment;
  const Vec3 linear = velocity.head<3>();
  const Vec3 angular = velocity.tail<3>();
  const Vec3 position = tool.start.position + h * linear;
  const Quaternion orientation = normalised(quaternion_from_rotation_vector(h * angular) * tool.start.orientation);
  const Vec3 linear_momentum = scene.settings.tools[t].body.mass_kg * linear;
  const Vec3 angular_momentum = tool.inertia * angular;

  double* pose = &state.tool_poses[7 * t];
  double* momentum = &state.tool_momenta[6 * t];
  double* filtered = &state.filtered_forces[6 * t];
  const double numbers[7] = {position[0],   position[1],   position[2],  orientation.s,
                             orientation.x, orientation.y, orientation.z};
  std::copy(numbers, numbers + 7, pose);
  const Vec3 hand_velocity = sample.linear_velocity_valid ? sample.linear_velocity : Vec3(Vec3::Zero());
  const Vec3 hand_rotation = sample.angular_velocity_valid ? sample.angular_velocity : Vec3(Vec3::Zero());
  report.coupling_force = -(coupling.stiffness_N_m * (sample.position - position) +
                            coupling.damping_N_s_m * (hand_velocity - linear));
  report.coupling_torque = -(coupling.rotational_stiffness_N_m_rad *
                                 (tool.misalignment - h * (tool.stiffness * angular)) +
                             coupling.rotational_damping_N_m_s_rad * (hand_rotation - angular));
  bool finite = true;
  for (int d = 0; d < 3; ++d) {
    momentum[d] = linear_momentum[d];
    momentum[3 + d] = angular_momentum[d];
    filtered[d] += scene.filter_alpha[t] * (report.coupling_force[d] - filtered[d]);
    filtered[3 + d] += scene.filter_alpha[t] * (report.coupling_torque[d] - filtered[3 + d]);
    report.displayed_force[d] = filtered[d];
    report.displayed_torque[d] = filtered[3 + d];
    finite = finite && std::isfinite(position[d]) && std::isfinite(momentum[d]) && std::isfinite(momentum[3 + d]);
  }
  return finite;
}

template <class Real>
void step_in(const Scene& scene, std::span<const DeviceSample> samples, State& state, StepReport& report,
             Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer) {
  if (!scene.settings.tools.empty()) find_contacts(scene, state, workspace);
  for (ToolReport& tool : report.tools) tool = ToolReport{};
  for (const Contact& contact : workspace.contacts) {
    double& depth = report.tools[static_cast<std::size_t>(contact.tool)].max_penetration_m;
    depth = std::fmax(depth, contact.depth_m);
  }
  if (observer != nullptr) observer->stage_done(Stage::contacts);

  const SolverSettings& settings = scene.settings.solver;
  SolveResult result = assemble_and_solve(scene, samples, state, numbers, workspace, observer, settings.tolerance,
                                          settings.velocity_floor_m_s);
  report.iterations = result.iterations;
  constexpr int most_solves_again = 4;  // what still pulls then is smaller by orders: the report's min_push tells
  for (int again = 0; again < most_solves_again && scene.settings.contact.tension_rule &&
                      drop_pulling_contacts(scene, state, workspace, report);
       ++again) {
    result = assemble_and_solve(scene, samples, state, numbers, workspace, observer, settings.tolerance,
                                settings.velocity_floor_m_s);
    report.iterations += result.iterations;
  }
  report.residual = result.residual;
  report.converged = result.converged;

  report_contacts(scene, state, workspace, report);
  if (scene.settings.energies) report_elastic_energy(scene, state, workspace.threads, report);
  report.finite = update_tissue(scene, workspace, state) && !result.broken;
  if (scene.settings.energies) report_kinetic_energy(scene, state, report);
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    report.finite = update_tool(scene, samples[t], t, workspace, state, report.tools[t]) && report.finite;
  }
  report.step = state.step;
  ++state.step;
  report.time_s = static_cast<double>(state.step) * scene.settings.step_s;
  if (observer != nullptr) observer->stage_done(Stage::update);
}

}  // namespace

WorkspacePtr make_workspace(const Scene& scene, int threads, Isa isa) {
  assert(threads >= 1);
  WorkspacePtr workspace(new Workspace);
  workspace->threads = threads;
  if (scene.settings.solver.precision == Precision::single_precision) {
    workspace->single = make_numbers<float>(scene, threads, isa);
  } else {
    workspace->twice = make_numbers<double>(scene, threads, isa);
  }
  const std::size_t nodes = scene.mesh.rest_positions.size();
  workspace->forces.assign(3 * nodes, 0.0);
  workspace->increments.assign(3 * nodes, 0.0);
  workspace->tools.resize(scene.settings.tools.size());
  std::size_t vertices = 0, most = 0;
  for (const Tool& tool : scene.settings.tools) {
    vertices += tool.surface.vertices.size();
    most = std::max(most, tool.surface.vertices.size());
  }
  if (!scene.settings.tools.empty()) {
    workspace->row_of_node.assign(nodes, -1);
    workspace->touched.reserve(4 * most);
    workspace->contacts.reserve(vertices);
    workspace->vertices.reserve(most);
    workspace->search.found.reserve(most);
    workspace->search.candidates.reserve(scene.mesh.tets.size());
    workspace->search.cell_items.reserve(8 * scene.mesh.tets.size());
    workspace->search.cell_start.reserve(16 * 16 * 16 + 1);
  }
  return workspace;
}

StepReport make_report(const Scene& scene) {
  StepReport report;
  report.tools.resize(scene.settings.tools.size());
  return report;
}

void step(const Scene& scene, std::span<const DeviceSample> samples, State& state, StepReport& report,
          Workspace& workspace, StageObserver* observer) {
  assert(samples.size() == scene.settings.tools.size() && report.tools.size() == samples.size());
  if (workspace.single) {
    step_in(scene, samples, state, report, *workspace.single, workspace, observer);
  } else {
    step_in(scene, samples, state, report, *workspace.twice, workspace, observer);
  }
}

double measure_solver_error(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                            int threads) {
  // the scene's own solve
  State copy = state;
  WorkspacePtr own = make_workspace(scene, threads);
  if (!scene.settings.tools.empty()) find_contacts(scene, copy, *own);
  const SolverSettings& settings = scene.settings.solver;
  if (own->single) {
    assemble_and_solve(scene, samples, copy, *own->single, *own, nullptr, settings.tolerance,
                       settings.velocity_floor_m_s);
  } else {
    assemble_and_solve(scene, samples, copy, *own->twice, *own, nullptr, settings.tolerance,
                       settings.velocity_floor_m_s);
  }
  // the reference: same contacts, double precision, tight tolerance
  Workspace reference;
  reference.threads = threads;
  reference.forces.assign(state.positions.size(), 0.0);
  reference.increments.assign(state.positions.size(), 0.0);
  reference.tools.resize(scene.settings.tools.size());
  reference.row_of_node = own->row_of_node;
  reference.contacts = own->contacts;
  const auto numbers = make_numbers<double>(scene, threads, widest_isa());
  copy = state;
  assemble_and_solve(scene, samples, copy, *numbers, reference, nullptr, 1e-10, 0);
  double error = 0, size = 0;
  for (std::size_t i = 0; i < state.positions.size(); ++i) {
    const double difference = own->increments[i] - reference.increments[i];
    error += difference * difference;
    size += reference.increments[i] * reference.increments[i];
  }
  const double rest = static_cast<double>(scene.node_count()) * resting_increment_m_s * resting_increment_m_s;
  return std::sqrt(error / std::max(size, rest));
}

std::vector<double> max_principal_stress(const Scene& scene, const State& state) {
  return largest_principal_stress(scene.elements, scene.mesh.rest_positions, state.positions, state.alive);
}

std::int64_t count_inverted(const Scene& scene, const State& state) {
  return count_inverted_elements(scene.elements, scene.mesh.rest_positions, state.positions, state.alive);
}

}  // namespace sulcus
