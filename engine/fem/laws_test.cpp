// Material laws and damping by label.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/fem/test_body.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr double step_s = 0.01;

// Two labels, one above the other.
struct TwoMaterials {
  EmbeddingMesh mesh = box_mesh(3, 3, 6, 0.01);
  std::vector<std::int32_t> numbers;
  std::vector<double> positions, velocities, rotations;
  Sparsity sparsity = build_sparsity(mesh);

  TwoMaterials() {
    std::mt19937_64 random(51);
    for (const auto& tet : mesh.tets) {
      double height = 0;
      for (std::int32_t node : tet) height += 0.25 * mesh.rest_positions[static_cast<std::size_t>(node)][2];
      numbers.push_back(height > 0.03);
      rotations.insert(rotations.end(), {1, 0, 0, 0});
    }
    positions = flat_positions(mesh);
    for (double& x : positions) x += uniform(random, -0.001, 0.001);
    for (std::size_t i = 0; i < positions.size(); ++i) velocities.push_back(uniform(random, -0.1, 0.1));
  }

  struct Result {
    std::vector<double> forces, rotations;
    Eigen::MatrixXd matrix;
  };
  template <class Real = double>
  Result assemble(const std::vector<Material>& materials, const RayleighDamping& damping,
                  Isa isa = widest_isa()) {
    const ElementData elements = build_elements(mesh, materials, numbers, damping);
    auto system = make_system_matrix<Real>(elements, sparsity, isa, 2);
    Result result{std::vector<double>(positions.size()), rotations, {}};
    assemble_elements<Real>(elements, sparsity, {step_s, damping}, mesh.rest_positions, positions, velocities,
                            {}, std::vector<std::uint8_t>(mesh.rest_positions.size(), 1), result.rotations,
                            system);
    result.forces = system.node_forces;
    if constexpr (sizeof(Real) == 8) {
      const auto n = static_cast<Eigen::Index>(positions.size());
      result.matrix = Eigen::MatrixXd::Zero(n, n);
      for_each_entry(sparsity, system, [&](int i, int j, double value) { result.matrix(i, j) += value; });
    }
    return result;
  }
};

TEST(Laws, PlainLinearForceIsTheRestStiffnessTimesTheDisplacement) {
  std::mt19937_64 random(52);
  Material material{2000, 0.3, 1000};
  material.law = Law::linear;
  Body body(box_mesh(2, 3, 2, 0.01), material);
  const Eigen::SparseMatrix<double> k = stiffness(body);
  body.deform(random_rotation(random));
  Eigen::VectorXd u(k.rows());
  for (Eigen::Index i = 0; i < u.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    body.positions[at] += uniform(random, -0.01, 0.01);
    u[i] = body.positions[at] - body.mesh.rest_positions[at / 3][i % 3];
  }
  const Eigen::VectorXd expected = k * u;
  const std::vector<double> force = body.force();
  for (Eigen::Index i = 0; i < u.size(); ++i) {
    EXPECT_NEAR(force[static_cast<std::size_t>(i)], expected[i], 1e-12 * expected.cwiseAbs().maxCoeff());
  }
  EXPECT_LT((stiffness(body) - k).norm(), 1e-12 * k.norm());  // and it stays what it was
}

TEST(Laws, PlainLinearForceIsTheGradientOfTheEnergy) {
  std::mt19937_64 random(53);
  Material material{2000, 0.45, 1000};
  material.law = Law::linear;
  Body body(box_mesh(2, 2, 2, 0.01), material);
  body.deform(random_rotation(random));
  for (double& x : body.positions) x += uniform(random, -0.001, 0.001);
  const std::vector<double> force = body.force();  // leaves the rotations at I
  const auto energy = [&] { return elastic_energy(body.elements, body.positions, body.rotations, {}, 1); };
  double largest = 0;
  for (double f : force) largest = std::fmax(largest, std::fabs(f));
  for (std::size_t i = 0; i < body.positions.size(); i += 7) {
    const double eps = 1e-6, x = body.positions[i];
    body.positions[i] = x + eps;
    const double above = energy();
    body.positions[i] = x - eps;
    const double below = energy();
    body.positions[i] = x;
    EXPECT_NEAR(force[i], (above - below) / (2 * eps), 1e-6 * largest) << i;
  }
}

TEST(Laws, AreChosenForEachElement) {
  TwoMaterials two;
  Material corotated{1000, 0.45, 1000}, linear{1000, 0.45, 1000};
  linear.law = Law::linear;
  const auto mixed = two.assemble({corotated, linear}, {0, 0.1});
  const auto all_corotated = two.assemble({corotated, corotated}, {0, 0.1});
  const auto all_linear = two.assemble({linear, linear}, {0, 0.1});
  bool differ = false;
  for (std::size_t n = 0; n < two.mesh.rest_positions.size(); ++n) {
    const double z = two.mesh.rest_positions[n][2];
    for (std::size_t i = 3 * n; i < 3 * n + 3; ++i) {
      if (z < 0.025) {
        EXPECT_EQ(mixed.forces[i], all_corotated.forces[i]);
      } else if (z > 0.035) {
        EXPECT_EQ(mixed.forces[i], all_linear.forces[i]);
      }
      differ = differ || all_corotated.forces[i] != all_linear.forces[i];
    }
  }
  EXPECT_TRUE(differ);
  for (std::size_t t = 0; t < two.numbers.size(); ++t) {
    if (two.numbers[t]) {
      EXPECT_EQ(mixed.rotations[4 * t], 1.0);
    }
  }
}

TEST(Laws, GiveTheSameBitsOnEveryInstructionSet) {
  TwoMaterials two;
  Material corotated{1000, 0.45, 1000}, linear{2000, 0.3, 1000};
  linear.law = Law::linear;
  linear.damping = RayleighDamping{0.3, 0.02};
  const auto expected = two.assemble<float>({corotated, linear}, {0, 0.1}, Isa::sse2);
  const auto expected_double = two.assemble<double>({corotated, linear}, {0, 0.1}, Isa::sse2);
  for (Isa isa : {Isa::avx2, Isa::avx512}) {
    if (isa > widest_isa()) continue;
    EXPECT_EQ(two.assemble<float>({corotated, linear}, {0, 0.1}, isa).forces, expected.forces);
    const auto found = two.assemble<double>({corotated, linear}, {0, 0.1}, isa);
    EXPECT_EQ(found.forces, expected_double.forces);
    EXPECT_EQ(found.matrix, expected_double.matrix);
  }
}

template <class Real>
void expect_energy_of_assembly(const ElementData& elements, const TwoMaterials& two,
                               std::span<const std::uint8_t> alive, double accuracy) {
  std::vector<double> first;
  for (Isa isa : {Isa::sse2, Isa::avx2, Isa::avx512}) {
    if (isa > widest_isa()) continue;
    for (int threads : {1, 2, 3}) {
      auto system = make_system_matrix<Real>(elements, two.sparsity, isa, threads, true);
      std::vector<double> rotations = two.rotations;
      assemble_elements<Real>(
          elements, two.sparsity, {step_s, {0, 0.1}}, two.mesh.rest_positions, two.positions, two.velocities,
          alive, std::vector<std::uint8_t>(two.mesh.rest_positions.size(), 1), rotations, system);
      const double expected = elastic_energy(elements, two.positions, rotations, alive, 1);
      double sum = 0;
      for (double block : system.energies) sum += block;
      EXPECT_GT(expected, 1e-6);
      EXPECT_NEAR(sum, expected, accuracy * expected);
      if (first.empty()) first = system.energies;
      EXPECT_EQ(system.energies, first) << isa_name(isa) << ' ' << threads;
    }
  }
}

TEST(Laws, EnergyThatTheAssemblySumsIsTheElasticEnergyWithTheSameBitsEverywhere) {
  const TwoMaterials two;
  Material corotated{1000, 0.45, 1000}, linear{2000, 0.3, 1000};
  linear.law = Law::linear;
  linear.damping = RayleighDamping{0.3, 0.02};
  const ElementData elements =
      build_elements(two.mesh, std::vector{corotated, linear}, two.numbers, RayleighDamping{0, 0.1});
  std::vector<std::uint8_t> alive(two.numbers.size(), 1);
  for (std::size_t t = 0; t < alive.size(); t += 7) alive[t] = 0;
  for (const std::span<const std::uint8_t> present :
       {std::span<const std::uint8_t>(), std::span<const std::uint8_t>(alive)}) {
    expect_energy_of_assembly<float>(elements, two, present, 1e-5);
    expect_energy_of_assembly<double>(elements, two, present, 1e-12);
  }
}

TEST(Damping, OfAMaterialReplacesTheScenes) {
  TwoMaterials two;
  const Material plain{1000, 0.45, 1000};
  Material damped = plain;
  damped.damping = RayleighDamping{0.7, 0.02};
  // a material that names what the scene has anyway changes nothing but the last digits
  const auto scene = two.assemble({plain, plain}, {0.7, 0.02});
  const auto own = two.assemble({damped, damped}, {0, 0.3});
  const double size = scene.matrix.cwiseAbs().maxCoeff();
  EXPECT_LT((own.matrix - scene.matrix).cwiseAbs().maxCoeff(), 1e-12 * size);
  double largest = 0;
  for (double f : scene.forces) largest = std::fmax(largest, std::fabs(f));
  for (std::size_t i = 0; i < own.forces.size(); ++i)
    EXPECT_NEAR(own.forces[i], scene.forces[i], 1e-12 * largest);
  // and of two materials each has its own
  const auto mixed = two.assemble({damped, plain}, {0, 0.3});
  const auto other = two.assemble({plain, plain}, {0, 0.3});
  for (std::size_t n = 0; n < two.mesh.rest_positions.size(); ++n) {
    const double z = two.mesh.rest_positions[n][2];
    const auto i = static_cast<Eigen::Index>(3 * n);
    if (z < 0.015) {
      EXPECT_NEAR(mixed.forces[3 * n], scene.forces[3 * n], 1e-12 * largest);
      EXPECT_NEAR(mixed.matrix(i, i), scene.matrix(i, i), 1e-12 * size);
    } else if (z > 0.045) {
      EXPECT_NEAR(mixed.forces[3 * n], other.forces[3 * n], 1e-12 * largest);
      EXPECT_NEAR(mixed.matrix(i, i), other.matrix(i, i), 1e-12 * size);
    }
  }
  EXPECT_LT((mixed.matrix - mixed.matrix.transpose()).cwiseAbs().maxCoeff(), 1e-14 * size);
}

TEST(Damping, CostsNoMemoryWhereNoMaterialAsksForIt) {
  const EmbeddingMesh mesh = box_mesh(2, 2, 2, 0.01);
  const Material material{1000, 0.45, 1000};
  const ElementData elements =
      build_elements(mesh, std::span(&material, 1), std::vector<std::int32_t>(mesh.tets.size(), 0));
  EXPECT_TRUE(elements.linear.empty() && elements.beta_s.empty() && elements.drag_kg_s.empty());
}

TEST(Damping, ThatIsNegativeIsRefused) {
  const EmbeddingMesh mesh = box_mesh(1, 1, 1, 0.01);
  const std::vector<std::int32_t> numbers(mesh.tets.size(), 0);
  for (const RayleighDamping& damping :
       {RayleighDamping{-1, 0}, RayleighDamping{0, -1}, RayleighDamping{NAN, 0}}) {
    Material material{1000, 0.45, 1000};
    material.damping = damping;
    EXPECT_THROW(build_elements(mesh, std::span(&material, 1), numbers), InputError);
  }
}

}  // namespace
}  // namespace sulcus
