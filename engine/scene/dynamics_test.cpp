// Bodies in motion against theory: free fall, spin, the first mode of a bar, decay of its energy, recovery
// from inversion (equations.md 7, cases 7 to 10). E = 2000 Pa where nothing else is said.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <complex>
#include <random>

#include "engine/fem/stress.h"
#include "engine/fem/test_body.h"
#include "engine/scene/step.h"

namespace sulcus {
namespace {

SceneDescription description(int nx, int ny, int nz, double edge_m, Material material,
                             RayleighDamping damping, double step_s) {
  SceneDescription d;
  d.map = box_map(nx, ny, nz, edge_m);
  d.embedding.size_m = edge_m;
  d.material = material;
  d.damping = damping;
  d.step_s = step_s;
  d.solver.precision = Precision::double_precision;
  d.solver.tolerance = 1e-13;
  d.solver.velocity_floor_m_s = 1e-16;
  return d;
}

Scene build(SceneDescription d) {
  EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
  return build_scene(std::move(d), std::move(mesh));
}

Vec3 at(std::span<const double> values, std::size_t node) {
  return {values[3 * node], values[3 * node + 1], values[3 * node + 2]};
}

struct Momenta {
  Vec3 linear = Vec3::Zero(), angular = Vec3::Zero();  // kg m/s; kg m^2/s about the centre of mass
};

Momenta momenta(const Scene& scene, const State& state) {
  Momenta m;
  Vec3 centre = Vec3::Zero();
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n)
    centre += scene.elements.node_mass[n] / scene.total_mass_kg * at(state.positions, n);
  for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
    const Vec3 p = scene.elements.node_mass[n] * at(state.velocities, n);
    m.linear += p;
    m.angular += (at(state.positions, n) - centre).cross(p);
  }
  return m;
}

TEST(FreeFall, FollowsBackwardEulerExactly) {
  SceneDescription d = description(3, 3, 3, 0.02, {2000, .45, 1000}, {0, 0.1}, 0.017);
  d.gravity = {0, 0, -9.81};
  const Scene scene = build(std::move(d));
  State state = initial_state(scene, {});
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  for (int n = 0; n < 60; ++n) step(scene, {}, state, report, *workspace);
  for (std::size_t n = 0; n < scene.mesh.rest_positions.size(); ++n) {
    EXPECT_NEAR(state.velocities[3 * n + 2], -10.0062, 1e-10);
    EXPECT_NEAR(state.positions[3 * n + 2] - scene.mesh.rest_positions[n][2], -5.1882147, 1e-9);
  }
  const double momentum = -10.0062 * scene.total_mass_kg;
  EXPECT_NEAR(momenta(scene, state).linear[2] / momentum, 1, 1e-12);
}

TEST(SpinningBar, KeepsItsMomentumAndLosesTheKnownShareOfItsSpin) {
  for (double beta : {0.0, 0.1}) {
    const Scene scene = build(description(2, 2, 8, 0.01, {2000, .45, 1000}, {0, beta}, 0.017));
    State state = initial_state(scene, {});
    Vec3 centre = Vec3::Zero();
    for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n)
      centre += scene.elements.node_mass[n] / scene.total_mass_kg * scene.mesh.rest_positions[n];
    for (std::size_t n = 0; n < scene.elements.node_mass.size(); ++n) {
      const Vec3 v = Vec3(0, 3, 1).cross(scene.mesh.rest_positions[n] - centre) + Vec3(.3, -.2, .5);
      for (int d = 0; d < 3; ++d) state.velocities[3 * n + static_cast<std::size_t>(d)] = v[d];
    }
    const Momenta start = momenta(scene, state);
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    for (int n = 0; n < 30; ++n) step(scene, {}, state, report, *workspace);  // .51 s
    const Momenta end = momenta(scene, state);
    EXPECT_LT((end.linear - start.linear).norm(), 1e-11 * start.linear.norm());
    const double kept = end.angular.norm() / start.angular.norm();
    EXPECT_LT(kept, 1);  // backward Euler: not exact
    EXPECT_GT(kept, beta > 0 ? .9995 : .9998);
  }
}

// The first axial mode of a bar of .01 x .01 x .1 m, fixed at z = 0, nu = 0, moving along z only.
struct AxialMode {
  Scene scene;
  double omega = 0;       // rad/s
  Eigen::VectorXd shape;  // [nodes] displacement along z
};

AxialMode axial_mode(RayleighDamping damping, double step_s) {
  SceneDescription d = description(1, 1, 20, 0.005, {2000, 0, 1000}, damping, step_s);
  {
    const EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
    for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
      if (mesh.rest_positions[n][2] < 1e-9) d.fixed_nodes.push_back(static_cast<std::int32_t>(n));
    }
  }
  AxialMode mode{build(std::move(d)), 0, {}};
  Body body(mode.scene.mesh, {2000, 0, 1000});
  const Eigen::MatrixXd k = stiffness(body);
  std::vector<int> free;
  for (int n = 0; n < k.rows() / 3; ++n) {
    if (mode.scene.free_node[static_cast<std::size_t>(n)]) free.push_back(n);
  }
  const auto size = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd scaled(size, size);  // M^-1/2 K M^-1/2
  const auto root = [&](int n) {
    return std::sqrt(mode.scene.elements.node_mass[static_cast<std::size_t>(n)]);
  };
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j) {
      const int a = free[static_cast<std::size_t>(i)], b = free[static_cast<std::size_t>(j)];
      scaled(i, j) = k(3 * a + 2, 3 * b + 2) / (root(a) * root(b));
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  mode.omega = std::sqrt(eigen.eigenvalues()[0]);
  mode.shape = Eigen::VectorXd::Zero(k.rows() / 3);
  for (Eigen::Index i = 0; i < size; ++i) {
    const int n = free[static_cast<std::size_t>(i)];
    mode.shape[n] = eigen.eigenvectors()(i, 0) / root(n);
  }
  mode.shape /= mode.shape.cwiseAbs().maxCoeff();
  return mode;
}

TEST(AxialMode, OfAFixedFreeBarHasTheFrequencyOfTheory) {
  EXPECT_NEAR(axial_mode({}, 0.017).omega, 22.21441, 0.02);  // rad/s; lumped masses: a little below
}

// Growth factor z of the mode in a step, the slower root of (1 + h beta w^2 + h^2 w^2) z^2 - (2 + h beta w^2)
// z + 1.
std::complex<double> growth(double h, double beta, double w) {
  const double a = 1 + h * beta * w * w + h * h * w * w, b = 2 + h * beta * w * w;
  const std::complex<double> root = std::sqrt(std::complex<double>(b * b - 4 * a));
  const std::complex<double> one = (b + root) / (2 * a), other = (b - root) / (2 * a);
  return std::abs(one) >= std::abs(other) ? one : other;
}

TEST(AxialMode, StepsByTheRootsOfBackwardEuler) {
  const double theory = 22.21441;  // rad/s
  const struct {
    double step_s, beta_s, size;
  } cases[] = {{.001, 0, .99975},   {.005, 0, .99389},   {.017, 0, .93551},  {.033, 0, .80650},
               {.001, .01, .99730}, {.017, .01, .90295}, {.017, .1, .80848}, {.033, .1, .68500}};
  for (const auto& c : cases) {
    EXPECT_NEAR(std::abs(growth(c.step_s, c.beta_s, theory)), c.size, 1e-5);
    const AxialMode mode = axial_mode({0, c.beta_s}, c.step_s);
    const std::complex<double> z = growth(c.step_s, c.beta_s, mode.omega);
    // start on the discrete solution x_n = Re(z^n) (or z^n): velocity (x_0 - x_-1) / h
    const double amplitude = 1e-6;  // m: small, for the law is linear then
    State state = initial_state(mode.scene, {});
    for (Eigen::Index n = 0; n < mode.shape.size(); ++n) {
      state.positions[static_cast<std::size_t>(3 * n + 2)] += amplitude * mode.shape[n];
      state.velocities[static_cast<std::size_t>(3 * n + 2)] =
          amplitude * mode.shape[n] * (1 - (1.0 / z).real()) / c.step_s;
    }
    WorkspacePtr workspace = make_workspace(mode.scene, 1);
    StepReport report = make_report(mode.scene);
    std::complex<double> expected = 1;
    for (int n = 0; n < 40; ++n) {
      step(mode.scene, {}, state, report, *workspace);
      expected *= z;
      double found = 0, size = 0;
      for (Eigen::Index i = 0; i < mode.shape.size(); ++i) {
        const auto node = static_cast<std::size_t>(i);
        const double mass = mode.scene.elements.node_mass[node];
        found +=
            mass * mode.shape[i] * (state.positions[3 * node + 2] - mode.scene.mesh.rest_positions[node][2]);
        size += mass * mode.shape[i] * mode.shape[i];
      }
      ASSERT_NEAR(found / size / amplitude, expected.real(), 2e-5)
          << "step " << c.step_s << " s, beta " << c.beta_s;
    }
  }
}

TEST(AxialMode, LosesExactlyTheEnergyOfBackwardEulerInEachStep) {
  const double steps_s[] = {.001, .005, .017, .033};
  const double factors[] = {.99951, .98781, .87518, .65045};
  for (int c = 0; c < 4; ++c) {
    EXPECT_NEAR(1 / (1 + std::pow(22.21441 * steps_s[c], 2)), factors[c], 1e-5);
    const AxialMode mode = axial_mode({}, steps_s[c]);
    const double factor = 1 / (1 + std::pow(mode.omega * steps_s[c], 2));
    State state = initial_state(mode.scene, {});
    for (Eigen::Index n = 0; n < mode.shape.size(); ++n)
      state.positions[static_cast<std::size_t>(3 * n + 2)] += 1e-6 * mode.shape[n];
    WorkspacePtr workspace = make_workspace(mode.scene, 1);
    StepReport report = make_report(mode.scene);
    double before = 0;
    for (int n = 0; n < 30; ++n) {
      const double kinetic = report.kinetic_energy_J;  // at the end of the last step
      step(mode.scene, {}, state, report, *workspace);
      const double energy = kinetic + report.elastic_energy_J;
      if (n > 0) {
        ASSERT_NEAR(energy / before, factor, 1e-4) << steps_s[c] << " s, step " << n;
      }
      before = energy;
    }
  }
}

// A scene of one tetrahedron (0,0,0), (10,0,0), (0,10,0), (0,0,10) mm.
Scene one_tetrahedron(double poisson_ratio, double beta_s, bool base_held) {
  SceneDescription d = description(1, 1, 1, 0.01, {2000, poisson_ratio, 1000}, {0, beta_s}, 0.017);
  EmbeddingMesh mesh = build_embedding(d.map, d.pairs, d.embedding);
  mesh.tets.resize(1);
  mesh.tets[0] = {0, 1, 2, 3};
  mesh.rest_positions = {{0, 0, 0}, {.01, 0, 0}, {0, .01, 0}, {0, 0, .01}};
  if (base_held) d.fixed_nodes = {0, 1, 2};
  return build_scene(std::move(d), std::move(mesh));
}

TEST(Inversion, ApexPushedThroughItsHeldBaseComesBack) {
  for (double nu : {.3, .45}) {
    for (double beta : {0.0, 0.1}) {
      const Scene scene = one_tetrahedron(nu, beta, true);
      State state = initial_state(scene, {});
      const double apex[3] = {.003, .002, -.008};
      std::copy(apex, apex + 3, &state.positions[9]);
      WorkspacePtr workspace = make_workspace(scene, 1);
      StepReport report = make_report(scene);
      int steps = 0;
      while (steps < 200 && (at(state.positions, 3) - Vec3(0, 0, .01)).cwiseAbs().maxCoeff() > 1e-6) {
        step(scene, {}, state, report, *workspace);
        ++steps;
      }
      // 9 or 10 steps without damping, 62 with
      EXPECT_GE(steps, beta > 0 ? 60 : 8) << nu;
      EXPECT_LE(steps, beta > 0 ? 64 : 11) << nu;
    }
  }
}

TEST(Inversion, OfAFreeTetrahedronIsOverInFiveSteps) {
  const std::uint64_t seed = 61;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  const Scene scene = one_tetrahedron(.45, .1, false);
  int inverted = 0;
  for (int start = 0; start < 60; ++start) {
    State state = initial_state(scene, {});
    for (double& x : state.positions) {
      x = 0;
      for (int k = 0; k < 12; ++k) x += uniform(random, -.005, .005);  // about normal, sigma 10 mm
    }
    inverted += count_inverted(scene, state) > 0;
    WorkspacePtr workspace = make_workspace(scene, 1);
    StepReport report = make_report(scene);
    for (int n = 1; n <= 400; ++n) {
      step(scene, {}, state, report, *workspace);
      ASSERT_TRUE(report.finite);
      if (n > 5) {
        ASSERT_EQ(count_inverted(scene, state), 0) << "start " << start << ", step " << n;
      }
    }
  }
  EXPECT_GT(inverted, 15);
}

TEST(Inversion, OfAFifthOfACubeIsOverInThreeHundredSteps) {
  const std::uint64_t seed = 62;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  for (double nu : {.3, .45}) {
    const Scene scene = build(description(2, 2, 2, 0.01, {2000, nu, 1000}, {0, .1}, 0.017));
    std::int64_t inverted = 0;
    int tangled = 0;
    for (int start = 0; start < 20; ++start) {
      State state = initial_state(scene, {});
      for (double& x : state.positions) {
        for (int k = 0; k < 12; ++k) x += uniform(random, -.004, .004);  // sigma 8 mm, .8 of a cell
      }
      inverted += count_inverted(scene, state);
      WorkspacePtr workspace = make_workspace(scene, 1);
      StepReport report = make_report(scene);
      for (int n = 0; n < 300; ++n) step(scene, {}, state, report, *workspace);
      tangled += count_inverted(scene, state) > 0;
      if (nu > .4) continue;
      double strain = 0;
      for (std::int64_t t = 0; t < scene.tet_count(); ++t) {
        const Mat3 f = deformation_gradient(scene.elements, scene.mesh.rest_positions, state.positions, t);
        strain = std::fmax(strain, (signed_svd(f).s - Vec3::Ones()).cwiseAbs().maxCoeff());
      }
      EXPECT_LT(strain, .004) << start;
    }
    // recovery from any tangle is not guaranteed: at .45 an implementation of its own kept one start in 120
    EXPECT_LE(tangled, nu > .4 ? 1 : 0) << nu;
    EXPECT_GT(inverted, 200);  // of 800
  }
}

}  // namespace
}  // namespace sulcus
