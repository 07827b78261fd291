// Topological singularities of a tetrahedral mesh that has lost elements, and how they are taken out (thesis
// 3.5.1 as corrected in equations.md 1 and 7.13).
//
//   singular vertex  the elements around it do not hang together by shared edges
//   singular edge    the elements around it do not hang together by shared faces
//
// Such a vertex or edge is a hinge: what hangs on it swings without stiffness. Of the pieces of the star
// around it the largest (in elements; the one with the lowest element number at ties) stays, the others are
// removed. That may make new hinges, so it is repeated around what was removed until a pass removes nothing.
// Every pass tests all stars against the same elements, so the result depends on the set of removed elements
// alone.
//
// A closed ring of elements around a vertex, open above and below (annular link), is no hinge and stays.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace sulcus {

// The mesh with all of its elements, and who is around a node. Views of arrays that others own.
struct MeshStars {
  std::span<const std::array<std::int32_t, 4>> tets;
  std::span<const std::int32_t> start;     // [nodes+1] into incident
  std::span<const std::int32_t> incident;  // element*4 + corner, ascending (ElementData::incident)
};

// Scratch; its content has no meaning between calls. Made once for a mesh, then nothing allocates.
struct StarScratch {
  std::vector<std::int32_t> parent;        // [nodes] -1, or the star's disjoint sets
  std::vector<std::int32_t> members;       // elements of the star
  std::vector<std::int32_t> count, first;  // [nodes] of a set: elements, lowest element
  std::vector<std::int32_t> nodes;         // candidates
  std::vector<std::int64_t> edges;         // candidates, lower node * 2^32 + higher node
  std::vector<std::int32_t> victims, recent;
};
StarScratch make_star_scratch(const MeshStars& mesh);

// Appends the elements of all but the strongest piece of the star around a node, or around the edge a-b.
// Returns whether there were any: whether the node or edge is singular. alive: [tets].
bool weaker_pieces_at_node(const MeshStars& mesh, std::span<const std::uint8_t> alive, std::int32_t node,
                           StarScratch& scratch, std::vector<std::int32_t>& weaker);
bool weaker_pieces_at_edge(const MeshStars& mesh, std::span<const std::uint8_t> alive, std::int32_t a,
                           std::int32_t b, StarScratch& scratch, std::vector<std::int32_t>& weaker);

// Removes elements (alive becomes 0) until no vertex or edge of the `removed` elements and of those that
// follow them is singular; appends what it removes to `removed`, each pass in ascending order. Returns the
// number of passes that removed something. Precondition: `removed` are not alive. Cost: the stars of their
// nodes and edges.
int remove_singularities(const MeshStars& mesh, std::span<std::uint8_t> alive,
                         std::vector<std::int32_t>& removed, StarScratch& scratch);

// Singular vertices and edges of the whole mesh, ascending.
struct Singularities {
  std::vector<std::int32_t> vertices;
  std::vector<std::array<std::int32_t, 2>> edges;  // lower node first
};
Singularities find_singularities(const MeshStars& mesh, std::span<const std::uint8_t> alive);

}  // namespace sulcus
