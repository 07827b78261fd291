// The linear system of one step, and the memory that it is made in. Private to this room, and for those who
// hash what the stages of a step leave (verify/step_tree.h, test_probe.cpp).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "engine/fem/assembly.h"
#include "engine/scene/alive_view.h"
#include "engine/scene/step.h"
#include "engine/solver/conjugate_gradients.h"
#include "engine/solver/refinement.h"

namespace sulcus {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

// What one precision of the solver works on.
template <class Real>
struct Numbers {
  SystemMatrix<Real> system;
  SolverWorkspace<Real> solver;
  std::unique_ptr<Refinement>
      refinement;  // in double precision, where single is asked and too little by itself
  std::vector<ToolBorder<Real>> borders;  // [tools]
  // What the tissue's part holds where contacts will be added, so that a repeated solve need not assemble the
  // tissue again. Four nodes and six edges, twelve blocks, a contact.
  std::vector<Real> saved_blocks, saved_terms;  // [12*9*contacts], [4*9*contacts]
  std::vector<double> saved_forces;             // [4*3*contacts] N s
  std::vector<std::int32_t> saved_tets;         // [contacts]
  std::vector<std::int32_t> touched_chunks;     // of rows that hold more than tissue, ascending
};

// The 6x6 part of the step's system that belongs to one tool (equations.md 4), and its right-hand side.
struct ToolSystem {
  RigidBodyState start;
  Mat3 inertia;          // world, kg m^2
  Vec6 velocity;         // v_com, omega at the start
  Mat3 lever;            // G, N m/rad; zero where it is left out
  Vec3 misalignment;     // u, rad
  Mat3 stiffness;        // H
  Mat6 matrix;           // C
  Vec6 right_hand_side;  // of the increment
  Vec6 increment;        // solution
};

// A node that a tool leads (prescribed_contact.h).
struct LedNode {
  std::int32_t node = 0, tool = 0;
  double weight = 0;           // of its contacts, summed
  Vec3 way = Vec3::Zero();     // m, over the step
  Vec3 normal = Vec3::Zero();  // unit, out of the tissue
  Vec3 place = Vec3::Zero();   // m, on the tool, at the start of the step
  bool slides = false;         // led along the normal only
  Vec3 force = Vec3::Zero();   // N, of the tool on the node
};

struct Workspace {
  int threads = 1;
  std::unique_ptr<Numbers<float>> single;  // one of the two, as the scene's precision asks
  std::unique_ptr<Numbers<double>> twice;
  std::vector<double> forces;         // [3*nodes] N
  std::vector<double> increments;     // [3*nodes] m/s
  std::vector<std::uint8_t> finite;   // [threads] whether the positions that a thread moved are
  std::vector<DeviceSample> samples;  // [tools]
  std::vector<Contact> contacts;      // of all tools, of obstacles, then those taken back
  std::vector<Contact> dropped;       // in the step, by the tension rule
  std::vector<LedNode> led;           // in scenes with prescribed contact
  ContactSearch search;
  std::vector<ToolSystem> tools;
  std::vector<std::int32_t> touched;      // nodes in contact with one tool, by slot
  std::vector<std::int32_t> row_of_node;  // [nodes] -1 or number in `touched`
  AliveView view;                         // of scenes that fracture or touch by nodes
  FractureScratch fracture;               // of scenes that fracture
  std::vector<Vec3> motion_forces;        // [motions] N
  double path_work_J = 0;                 // of all motions in the step
  std::vector<double> places;             // [3*nodes] m, of the ledger
  std::vector<Vec3> plane_forces;         // [planes] N
  std::vector<double> past_products;      // [5*blocks of nodes], of scenes that guess from the past
};

// Place of entry d of a node in a solver vector.
inline std::size_t solver_entry(const Scene& scene, std::int32_t node, std::size_t d) {
  const auto slot = static_cast<std::size_t>(scene.sparsity.slot_of_node[static_cast<std::size_t>(node)]);
  return (slot / 16 * 3 + d) * 16 + slot % 16;
}

// refined: with a refinement.
template <class Real>
std::unique_ptr<Numbers<Real>> make_numbers(const Scene& scene, int threads, Isa isa, bool refined = false);

// The elements that are present; empty (all are) in scenes that do not fracture.
inline std::span<const std::uint8_t> present(const Scene& scene, const State& state) {
  return scene.fracture ? std::span<const std::uint8_t>(state.alive) : std::span<const std::uint8_t>();
}

// Nodes that move, [nodes]: where tissue tears, those that some element still holds.
inline std::span<const std::uint8_t> free_nodes(const Scene& scene, const AliveView& view) {
  return scene.fracture ? std::span<const std::uint8_t>(view.free_node) : scene.free_node;
}

// How far to solve; as in SolverSettings.
struct Effort {
  double tolerance = 0, floor_m_s = 0;
  int max_iterations = 0;
};

// Assembles the system of tissue, tools and workspace.contacts for the step after `state` (the rotations in
// it are brought up to date) and solves it for workspace.increments and the tools' increments (equations.md
// 4). again: the call before was for the same step, with contacts that are dropped now; its tissue is taken
// over, and the search begins at its solution.
template <class Real>
SolveResult assemble_and_solve(const Scene& scene, std::span<const DeviceSample> samples, State& state,
                               Numbers<Real>& numbers, Workspace& workspace, StageObserver* observer,
                               const Effort& effort, bool again = false);

// Takes the solution of the call before, of the same system, further, as if that had gone on. Returns the
// iterations of this call.
template <class Real>
SolveResult go_on_solving(const Scene& scene, const State& state, Numbers<Real>& numbers,
                          Workspace& workspace, StageObserver* observer, const Effort& effort);

// Lets nodes slide: along the axes that they keep, the inverse of their diagonal block is zero, so the solver
// never moves them there; the rest of the block is inverted by itself. After close_rows.
template <class Real>
void keep_in_planes(const Scene& scene, SystemMatrix<Real>& system);

// Force [N] of a contact on the tissue at the end of the step, by the solution in the workspace.
Vec3 contact_force(const Scene& scene, const State& state, const Contact& contact,
                   const Workspace& workspace);

}  // namespace sulcus
