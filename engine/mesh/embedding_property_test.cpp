// Statements about every mesh, tested on thousands of random label maps (docs/mesher.md states them).
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <numeric>
#include <set>

#include "engine/mesh/embedding.h"
#include "engine/mesh/topology.h"
#include "engine/volume/test_maps.h"

namespace sulcus {
namespace {

constexpr std::uint64_t first_seed = 1000;
constexpr int trials = 3000;

struct Case {
  LabelMap map;
  SeparationPairs pairs;
  EmbeddingOptions options;
};

// A random image up to 12^3, one voxel thick in every third case, with random pairs and any cell size.
Case random_case(std::uint64_t seed) {
  Random random(seed);
  Case c;
  Index3 size;
  for (int& side : size) side = 2 + random_below(random, 11);
  if (seed % 3 == 0) size[2] = 1;
  const int labels = 1 + random_below(random, 5);
  c.map = random_map(random, size, labels);
  c.map.labels[random() % c.map.labels.size()] = 1;
  c.map.spacing = {1e-3, 1e-3 * (1 + random_below(random, 2)), 1e-3};
  if (random_below(random, 4) == 0) c.map.direction(1, 1) = -1;
  c.pairs = random_pairs(random, labels);
  c.options.size_m = 1e-3 * (1 + random_below(random, std::max({size[0], size[1], size[2]})));
  c.options.split = random_below(random, 2) ? TetSplit::six : TetSplit::five;
  return c;
}

// Runs `check` on all cases; a failure names its seed.
template <class Check>
void for_random_cases(Check check) {
  for (std::uint64_t seed = first_seed; seed < first_seed + trials; ++seed) {
    const Case c = random_case(seed);
    check(c, build_embedding(c.map, c.pairs, c.options));
    if (::testing::Test::HasFatalFailure()) FAIL() << "seed " << seed;
  }
}

Index3 voxel_at(const LabelMap& map, std::size_t v) {
  const auto nx = static_cast<std::size_t>(map.size[0]), ny = static_cast<std::size_t>(map.size[1]);
  return {static_cast<int>(v % nx), static_cast<int>(v / nx % ny), static_cast<int>(v / nx / ny)};
}

Index3 grid_cell(const EmbeddingMesh& mesh, const Index3& voxel) {
  Index3 cell;
  for (int a = 0; a < 3; ++a) cell[a] = voxel[a] / mesh.voxels_per_cell[a];
  return cell;
}

// Calls visit(v, w) for every two face neighbours that the map connects.
template <class Visit>
void for_connected_neighbours(const Case& c, Visit visit) {
  const std::size_t step[3] = {1, static_cast<std::size_t>(c.map.size[0]),
                               static_cast<std::size_t>(c.map.size[0]) * c.map.size[1]};
  for (std::size_t v = 0; v < c.map.voxel_count(); ++v) {
    for (int a = 0; a < 3; ++a) {
      if (voxel_at(c.map, v)[a] + 1 == c.map.size[a]) continue;
      if (c.pairs.connected(c.map.labels[v], c.map.labels[v + step[a]])) visit(v, v + step[a]);
    }
  }
}

std::size_t root(std::vector<std::size_t>& parent, std::size_t n) {
  while (parent[n] != n) n = parent[n];
  return n;
}

TEST(EveryMesh, HasThePiecesOfItsVoxels) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    const Pieces voxels = voxel_pieces(c.map, c.pairs);
    const Pieces tets = mesh_pieces(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
    ASSERT_EQ(tets.item_count.size(), voxels.item_count.size());
    std::vector<std::int32_t> partner(voxels.item_count.size(), -1);
    for (std::size_t v = 0; v < c.map.voxel_count(); ++v) {
      if (c.map.labels[v] == 0) continue;
      for (int t = 0; t < mesh.tets_per_cell; ++t) {
        const std::int32_t piece = tets.piece[mesh.cell_of_voxel[v] * mesh.tets_per_cell + t];
        std::int32_t& known = partner[voxels.piece[v]];
        if (known < 0) known = piece;
        ASSERT_EQ(known, piece);
      }
    }
    std::sort(partner.begin(), partner.end());  // one to one
    for (std::size_t p = 0; p < partner.size(); ++p) ASSERT_EQ(partner[p], static_cast<std::int32_t>(p));
  });
}

TEST(EveryMesh, OwnsEveryVoxelOnceAndHasNoCellWithoutOne) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    std::vector<std::map<std::int32_t, int>> labels(mesh.cell_position.size());
    std::vector<std::size_t> first(mesh.cell_position.size(), c.map.voxel_count());
    for (std::size_t v = 0; v < c.map.voxel_count(); ++v) {
      const std::int32_t cell = mesh.cell_of_voxel[v];
      ASSERT_EQ(cell >= 0, c.map.labels[v] != 0);
      if (cell < 0) continue;
      ASSERT_LT(static_cast<std::size_t>(cell), mesh.cell_position.size());
      ASSERT_EQ(mesh.cell_position[cell], grid_cell(mesh, voxel_at(c.map, v)));
      first[cell] = std::min(first[cell], v);
      ++labels[cell][c.map.labels[v]];
    }
    for (std::size_t cell = 0; cell < labels.size(); ++cell) {
      int count = 0, most = 0;
      for (const auto& [label, n] : labels[cell]) {
        count += n;
        most = std::max(most, n);
      }
      ASSERT_GT(count, 0);
      ASSERT_EQ(mesh.cell_voxels[cell], count);
      ASSERT_EQ(labels[cell][mesh.cell_label[cell]], most);
      // Ordered by grid position, then by first voxel.
      if (cell == 0) continue;
      const Index3 &p = mesh.cell_position[cell - 1], &q = mesh.cell_position[cell];
      ASSERT_TRUE(std::tie(p[2], p[1], p[0], first[cell - 1]) < std::tie(q[2], q[1], q[0], first[cell]));
    }
  });
}

TEST(EveryMesh, CopiesAreThePiecesWithinAGridCell) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    std::vector<std::size_t> parent(c.map.voxel_count());
    std::iota(parent.begin(), parent.end(), 0);
    for_connected_neighbours(c, [&](std::size_t v, std::size_t w) {
      if (grid_cell(mesh, voxel_at(c.map, v)) == grid_cell(mesh, voxel_at(c.map, w))) {
        parent[root(parent, w)] = root(parent, v);
      }
    });
    std::map<std::size_t, std::int32_t> copy_of_root;
    std::set<std::int32_t> copies;
    for (std::size_t v = 0; v < c.map.voxel_count(); ++v) {
      if (c.map.labels[v] == 0) continue;
      const auto [known, added] = copy_of_root.try_emplace(root(parent, v), mesh.cell_of_voxel[v]);
      ASSERT_EQ(known->second, mesh.cell_of_voxel[v]);
      if (added) {
        ASSERT_TRUE(copies.insert(known->second).second);
      }
    }
    ASSERT_EQ(copies.size(), mesh.cell_position.size());
  });
}

TEST(EveryMesh, LinksCopiesThatAVoxelFaceConnects) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    std::set<std::array<std::int32_t, 2>> expected;
    for_connected_neighbours(c, [&](std::size_t v, std::size_t w) {
      const std::int32_t a = mesh.cell_of_voxel[v], b = mesh.cell_of_voxel[w];
      if (a != b) expected.insert({std::min(a, b), std::max(a, b)});
    });
    ASSERT_TRUE(std::equal(expected.begin(), expected.end(), mesh.cell_links.begin(), mesh.cell_links.end()));
  });
}

// The same nodes another way: each link merges the four corners that its two copies have in common.
TEST(EveryMesh, SharesNodesAlongLinksAndOnlyThere) {
  for_random_cases([](const Case&, const EmbeddingMesh& mesh) {
    std::vector<std::size_t> parent(mesh.cell_nodes.size() * 8);
    std::iota(parent.begin(), parent.end(), 0);
    for (const auto& [a, b] : mesh.cell_links) {
      int axis = 0;
      while (mesh.cell_position[a][axis] == mesh.cell_position[b][axis]) ++axis;
      for (std::size_t corner = 0; corner < 8; ++corner) {
        if (!(corner >> axis & 1)) continue;
        const std::size_t x = static_cast<std::size_t>(a) * 8 + corner;
        const std::size_t y = static_cast<std::size_t>(b) * 8 + (corner ^ (std::size_t{1} << axis));
        parent[root(parent, y)] = root(parent, x);
      }
    }
    std::map<std::size_t, std::int32_t> node_of_root;
    std::set<std::int32_t> nodes;
    for (std::size_t x = 0; x < parent.size(); ++x) {
      const std::int32_t node = mesh.cell_nodes[x / 8][x % 8];
      const auto [known, added] = node_of_root.try_emplace(root(parent, x), node);
      ASSERT_EQ(known->second, node);
      if (added) {
        ASSERT_TRUE(nodes.insert(node).second);
      }
    }
    ASSERT_EQ(nodes.size(), mesh.rest_positions.size());
  });
}

// Six times the signed volume of a tetrahedron, m^3.
double six_volumes(const EmbeddingMesh& mesh, const std::array<std::int32_t, 4>& t) {
  const Vec3 &o = mesh.rest_positions[t[0]], a = mesh.rest_positions[t[1]] - o,
             b = mesh.rest_positions[t[2]] - o, c = mesh.rest_positions[t[3]] - o;
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

TEST(EveryMesh, FillsItsCellsWithPositiveTetrahedra) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    double cell_volume = 1;  // m^3
    for (int a = 0; a < 3; ++a) cell_volume *= mesh.voxels_per_cell[a] * c.map.spacing[a];
    ASSERT_EQ(mesh.tets.size(), mesh.cell_nodes.size() * mesh.tets_per_cell);
    for (std::size_t cell = 0; cell < mesh.cell_nodes.size(); ++cell) {
      double sum = 0;
      for (int t = 0; t < mesh.tets_per_cell; ++t) {
        const double volume = six_volumes(mesh, mesh.tets[cell * mesh.tets_per_cell + t]) / 6;
        ASSERT_GT(volume, 0.1 * cell_volume);
        sum += volume;
      }
      ASSERT_NEAR(sum, cell_volume, 1e-9 * cell_volume);
    }
  });
}

using Triangle = std::array<std::int32_t, 3>;

// Tetrahedron faces by their sorted nodes, with the cells they occur in (twice if inside the cell).
std::map<Triangle, std::vector<std::int32_t>> faces_of(const EmbeddingMesh& mesh) {
  std::map<Triangle, std::vector<std::int32_t>> faces;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    for (int left_out = 0; left_out < 4; ++left_out) {
      Triangle face{};
      for (int v = 0, n = 0; v < 4; ++v) {
        if (v != left_out) face[n++] = mesh.tets[t][v];
      }
      std::sort(face.begin(), face.end());
      faces[face].push_back(static_cast<std::int32_t>(t) / mesh.tets_per_cell);
    }
  }
  return faces;
}

TEST(EveryMesh, IsConforming) {
  for_random_cases([](const Case&, const EmbeddingMesh& mesh) {
    // How many faces two linked copies have in common: always the two triangles of their square.
    std::map<std::array<std::int32_t, 2>, int> common;
    for (const auto& [face, cells] : faces_of(mesh)) {
      std::map<std::int32_t, int> times;
      for (const std::int32_t cell : cells) ++times[cell];
      std::set<Index3> positions;
      for (const auto& [cell, n] : times) positions.insert(mesh.cell_position[cell]);
      // A face lies inside one grid cell, in two tetrahedra of each copy there that has it, or between two
      // grid cells (or on the border of one), in one tetrahedron of each copy.
      const int n = times.begin()->second;
      for (const auto& [cell, count] : times) ASSERT_EQ(count, n);
      ASSERT_LE(n, 2);
      ASSERT_LE(positions.size(), n == 2 ? 1U : 2U);
      for (const auto& [a, count] : times) {
        for (const auto& [b, other] : times) {
          if (n == 1 && a < b) ++common[{a, b}];
        }
      }
    }
    for (const auto& link : mesh.cell_links) ASSERT_EQ(common[link], 2);
  });
}

TEST(EveryMesh, SharesInnerFacesBetweenExactlyTwoTetrahedraWithoutSuperimposedCells) {
  int checked = 0;
  for_random_cases([&](const Case&, const EmbeddingMesh& mesh) {
    const std::set<Index3> positions(mesh.cell_position.begin(), mesh.cell_position.end());
    if (positions.size() != mesh.cell_position.size()) return;
    ++checked;
    std::size_t between = 0;
    for (const auto& [face, cells] : faces_of(mesh)) {
      ASSERT_LE(cells.size(), 2U);
      if (cells.size() == 2 && cells[0] != cells[1]) ++between;
    }
    ASSERT_GE(between, 2 * mesh.cell_links.size());
  });
  EXPECT_GT(checked, 500);
}

TEST(EveryMesh, IsTheSameForAnyThreadCount) {
  const int threads = omp_get_max_threads();
  for (std::uint64_t seed = first_seed; seed < first_seed + 300; ++seed) {
    const Case c = random_case(seed);
    omp_set_num_threads(1);
    const EmbeddingMesh one = build_embedding(c.map, c.pairs, c.options);
    omp_set_num_threads(2 + static_cast<int>(seed % 3));
    const EmbeddingMesh many = build_embedding(c.map, c.pairs, c.options);
    EXPECT_EQ(one.cell_position, many.cell_position);
    EXPECT_EQ(one.cell_nodes, many.cell_nodes);
    EXPECT_EQ(one.cell_voxels, many.cell_voxels);
    EXPECT_EQ(one.cell_label, many.cell_label);
    EXPECT_EQ(one.cell_links, many.cell_links);
    EXPECT_EQ(one.cell_of_voxel, many.cell_of_voxel);
    EXPECT_EQ(one.rest_positions, many.rest_positions);
    EXPECT_EQ(one.tets, many.tets);
    ASSERT_FALSE(HasFailure()) << "seed " << seed;
  }
  omp_set_num_threads(threads);
}

TEST(EveryMesh, DoesNotDependOnTheNumberingOfLabels) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    const std::int32_t renamed[6] = {0, 2000000000, -7, 41, 40, -2000000000};
    Case other = c;
    for (auto& label : other.map.labels) label = renamed[label];
    for (auto& [a, b] : other.pairs.pairs) {
      a = renamed[a];
      b = renamed[b];
    }
    other.pairs = make_separation_pairs(other.pairs.pairs);
    const EmbeddingMesh again = build_embedding(other.map, other.pairs, other.options);
    ASSERT_EQ(mesh.cell_nodes, again.cell_nodes);
    ASSERT_EQ(mesh.cell_links, again.cell_links);
    ASSERT_EQ(mesh.cell_of_voxel, again.cell_of_voxel);
    ASSERT_EQ(mesh.tets, again.tets);
    for (std::size_t cell = 0; cell < mesh.cell_label.size(); ++cell) {
      ASSERT_EQ(renamed[mesh.cell_label[cell]], again.cell_label[cell]);
    }
  });
}

TEST(EveryMesh, WithoutIslandsIsTheMeshOfTheMapWithoutThem) {
  int removed = 0;
  for_random_cases([&](const Case& c, const EmbeddingMesh& mesh) {
    const Pieces pieces = mesh_pieces(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
    const std::int64_t largest = *std::max_element(pieces.item_count.begin(), pieces.item_count.end());
    Case kept = c;
    kept.options.min_island_cells = largest / mesh.tets_per_cell;
    const EmbeddingMesh without = build_embedding(kept.map, kept.pairs, kept.options);
    for (std::size_t v = 0; v < c.map.voxel_count(); ++v) {
      const std::int32_t cell = mesh.cell_of_voxel[v];
      if (cell >= 0 && pieces.item_count[pieces.piece[cell * mesh.tets_per_cell]] < largest)
        kept.map.labels[v] = 0;
    }
    removed += kept.map.labels != c.map.labels;
    kept.options.min_island_cells = 0;
    const EmbeddingMesh expected = build_embedding(kept.map, kept.pairs, kept.options);
    ASSERT_EQ(without.cell_position, expected.cell_position);
    ASSERT_EQ(without.cell_nodes, expected.cell_nodes);
    ASSERT_EQ(without.cell_links, expected.cell_links);
    ASSERT_EQ(without.cell_of_voxel, expected.cell_of_voxel);
    ASSERT_EQ(without.cell_voxels, expected.cell_voxels);
    ASSERT_EQ(without.cell_label, expected.cell_label);
    ASSERT_EQ(without.tets, expected.tets);
  });
  EXPECT_GT(removed, 300);
}

TEST(EveryMesh, NotSuperimposedHasOneCopyAGridCellAndOneNodeACorner) {
  for_random_cases([](const Case& c, const EmbeddingMesh& mesh) {
    EmbeddingOptions plain = c.options;
    plain.superimpose = false;
    const EmbeddingMesh grid = build_embedding(c.map, c.pairs, plain);
    const std::set<Index3> occupied(mesh.cell_position.begin(), mesh.cell_position.end());
    ASSERT_EQ(grid.cell_position.size(), occupied.size());
    std::set<Index3> corners;
    for (std::size_t cell = 0; cell < grid.cell_position.size(); ++cell) {
      ASSERT_TRUE(occupied.count(grid.cell_position[cell]));
      for (int n = 0; n < 8; ++n) {
        const Index3& p = grid.cell_position[cell];
        corners.insert({p[0] + (n & 1), p[1] + (n >> 1 & 1), p[2] + (n >> 2)});
      }
    }
    ASSERT_EQ(grid.rest_positions.size(), corners.size());
  });
}

TEST(LocateTet, FindsThePointAgain) {
  for (std::uint64_t seed = first_seed; seed < first_seed + 500; ++seed) {
    const Case c = random_case(seed);
    const EmbeddingMesh mesh = build_embedding(c.map, c.pairs, c.options);
    Random random(seed);
    for (int n = 0; n < 20; ++n) {
      const auto cell = static_cast<std::int32_t>(random() % mesh.cell_position.size());
      Vec3 voxel;
      const double reach = n < 10 ? 0.0 : 0.3;  // inside the cell, then up to 0.3 cells outside
      for (int a = 0; a < 3; ++a) {
        const double local = -reach + (1 + 2 * reach) * 0.001 * random_below(random, 1001);
        voxel[a] = (mesh.cell_position[cell][a] + local) * mesh.voxels_per_cell[a] - 0.5;
      }
      std::array<double, 4> weights{};
      const std::int32_t tet = locate_tet_in_cell(mesh, cell, voxel, weights);
      ASSERT_EQ(tet / mesh.tets_per_cell, cell);
      const Vec3 world = c.map.to_world(voxel);
      for (int a = 0; a < 3; ++a) {
        double sum = 0;
        for (int v = 0; v < 4; ++v) sum += weights[v] * mesh.rest_positions[mesh.tets[tet][v]][a];
        ASSERT_NEAR(sum, world[a], 1e-12);
      }
      if (n < 10) {
        ASSERT_GE(*std::min_element(weights.begin(), weights.end()), -1e-12);
      }
    }
  }
}

}  // namespace
}  // namespace sulcus
