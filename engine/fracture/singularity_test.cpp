// The table of equations.md 7.13, and a zoo of meshes from which elements are removed at random, beside a
// checker that builds the link of every vertex and edge from nothing.
#include "engine/fracture/singularity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "engine/fracture/test_zoo.h"

namespace sulcus {
namespace {

using Edge = std::array<std::int32_t, 2>;

Singularities singularities(const StarMesh& mesh) {
  return find_singularities(mesh.stars(), mesh.alive);
}

void expect_singular(const StarMesh& mesh, std::vector<std::int32_t> vertices, std::vector<Edge> edges) {
  const Singularities found = singularities(mesh);
  EXPECT_EQ(found.vertices, vertices);
  EXPECT_EQ(found.edges, edges);
}

TEST(Singularity, NeitherOneElementNorTwoWithACommonFaceAreSingular) {
  expect_singular(star_mesh({{0, 1, 2, 3}}), {}, {});
  expect_singular(star_mesh({{0, 1, 2, 3}, {1, 2, 3, 4}}), {}, {});
}

TEST(Singularity, ACommonEdgeAloneIsSingular) {
  expect_singular(star_mesh({{0, 1, 2, 3}, {0, 1, 4, 5}}), {}, {{0, 1}});
}

TEST(Singularity, ACommonVertexAloneIsSingular) {
  expect_singular(star_mesh({{0, 1, 2, 3}, {0, 4, 5, 6}}), {0}, {});
  expect_singular(star_mesh({{0, 1, 2, 3}, {1, 2, 3, 4}, {4, 5, 6, 7}}), {4}, {});
}

TEST(Singularity, AFanAroundAnEdgeIsNotSingularUntilItFallsApart) {
  const std::vector<std::array<std::int32_t, 4>> fan = {
      {0, 1, 2, 3}, {0, 1, 3, 4}, {0, 1, 4, 5}, {0, 1, 5, 2}};
  StarMesh mesh = star_mesh(fan);
  expect_singular(mesh, {}, {});
  mesh.alive = {1, 1, 1, 0};
  expect_singular(mesh, {}, {});
  mesh.alive = {1, 0, 1, 0};
  expect_singular(mesh, {}, {{0, 1}});
  expect_singular(star_mesh({{0, 1, 2, 3}, {0, 1, 3, 4}, {0, 1, 5, 6}, {0, 1, 6, 7}}), {}, {{0, 1}});
}

TEST(Singularity, ARingByEdgesHasThreeSingularEdges) {
  expect_singular(star_mesh({{0, 1, 2, 3}, {0, 3, 4, 5}, {0, 5, 6, 1}}), {}, {{0, 1}, {0, 3}, {0, 5}});
}

// Cell i + 2 j + 4 k of 2 x 2 x 2 cells in six elements each; node 13 is the middle.
StarMesh cells_kept(const std::set<int>& kept) {
  StarMesh mesh = star_cube(2, TetSplit::six);
  for (std::size_t t = 0; t < mesh.alive.size(); ++t)
    mesh.alive[t] = kept.count(static_cast<int>(t / 6)) != 0;
  return mesh;
}

TEST(Singularity, CellsThatTouchByAnEdgeOrACornerAreSingularThere) {
  expect_singular(cells_kept({0, 3}), {}, {{4, 13}});
  expect_singular(cells_kept({0, 7}), {13}, {});
  const Singularities checkerboard = singularities(cells_kept({0, 3, 5, 6}));
  EXPECT_TRUE(checkerboard.vertices.empty());
  EXPECT_EQ(checkerboard.edges.size(), 6U);
  for (const Edge& edge : checkerboard.edges) EXPECT_TRUE(edge[0] == 13 || edge[1] == 13);
}

TEST(Singularity, ACubeIsNotSingularNorWithOneCellMissing) {
  expect_singular(cells_kept({0, 1, 2, 3, 4, 5, 6, 7}), {}, {});
  expect_singular(cells_kept({0, 1, 2, 3, 4, 5, 6}), {}, {});
}

// Prisms around a vertical line through the vertex, with elements above and below missing: the link of the
// vertex is an annulus. Two boundary fans meet at the vertex, yet nothing can swing about it.
TEST(Singularity, AnAnnularLinkIsNoHinge) {
  std::vector<std::array<std::int32_t, 4>> ring;
  for (int k = 0; k < 6; ++k) {  // link vertices 1..6 below, 7..12 above
    const int below = 1 + k, below_next = 1 + (k + 1) % 6, above = 7 + k, above_next = 7 + (k + 1) % 6;
    ring.push_back({0, below, below_next, above});
    ring.push_back({0, below_next, above_next, above});
  }
  expect_singular(star_mesh(ring), {}, {});
}

// ---- links built from nothing ----

// Whether the elements around `simplex` (one or two nodes) hang together by a chain in which neighbours share
// one node more than the simplex. Quadratic in the star.
bool hangs_together(const StarMesh& mesh, const std::set<std::int32_t>& simplex) {
  std::vector<std::set<std::int32_t>> links;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (!mesh.alive[t]) continue;
    std::set<std::int32_t> nodes(mesh.tets[t].begin(), mesh.tets[t].end());
    if (!std::includes(nodes.begin(), nodes.end(), simplex.begin(), simplex.end())) continue;
    for (std::int32_t node : simplex) nodes.erase(node);
    links.push_back(nodes);
  }
  if (links.empty()) return true;
  std::vector<std::size_t> reached{0};
  std::vector<bool> seen(links.size(), false);
  seen[0] = true;
  for (std::size_t r = 0; r < reached.size(); ++r) {
    for (std::size_t other = 0; other < links.size(); ++other) {
      if (seen[other]) continue;
      const auto& mine = links[reached[r]];
      if (std::any_of(mine.begin(), mine.end(), [&](std::int32_t n) { return links[other].count(n) != 0; })) {
        seen[other] = true;
        reached.push_back(other);
      }
    }
  }
  return reached.size() == links.size();
}

Singularities brute_force(const StarMesh& mesh) {
  std::set<std::int32_t> vertices;
  std::set<Edge> edges;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (!mesh.alive[t]) continue;
    for (std::size_t a = 0; a < 4; ++a) {
      vertices.insert(mesh.tets[t][a]);
      for (std::size_t b = a + 1; b < 4; ++b) {
        const auto [low, high] = std::minmax(mesh.tets[t][a], mesh.tets[t][b]);
        edges.insert({low, high});
      }
    }
  }
  Singularities found;
  for (std::int32_t v : vertices) {
    if (!hangs_together(mesh, {v})) found.vertices.push_back(v);
  }
  for (const Edge& e : edges) {
    if (!hangs_together(mesh, {e[0], e[1]})) found.edges.push_back(e);
  }
  return found;
}

void remove(StarMesh& mesh, std::vector<std::int32_t> elements, StarScratch& scratch,
            std::vector<std::int32_t>& removed) {
  removed.clear();
  for (std::int32_t e : elements) {
    if (mesh.alive[static_cast<std::size_t>(e)]) removed.push_back(e);
    mesh.alive[static_cast<std::size_t>(e)] = 0;
  }
  remove_singularities(mesh.stars(), mesh.alive, removed, scratch);
}

// A few random elements, or all within a random ball of elements' numbers: scattered holes and cracks.
std::vector<std::int32_t> random_elements(Random& random, const StarMesh& mesh) {
  std::vector<std::int32_t> elements;
  const auto count = static_cast<int>(mesh.tets.size());
  const int wanted = 1 + random_below(random, 6);
  for (int i = 0; i < wanted; ++i) elements.push_back(random_below(random, count));
  if (random_below(random, 4) == 0) {
    const int first = random_below(random, count);
    for (int e = first; e < std::min(first + 10, count); ++e) elements.push_back(e);
  }
  return elements;
}

// Takes out what is singular in the whole mesh, so that what follows starts manifold.
void clean(StarMesh& mesh, StarScratch& scratch) {
  std::vector<std::int32_t> removed;
  for (;;) {
    const Singularities found = singularities(mesh);
    if (found.vertices.empty() && found.edges.empty()) return;
    for (std::int32_t v : found.vertices)
      weaker_pieces_at_node(mesh.stars(), mesh.alive, v, scratch, removed);
    for (const Edge& e : found.edges)
      weaker_pieces_at_edge(mesh.stars(), mesh.alive, e[0], e[1], scratch, removed);
    for (std::int32_t e : removed) mesh.alive[static_cast<std::size_t>(e)] = 0;
  }
}

TEST(RemoveSingularities, LeavesNoneAfterTenThousandRandomRemovals) {
  const std::uint64_t seed = 20261122;
  SCOPED_TRACE(seed);
  Random random(seed);
  const std::vector<StarMesh> zoo = star_zoo(random);
  int removals = 0, singular_without = 0, checked = 0;
  std::vector<std::int32_t> removed, removed_again;
  while (removals < 10000) {
    const StarMesh& kind = zoo[static_cast<std::size_t>(random_below(random, static_cast<int>(zoo.size())))];
    StarMesh mesh = kind;
    StarScratch scratch = make_star_scratch(mesh.stars());
    clean(mesh, scratch);
    for (int round = 0; round < 12 && removals < 10000; ++round, ++removals) {
      std::vector<std::int32_t> elements = random_elements(random, mesh);
      StarMesh plain = mesh, shuffled = mesh;
      for (std::int32_t e : elements) plain.alive[static_cast<std::size_t>(e)] = 0;
      const Singularities without = singularities(plain);
      singular_without += !without.vertices.empty() || !without.edges.empty();

      remove(mesh, elements, scratch, removed);
      for (std::size_t i = elements.size(); i > 1; --i) {
        std::swap(elements[i - 1],
                  elements[static_cast<std::size_t>(random_below(random, static_cast<int>(i)))]);
      }
      remove(shuffled, elements, scratch, removed_again);
      ASSERT_EQ(mesh.alive, shuffled.alive)
          << "the order of the elements changed the result, removal " << removals;

      const Singularities left = singularities(mesh);
      ASSERT_TRUE(left.vertices.empty() && left.edges.empty()) << "removal " << removals;
      if (removals % 8 == 0) {  // the checker is slow
        const Singularities links = brute_force(mesh), links_plain = brute_force(plain);
        ASSERT_TRUE(links.vertices.empty() && links.edges.empty()) << "removal " << removals;
        ASSERT_EQ(links_plain.vertices, without.vertices) << "removal " << removals;
        ASSERT_EQ(links_plain.edges, without.edges) << "removal " << removals;
        ++checked;
      }
    }
  }
  EXPECT_GT(singular_without, 2000);  // the removals do make hinges
  EXPECT_GT(checked, 1000);
}

TEST(RemoveSingularities, KeepsTheLargestPieceAndTheLowestElementAtTies) {
  std::vector<std::int32_t> weaker;
  StarMesh mesh = star_mesh({{0, 1, 2, 3}, {0, 4, 5, 6}, {0, 4, 5, 7}});
  StarScratch scratch = make_star_scratch(mesh.stars());
  EXPECT_TRUE(weaker_pieces_at_node(mesh.stars(), mesh.alive, 0, scratch, weaker));
  EXPECT_EQ(weaker, std::vector<std::int32_t>({0}));
  weaker.clear();
  mesh = star_mesh({{0, 4, 5, 6}, {0, 1, 2, 3}, {0, 7, 8, 9}});
  scratch = make_star_scratch(mesh.stars());
  EXPECT_TRUE(weaker_pieces_at_node(mesh.stars(), mesh.alive, 0, scratch, weaker));
  EXPECT_EQ(weaker, std::vector<std::int32_t>({1, 2}));
}

TEST(RemoveSingularities, LeavesAMeshWithoutElementsAlone) {
  StarMesh mesh = star_cube(2, TetSplit::five);
  std::fill(mesh.alive.begin(), mesh.alive.end(), std::uint8_t{0});
  StarScratch scratch = make_star_scratch(mesh.stars());
  std::vector<std::int32_t> removed{0, 1, 2};
  EXPECT_EQ(remove_singularities(mesh.stars(), mesh.alive, removed, scratch), 0);
  EXPECT_EQ(removed.size(), 3U);
}

}  // namespace
}  // namespace sulcus
