// What the parts of a scene cost: a block under gravity, stepped with one part switched on, with every part
// named but off, and by a loop that knows of no part at all. part_cost_test counts its instructions,
// tools/hard/cost-of-parts makes the table of docs/cost-of-parts.md from it.
//
//   part_cost PART [steps]      prints "PART steps iterations hash scene_bytes workspace_bytes
//   seconds_per_step"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "engine/contact/test_tools.h"
#include "engine/scene/allocation_count.h"
#include "engine/scene/system.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

constexpr double edge_m = 0.01;
constexpr int cells = 8;

// Tissue alone: nothing but elasticity, mass, damping, gravity and a held bottom.
SceneDescription tissue_alone() {
  SceneDescription d = block_description({cells, cells, cells}, edge_m);
  d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
  d.gravity = {0, 0, -9.81};
  d.material.youngs_modulus_Pa = 500;
  d.solver.precision = Precision::single_precision;
  d.solver.tolerance = 1e-3;
  d.solver.preconditioner = Preconditioner::block_jacobi;
  d.energies = false;
  return d;
}

void press_a_ball_in(SceneDescription& d) {
  Tool ball;
  ball.surface = sphere_tool(0.025);
  d.tools.push_back(ball);
  d.contact.stiffness_N_m = 20;
}

SceneDescription with_part(const std::string& part) {
  SceneDescription d = tissue_alone();
  if (part == "off") {  // all that a scene can say of parts that it does not have
    d.solver.preconditioner = Preconditioner::automatic;
    d.solver.max_iterations = 777;
    d.material.fracture_threshold_Pa = 1;
    d.contact.stiffness_N_m = 1000;
    d.contact.friction = 0.5;
    d.contact.explicit_forces = true;
    d.detection = ContactDetection::surface_nodes;
  } else if (part == "fracture") {
    d.material.fracture_threshold_Pa = 1e9;  // its stress is computed, nothing tears
    d.fracture.emplace();
  } else if (part == "multigrid") {
    d.solver.preconditioner = Preconditioner::multigrid;
  } else if (part == "energies") {
    d.energies = true;
  } else if (part == "ledger") {
    d.ledger = true;
  } else if (part == "tool" || part == "friction") {
    press_a_ball_in(d);
    if (part == "friction") d.contact.friction = 0.3;
  }
  return d;
}

// The step of tissue alone, written out: what step() has to come down to where no part is on.
struct ByHand {
  SystemMatrix<float> system;
  SolverWorkspace<float> solver;
  std::vector<double> forces, increments;
  std::vector<ToolBorder<float>> no_tools;

  explicit ByHand(const Scene& scene)
      : system(make_system_matrix<float>(scene.elements, scene.sparsity, Isa::sse2, 1)),
        solver(make_solver_workspace<float>(scene.sparsity, Isa::sse2, 1)),
        forces(3 * scene.mesh.rest_positions.size()),
        increments(forces.size()) {}

  int step(const Scene& scene, State& state) {
    const double h = scene.settings.step_s;
    assemble_elements<float>(scene.elements, scene.sparsity, {h, scene.settings.damping},
                             scene.mesh.rest_positions, state.positions, state.velocities, {},
                             scene.free_node, state.rotations, system);
    const Vec3& gravity = scene.settings.gravity;
    const std::size_t nodes = scene.mesh.rest_positions.size();
    for (std::size_t n = 0; n < nodes; ++n) {
      const double mass = scene.elements.node_mass[n];
      for (std::size_t d = 0; d < 3; ++d)
        forces[3 * n + d] = h * (mass * (gravity[static_cast<Eigen::Index>(d)] -
                                         scene.settings.damping.alpha_1_s * state.velocities[3 * n + d]) -
                                 system.node_forces[3 * n + d]);
    }
    const std::int64_t slots = scene.sparsity.chunks * 16;
    const auto for_entries = [&](auto&& visit) {
      for (std::int64_t slot = 0; slot < slots; ++slot) {
        const std::int32_t node = scene.sparsity.node_of_slot[static_cast<std::size_t>(slot)];
        for (std::int64_t d = 0; d < 3; ++d)
          visit(static_cast<std::size_t>((slot / 16 * 3 + d) * 16 + slot % 16), 3 * std::int64_t{node} + d,
                node >= 0);
      }
    };
    for_entries([&](std::size_t entry, std::int64_t i, bool there) {
      solver.b[entry] = there ? static_cast<float>(forces[static_cast<std::size_t>(i)]) : 0.0f;
    });
    const RowMatrix<float> matrix{scene.sparsity.chunks,        scene.sparsity.chunk_start.data(),
                                  scene.sparsity.column.data(), system.values.data(),
                                  system.diagonal.data(),       system.inverse.data()};
    const SolverSettings& settings = scene.settings.solver;
    const double floor = settings.velocity_floor_m_s * std::sqrt(scene.total_mass_kg);
    const SolveResult result =
        conjugate_gradients(matrix, no_tools, settings.tolerance, floor, settings.max_iterations, solver);
    for_entries([&](std::size_t entry, std::int64_t i, bool there) {
      if (there) increments[static_cast<std::size_t>(i)] = static_cast<double>(solver.x[entry]);
    });
    for (std::size_t i = 0; i < increments.size(); ++i) {
      state.velocities[i] += increments[i];
      state.positions[i] += h * state.velocities[i];
    }
    return result.iterations;
  }
};

DeviceSample hand(std::int64_t step) {
  DeviceSample sample;
  const double middle = 0.5 * cells * edge_m;
  sample.position = {middle, middle, cells * edge_m + 0.02 - 1e-4 * static_cast<double>(step % 30)};
  return sample;
}

std::uint64_t hash_of(const State& state) {
  std::uint64_t hash = 1469598103934665603u;
  for (const double x : state.positions) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &x, sizeof bits);
    hash = (hash ^ bits) * 1099511628211u;
  }
  return hash;
}

struct Outcome {
  int iterations = 0;
  double seconds = 0;
};

}  // namespace

// Valgrind counts what is done in here and nothing else, so it has a name of its own.
extern "C" __attribute__((noinline)) void part_cost_steps(const Scene& scene, int steps, bool stress,
                                                          State& state, StepReport& report,
                                                          Workspace* workspace, ByHand* by_hand,
                                                          Outcome& outcome) {
  std::vector<double> seconds;
  seconds.reserve(static_cast<std::size_t>(steps));
  for (int n = 0; n < steps; ++n) {
    const auto start = std::chrono::steady_clock::now();
    const DeviceSample sample = hand(state.step);
    if (by_hand != nullptr) {
      outcome.iterations += by_hand->step(scene, state);
      ++state.step;
    } else {
      step(scene, std::span(&sample, scene.settings.tools.size()), state, report, *workspace);
      outcome.iterations += report.iterations;
    }
    if (stress && max_principal_stress(scene, state).empty()) std::abort();
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  std::nth_element(seconds.begin(), seconds.begin() + steps / 2, seconds.end());
  outcome.seconds = seconds[static_cast<std::size_t>(steps / 2)];
}

}  // namespace sulcus

int main(int argc, char** argv) {
  using namespace sulcus;
  const std::string part = argc > 1 ? argv[1] : "none";
  const int steps = argc > 2 ? std::atoi(argv[2]) : 20;
  if (steps < 1) {
    std::fprintf(stderr, "part_cost PART [steps]\n");
    return 2;
  }
  SceneDescription description = with_part(part);
  const DeviceSample first = hand(0);

  const long before = bytes_held();
  const Scene scene = build(std::move(description));
  const long after_scene = bytes_held();
  State state = initial_state(scene, std::span(&first, scene.settings.tools.size()));
  StepReport report = make_report(scene);
  const long before_workspace = bytes_held();
  std::unique_ptr<ByHand> by_hand;
  WorkspacePtr workspace;
  if (part == "by_hand") {
    by_hand = std::make_unique<ByHand>(scene);
  } else {
    workspace = make_workspace(scene, 1, Isa::sse2);
  }
  Outcome outcome;
  part_cost_steps(scene, steps, part == "stress", state, report, workspace.get(), by_hand.get(), outcome);
  long scene_bytes = after_scene - before;
  if (part == "by_hand") {  // what a scene of tissue alone is made of, made once more
    const long none = bytes_held();
    const SceneDescription& d = scene.settings;
    const LabelMap map = d.map;
    const EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
    const ElementData elements = build_elements(mesh, std::vector<Material>{d.material},
                                                std::vector<std::int32_t>(mesh.tets.size(), 0), d.damping);
    const Sparsity sparsity = build_sparsity(mesh);
    const std::vector<std::int32_t> held = d.fixed_nodes;
    const std::vector<std::uint8_t> free_node = scene.free_node;
    scene_bytes = bytes_held() - none;
  }
  const long workspace_bytes = bytes_held() - before_workspace;
  std::printf("%s %d %d %016llx %ld %ld %.9f\n", part.c_str(), steps, outcome.iterations,
              static_cast<unsigned long long>(hash_of(state)), scene_bytes, workspace_bytes, outcome.seconds);
  return 0;
}
