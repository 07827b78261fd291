// Detection B (thesis 5.3 as corrected): vertices of a tool inside the embedded volume.
//
// A tool vertex p (world) lies in a deformed tetrahedron T; its barycentric coordinates carry it to rest
// coordinates, where the voxel under it tells which of several superimposed copies is meant and the distance
// field tells how deep it lies. It is projected along the gradient to the surface point x_s of the rest
// shape, whose tetrahedron T_s carries the contact force (the thesis takes T_s = T).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/mesh/embedding.h"
#include "engine/volume/distance_field.h"

namespace sulcus {

// Penalty law f = k N g + b N g', N = a I + (1-a) n n^T (equations.md 2.6), and Coulomb friction.
struct ContactLaw {
  double stiffness_N_m = 10;    // N/m a contact, k >= 0
  double damping_N_s_m = 0.01;  // N s/m a contact, b >= 0
  double anisotropy = 0;        // a in [0, 1]: 0 frictionless, 1 isotropic
  bool tension_rule = true;     // contacts that would pull are dropped, up to eight re-solves
  // Coulomb friction, regularised: -mu |f_n| v / sqrt(|v|^2 + v_s^2) for a speed of slip v along the surface.
  // 0: none. What rests on a slope of the tangent t creeps at v_s t / sqrt(mu^2 - t^2).
  double friction = 0;                // mu >= 0
  double friction_speed_m_s = 0.001;  // m/s, v_s > 0
  // Forces of the start of the step, no derivative in the matrix (thesis 4.6.2, set B): for comparison only,
  // it vibrates where the stiffness of all contacts together is beyond what the step allows.
  bool explicit_forces = false;
  // Nodes that a tool touches go where it takes them, in place of a penalty (thesis 3.3.3): along the normal
  // only with a = 0, altogether with a = 1. Stiffness, damping and friction mean nothing then.
  bool prescribed = false;
};

struct Contact {
  std::int32_t tool = 0;            // number of the rigid body: tools first, then obstacles
  std::int32_t vertex = 0;          // of the tool's surface; the node, of detection by nodes
  std::int32_t tet = 0;             // T_s, carries the force
  std::array<double, 4> weights{};  // of x_s in T_s (may extrapolate slightly)
  Vec3 arm = Vec3::Zero();          // m, world: vertex - centre of mass
  Vec3 gap = Vec3::Zero();          // m, world: p - x_s
  Vec3 normal = Vec3::Zero();       // unit, world, out of the tissue
  double depth_m = 0;               // m, rest distance below the surface, > 0
  Vec3 slip = Vec3::Zero();         // m/s, of the body along the tissue, where its friction is linearised
};

// A tetrahedron near the tool: the weight of corner v at x is weight[0][v] + sum over a of weight[1 + a][v]
// x_a. low, high: the cells of the search's grid that its box meets.
struct CandidateTet {
  std::int32_t tet = 0;
  std::array<std::int8_t, 3> low{}, high{};
  std::array<std::array<double, 4>, 4> weight{};  // 1, 1/m
};

// The voxels that a cell owns lie between these two, both included.
struct VoxelBox {
  Index3 low{0, 0, 0}, high{-1, -1, -1};
};

// Box of each cell's voxels, [cells]; a cell without any has an empty one. Cost: a look at the voxels of all
// cells.
std::vector<VoxelBox> find_owned_voxels(const LabelMap& map, const EmbeddingMesh& mesh);

// The tissue at rest, as the search sees it.
struct EmbeddedTissue {
  const LabelMap& map;
  const SeparationPairs& pairs;
  const DistanceField& distance;
  const EmbeddingMesh& mesh;
  std::span<const VoxelBox> owned;  // by find_owned_voxels
};

// Scratch of the search; reused from step to step, content without meaning between calls.
struct ContactSearch {
  int threads = 1;
  std::vector<Vec3> vertices;       // [vertices] m, world
  std::vector<std::uint8_t> sides;  // [nodes] on which sides of the tool's box a node lies, as bits
  // A thread's own. Each makes all candidates for itself: that is quicker than to have the other's memory.
  struct alignas(64) Part {
    Vec3 low, high;                                    // m, box of its share of the vertices
    bool finite = true;                                // all of them
    std::vector<std::int32_t> near;                    // tetrahedra near the tool in its share of the cells
    std::vector<CandidateTet> candidates;              // of all parts
    std::vector<std::int32_t> cell_start, cell_items;  // of a grid over the tool's box: candidates
  };
  std::vector<Part> parts;            // [threads]
  std::vector<Contact> found;         // [vertices]
  std::vector<std::uint8_t> touches;  // [vertices] whether there is one
};

// Appends the contacts of one tool in order of its vertices, the same for any number of threads.
// vertices: [vertices] m, of the tool, which stand at position + rotation * vertex; position: of its centre
// of mass. positions: [3*nodes]. alive: [tets] or empty = all.
void find_embedded_contacts(const EmbeddedTissue& tissue, std::span<const double> positions,
                            std::span<const std::uint8_t> alive, std::int32_t tool,
                            std::span<const Vec3> vertices, const Mat3& rotation, const Vec3& position,
                            ContactSearch& search, std::vector<Contact>& contacts);

}  // namespace sulcus
