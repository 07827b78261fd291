#include "engine/scene/statics.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "engine/fem/stress.h"
#include "engine/fem/tangent.h"
#include "engine/numerics/error.h"
#include "engine/scene/pieces.h"
#include "engine/scene/system.h"

namespace sulcus {
namespace {

// One equilibrium in the making. Forces are those on the nodes' restraint: the gradient of the energy.
struct Problem {
  const Scene& scene;
  const StaticSettings& settings;
  State& state;
  ElementData own_elements;  // without damping, where the scene's have their own
  const ElementData& elements;
  AliveView view;
  SystemMatrix<double> system;
  SolverWorkspace<double> solver;
  std::vector<double> forces;  // [3*nodes] N, gradient of the energy
  double energy = 0;           // J, elastic less the work of gravity and loads
  double elastic = 0;          // J
  double scale = 0;            // N, largest force
  double rounding_N = 0;       // N, what forces cannot be better than

  Problem(const Scene& of, const StaticSettings& how, State& from, int threads)
      : scene(of),
        settings(how),
        state(from),
        own_elements(of.elements.beta_s.empty() ? ElementData() : of.elements),
        elements(of.elements.beta_s.empty() ? of.elements : own_elements),
        forces(from.positions.size(), 0.0) {
    own_elements.beta_s.clear();
    own_elements.drag_kg_s.clear();
    system = make_system_matrix<double>(elements, scene.sparsity, widest_isa(), threads);
    solver = make_solver_workspace<double>(scene.sparsity, widest_isa(), threads);
    solver.prescribed.assign(solver.b.size(), 0.0);
    if (scene.fracture) update(scene, state.alive, view);
  }

  bool moves(std::size_t entry) const {
    return free_nodes(scene, view)[entry / 3] && (scene.keeps.empty() || !scene.keeps[entry / 3][entry % 3]);
  }

  // Rotations, warped stiffness, forces and energy at state.positions.
  void evaluate() {
    const std::vector<double> rest_velocity(state.positions.size(), 0.0);
    assemble_elements<double>(elements, scene.sparsity, {1, {}}, scene.mesh.rest_positions, state.positions,
                              rest_velocity, present(scene, state), free_nodes(scene, view), state.rotations,
                              system);
    forces = system.node_forces;
    std::fill(system.node_terms.begin(), system.node_terms.end(), 0.0);  // no mass
    elastic =
        elastic_energy(elements, state.positions, state.rotations, present(scene, state), system.threads);
    std::vector<double> external(forces.size(), 0.0);
    double work = 0;
    for (std::size_t i = 0; i < forces.size(); ++i) {
      external[i] = elements.node_mass[i / 3] * scene.settings.gravity[static_cast<Eigen::Index>(i % 3)];
    }
    for (const NodeForce& load : scene.settings.forces) {
      for (std::size_t d = 0; d < 3; ++d) {
        external[3 * static_cast<std::size_t>(load.node) + d] += load.force_N[static_cast<Eigen::Index>(d)];
      }
    }
    scale = 0;
    for (std::size_t i = 0; i < forces.size(); ++i) {
      const double displacement =
          state.positions[i] - scene.mesh.rest_positions[i / 3][static_cast<Eigen::Index>(i % 3)];
      work += external[i] * displacement;
      forces[i] -= external[i];
      scale = std::fmax(scale, std::fabs(external[i]));
    }
    for (const NodeSpring& spring : scene.settings.springs) {
      const auto n = static_cast<std::size_t>(spring.node);
      for (std::size_t d = 0; d < 3; ++d) {
        const double stretch =
            state.positions[3 * n + d] - scene.mesh.rest_positions[n][static_cast<Eigen::Index>(d)];
        const double force = spring.stiffness_N_m * stretch;
        forces[3 * n + d] += force;
        scale = std::fmax(scale, std::fabs(force));
        elastic += 0.5 * force * stretch;
        system.node_terms[16 * n + 4 * d] += spring.stiffness_N_m;
      }
    }
    for (std::size_t i = 0; i < forces.size(); ++i) {
      if (!moves(i)) scale = std::fmax(scale, std::fabs(forces[i]));  // reactions
    }
    energy = elastic - work;
  }

  // Largest unbalanced force over the largest force.
  double balance() const {
    double worst = 0;
    for (std::size_t i = 0; i < forces.size(); ++i) {
      if (!moves(i)) continue;
      if (!std::isfinite(forces[i])) return forces[i];
      worst = std::fmax(worst, std::fabs(forces[i]));
    }
    return worst <= rounding_N ? 0 : worst / std::fmax(scale, rounding_N);
  }
  std::int32_t worst_node() const {
    std::int32_t worst = 0;
    double most = -1;
    for (std::size_t i = 0; i < forces.size(); ++i) {
      if (!moves(i)) continue;
      if (!std::isfinite(forces[i])) return static_cast<std::int32_t>(i / 3);
      if (std::fabs(forces[i]) <= most) continue;
      most = std::fabs(forces[i]);
      worst = static_cast<std::int32_t>(i / 3);
    }
    return worst;
  }

  void finish_matrix() {
    close_rows<double>(scene.sparsity, free_nodes(scene, view), system);
    if (!scene.keeps.empty()) keep_in_planes(scene, system);
  }

  // The step to the minimum of the energy's quadratic model, held nodes by solver.prescribed; false if the
  // matrix is not positive definite or gives no way down.
  bool direction(double tolerance, std::vector<double>& step, StaticReport& report) {
    RowMatrix<double> matrix{scene.sparsity.chunks,        scene.sparsity.chunk_start.data(),
                             scene.sparsity.column.data(), system.values.data(),
                             system.diagonal.data(),       system.inverse.data()};
    for (std::int32_t n = 0; n < scene.node_count(); ++n) {
      for (std::size_t d = 0; d < 3; ++d)
        solver.b[solver_entry(scene, n, d)] = -forces[3 * static_cast<std::size_t>(n) + d];
    }
    const SolveResult result =
        settings.solver ? settings.solver(matrix, tolerance, solver)
                        : conjugate_gradients(matrix, {}, tolerance, 0.0, most_linear_iterations, solver);
    report.linear_iterations += result.iterations;
    if (result.broken) return false;
    for (std::int32_t n = 0; n < scene.node_count(); ++n) {
      for (std::size_t d = 0; d < 3; ++d)
        step[3 * static_cast<std::size_t>(n) + d] = solver.x[solver_entry(scene, n, d)];
    }
    return true;
  }
  double slope(const std::vector<double>& step) const {
    double sum = 0;
    for (std::size_t i = 0; i < step.size(); ++i) sum += forces[i] * step[i];
    return sum;
  }

  static constexpr int most_linear_iterations = 20000;
};

// Moves the nodes of the paths a share of their way, and all others as the tangent follows.
void follow_paths(Problem& problem, const std::vector<double>& way, double share, std::vector<double>& step,
                  StaticReport& report) {
  const Scene& scene = problem.scene;
  bool moved = false;
  for (const PrescribedMotion& motion : scene.settings.motions) {
    for (std::int32_t node : motion.nodes) {
      for (std::size_t d = 0; d < 3; ++d) {
        const double increment = share * way[3 * static_cast<std::size_t>(node) + d];
        problem.solver.prescribed[solver_entry(scene, node, d)] = increment;
        moved = moved || increment != 0;
      }
    }
  }
  if (!moved) return;
  problem.finish_matrix();  // warped: the predictor need not be more
  if (problem.direction(1e-3, step, report)) {
    for (std::size_t i = 0; i < step.size(); ++i) problem.state.positions[i] += step[i];
  }
  std::fill(problem.solver.prescribed.begin(), problem.solver.prescribed.end(), 0.0);
  problem.evaluate();
}

// Goes down along the step; false if no length of it does.
bool search_line(Problem& problem, const std::vector<double>& step) {
  constexpr int halvings = 40;
  constexpr double sufficient = 1e-4, rounding = 1e-12;
  const double start = problem.energy, slope = problem.slope(step), balance = problem.balance();
  const std::vector<double> from = problem.state.positions;
  const std::vector<double> rotations = problem.state.rotations;
  double length = 1;
  for (int k = 0; k < halvings; ++k, length *= 0.5) {
    for (std::size_t i = 0; i < from.size(); ++i) problem.state.positions[i] = from[i] + length * step[i];
    problem.evaluate();
    const double after = problem.balance();
    if (problem.energy <= start + sufficient * length * slope) return true;
    // near the minimum the energy is flat within its rounding: there the forces decide
    if (std::fabs(slope) <= rounding * std::fabs(start) + rounding * std::fabs(problem.elastic) &&
        after < balance)
      return true;
  }
  problem.state.positions = from;
  problem.state.rotations = rotations;
  problem.evaluate();
  return false;
}

// Newton to balance at fixed places of the held nodes.
bool balance_forces(Problem& problem, std::vector<double>& step, StaticReport& report) {
  const StaticSettings& settings = problem.settings;
  report.balances.assign(1, problem.balance());
  for (int iteration = 0; iteration < settings.max_iterations; ++iteration) {
    const double balance = problem.balance();
    if (balance <= settings.tolerance) return true;
    if (!std::isfinite(balance)) return false;
    const double tolerance = std::clamp(0.1 * balance, 1e-10, 1e-2);
    add_geometric_stiffness(problem.elements, problem.scene.sparsity, problem.scene.mesh.rest_positions,
                            problem.state.positions, present(problem.scene, problem.state),
                            problem.state.rotations, 1, problem.system);
    problem.finish_matrix();
    bool down =
        problem.direction(tolerance, step, report) && problem.slope(step) < 0 && search_line(problem, step);
    if (!down) {
      ++report.warped_iterations;
      problem.evaluate();  // the blocks without their geometric part
      problem.finish_matrix();
      down = problem.direction(tolerance, step, report) && search_line(problem, step);
    }
    ++report.iterations;
    report.balances.push_back(problem.balance());
    if (!down) return problem.balance() <= settings.tolerance;
  }
  return problem.balance() <= settings.tolerance;
}

// Ways of the nodes on paths from where they are to where they shall be at a step.
struct Ways {
  std::vector<double> way;  // [3*nodes] m
  double longest_m = 0;
};
Ways ways(const Scene& scene, const State& state, std::int64_t step) {
  Ways found{std::vector<double>(state.positions.size(), 0.0)};
  for (const PrescribedMotion& motion : scene.settings.motions) {
    const auto& place = motion.path[std::min(static_cast<std::size_t>(step), motion.path.size() - 1)];
    const Mat3 turn = rotation_matrix(place.turn);
    for (std::int32_t node : motion.nodes) {
      const Vec3 rest = scene.mesh.rest_positions[static_cast<std::size_t>(node)] - motion.centre;
      const Vec3 to = motion.centre + turn * rest + place.shift - node_vector(state.positions, node);
      for (int d = 0; d < 3; ++d)
        found.way[3 * static_cast<std::size_t>(node) + static_cast<std::size_t>(d)] = to[d];
      found.longest_m = std::fmax(found.longest_m, to.norm());
    }
  }
  return found;
}

double shortest_edge(const Scene& scene) {
  double shortest = 1e300;
  for (const auto& edge : scene.sparsity.edges) {
    const Vec3 between = scene.mesh.rest_positions[static_cast<std::size_t>(edge[1])] -
                         scene.mesh.rest_positions[static_cast<std::size_t>(edge[0])];
    shortest = std::fmin(shortest, between.norm());
  }
  return shortest;
}

void sum_reactions(const Problem& problem, StaticReport& report) {
  const SceneDescription& d = problem.scene.settings;
  for (std::int32_t node : d.fixed_nodes) report.support_force += node_vector(problem.forces, node);
  for (const PrescribedMotion& motion : d.motions) {
    Vec3 sum = Vec3::Zero();
    for (std::int32_t node : motion.nodes) sum += node_vector(problem.forces, node);
    report.motion_forces.push_back(sum);
  }
  report.plane_forces.assign(problem.scene.plane_count, Vec3::Zero());
  for (const SlidingNode& sliding : d.sliding) {
    if (!problem.scene.free_node[static_cast<std::size_t>(sliding.node)]) continue;
    report.plane_forces[static_cast<std::size_t>(sliding.plane)][sliding.axis] +=
        node_vector(problem.forces, sliding.node)[sliding.axis];
  }
}

// Goes along the paths to step `to`, a stretch of them at a time.
constexpr int most_load_steps = 100000;  // between two steps of a scenario

void go_to(std::int64_t to, double longest_m, Problem& problem, StaticReport& report) {
  const Scene& scene = problem.scene;
  State& state = problem.state;
  std::vector<double> step(state.positions.size(), 0.0);
  do {
    std::int64_t next = scene.settings.motions.empty() ? to : std::min(to, state.step + 1);
    Ways found = ways(scene, state, next);
    while (next < to) {
      Ways farther = ways(scene, state, next + 1);
      if (farther.longest_m > longest_m) break;
      found = std::move(farther);
      ++next;
    }
    const double parts = std::fmax(1.0, std::ceil(found.longest_m / longest_m - 1e-9));
    if (!(parts <= most_load_steps)) {
      throw InputError("static solve: a path moves nodes by " + std::to_string(found.longest_m) +
                       " m within a step of the scenario, which is more than " +
                       std::to_string(most_load_steps) + " load steps; give shorter ways");
    }
    for (int k = 0; k < static_cast<int>(parts); ++k) {
      follow_paths(problem, found.way, 1 / parts, step, report);
      report.converged = balance_forces(problem, step, report);
      ++report.load_steps;
      if (!report.converged) return;
    }
    state.step = next;
  } while (state.step < to);
}

}  // namespace

StaticReport solve_static(const Scene& scene, const StaticSettings& settings, std::int64_t to, State& state,
                          int threads) {
  assert(threads >= 1 && to >= state.step);
  if (!scene.settings.tools.empty()) {
    throw InputError(
        "static solve: the scene has tools, and where a tool comes to rest is a matter of its motion; leave "
        "them out (/tools), or run the scene until it rests");
  }
  if (!scene.settings.obstacles.empty()) {
    throw InputError(
        "static solve: the scene has obstacles, and what touches them is found by running; leave them out "
        "(/obstacles), or run the scene until it rests");
  }
  if (const std::vector<std::string> loose = loose_pieces(scene, present(scene, state)); !loose.empty())
    throw InputError("static solve: " + loose.front());

  StaticReport report;
  Problem problem(scene, settings, state, threads);
  std::fill(state.velocities.begin(), state.velocities.end(), 0.0);
  problem.evaluate();
  // some rounding errors of the coordinates, times the stiffest node
  problem.finish_matrix();
  double stiffest = 0, farthest = 0;
  for (double k : problem.system.diagonal) stiffest = std::fmax(stiffest, std::fabs(k));
  for (double x : state.positions) farthest = std::fmax(farthest, std::fabs(x));
  problem.rounding_N = 1e-14 * stiffest * farthest;

  go_to(to, settings.load_step_cells * shortest_edge(scene), problem, report);
  report.balance = problem.balance();
  report.largest_force_N = problem.scale;
  report.elastic_energy_J = problem.elastic;
  sum_reactions(problem, report);
  if (!report.converged) {
    const std::string where = describe_piece(scene, present(scene, state), problem.worst_node());
    report.problem = std::isfinite(report.balance)
                         ? "forces balance to " + std::to_string(report.balance) + " only, worst in " +
                               where +
                               "; give smaller loads or shorter ways, or let the scene run until it rests"
                         : "a force is not finite in " + where + "; give smaller loads or shorter ways";
  }
  return report;
}

}  // namespace sulcus
