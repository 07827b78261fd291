// Scene: all that does not change during a run. State: all that does. step() is a function of scene, state
// and the device samples, and of nothing else.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/contact/embedded.h"
#include "engine/contact/surface_nodes.h"
#include "engine/fem/elements.h"
#include "engine/fem/sparsity.h"
#include "engine/fracture/fracture.h"
#include "engine/mesh/embedding.h"
#include "engine/solver/conjugate_gradients.h"
#include "engine/tool/rigid_body.h"
#include "engine/tool/virtual_coupling.h"
#include "engine/volume/distance_field.h"

namespace sulcus {

struct NodeSpring {
  std::int32_t node = 0;
  double stiffness_N_m = 0;  // N/m, >= 0
  double damping_N_s_m = 0;  // N s/m, >= 0
};

// A force that does not depend on where the node is.
struct NodeForce {
  std::int32_t node = 0;
  Vec3 force_N = Vec3::Zero();  // N, world
};

// A node that keeps its coordinate along one of the world's axes, and is free along the others.
struct SlidingNode {
  std::int32_t node = 0;
  int axis = 0;            // 0..2
  std::int32_t plane = 0;  // number of the plane that it slides on, for the plane's force; >= 0
};

struct Tool {
  std::string name;
  ToolSurface surface;
  RigidBody body;
  VirtualCoupling coupling;
  double filter_Hz = 0;  // Hz, cut-off of the displayed force; 0 = no filter
  // What its device can give; the displayed force and torque are shortened to it. 0: no limit.
  double max_force_N = 0, max_torque_N_m = 0;
};

// A rigid body that stands still. Tissue touches it by the nodes of its mesh's boundary, whatever the
// detection of the tools is (contact/surface_nodes.h).
struct Obstacle {
  std::string name;
  ToolSurface surface;           // closed
  Vec3 position = Vec3::Zero();  // m, of the surface's origin
  Quaternion orientation;        // unit, body -> world
  ContactLaw contact;
};

// Nodes that follow a path, whatever force that takes: at the end of step k (the first is 0) a node with the
// rest position X stands at centre + R_k (X - centre) + shift_k.
struct PrescribedMotion {
  struct Place {
    Vec3 shift = Vec3::Zero();  // m
    Quaternion turn;            // unit; R
  };
  std::string name;
  std::vector<std::int32_t> nodes;
  Vec3 centre = Vec3::Zero();  // m
  std::vector<Place> path;     // one a step; the last holds for all later steps
};

// What an element's stiffness and mass come from.
enum class ElementFilling {
  whole_cells,  // its cell's most frequent label fills it
  shares        // the voxels in it, by volume (fem/elements.h, ElementContent)
};

enum class ContactDetection {
  embedded_vertices,  // tool vertices inside the embedded volume (contact/embedded.h)
  surface_nodes,      // nodes of the mesh's boundary inside the tool (contact/surface_nodes.h)
};

// What a scene is built from. Plain data in SI units; the caller has read and checked files and keys.
struct SceneDescription {
  LabelMap map;
  SeparationPairs pairs;
  EmbeddingOptions embedding;
  Material material;                           // of labels that `materials` does not name
  std::map<std::int32_t, Material> materials;  // by label
  ElementFilling filling = ElementFilling::whole_cells;
  RayleighDamping damping;
  Vec3 gravity = Vec3::Zero();            // m/s^2
  std::vector<std::int32_t> fixed_nodes;  // held at rest
  std::vector<NodeSpring> springs;        // to the rest position
  std::vector<NodeForce> forces;          // on nodes; several on one node add up
  std::vector<SlidingNode> sliding;       // in planes; a node may be named for several axes, once for each
  std::vector<PrescribedMotion> motions;
  std::vector<Tool> tools;
  std::vector<Obstacle> obstacles;
  std::vector<Vec3> start_positions;  // [nodes] m, where they are before the first step; empty: at rest
  ContactLaw contact;                 // of the tools
  ContactDetection detection = ContactDetection::embedded_vertices;
  std::optional<FractureSettings> fracture;  // none: no stress is computed, nothing tears
  SolverSettings solver;
  double step_s = 0.033;  // s, time step h > 0
  bool energies = true;   // whether the energy of the tissue is reported at each step
  bool ledger = false;    // whether an energy ledger is kept; asks for energies
};

struct Scene {
  SceneDescription settings;  // as given (the label map stays here)
  EmbeddingMesh mesh;
  ElementData elements;
  Sparsity sparsity;
  std::unique_ptr<const DistanceField> distance;   // only in scenes with a tool and embedded_vertices
  std::vector<VoxelBox> owned_voxels;              // [cells], likewise
  std::vector<RigidDistance> tool_distances;       // [tools], only with surface_nodes
  std::vector<RigidDistance> obstacle_distances;   // [obstacles]
  FaceNeighbours faces;                            // only where nodes touch rigid bodies
  std::unique_ptr<const FractureData> fracture;    // only in scenes that fracture
  std::unique_ptr<const Multigrid> multigrid;      // only where it is the preconditioner
  std::vector<double> filter_alpha;                // [tools]
  std::vector<std::uint8_t> free_node;             // [nodes] 1: moves, 0: held at rest or on a path
  std::vector<std::array<std::uint8_t, 3>> keeps;  // [nodes] 1: keeps its coordinate; empty: none does
  std::size_t plane_count = 0;                     // one more than the largest SlidingNode::plane
  double total_mass_kg = 0;                        // kg, of the tissue

  MeshStars stars() const { return {mesh.tets, elements.incident_start, elements.incident}; }
  BoundaryMesh boundary_mesh() const {
    return {mesh.tets, faces, elements.incident_start, elements.incident};
  }
  std::int64_t node_count() const { return static_cast<std::int64_t>(mesh.rest_positions.size()); }
  bool solves_again() const {  // whether a step may have to be solved again
    const auto may = [](const ContactLaw& law) { return law.tension_rule || law.friction > 0; };
    bool any = !settings.tools.empty() && may(settings.contact);
    for (const Obstacle& obstacle : settings.obstacles) any = any || may(obstacle.contact);
    return any;
  }
  bool only_drops_contacts() const {  // whether that is only for contacts that pull
    bool other = settings.contact.prescribed || settings.contact.friction > 0;
    for (const Obstacle& obstacle : settings.obstacles) other = other || obstacle.contact.friction > 0;
    return solves_again() && !other;
  }
  bool nodes_touch() const {  // whether contacts of nodes of the boundary are looked for
    return !tool_distances.empty() || !obstacle_distances.empty();
  }
  std::int64_t tet_count() const { return static_cast<std::int64_t>(mesh.tets.size()); }
};

// Builds the scene on the mesh that build_embedding makes of its map; the caller makes it, so that nodes can
// be chosen by position first. Throws InputError for what cannot be simulated (negative stiffness, nu outside
// (-1, 0.5), no mass, a node number out of range, a time step of zero, a tool that is not finite, a node both
// fixed and on a path, fracture with a detection that cannot follow torn tissue).
Scene build_scene(SceneDescription description, EmbeddingMesh mesh);

}  // namespace sulcus
