// Detection A (thesis 4.4): nodes on the boundary of the tissue's mesh against the signed distance of a rigid
// tool. It follows removed elements at once: the boundary is that of the elements which are present.
//
// A node x inside the tool is pushed along its tissue's outward normal n, into the tissue, until it leaves
// the tool at p = x - s n: gap p - x, depth s. So a node that has passed the middle of a thin blade is pushed
// on the side that it came from. A node whose way out leads sideways (much longer than the tool is thick
// there, or leaving it at a grazing angle) gives none. Obstacles are thick and stand still: out of them a
// node is pushed the shortest way, p = x - phi grad phi, whatever the tissue's normal is at an edge.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/contact/embedded.h"
#include "engine/contact/rigid_distance.h"
#include "engine/mesh/topology.h"
#include "engine/tool/rigid_body.h"

namespace sulcus {

// The mesh, and who is around a node and behind a face. Views of arrays that others own.
struct BoundaryMesh {
  std::span<const std::array<std::int32_t, 4>> tets;
  const FaceNeighbours& faces;
  std::span<const std::int32_t> start, incident;  // NodeStars
};

// Whether `node` lies on the boundary of the elements that are present (alive: [tets] or empty = all).
bool on_boundary(const BoundaryMesh& mesh, std::span<const std::uint8_t> alive, std::int32_t node);

enum class WayOut { along_tissue_normal, shortest };

// Appends the contacts of one rigid body in order of the nodes. Contact::vertex is the node. boundary:
// [nodes] 1 for nodes on the boundary. positions: [3*nodes].
void find_node_contacts(const BoundaryMesh& mesh, std::span<const std::uint8_t> alive,
                        std::span<const std::uint8_t> boundary, std::span<const double> positions,
                        const RigidDistance& distance, const RigidBodyState& pose, std::int32_t tool,
                        std::vector<Contact>& contacts, WayOut way = WayOut::along_tissue_normal);

}  // namespace sulcus
