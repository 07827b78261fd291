#include "engine/scene/system.h"

#include "engine/scene/contact_system.h"
#include "engine/scene/past.h"
#include "engine/scene/prescribed_contact.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <type_traits>

namespace sulcus {
namespace {

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
    if (contact.tool != static_cast<std::int32_t>(t) || law.explicit_forces) continue;
    const Vec3 force = -law.stiffness_N_m * (respond(scene, contact).direction * contact.gap);
    lever += 0.5 * (contact.arm * force.transpose() + force * contact.arm.transpose()) -
             force.dot(contact.arm) * Mat3::Identity();
  }
  const Mat3 with_lever = angular - h * h * lever;
  const bool definite = with_lever(0, 0) > 0 &&
                        with_lever(0, 0) * with_lever(1, 1) - with_lever(0, 1) * with_lever(1, 0) > 0 &&
                        with_lever.determinant() > 0;

  tool.lever = definite ? lever : Mat3(Mat3::Zero());
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

// Matrix of the tissue without contacts; workspace.forces becomes its right-hand side, impulses [N s].
template <class Real>
void assemble_tissue(const Scene& scene, State& state, Numbers<Real>& numbers, Workspace& workspace) {
  const double h = scene.settings.step_s;
  const StepCoefficients coefficients{h, scene.settings.damping};
  assemble_elements<Real>(scene.elements, scene.sparsity, coefficients, scene.mesh.rest_positions,
                          state.positions, state.velocities, present(scene, state),
                          free_nodes(scene, workspace.view), state.rotations, numbers.system);
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
               numbers.system.node_forces[3 * n + d]);
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

// Chunks of the rows that springs, contacts and leading tools change beside the tissue: what a repeated solve
// closes anew.
void list_touched(const Scene& scene, const Workspace& workspace, std::vector<std::int32_t>& chunks) {
  chunks.clear();
  const auto touch = [&](std::int32_t node) {
    chunks.push_back(scene.sparsity.slot_of_node[static_cast<std::size_t>(node)] / Sparsity::chunk_rows);
  };
  for (const NodeSpring& spring : scene.settings.springs) touch(spring.node);
  for (const Contact& contact : workspace.contacts)
    std::ranges::for_each(scene.mesh.tets[static_cast<std::size_t>(contact.tet)], touch);
  for (const LedNode& led : workspace.led) touch(led.node);
  std::sort(chunks.begin(), chunks.end());
  chunks.erase(std::unique(chunks.begin(), chunks.end()), chunks.end());
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

// Makes tissue at rest that place: where nodes are free to move.
template <class Real>
void guess_rest(const Scene& scene, const State& state, const Workspace& workspace,
                SolverWorkspace<Real>& solver) {
  std::fill(solver.guess.begin(), solver.guess.end(), Real(0));
  const std::span<const std::uint8_t> free_node = free_nodes(scene, workspace.view);
  for (std::size_t n = 0; n < free_node.size(); ++n) {
    for (std::size_t d = 0; d < 3; ++d) {
      if (!free_node[n] || (!scene.keeps.empty() && scene.keeps[n][d])) continue;
      solver.guess[solver_entry(scene, static_cast<std::int32_t>(n), d)] =
          static_cast<Real>(-state.velocities[3 * n + d]);
    }
  }
  for (const LedNode& led : workspace.led) {
    for (std::size_t d = 0; d < 3; ++d) solver.guess[solver_entry(scene, led.node, d)] = Real(0);
  }
}

// What holds the nodes on their paths: the residual there.
template <class Real>
void sum_motion_forces(const Scene& scene, const State& state, const SolverWorkspace<Real>& solver,
                       Workspace& workspace) {
  workspace.path_work_J = 0;
  for (std::size_t m = 0; m < scene.settings.motions.size(); ++m) {
    Vec3 impulse = Vec3::Zero();
    for (std::int32_t node : scene.settings.motions[m].nodes) {
      for (std::size_t d = 0; d < 3; ++d) {
        const std::size_t entry = solver_entry(scene, node, d);
        const double held = static_cast<double>(solver.r[entry]);
        impulse[static_cast<Eigen::Index>(d)] -= held;
        workspace.path_work_J -= held * (state.velocities[3 * static_cast<std::size_t>(node) + d] +
                                         static_cast<double>(solver.x[entry]));
      }
    }
    workspace.motion_forces[m] = impulse / scene.settings.step_s;
  }
}

// The same across the planes that nodes slide on.
template <class Real>
void sum_plane_forces(const Scene& scene, const SolverWorkspace<Real>& solver, Workspace& workspace) {
  for (Vec3& force : workspace.plane_forces) force.setZero();
  for (const SlidingNode& sliding : scene.settings.sliding) {
    if (!scene.free_node[static_cast<std::size_t>(sliding.node)]) continue;
    const auto axis = static_cast<std::size_t>(sliding.axis);
    workspace.plane_forces[static_cast<std::size_t>(sliding.plane)][sliding.axis] -=
        static_cast<double>(solver.r[solver_entry(scene, sliding.node, axis)]) / scene.settings.step_s;
  }
}

template <class Real>
RowMatrix<Real> row_matrix(const Scene& scene, const Numbers<Real>& numbers) {
  return {scene.sparsity.chunks,        scene.sparsity.chunk_start.data(), scene.sparsity.column.data(),
          numbers.system.values.data(), numbers.system.diagonal.data(),    numbers.system.inverse.data()};
}

// The solver's right-hand side, without the tools: b - B C^-1 c.
template <class Real>
void eliminate_tools(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace) {
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
}

// Solves for the tissue and with it for the tools, or goes on if the solver is to.
template <class Real>
SolveResult solve(const Scene& scene, const State& state, const Effort& effort, Numbers<Real>& numbers,
                  Workspace& workspace) {
  auto& solver = numbers.solver;
  const std::int64_t slots = scene.sparsity.chunks * 16;
  if (solver.start != Start::pause) {
    eliminate_tools(scene, numbers, workspace);
    if (!scene.settings.motions.empty()) prescribe(scene, state, solver);
    if (scene.settings.solver.first_guess == FirstGuess::past && solver.start == Start::rest &&
        guess_from_past(scene, state, workspace, solver))
      solver.start = Start::guess;
  }
  const RowMatrix<Real> matrix = row_matrix(scene, numbers);
  const double floor = effort.floor_m_s * std::sqrt(scene.total_mass_kg);
  SolveResult result;
  if constexpr (std::is_same_v<Real, double>) {
    if (numbers.refinement)
      result = refined_conjugate_gradients(matrix, numbers.borders, effort.tolerance, floor,
                                           effort.max_iterations, solver, *numbers.refinement);
  }
  if (!numbers.refinement)
    result =
        conjugate_gradients(matrix, numbers.borders, effort.tolerance, floor, effort.max_iterations, solver);
  sum_motion_forces(scene, state, solver, workspace);
  sum_plane_forces(scene, solver, workspace);

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
std::unique_ptr<Numbers<Real>> make_numbers(const Scene& scene, int threads, Isa isa, bool refined) {
  auto numbers = std::make_unique<Numbers<Real>>();
  numbers->system = make_system_matrix<Real>(scene.elements, scene.sparsity, isa, threads,
                                             scene.settings.energies && !scene.settings.ledger);
  numbers->solver = make_solver_workspace<Real>(scene.sparsity, isa, threads);
  if (scene.solves_again() || scene.settings.solver.first_guess != FirstGuess::velocity)
    numbers->solver.guess.assign(numbers->solver.b.size(), Real(0));
  if (scene.solves_again()) {
    const std::size_t contacts = most_contacts(scene);
    numbers->saved_tets.reserve(contacts);
    numbers->saved_blocks.reserve(108 * contacts);
    numbers->saved_terms.reserve(36 * contacts);
    numbers->saved_forces.reserve(12 * contacts);
  }
  numbers->touched_chunks.reserve(scene.settings.springs.size() + 4 * most_contacts(scene) +
                                  (scene.settings.contact.prescribed ? scene.mesh.rest_positions.size() : 0));
  if (refined) numbers->refinement = make_refinement(scene.sparsity, isa, threads);
  if (scene.multigrid && refined) {
    use_multigrid(*scene.multigrid, scene.sparsity.chunks, numbers->refinement->solver);
  } else if (scene.multigrid) {
    use_multigrid(*scene.multigrid, scene.sparsity.chunks, numbers->solver);
  }
  if (!scene.settings.motions.empty() || scene.settings.contact.prescribed)
    numbers->solver.prescribed.assign(numbers->solver.b.size(), Real(0));
  if (scene.settings.contact.prescribed) {
    numbers->solver.sliding.reserve(scene.mesh.rest_positions.size());
    if (refined) numbers->refinement->solver.sliding.reserve(scene.mesh.rest_positions.size());
  }
  numbers->borders.resize(scene.settings.tools.size());
  if (refined) numbers->refinement->borders.resize(scene.settings.tools.size());
  for (std::size_t t = 0; t < numbers->borders.size(); ++t) {
    const bool by_nodes = scene.settings.detection == ContactDetection::surface_nodes;
    const std::size_t most =
        by_nodes ? scene.mesh.rest_positions.size() : 4 * scene.settings.tools[t].surface.vertices.size();
    numbers->borders[t].rows.reserve(most);
    if (refined) numbers->refinement->borders[t].rows.reserve(most);
  }
  return numbers;
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

// Makes the coarse levels follow the matrix.
template <class Real>
void set_up_levels(const Scene& scene, const State& state, const Workspace& workspace,
                   const RowMatrix<Real>& matrix, SolverWorkspace<Real>& solver) {
  auto& levels = solver.levels;
  clear_contacts(levels);
  for (const Contact& contact : workspace.contacts) {
    const ContactResponse response = respond(scene, contact);
    if (response.weight_kg == 0) continue;
    add_contact(*scene.multigrid, scene.mesh, contact.tet, contact.weights,
                response.weight_kg * response.matrix, levels);
  }
  set_up_multigrid<Real>(*scene.multigrid, matrix, state.rotations, present(scene, state), solver.kernels,
                         workspace.threads, levels);
  // a node that is led along one direction takes no corrections from the levels: they would move it there too
  for (const LedNode& led : workspace.led) {
    for (std::size_t d = 0; d < 3; ++d) levels.share[solver_entry(scene, led.node, d)] = Real(0);
  }
}

// What conjugate gradients need beside the matrix. A repeated solve keeps the levels: contacts that are gone
// only make the corrections there smaller.
template <class Real>
void prepare_solver(const Scene& scene, const State& state, const Workspace& workspace, bool again,
                    Numbers<Real>& numbers) {
  const bool with_levels = scene.multigrid && !again;
  if constexpr (std::is_same_v<Real, double>) {
    if (numbers.refinement) {
      const RowMatrix<float> rounded = round_matrix(row_matrix(scene, numbers), *numbers.refinement);
      if (with_levels) set_up_levels(scene, state, workspace, rounded, numbers.refinement->solver);
      return;
    }
  }
  if (with_levels) set_up_levels(scene, state, workspace, row_matrix(scene, numbers), numbers.solver);
}

template <class Real>
SolveResult solve_and_tell(const Scene& scene, const State& state, const Effort& effort,
                           Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer) {
  const SolveResult result = solve(scene, state, effort, numbers, workspace);
  if (scene.settings.contact.prescribed) read_led_forces(scene, numbers, workspace);
  if (observer != nullptr) observer->stage_done(Stage::solve);
  return result;
}

template <class Real>
SolveResult assemble_and_solve(const Scene& scene, std::span<const DeviceSample> samples, State& state,
                               Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer,
                               const Effort& effort, bool again) {
  const bool from_rest = scene.settings.solver.first_guess == FirstGuess::rest && !again;
  numbers.solver.start = again ? Start::guess : from_rest ? Start::whole_guess : Start::rest;
  if (again) guess_last_solution(numbers.solver);
  if (from_rest) guess_rest(scene, state, workspace, numbers.solver);
  if (again) {
    restore_tissue(scene, numbers, workspace);
  } else {
    assemble_tissue(scene, state, numbers, workspace);
    if (scene.solves_again()) save_tissue(scene, numbers, workspace);
  }
  for (std::size_t t = 0; t < workspace.tools.size(); ++t)
    assemble_tool(scene, samples[t], state, t, workspace);
  assemble_contacts(scene, state, numbers, workspace);
  if (!again) list_touched(scene, workspace, numbers.touched_chunks);
  close_rows<Real>(scene.sparsity, free_nodes(scene, workspace.view), numbers.touched_chunks, numbers.system);
  if (!scene.keeps.empty()) keep_in_planes(scene, numbers.system);
  if (scene.settings.contact.prescribed) {
    std::fill(numbers.solver.prescribed.begin(), numbers.solver.prescribed.end(), Real(0));
    impose_led(scene, state, numbers, workspace);
  }
  prepare_solver(scene, state, workspace, again, numbers);
  if (observer != nullptr) observer->stage_done(Stage::assembly);
  return solve_and_tell(scene, state, effort, numbers, workspace, observer);
}

template <class Real>
SolveResult go_on_solving(const Scene& scene, const State& state, Numbers<Real>& numbers,
                          Workspace& workspace, StageObserver* observer, const Effort& effort) {
  numbers.solver.start = Start::pause;
  return solve_and_tell(scene, state, effort, numbers, workspace, observer);
}

#define SULCUS_INSTANTIATE(Real)                                                                           \
  template std::unique_ptr<Numbers<Real>> make_numbers<Real>(const Scene&, int, Isa, bool);                \
  template void keep_in_planes<Real>(const Scene&, SystemMatrix<Real>&);                                   \
  template SolveResult assemble_and_solve<Real>(const Scene&, std::span<const DeviceSample>, State&,       \
                                                Numbers<Real>&, Workspace&, StageObserver*, const Effort&, \
                                                bool);                                                     \
  template SolveResult go_on_solving<Real>(const Scene&, const State&, Numbers<Real>&, Workspace&,         \
                                           StageObserver*, const Effort&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
