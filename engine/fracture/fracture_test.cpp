#include "engine/fracture/fracture.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/fem/rotation.h"
#include "engine/fem/stress.h"
#include "engine/fracture/test_zoo.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

// E = 2000 Pa, nu = 0.45 of equations.md 7.
Material soft(double threshold_Pa) {
  Material material;
  material.youngs_modulus_Pa = 2000;
  material.poisson_ratio = 0.45;
  material.fracture_threshold_Pa = threshold_Pa;
  return material;
}

struct Body {
  EmbeddingMesh mesh;
  ElementData elements;
  NodeStars around;
  FractureData data;
  std::vector<std::uint8_t> alive;
  std::vector<double> positions;

  MeshStars stars() const { return {mesh.tets, around.start, around.incident}; }
  FractureScratch scratch(Isa isa = widest_isa(), int threads = 2) const {
    return make_fracture_scratch(elements, stars(), isa, threads);
  }
  FractureReport tear(const FractureSettings& settings, FractureScratch& scratch,
                      std::span<std::uint8_t> counters = {}) {
    return sulcus::tear(elements, data, settings, stars(), mesh.rest_positions, positions, alive, counters,
                        scratch);
  }
};

Body make_body(int cells, const std::vector<Material>& materials,
               const std::vector<std::int32_t>& of_tet = {}) {
  Body body;
  body.mesh = box_mesh(cells, cells, cells, 0.01);
  std::vector<std::int32_t> material_of_tet = of_tet;
  if (material_of_tet.empty()) material_of_tet.assign(body.mesh.tets.size(), 0);
  body.elements = build_elements(body.mesh, materials, material_of_tet);
  body.around = build_node_stars(body.mesh.tets, static_cast<std::int64_t>(body.mesh.rest_positions.size()));
  body.data = build_fracture_data(body.elements, materials, material_of_tet);
  body.alive.assign(body.mesh.tets.size(), 1);
  body.positions = flat_positions(body.mesh);
  return body;
}

void deform(Body& body, const Mat3& f) {
  for (std::size_t n = 0; n < body.mesh.rest_positions.size(); ++n) {
    const Vec3 x = f * body.mesh.rest_positions[n];
    for (int i = 0; i < 3; ++i) body.positions[3 * n + static_cast<std::size_t>(i)] = x[i];
  }
}

Mat3 stretch(double a, double b, double c) {
  return Vec3(a, b, c).asDiagonal();
}

TEST(Criterion, TearsAboveTheLargestPrincipalStressOfTheTableAndNotBelow) {
  // stretches (1.3, .877058, .877058): 749.686 Pa
  for (const double threshold : {749.0, 750.5}) {
    Body body = make_body(2, {soft(threshold)});
    deform(body, stretch(0.877058, 1.3, 0.877058));
    FractureScratch scratch = body.scratch();
    const FractureReport report = body.tear({}, scratch);
    EXPECT_EQ(report.by_criterion, threshold < 749.686 ? 40 : 0);
    EXPECT_NEAR(report.margin, std::fabs(749.686 / threshold - 1), 1e-6);
  }
}

TEST(Criterion, PurePressureTearsByTheAbsoluteRuleOnly) {
  // stretches (.8, 1, 1): -1517.24, -1241.38, -1241.38 Pa
  for (const FractureCriterion criterion :
       {FractureCriterion::tensile, FractureCriterion::largest_absolute}) {
    for (const double threshold : {1517.0, 1518.0}) {
      Body body = make_body(2, {soft(threshold)});
      deform(body, stretch(0.8, 1, 1));
      FractureScratch scratch = body.scratch();
      const bool tears = criterion == FractureCriterion::largest_absolute && threshold < 1517.24;
      EXPECT_EQ(body.tear({criterion}, scratch).by_criterion, tears ? 40 : 0);
    }
  }
}

TEST(Criterion, ARotationTearsNothing) {
  Body body = make_body(2, {soft(1)});
  deform(body, rotation_matrix(quaternion_from_rotation_vector(Vec3(1, -2, 0.5))));
  FractureScratch scratch = body.scratch();
  const FractureReport report = body.tear({}, scratch);
  EXPECT_EQ(report.by_criterion, 0);
  EXPECT_EQ(report.margin, widest_margin);
}

TEST(Criterion, EachMaterialHasItsThresholdAndThoseWithoutNeverTear) {
  std::vector<std::int32_t> of_tet(40);
  for (std::size_t t = 0; t < 40; ++t) of_tet[t] = static_cast<std::int32_t>(t / 5 % 3);
  const double never = std::numeric_limits<double>::infinity();
  Body body = make_body(2, {soft(never), soft(500), soft(900)}, of_tet);
  deform(body, stretch(1.3, 0.877058, 0.877058));
  FractureScratch scratch = body.scratch();
  FractureSettings settings;
  settings.avoid_singularities = false;
  body.tear(settings, scratch);
  for (std::size_t t = 0; t < 40; ++t) EXPECT_EQ(body.alive[t], of_tet[t] == 1 ? 0 : 1) << t;
}

// Exact stresses by the SVD, the criterion's reference.
double reference_stress(const Body& body, std::int64_t element, FractureCriterion criterion) {
  const Vec3 s =
      signed_svd(deformation_gradient(body.elements, body.mesh.rest_positions, body.positions, element)).s;
  const double lambda = 6206.8965517241, mu = 689.6551724138, sum = lambda * (s[0] + s[1] + s[2] - 3);
  const double first = 2 * mu * (s[0] - 1) + sum, last = 2 * mu * (s[2] - 1) + sum;
  return criterion == FractureCriterion::tensile ? first : std::fmax(std::fabs(first), std::fabs(last));
}

TEST(StressBound, IsNeverBelowTheStressAlsoInvertedAndTheSameOnEveryInstructionSet) {
  const std::uint64_t seed = 77;
  SCOPED_TRACE(seed);
  Random random(seed);
  Body body = make_body(3, {soft(1000)});
  double tightest = 1e9;
  for (int trial = 0; trial < 200; ++trial) {
    const double noise = 0.012 * std::pow(10.0, -(trial % 5));  // m, from inverted to nearly at rest
    body.positions = flat_positions(body.mesh);
    for (double& x : body.positions) x += uniform(random, -noise, noise);
    for (const FractureCriterion criterion :
         {FractureCriterion::tensile, FractureCriterion::largest_absolute}) {
      std::vector<float> first;
      for (const Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
        if (isa > widest_isa()) continue;
        std::vector<float> bounds((body.alive.size() + 15) / 16 * 16, 0.0F);
        const FractureKernels kernels = fracture_kernels(isa);
        const auto kernel =
            criterion == FractureCriterion::tensile ? kernels.tensile_bounds : kernels.absolute_bounds;
        kernel({body.elements.nodes.data(), body.elements.rest_single.data(),
                static_cast<std::int64_t>(body.positions.size() / 3), body.positions.data(),
                body.data.wanted.data(), bounds.data()},
               0, static_cast<std::int64_t>(body.data.wanted.size()));
        bounds.resize(body.alive.size());
        if (first.empty()) first = bounds;
        EXPECT_EQ(first, bounds);
      }
      for (std::size_t t = 0; t < body.alive.size(); ++t) {
        const double stress = reference_stress(body, static_cast<std::int64_t>(t), criterion);
        ASSERT_GE(first[t], stress - 1e-4 * std::fabs(stress) - 0.01)
            << "trial " << trial << " element " << t;
        if (stress > 10) tightest = std::fmin(tightest, first[t] / stress);
      }
    }
  }
  EXPECT_LT(tightest, 1.05);
}

TEST(Tear, EqualsTheStressOfEveryElementForAnyNumberOfThreads) {
  const std::uint64_t seed = 5;
  SCOPED_TRACE(seed);
  Random random(seed);
  FractureSettings settings;
  settings.avoid_singularities = false;
  int torn = 0;
  for (int trial = 0; trial < 60; ++trial) {
    settings.criterion = trial % 2 ? FractureCriterion::tensile : FractureCriterion::largest_absolute;
    Body body = make_body(3, {soft(1200)});
    for (double& x : body.positions) x += uniform(random, -0.0015, 0.0015);
    Body expected = body;
    double margin = widest_margin;
    for (std::size_t t = 0; t < body.alive.size(); ++t) {
      const double ratio = reference_stress(body, static_cast<std::int64_t>(t), settings.criterion) / 1200;
      expected.alive[t] = ratio > 1 ? 0 : 1;
      margin = std::fmin(margin, std::fabs(ratio - 1));
    }
    for (const int threads : {1, 2, 3}) {
      Body copy = body;
      FractureScratch scratch = copy.scratch(widest_isa(), threads);
      const FractureReport report = copy.tear(settings, scratch);
      EXPECT_EQ(copy.alive, expected.alive);
      EXPECT_NEAR(report.margin, margin, 1e-9);
      torn += report.by_criterion;
      double volume = 0;
      for (std::int32_t e : scratch.removed) volume += e % 5 == 4 ? 1e-6 / 3 : 1e-6 / 6;
      EXPECT_NEAR(report.lost_volume_m3, volume, 1e-15);
    }
  }
  EXPECT_GT(torn, 500);
}

TEST(Hysteresis, TearsAfterThreeStepsInARowAndForgetsAnInterruption) {
  Body body = make_body(1, {soft(500)});
  FractureScratch scratch = body.scratch();
  FractureSettings settings;
  settings.steps_above = 3;
  std::vector<std::uint8_t> counters(body.alive.size(), 0);
  const Mat3 torn = stretch(1.3, 0.877058, 0.877058);
  const auto step = [&](const Mat3& f) {
    deform(body, f);
    return body.tear(settings, scratch, counters).by_criterion;
  };
  EXPECT_EQ(step(torn), 0);
  EXPECT_EQ(step(torn), 0);
  EXPECT_EQ(step(Mat3::Identity()), 0);
  EXPECT_EQ(step(torn), 0);
  EXPECT_EQ(step(torn), 0);
  EXPECT_EQ(step(torn), 5);
}

TEST(Detached, SingleElementsGoOnlyWhereAsked) {
  for (const bool asked : {false, true}) {
    Body body = make_body(1, {soft(500)});
    body.alive = {1, 1, 1, 1, 1};
    // all but one element of the cell above the threshold: move one node of the middle element far away
    FractureScratch scratch = body.scratch();
    FractureSettings settings;
    settings.remove_detached = asked;
    std::vector<std::int32_t> of_tet(5, 1);
    of_tet[0] = 0;
    Body mixed = make_body(1, {soft(1e9), soft(500)}, of_tet);
    deform(mixed, stretch(1.3, 0.877058, 0.877058));
    const FractureReport report = mixed.tear(settings, scratch);
    EXPECT_EQ(report.by_criterion, 4);
    EXPECT_EQ(report.detached, asked ? 1 : 0);
    EXPECT_EQ(mixed.alive[0], asked ? 0 : 1);
  }
}

TEST(Tear, NumbersThatAreNotFiniteTearNothing) {
  Body body = make_body(2, {soft(500)});
  body.positions[7] = std::nan("");
  FractureScratch scratch = body.scratch();
  EXPECT_EQ(body.tear({}, scratch).by_criterion, 0);
}

TEST(Threshold, OfZeroOrNaNIsRefusedAndSoIsAMeshThatCannotTear) {
  for (const double wrong : {0.0, -1.0, std::nan("")}) {
    EXPECT_THROW(make_body(1, {soft(wrong)}), InputError);
  }
  EXPECT_THROW(make_body(1, {soft(std::numeric_limits<double>::infinity())}), InputError);
}

TEST(ClearSingularities, MakesALabelMapMeshManifold) {
  const std::uint64_t seed = 31;
  SCOPED_TRACE(seed);
  Random random(seed);
  int cleared = 0;
  for (int trial = 0; trial < 300; ++trial) {
    StarMesh mesh = star_label_map(random);
    if (trial % 2) {  // and with holes
      for (std::uint8_t& alive : mesh.alive) alive = random_below(random, 4) != 0;
    }
    FractureScratch scratch;
    scratch.star = make_star_scratch(mesh.stars());
    clear_singularities(mesh.stars(), mesh.alive, scratch);
    cleared += !scratch.removed.empty();
    const Singularities left = find_singularities(mesh.stars(), mesh.alive);
    ASSERT_TRUE(left.vertices.empty() && left.edges.empty()) << "trial " << trial;
  }
  EXPECT_GT(cleared, 100);
}

}  // namespace
}  // namespace sulcus
