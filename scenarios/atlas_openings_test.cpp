// The forced openings of thesis 2.7.4 on the SPL atlas; skipped where the atlas is absent.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/mesh/topology.h"
#include "engine/scene/step.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

// Where the point of the cell's tissue went, m.
Vec3 moved(const Scene& scene, const State& state, std::int32_t cell, const Vec3& point_voxel) {
  std::array<double, 4> weights;
  const std::int32_t tet = locate_tet_in_cell(scene.mesh, cell, point_voxel, weights);
  Vec3 sum = Vec3::Zero();
  for (std::size_t v = 0; v < 4; ++v) {
    const std::int32_t node = scene.mesh.tets[static_cast<std::size_t>(tet)][v];
    sum += weights[v] * Eigen::Map<const Vec3>(&state.positions[3 * static_cast<std::size_t>(node)]);
  }
  return sum;
}

// How far the two sides of voxel faces have come apart.
struct Openings {
  std::vector<double> pair_faces_m;  // between the labels of a pair, largest last
  double largest_elsewhere_m = 0;    // at every seventh connected face

  double share_beyond(double distance_m) const {
    const auto wide = std::count_if(pair_faces_m.begin(), pair_faces_m.end(),
                                    [&](double opening) { return opening > distance_m; });
    return static_cast<double>(wide) / static_cast<double>(pair_faces_m.size());
  }
};

Openings measure_openings(const Scene& scene, const State& state) {
  const LabelMap& map = scene.settings.map;
  const std::size_t step[3] = {1, static_cast<std::size_t>(map.size[0]),
                               static_cast<std::size_t>(map.size[0]) * static_cast<std::size_t>(map.size[1])};
  Openings openings;
  std::size_t connected = 0;
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        const std::size_t voxel = map.index(i, j, k);
        const Index3 at{i, j, k};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          if (map.labels[voxel] == 0 || at[axis] + 1 == map.size[axis]) continue;
          const std::size_t other = voxel + step[axis];
          const std::int32_t a = scene.mesh.cell_of_voxel[voxel], b = scene.mesh.cell_of_voxel[other];
          if (map.labels[other] == 0 || a < 0 || b < 0) continue;
          const bool joined = scene.settings.pairs.connected(map.labels[voxel], map.labels[other]);
          if (joined && ++connected % 7 != 0) continue;
          Vec3 middle(i, j, k);
          middle[static_cast<Eigen::Index>(axis)] += 0.5;
          const double opening = (moved(scene, state, a, middle) - moved(scene, state, b, middle)).norm();
          if (joined) {
            openings.largest_elsewhere_m = std::max(openings.largest_elsewhere_m, opening);
          } else {
            openings.pair_faces_m.push_back(opening);
          }
        }
      }
    }
  }
  std::sort(openings.pair_faces_m.begin(), openings.pair_faces_m.end());
  return openings;
}

class Atlas : public testing::Test {
 protected:
  void SetUp() override {
    const fs::path map = fs::path(SULCUS_SOURCE_DIR) / "../shared/data/spl-brain-atlas/hncma-atlas-2014.nrrd";
    if (!fs::exists(map)) GTEST_SKIP() << map << " is absent";
  }

  // Runs the scenario in few large steps.
  static Openings open(const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> overrides = {"/time/step_s=0.25"};
    overrides.insert(overrides.end(), more.begin(), more.end());
    const Scenario scenario =
        load_scenario(fs::path(SULCUS_SOURCE_DIR) / "scenarios/atlas" / (name + ".json"), overrides);
    const Scene scene = make_scene(scenario);
    const WorkspacePtr workspace = make_workspace(scene, 2);
    State state = initial_state(scene, {});
    StepReport report = make_report(scene);
    for (std::int64_t n = 0; n < scenario.steps(); ++n) {
      step(scene, {}, state, report, *workspace);
      EXPECT_TRUE(report.finite && report.converged) << name << ", step " << n;
    }
    EXPECT_EQ(count_inverted(scene, state), 0) << name;
    const Openings openings = measure_openings(scene, state);
    std::printf("%s %s: %zu cells; largest opening %.1f mm, %.0f %% of the pairs' faces beyond 1 mm\n",
                name.c_str(), more.empty() ? "" : more.front().c_str(), scene.mesh.cell_nodes.size(),
                openings.pair_faces_m.back() * 1e3, 100 * openings.share_beyond(1e-3));
    return openings;
  }
};

constexpr double rounding_m = 1e-9;  // m, of sums of coordinates of about 0.1 m

// Both sides have pairs, and only the temporal lobe of one is pulled, so most faces stay together. A coarser
// cell holds more voxels that are connected past the end of a cut, so less of the fissure opens
// (docs/mesher.md).
TEST_F(Atlas, SylvianFissureOpensAtEveryCellSizeAndMoreOfItInSmallerCells) {
  double finer = 1;
  for (const char* size : {"5", "10", "15"}) {
    const Openings openings = open("atlas_sylvian_opening", {std::string("/mesh/size_mm=") + size});
    EXPECT_GT(openings.pair_faces_m.back(), 6e-3) << size;
    EXPECT_LT(openings.share_beyond(1e-3), finer) << size;
    EXPECT_GT(openings.share_beyond(1e-3), 0.03) << size;
    EXPECT_LT(openings.largest_elsewhere_m, rounding_m) << size;
    finer = openings.share_beyond(1e-3);
  }
}

TEST_F(Atlas, SylvianFissureStaysClosedWithoutSuperimposedCells) {
  const Openings openings = open("atlas_sylvian_opening", {"/mesh/superimpose=false"});
  EXPECT_LT(openings.pair_faces_m.back(), rounding_m);
}

TEST_F(Atlas, CerebellumComesAway) {
  const Openings openings = open("atlas_cerebellum_opening", {});
  EXPECT_GT(openings.pair_faces_m.back(), 4e-3);
  EXPECT_GT(openings.share_beyond(1e-3), 0.25);
  EXPECT_LT(openings.largest_elsewhere_m, rounding_m);
}

TEST_F(Atlas, LongitudinalFissureOpens) {
  const Openings openings = open("atlas_longitudinal_opening", {});
  EXPECT_GT(openings.pair_faces_m.back(), 6e-3);
  EXPECT_GT(openings.share_beyond(1e-3), 0.25);
  EXPECT_LT(openings.largest_elsewhere_m, rounding_m);
}

}  // namespace
}  // namespace sulcus
