#include "engine/scene/system.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace sulcus {
namespace {

using Mat36 = Eigen::Matrix<double, 3, 6>;

Mat3 skew(const Vec3& u) {
  Mat3 m;
  m << 0, -u[2], u[1], u[2], 0, -u[0], -u[1], u[0], 0;
  return m;
}

Mat3 response(const ContactLaw& law, const Vec3& normal) {
  return law.anisotropy * Mat3::Identity() + (1 - law.anisotropy) * (normal * normal.transpose());
}

// Velocity of the tool's vertex minus that of the tissue's surface point.
Vec3 gap_velocity(const Contact& contact, const EmbeddingMesh& mesh, std::span<const double> velocities,
                  const Vec6& tool) {
  Vec3 rate = tool.head<3>() + tool.tail<3>().cross(contact.arm);
  const auto& nodes = mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c) rate -= contact.weights[c] * node_vector(velocities, nodes[c]);
  return rate;
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
      tool.start.linear_momentum + h * (coupling.stiffness_N_m * (sample.position - tool.start.position) +
                                        coupling.damping_N_s_m * hand_velocity);
  tool.right_hand_side.tail<3>() =
      tool.start.angular_momentum + h * (coupling.rotational_stiffness_N_m_rad * tool.misalignment +
                                         coupling.rotational_damping_N_m_s_rad * hand_rotation);
  tool.right_hand_side -= tool.matrix * tool.velocity;
}

// Calls visit(numbers, their saved copy) for all that the tissue's part holds at a contact's nodes and edges.
template <class Real, class Visit>
void for_each_saved(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace, std::size_t contact,
                    Visit&& visit) {
  const auto tet = static_cast<std::size_t>(numbers.saved_tets[contact]);
  for (std::size_t k = 0; k < 6; ++k) {
    const auto edge = static_cast<std::size_t>(scene.sparsity.tet_edges[6 * tet + k]);
    visit(std::span(&numbers.system.blocks[12 * edge], 12),
          std::span(&numbers.saved_blocks[12 * (6 * contact + k)], 12));
  }
  for (std::size_t c = 0; c < 4; ++c) {
    const auto node = static_cast<std::size_t>(scene.mesh.tets[tet][c]);
    visit(std::span(&numbers.system.node_terms[16 * node], 9),
          std::span(&numbers.saved_terms[9 * (4 * contact + c)], 9));
    visit(std::span(&workspace.forces[3 * node], 3),
          std::span(&numbers.saved_forces[3 * (4 * contact + c)], 3));
  }
}

template <class Real>
void save_tissue(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace) {
  const std::size_t count = workspace.contacts.size();
  numbers.saved_tets.clear();
  for (const Contact& contact : workspace.contacts) numbers.saved_tets.push_back(contact.tet);
  numbers.saved_blocks.resize(72 * count);
  numbers.saved_terms.resize(36 * count);
  numbers.saved_forces.resize(12 * count);
  for (std::size_t c = 0; c < count; ++c) {
    for_each_saved(scene, numbers, workspace, c,
                   [](auto now, auto saved) { std::copy(now.begin(), now.end(), saved.begin()); });
  }
}

// Backwards, so that of several copies of a place the first one saved is the last one restored.
template <class Real>
void restore_tissue(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace) {
  for (std::size_t c = numbers.saved_tets.size(); c-- > 0;) {
    for_each_saved(scene, numbers, workspace, c,
                   [](auto now, auto saved) { std::copy(saved.begin(), saved.end(), now.begin()); });
  }
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
      for (std::size_t c = 0; c < 4; ++c) {
        const std::int32_t node = scene.mesh.tets[static_cast<std::size_t>(contact.tet)][c];
        std::int32_t& row = workspace.row_of_node[static_cast<std::size_t>(node)];
        if (row < 0 && contact.weights[c] != 0) {
          row = 0;
          workspace.touched.push_back(node);
        }
      }
    }
    const auto slot = [&](std::int32_t node) {
      return scene.sparsity.slot_of_node[static_cast<std::size_t>(node)];
    };
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
      const Vec3 push = n * (h * law.stiffness_N_m * contact.gap +
                             weight * gap_velocity(contact, scene.mesh, state.velocities, tool.velocity));
      tool.matrix += weight * (jacobian.transpose() * (n * jacobian));
      tool.right_hand_side -= jacobian.transpose() * push;

      const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
      for (std::size_t c = 0; c < 4; ++c) {
        if (contact.weights[c] == 0) continue;
        const auto node = static_cast<std::size_t>(nodes[c]);
        for (std::size_t d = 0; d < 3; ++d) {
          workspace.forces[3 * node + d] += contact.weights[c] * push[static_cast<Eigen::Index>(d)];
        }
        Real* terms = &numbers.system.node_terms[16 * node];
        for (int i = 0; i < 3; ++i) {
          for (int j = 0; j < 3; ++j)
            terms[3 * i + j] += static_cast<Real>(weight * contact.weights[c] * n(i, j));
        }
        auto& b = rows[static_cast<std::size_t>(workspace.row_of_node[node])].b;
        const Mat36 block = (-weight * contact.weights[c]) * (n * jacobian);
        for (int i = 0; i < 3; ++i) {
          for (int j = 0; j < 6; ++j)
            b[static_cast<std::size_t>(6 * i + j)] += static_cast<Real>(block(i, j));
        }
      }
      for (std::size_t k = 0; k < 6; ++k) {
        const double scale = weight * contact.weights[static_cast<std::size_t>(corner_pairs[k][0])] *
                             contact.weights[static_cast<std::size_t>(corner_pairs[k][1])];
        if (scale != 0) {
          add_edge_block(numbers.system,
                         scene.sparsity.tet_edges[6 * static_cast<std::size_t>(contact.tet) + k], scale * n);
        }
      }
    }
    for (std::int32_t node : workspace.touched) workspace.row_of_node[static_cast<std::size_t>(node)] = -1;
  }
}

// Matrix of the tissue without contacts; workspace.forces becomes its right-hand side, impulses [N s].
template <class Real>
void assemble_tissue(const Scene& scene, State& state, Numbers<Real>& numbers, Workspace& workspace) {
  const double h = scene.settings.step_s;
  const StepCoefficients coefficients{h, scene.settings.damping};
  assemble_elements<Real>(scene.elements, scene.sparsity, coefficients, scene.mesh.rest_positions,
                          state.positions, state.velocities, present(scene, state), state.rotations,
                          numbers.system);
  elastic_forces<Real>(scene.elements, numbers.system, workspace.forces);
  const double alpha = scene.settings.damping.alpha_1_s;
  const Vec3& gravity = scene.settings.gravity;
  const std::int64_t count = scene.node_count();
#pragma omp parallel for num_threads(workspace.threads) schedule(static)
  for (std::int64_t i = 0; i < count; ++i) {
    const auto n = static_cast<std::size_t>(i);
    const double mass = scene.elements.node_mass[n];
    // materials with a damping of their own: drag instead of alpha
    const double own_alpha = scene.elements.drag_kg_s.empty() ? alpha : scene.elements.drag_kg_s[n] / mass;
    for (std::size_t d = 0; d < 3; ++d) {
      workspace.forces[3 * n + d] =
          h * (mass * (gravity[static_cast<Eigen::Index>(d)] - own_alpha * state.velocities[3 * n + d]) -
               workspace.forces[3 * n + d]);
    }
  }
  for (const NodeForce& load : scene.settings.forces) {
    const auto n = static_cast<std::size_t>(load.node);
    for (std::size_t d = 0; d < 3; ++d)
      workspace.forces[3 * n + d] += h * load.force_N[static_cast<Eigen::Index>(d)];
  }
  for (const NodeSpring& spring : scene.settings.springs) {
    const auto n = static_cast<std::size_t>(spring.node);
    const double weight = h * (spring.damping_N_s_m + h * spring.stiffness_N_m);
    for (std::size_t d = 0; d < 3; ++d) {
      const double stretch =
          state.positions[3 * n + d] - scene.mesh.rest_positions[n][static_cast<Eigen::Index>(d)];
      workspace.forces[3 * n + d] -=
          h * spring.stiffness_N_m * stretch + weight * state.velocities[3 * n + d];
      numbers.system.node_terms[16 * n + 4 * d] += static_cast<Real>(weight);
    }
  }
}

// The increments that bring the nodes on paths to where they shall be at the end of the step.
template <class Real>
void prescribe(const Scene& scene, const State& state, SolverWorkspace<Real>& solver) {
  for (const PrescribedMotion& motion : scene.settings.motions) {
    const auto next = static_cast<std::size_t>(state.step) + 1;
    const auto& place = motion.path[std::min(next, motion.path.size() - 1)];
    const Mat3 turn = rotation_matrix(place.turn);
    for (std::int32_t node : motion.nodes) {
      const Vec3 rest = scene.mesh.rest_positions[static_cast<std::size_t>(node)] - motion.centre;
      const Vec3 way = motion.centre + turn * rest + place.shift - node_vector(state.positions, node);
      const Vec3 increment = way / scene.settings.step_s - node_vector(state.velocities, node);
      for (std::size_t d = 0; d < 3; ++d) {
        solver.prescribed[solver_entry(scene, node, d)] =
            static_cast<Real>(increment[static_cast<Eigen::Index>(d)]);
      }
    }
  }
}

// Makes the last solution the place where the next search begins.
template <class Real>
void guess_last_solution(SolverWorkspace<Real>& solver) {
  for (std::size_t i = 0; i < solver.guess.size(); ++i) {
    solver.guess[i] = solver.prescribed.empty() ? solver.x[i] : solver.x[i] - solver.prescribed[i];
  }
}

// What holds the nodes on their paths: the residual there.
template <class Real>
void sum_motion_forces(const Scene& scene, const SolverWorkspace<Real>& solver, Workspace& workspace) {
  for (std::size_t m = 0; m < scene.settings.motions.size(); ++m) {
    Vec3 impulse = Vec3::Zero();
    for (std::int32_t node : scene.settings.motions[m].nodes) {
      for (std::size_t d = 0; d < 3; ++d) {
        impulse[static_cast<Eigen::Index>(d)] -= static_cast<double>(solver.r[solver_entry(scene, node, d)]);
      }
    }
    workspace.motion_forces[m] = impulse / scene.settings.step_s;
  }
}

template <class Real>
SolveResult solve(const Scene& scene, const State& state, double tolerance, double floor_m_s,
                  Numbers<Real>& numbers, Workspace& workspace) {
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
  for (std::size_t t = 0; t < workspace.tools.size(); ++t) {
    const Mat6 inverse = workspace.tools[t].matrix.llt().solve(Mat6::Identity());
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j)
        numbers.borders[t].inverse[static_cast<std::size_t>(6 * i + j)] = inverse(i, j);
    }
    const Vec6 first = inverse * workspace.tools[t].right_hand_side;
    for (const auto& row : numbers.borders[t].rows) {
      for (std::size_t i = 0; i < 3; ++i) {
        double sum = 0;
        for (std::size_t j = 0; j < 6; ++j) {
          sum += static_cast<double>(row.b[6 * i + j]) * first[static_cast<Eigen::Index>(j)];
        }
        solver.b[static_cast<std::size_t>(row.offset) + 16 * i] -= static_cast<Real>(sum);
      }
    }
  }

  if (!scene.settings.motions.empty()) prescribe(scene, state, solver);

  RowMatrix<Real> matrix;
  matrix.chunks = scene.sparsity.chunks;
  matrix.chunk_start = scene.sparsity.chunk_start.data();
  matrix.column = scene.sparsity.column.data();
  matrix.values = numbers.system.values.data();
  matrix.diagonal = numbers.system.diagonal.data();
  matrix.inverse = numbers.system.inverse.data();
  const double floor = floor_m_s * std::sqrt(scene.total_mass_kg);
  const SolveResult result = conjugate_gradients(matrix, numbers.borders, tolerance, floor,
                                                 scene.settings.solver.max_iterations, solver);
  sum_motion_forces(scene, solver, workspace);

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

}  // namespace

template <class Real>
std::unique_ptr<Numbers<Real>> make_numbers(const Scene& scene, int threads, Isa isa) {
  auto numbers = std::make_unique<Numbers<Real>>();
  numbers->system = make_system_matrix<Real>(scene.elements, scene.sparsity, isa, threads);
  numbers->solver = make_solver_workspace<Real>(scene.sparsity, isa, threads);
  if (!scene.settings.tools.empty() && scene.settings.contact.tension_rule) {
    numbers->solver.guess.assign(numbers->solver.b.size(), Real(0));
    std::size_t contacts = 0;
    for (const Tool& tool : scene.settings.tools) contacts += tool.surface.vertices.size();
    if (scene.settings.detection == ContactDetection::surface_nodes)
      contacts = scene.mesh.rest_positions.size() * scene.settings.tools.size();
    numbers->saved_tets.reserve(contacts);
    numbers->saved_blocks.reserve(72 * contacts);
    numbers->saved_terms.reserve(36 * contacts);
    numbers->saved_forces.reserve(12 * contacts);
  }
  if (!scene.settings.motions.empty()) numbers->solver.prescribed.assign(numbers->solver.b.size(), Real(0));
  numbers->borders.resize(scene.settings.tools.size());
  for (std::size_t t = 0; t < numbers->borders.size(); ++t) {
    const bool by_nodes = scene.settings.detection == ContactDetection::surface_nodes;
    numbers->borders[t].rows.reserve(by_nodes ? scene.mesh.rest_positions.size()
                                              : 4 * scene.settings.tools[t].surface.vertices.size());
  }
  return numbers;
}

// Force of a contact on the tissue after the solve.
Vec3 contact_force(const Scene& scene, const State& state, const Contact& contact,
                   const Workspace& workspace) {
  const ContactLaw& law = scene.settings.contact;
  const ToolSystem& tool = workspace.tools[static_cast<std::size_t>(contact.tool)];
  Vec3 rate = gap_velocity(contact, scene.mesh, state.velocities, tool.velocity + tool.increment);
  const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c)
    rate -= contact.weights[c] * node_vector(workspace.increments, nodes[c]);
  return response(law, contact.normal) *
         (law.stiffness_N_m * contact.gap +
          (law.damping_N_s_m + scene.settings.step_s * law.stiffness_N_m) * rate);
}

template <class Real>
void keep_in_planes(const Scene& scene, SystemMatrix<Real>& system) {
  for (const SlidingNode& sliding : scene.settings.sliding) {
    const auto& keeps = scene.keeps[static_cast<std::size_t>(sliding.node)];
    const auto slot =
        static_cast<std::size_t>(scene.sparsity.slot_of_node[static_cast<std::size_t>(sliding.node)]);
    const std::size_t first = slot / 16 * 144 + slot % 16;
    if (system.inverse[first] == 0 && system.inverse[first + 64] == 0 && system.inverse[first + 128] == 0)
      continue;
    Mat3 block;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const bool kept = keeps[static_cast<std::size_t>(i)] || keeps[static_cast<std::size_t>(j)];
        block(i, j) =
            !kept ? static_cast<double>(system.diagonal[first + 16 * static_cast<std::size_t>(3 * i + j)])
                  : (i == j ? 1.0 : 0.0);
      }
    }
    const Mat3 inverse = block.inverse();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const bool kept = keeps[static_cast<std::size_t>(i)] || keeps[static_cast<std::size_t>(j)];
        system.inverse[first + 16 * static_cast<std::size_t>(3 * i + j)] =
            kept ? Real(0) : static_cast<Real>(inverse(i, j));
      }
    }
  }
}

template <class Real>
SolveResult assemble_and_solve(const Scene& scene, std::span<const DeviceSample> samples, State& state,
                               Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer,
                               double tolerance, double floor_m_s, bool again) {
  numbers.solver.use_guess = again;
  if (again) guess_last_solution(numbers.solver);
  if (again) {
    restore_tissue(scene, numbers, workspace);
  } else {
    assemble_tissue(scene, state, numbers, workspace);
    if (!numbers.solver.guess.empty()) save_tissue(scene, numbers, workspace);
  }
  for (std::size_t t = 0; t < workspace.tools.size(); ++t)
    assemble_tool(scene, samples[t], state, t, workspace);
  assemble_contacts(scene, state, numbers, workspace);
  finish_rows<Real>(scene.sparsity, scene.fracture ? workspace.view.free_node : scene.free_node,
                    numbers.system);
  if (!scene.keeps.empty()) keep_in_planes(scene, numbers.system);
  if (observer != nullptr) observer->stage_done(Stage::assembly);
  const SolveResult result = solve(scene, state, tolerance, floor_m_s, numbers, workspace);
  if (observer != nullptr) observer->stage_done(Stage::solve);
  return result;
}

#define SULCUS_INSTANTIATE(Real)                                                                            \
  template std::unique_ptr<Numbers<Real>> make_numbers<Real>(const Scene&, int, Isa);                       \
  template void keep_in_planes<Real>(const Scene&, SystemMatrix<Real>&);                                    \
  template SolveResult assemble_and_solve<Real>(const Scene&, std::span<const DeviceSample>, State&,        \
                                                Numbers<Real>&, Workspace&, StageObserver*, double, double, \
                                                bool);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
