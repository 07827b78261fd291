// Bodies at rest against theory: patch, bar, beam, torsion, rigid motion, Hertz (equations.md 7, cases 1 to
// 6). E = 2000 Pa, nu = 0.45 where nothing else is said.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "engine/fem/test_body.h"

namespace sulcus {
namespace {

constexpr double pi = 3.14159265358979323846;
constexpr double youngs_modulus = 2000;                         // Pa
constexpr double lambda = 6206.896551724, mu = 689.6551724138;  // Pa, of E = 2000, nu = .45

Material linear_material(double poisson_ratio = 0.45) {
  Material material{youngs_modulus, poisson_ratio, 1000};
  material.law = Law::linear;
  return material;
}

// Numbers of the nodes that lie in the plane axis = value.
std::vector<int> nodes_at(const EmbeddingMesh& mesh, int axis, double value) {
  std::vector<int> nodes;
  for (std::size_t n = 0; n < mesh.rest_positions.size(); ++n) {
    if (std::fabs(mesh.rest_positions[n][axis] - value) < 1e-9) nodes.push_back(static_cast<int>(n));
  }
  return nodes;
}

const Vec3& rest_of(const Body& body, int node) {
  return body.mesh.rest_positions[static_cast<std::size_t>(node)];
}

bool inside_box(const Vec3& x, double edge) {
  return x.minCoeff() > 1e-9 && x.maxCoeff() < edge - 1e-9;
}

// A cube of .1 m whose inner nodes do not stand in rows.
EmbeddingMesh irregular_cube(std::mt19937_64& random) {
  EmbeddingMesh mesh = box_mesh(4, 4, 4, 0.025);
  for (Vec3& x : mesh.rest_positions) {
    const double a = uniform(random, -0.006, 0.006), b = uniform(random, -0.006, 0.006),
                 c = uniform(random, -0.006, 0.006);
    if (inside_box(x, 0.1)) x += Vec3(a, b, c);
  }
  return mesh;
}

TEST(PatchTest, LinearInteriorFollowsItsBoundaryExactly) {
  const std::uint64_t seed = 41;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(irregular_cube(random), linear_material());
  Mat3 a;
  a << .02, .01, -.005, .003, -.01, .007, 0, .004, .015;
  std::map<int, double> boundary;
  for (int n = 0; n < static_cast<int>(body.mesh.rest_positions.size()); ++n) {
    if (inside_box(rest_of(body, n), 0.1)) continue;
    const Vec3 u = a * rest_of(body, n);
    for (int d = 0; d < 3; ++d) boundary[3 * n + d] = u[d];
  }
  ASSERT_LT(boundary.size(), body.positions.size());
  const Solution s =
      solve(body, boundary, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size())));
  for (int n = 0; n < static_cast<int>(body.mesh.rest_positions.size()); ++n) {
    EXPECT_LT((s.u.segment<3>(3 * n) - a * rest_of(body, n)).norm(), 1e-13);  // m
  }
}

TEST(PatchTest, CorotatedInteriorOfAHomogeneousDeformationFeelsNoForce) {
  const std::uint64_t seed = 42;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(irregular_cube(random));
  Mat3 f;
  f << 1.1, .03, -.01, .03, .95, .04, -.01, .04, 1.07;
  body.deform(rotation_matrix(quaternion_from_rotation_vector({0.3, 0.7, -0.9})) * f);
  const std::vector<double> force = body.force();
  double boundary = 0;
  for (std::size_t i = 0; i < force.size(); ++i) {
    const bool inner = inside_box(body.mesh.rest_positions[i / 3], 0.1);
    if (inner) {
      EXPECT_LT(std::fabs(force[i]), 1e-12);  // N
    } else {
      boundary = std::fmax(boundary, std::fabs(force[i]));
    }
  }
  EXPECT_GT(boundary, 0.01);
}

// Corotated stress, mean over the volume, from the virial of the nodal forces: sum of f (x) X = V P.
Mat3 mean_stress(Body& body, double volume) {
  const std::vector<double> force = body.force();
  Mat3 p = Mat3::Zero();
  for (std::size_t n = 0; n < force.size() / 3; ++n) {
    p += Vec3(force[3 * n], force[3 * n + 1], force[3 * n + 2]) * body.mesh.rest_positions[n].transpose();
  }
  return p / volume;
}

TEST(PatchTest, StressOfAPureStretchAndOfAPureShearAreThoseOfTheory) {
  Body body(box_mesh(3, 3, 3, 0.02));
  body.deform(Vec3(1.1, 1, 1).asDiagonal());
  const Mat3 stretched = mean_stress(body, 0.06 * 0.06 * 0.06);
  EXPECT_LT((stretched - Mat3(Vec3(758.6207, 620.6897, 620.6897).asDiagonal())).cwiseAbs().maxCoeff(), 5e-5);
  Mat3 shear = Mat3::Identity();
  shear(0, 1) = shear(1, 0) = 0.05;
  body.deform(shear);
  Mat3 expected = Mat3::Zero();
  expected(0, 1) = expected(1, 0) = 68.9655;
  EXPECT_LT((mean_stress(body, 0.06 * 0.06 * 0.06) - expected).cwiseAbs().maxCoeff(), 5e-5);
}

TEST(Bar, StretchedByATenthCarriesExactlyEATimesTheStrain) {
  // .02 x .02 x .1 m, ends held lengthwise, sides free; linear in the nominal stress, so one solve finds it
  Body body(box_mesh(2, 2, 10, 0.01), linear_material());
  std::map<int, double> ends;
  for (int n : nodes_at(body.mesh, 2, 0)) ends[3 * n + 2] = 0;
  const std::vector<int> top = nodes_at(body.mesh, 2, 0.1);
  for (int n : top) ends[3 * n + 2] = 0.01;
  ends[0] = ends[1] = ends[3 * 2 + 1] = 0;  // corners of the bottom: no drift, no turn
  const Solution s =
      solve(body, ends, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size())));
  double force = 0;
  for (int n : top) force += s.force[3 * n + 2];
  EXPECT_NEAR(force, 0.08, 1e-10);  // N
  for (int n = 0; n < s.u.size() / 3; ++n) {
    EXPECT_NEAR(s.u[3 * n], -0.045 * (rest_of(body, n)[0] - rest_of(body, 0)[0]), 1e-11);
  }
  // and the corotated law has no force anywhere but at the ends in that shape
  Body turned(box_mesh(2, 2, 10, 0.01));
  for (int i = 0; i < s.u.size(); ++i) turned.positions[static_cast<std::size_t>(i)] += s.u[i];
  const std::vector<double> forces = turned.force();
  double end = 0;
  for (std::size_t n = 0; n < forces.size() / 3; ++n) {
    const double z = turned.mesh.rest_positions[n][2];
    if (z > 0.0999) end += forces[3 * n + 2];
    if (z < 1e-9 || z > 0.0999) continue;
    for (std::size_t d = 0; d < 3; ++d) EXPECT_LT(std::fabs(forces[3 * n + d]), 1e-11);
  }
  EXPECT_NEAR(end, 0.08, 1e-10);
}

double tip_over_timoshenko(int across, TetSplit split, double nu) {
  const double length = 0.1, height = 0.02, load = 1e-4;  // m, m, N
  Body body(box_mesh(across, across, 5 * across, height / across, split), linear_material(nu));
  std::map<int, double> clamped;
  for (int n : nodes_at(body.mesh, 2, 0)) {
    for (int d = 0; d < 3; ++d) clamped[3 * n + d] = 0;
  }
  const std::vector<int> tip = nodes_at(body.mesh, 2, length);
  std::map<int, double> weights;
  double sum = 0, mean = 0;
  for (int n : tip) {
    double weight = 1;
    for (int axis = 0; axis < 2; ++axis) {
      const double x = rest_of(body, n)[axis];
      if (x < 1e-9 || x > height - 1e-9) weight *= 0.5;
    }
    weights[n] = weight;
    sum += weight;
  }
  Eigen::VectorXd f = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size()));
  for (int n : tip) f[3 * n] = load * weights[n] / sum;
  const Solution s = solve(body, clamped, f);
  for (int n : tip) mean += s.u[3 * n] / static_cast<double>(tip.size());
  const double inertia = height * height * height * height / 12, shear = youngs_modulus / (2 * (1 + nu));
  const double kappa = 10 * (1 + nu) / (12 + 11 * nu);
  const double theory = load * length * length * length / (3 * youngs_modulus * inertia) +
                        load * length / (kappa * shear * height * height);
  return mean / theory;
}

TEST(Cantilever, TipApproachesTimoshenkoFromBelowByTheKnownSeries) {
  const struct {
    TetSplit split;
    double nu;
    double series[4];  // 1, 2, 4, 8 cells across
  } cases[] = {{TetSplit::five, .3, {.3518, .6643, .8762, .9554}},
               {TetSplit::six, .3, {.2332, .5070, .7824, .9229}},
               {TetSplit::five, .45, {.3081, .5998, .8282, .9239}},
               {TetSplit::six, .45, {.1294, .3062, .5885, .8187}}};
  for (const auto& c : cases) {
    double before = 0;
    for (int k = 0; k < 4; ++k) {
      const double ratio = tip_over_timoshenko(1 << k, c.split, c.nu);
      EXPECT_NEAR(ratio, c.series[k], 1e-3) << (1 << k) << " across, nu " << c.nu;
      EXPECT_GT(ratio, before);
      EXPECT_LT(ratio, 1);
      before = ratio;
    }
  }
}

TEST(Torsion, OfASquareBarApproachesSaintVenantFromAboveByTheKnownSeries) {
  const double a = 0.02, length = 0.1, angle = 0.05;  // m, m, rad; warping free
  const double theory = 0.140577 * a * a * a * a * mu * angle / length;
  EXPECT_NEAR(theory, 7.755972e-6, 1e-12);  // N m
  const double series[] = {4.742, 2.075, 1.327, 1.093};
  for (int k = 0; k < 4; ++k) {
    const int across = 1 << k;
    Body body(box_mesh(across, across, 5 * across, a / across), linear_material());
    std::map<int, double> ends;
    for (int n : nodes_at(body.mesh, 2, 0)) ends[3 * n] = ends[3 * n + 1] = 0;
    const std::vector<int> top = nodes_at(body.mesh, 2, length);
    for (int n : top) {
      ends[3 * n] = -angle * (rest_of(body, n)[1] - a / 2);
      ends[3 * n + 1] = angle * (rest_of(body, n)[0] - a / 2);
    }
    ends[2] = 0;
    const Solution s =
        solve(body, ends, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size())));
    double torque = 0;
    for (int n : top) {
      torque +=
          (rest_of(body, n)[0] - a / 2) * s.force[3 * n + 1] - (rest_of(body, n)[1] - a / 2) * s.force[3 * n];
    }
    EXPECT_NEAR(torque / theory, series[k], 1e-3) << across;
  }
}

double largest(const std::vector<double>& values) {
  double most = 0;
  for (double v : values) most = std::fmax(most, std::fabs(v));
  return most;
}

TEST(RigidRotation, GivesNoForceInTheCorotatedLawAndAFalseOneInThePlainLinearLaw) {
  const double angles[] = {0.1, 1.0, pi};
  const double linear_force[] = {.057, 5.3, 23};  // N, cube of .1 m, 4 cells an edge, about (1, 1, 0)
  for (int k = 0; k < 3; ++k) {
    const Mat3 turn =
        rotation_matrix(quaternion_from_rotation_vector(Vec3(1, 1, 0) / std::sqrt(2.0) * angles[k]));
    for (Law law : {Law::corotated, Law::linear}) {
      Material material{youngs_modulus, .45, 1000};
      material.law = law;
      Body body(box_mesh(4, 4, 4, 0.025), material);
      body.deform(turn);
      for (std::size_t i = 0; i < body.positions.size(); ++i)
        body.positions[i] += 1 + static_cast<double>(i % 3);
      if (law == Law::corotated) {
        EXPECT_LT(largest(body.force()), 1e-12) << angles[k];
      } else {
        EXPECT_NEAR(largest(body.force()), linear_force[k], 0.02 * linear_force[k]) << angles[k];
      }
    }
  }
}

TEST(RigidRotation, SpinningAnUndeformedTurnedBodyMeetsNoStiffnessDamping) {
  Body body(box_mesh(4, 4, 4, 0.025));
  body.deform(rotation_matrix(quaternion_from_rotation_vector({0.4, -1.1, 0.6})));
  const Eigen::SparseMatrix<double> k = stiffness(body);
  const Vec3 omega(0.3, -0.5, 0.8);
  Eigen::VectorXd v(k.rows());
  for (Eigen::Index n = 0; n < k.rows() / 3; ++n) {
    const auto at = static_cast<std::size_t>(3 * n);
    v.segment<3>(3 * n) =
        omega.cross(Vec3(body.positions[at], body.positions[at + 1], body.positions[at + 2]));
  }
  EXPECT_LT((0.1 * (k * v)).cwiseAbs().maxCoeff(), 1e-13);  // N; 0.1 s times K v
}

TEST(Hertz, BallPressedIntoACubeMeetsTheForceOfTheory) {
  const double radius = .03, depth = .005, edge = .1;  // m
  const double reduced = youngs_modulus / (1 - .45 * .45);
  EXPECT_NEAR(reduced, 2507.837, 1e-3);  // Pa
  const double theory = 4.0 / 3 * reduced * std::sqrt(radius) * std::pow(depth, 1.5);
  EXPECT_NEAR(theory, .20476, 1e-5);  // N
  Body body(box_mesh(10, 10, 10, 0.01), linear_material());
  std::map<int, double> base;
  for (int n : nodes_at(body.mesh, 2, 0)) {
    for (int d = 0; d < 3; ++d) base[3 * n + d] = 0;
  }
  const auto surface = [&](int n) {  // z of the ball over the node, relative to the top at rest
    const double x = rest_of(body, n)[0] - edge / 2, y = rest_of(body, n)[1] - edge / 2;
    const double inside = radius * radius - x * x - y * y;
    return inside > 0 ? radius - depth - std::sqrt(inside) : 1.0;
  };
  std::vector<int> touching;  // frictionless active set
  const std::vector<int> top = nodes_at(body.mesh, 2, edge);
  for (int n : top) {
    if (surface(n) < 0) touching.push_back(n);
  }
  double force = 0;
  bool settled = false;
  for (int round = 0; round < 8 && !settled; ++round) {
    std::map<int, double> prescribed = base;
    for (int n : touching) prescribed[3 * n + 2] = surface(n);
    const Solution s =
        solve(body, prescribed, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size())));
    std::vector<int> next;
    force = 0;
    for (int n : top) {
      const bool was = std::find(touching.begin(), touching.end(), n) != touching.end();
      if (was ? s.force[3 * n + 2] <= 0 : surface(n) < s.u[3 * n + 2] - 1e-9) next.push_back(n);
      if (was) force -= s.force[3 * n + 2];
    }
    settled = next == touching;
    touching = next;
  }
  EXPECT_TRUE(settled);
  EXPECT_EQ(touching.size(), 5u);
  EXPECT_NEAR(force, .2162, 1e-3);      // N, what this mesh gives
  EXPECT_NEAR(force / theory, 1, 0.1);  // and that is Hertz within a tenth
}

TEST(PrincipalStress, FollowsTheSignedStretchesOfAnyGradient) {
  const std::uint64_t seed = 43;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Body body(box_mesh(1, 1, 1, 0.01));
  for (int trial = 0; trial < 200; ++trial) {
    const double a = uniform(random, .5, 1.5), b = uniform(random, .5, 1.5), c = uniform(random, -1, 1.5);
    const Vec3 s(a, b, c);
    const Mat3 u = random_rotation(random), v = random_rotation(random);
    body.deform(u * s.asDiagonal() * v.transpose());
    // the inverted axis is the one of the smallest stretch, whatever axis the sign was given to
    Vec3 sizes = s.cwiseAbs();
    std::sort(sizes.data(), sizes.data() + 3);
    if (c < 0) sizes[0] = -sizes[0];
    const double expected = 2 * mu * (sizes[2] - 1) + lambda * (sizes.sum() - 3);
    for (double stress :
         largest_principal_stress(body.elements, body.mesh.rest_positions, body.positions, {})) {
      EXPECT_NEAR(stress, expected, 1e-7 * (std::fabs(expected) + 1000));
    }
  }
  const auto values = [&](const Vec3& s) {
    Vec3 result;
    for (int i = 0; i < 3; ++i) result[i] = 2 * mu * (s[i] - 1) + lambda * (s.sum() - 3);
    return result;
  };
  EXPECT_LT((values({1.3, .877058, .877058}) - Vec3(749.686, 166.318, 166.318)).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_LT((values({.8, 1, 1}) - Vec3(-1517.24, -1241.38, -1241.38)).cwiseAbs().maxCoeff(), 5e-3);
  body.deform(Vec3(.8, 1, 1).asDiagonal());  // compression pulls nowhere
  for (double stress :
       largest_principal_stress(body.elements, body.mesh.rest_positions, body.positions, {})) {
    EXPECT_NEAR(stress, -1241.38, 5e-3);
  }
}

}  // namespace
}  // namespace sulcus
