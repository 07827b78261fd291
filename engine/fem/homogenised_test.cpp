// A bar that is not aligned with the grid, embedded with whole cells and with cells weighted by their content
// (thesis 2.8 and 6.2), against a fine mesh that conforms to the bar.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "engine/fem/test_body.h"
#include "engine/mesh/shares.h"

namespace sulcus {
namespace {

constexpr double length_m = 0.06, width_m = 0.012;  // free length and square cross-section
constexpr double grip_m = 0.012;                    // held beyond either end
constexpr double voxel_m = 0.001;

// Axes of the bar (columns) in the grid's axes. Its own origin is the middle of the left end of the free
// length.
Mat3 bar_axes(int turn) {
  const Vec3 angles[] = {{0, 0, 0.3}, {0.2, 0.45, 0.6}, {0.7, 0.15, 1.1}};  // rad
  return rotation_matrix(quaternion_from_rotation_vector(angles[turn]));
}

// Material of a point in the bar's coordinates: 0 none, 1 soft half, 2 stiff half; the halves lie side by
// side along the whole bar.
int material_at(const Vec3& p, bool two_materials) {
  const bool inside = p[0] > -grip_m && p[0] < length_m + grip_m && std::fabs(p[1]) < width_m / 2 &&
                      std::fabs(p[2]) < width_m / 2;
  if (!inside) return 0;
  return two_materials && p[1] > 0 ? 2 : 1;
}

const std::vector<Material> materials{{1000, 0.3, 1000}, {1000, 0.3, 1000}, {5000, 0.3, 1200}};

// Stiffness [N/m] against pulling the right grip along the bar and across it, and mass [kg]. `own`: the bar's
// coordinates of a world point.
struct Answer {
  double pull = 0, bend = 0, mass = 0;
};
template <class Own>
Answer answer(Body& body, const Mat3& axes, const Own& own) {
  Answer result;
  for (const double mass : body.elements.node_mass) result.mass += mass;
  for (int direction = 0; direction < 2; ++direction) {
    const Vec3 push = axes.col(direction);
    std::map<int, double> prescribed;
    std::vector<int> right;
    for (std::size_t n = 0; n < body.mesh.rest_positions.size(); ++n) {
      const double along = own(body.mesh.rest_positions[n])[0];
      if (along > 1e-9 && along < length_m - 1e-9) continue;
      const bool moved = along >= length_m - 1e-9;
      if (moved) right.push_back(static_cast<int>(n));
      for (int a = 0; a < 3; ++a) prescribed[3 * static_cast<int>(n) + a] = moved ? push[a] : 0;
    }
    const Solution s = solve(body, prescribed, Eigen::VectorXd::Zero(3 * body.mesh.rest_positions.size()));
    double force = 0;  // N for a unit displacement
    for (const int n : right) {
      for (int a = 0; a < 3; ++a) force += push[a] * s.force[3 * n + a];
    }
    (direction == 0 ? result.pull : result.bend) = force;
  }
  return result;
}

// The bar by its own grid of cells of the given size.
Answer conforming(double cell_m, bool two_materials) {
  LabelMap map;
  map.spacing = Vec3::Constant(cell_m);
  const int along = static_cast<int>(std::lround((length_m + 2 * grip_m) / cell_m)),
            across = static_cast<int>(std::lround(width_m / cell_m));
  map.size = {along, across, across};
  map.origin = Vec3(-grip_m, -width_m / 2, -width_m / 2) + Vec3::Constant(0.5 * cell_m);
  for (int k = 0; k < across; ++k) {
    for (int j = 0; j < across; ++j) {
      for (int i = 0; i < along; ++i)
        map.labels.push_back(material_at(map.to_world(Vec3(i, j, k)), two_materials));
    }
  }
  const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = cell_m});
  std::vector<std::int32_t> of_tet;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) of_tet.push_back(mesh.cell_label[t / 5]);
  Body body(mesh, materials, of_tet);
  return answer(body, Mat3::Identity(), [](const Vec3& x) { return x; });
}

// The turned bar in a grid of voxels, embedded in cells of the given size.
Answer embedded(double cell_m, int turn, bool two_materials, bool by_content) {
  const Mat3 axes = bar_axes(turn);
  Vec3 low = Vec3::Constant(1), high = Vec3::Constant(-1);
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 p =
        axes * Vec3(corner & 1 ? length_m + grip_m : -grip_m, corner & 2 ? width_m / 2 : -width_m / 2,
                    corner & 4 ? width_m / 2 : -width_m / 2);
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  LabelMap map;
  map.spacing = Vec3::Constant(voxel_m);
  map.origin = low - Vec3::Constant(0.7 * voxel_m);
  for (int a = 0; a < 3; ++a) map.size[a] = static_cast<int>((high[a] - low[a]) / voxel_m) + 3;
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i)
        map.labels.push_back(material_at(axes.transpose() * map.to_world(Vec3(i, j, k)), two_materials));
    }
  }
  const EmbeddingMesh mesh = build_embedding(map, {}, {.size_m = cell_m});
  std::vector<std::int32_t> of_tet;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) of_tet.push_back(mesh.cell_label[t / 5]);
  Body body(mesh, materials, of_tet);
  if (by_content) {
    TetShares shares = tet_shares(map, mesh);
    const ElementContent content{shares.first, shares.label, shares.share};
    body.elements = build_elements(mesh, materials, of_tet, {}, &content);
  }
  return answer(body, axes, [&](const Vec3& x) { return Vec3(axes.transpose() * x); });
}

double percent(double value, double reference) {
  return 100 * (value / reference - 1);
}

TEST(Homogenised, BarAcrossTheGridIsCloserToTheFineMeshThanWithWholeCells) {
  for (const bool two_materials : {false, true}) {
    const Answer coarse = conforming(0.003, two_materials), fine = conforming(0.0015, two_materials);
    const auto limit = [](double c, double f) { return f + (f - c) / 3; };  // errors go with the square
    const Answer reference{limit(coarse.pull, fine.pull), limit(coarse.bend, fine.bend), fine.mass};
    std::printf("%s: %.4f N/m pulled, %.4f N/m bent, %.3f g (1.5 mm: %+.1f %% and %+.1f %%)\n",
                two_materials ? "two materials" : "one material", reference.pull, reference.bend,
                reference.mass * 1e3, percent(fine.pull, reference.pull), percent(fine.bend, reference.bend));
    for (const double cell_m : {0.003, 0.006}) {  // 0.002 too, if one has the time: docs/mesher.md
      Answer mean[2];                             // of the absolute errors over the turns, %
      for (int turn = 0; turn < 3; ++turn) {
        for (const bool by_content : {false, true}) {
          const Answer found = embedded(cell_m, turn, two_materials, by_content);
          mean[by_content].pull += std::fabs(percent(found.pull, reference.pull)) / 3;
          mean[by_content].bend += std::fabs(percent(found.bend, reference.bend)) / 3;
          mean[by_content].mass += std::fabs(percent(found.mass, reference.mass)) / 3;
        }
      }
      const Answer same = conforming(cell_m, two_materials);
      std::printf(
          "  H = %.0f mm: pulled %5.1f %% whole cells, %5.1f %% shares, %5.1f %% conforming;"
          "  bent %5.1f, %5.1f, %5.1f;  mass %5.1f, %5.1f\n",
          cell_m * 1e3, mean[0].pull, mean[1].pull, percent(same.pull, reference.pull), mean[0].bend,
          mean[1].bend, percent(same.bend, reference.bend), mean[0].mass, mean[1].mass);
      EXPECT_LT(mean[1].pull, 0.3 * mean[0].pull);
      EXPECT_LT(mean[1].bend, 0.5 * mean[0].bend);
      EXPECT_LT(mean[1].mass, 2);  // of the voxels themselves
    }
  }
}

// A full element is itself, an empty one is the least share of its own material, a half-filled one half.
TEST(Homogenised, ElementsAreTheMeansOfTheirContent) {
  const EmbeddingMesh mesh = box_mesh(2, 2, 2, 0.01);
  const std::vector<Material> two{{1000, 0.45, 900}, {4000, 0.2, 1100}};
  const std::vector<std::int32_t> of_tet(mesh.tets.size(), 1);
  ElementContent content;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    content.first.push_back(static_cast<std::int64_t>(content.share.size()));
    if (t == 0) continue;  // nothing in it
    content.material.push_back(0);
    content.share.push_back(t == 1 ? 1.0 : 0.5);
    if (t == 2) {
      content.material.push_back(1);
      content.share.push_back(0.25);
    }
  }
  content.first.push_back(static_cast<std::int64_t>(content.share.size()));
  const ElementData mixed = build_elements(mesh, two, of_tet, {}, &content);
  const ElementData soft = build_elements(mesh, two, std::vector<std::int32_t>(mesh.tets.size(), 0)),
                    stiff = build_elements(mesh, two, of_tet);
  const auto value = [](const ElementData& data, std::size_t component, std::size_t element) {
    constexpr std::size_t lanes = ElementData::lanes;
    return data.rest_double[(element / lanes * 12 + component) * lanes + element % lanes];
  };
  for (const std::size_t component : {9, 10}) {
    EXPECT_DOUBLE_EQ(value(mixed, component, 0), least_share * value(stiff, component, 0));
    EXPECT_DOUBLE_EQ(value(mixed, component, 1), value(soft, component, 1));
    EXPECT_DOUBLE_EQ(value(mixed, component, 2),
                     0.5 * value(soft, component, 2) + 0.25 * value(stiff, component, 2));
    EXPECT_DOUBLE_EQ(value(mixed, component, 3), 0.5 * value(soft, component, 3));
  }
  EXPECT_DOUBLE_EQ(value(mixed, 11, 3), value(soft, 11, 3));  // the volume stays the element's
  double mass = 0, expected = 0;
  for (const double m : mixed.node_mass) mass += m;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const double density = t == 0 ? least_share * 1100 : t == 1 ? 900 : t == 2 ? 450 + 275 : 450;
    expected += density * value(soft, 11, t);
  }
  EXPECT_NEAR(mass, expected, 1e-12 * expected);
}

}  // namespace
}  // namespace sulcus
