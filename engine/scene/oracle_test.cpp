// The 13-state form of the thesis as an oracle: its derivatives against finite differences, and the step of
// the engine against its trajectories (equations.md 4).
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/contact/test_tools.h"
#include "engine/numerics/test_random.h"
#include "engine/scene/test_oracle.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

using oracle::Column;
using oracle::Dense;
using oracle::Mat13;
using oracle::Vec13;
using oracle::Vec4;

Vec3 random_vector(std::mt19937_64& random, double size) {
  return {uniform(random, -size, size), uniform(random, -size, size), uniform(random, -size, size)};
}

// |found - expected| relative to the size of both, of the difference quotient of `function` at `at`.
template <class Function>
double error_of(const Dense& derivative, const Column& at, double eps, Function&& function) {
  Dense quotient(derivative.rows(), derivative.cols());
  for (Eigen::Index c = 0; c < at.size(); ++c) {
    Column ahead = at, behind = at;
    ahead[c] += eps;
    behind[c] -= eps;
    quotient.col(c) = (function(ahead) - function(behind)) / (2 * eps);
  }
  const double size = derivative.norm();
  return size > 0 ? (quotient - derivative).norm() / size : quotient.norm();
}

// Random states, quaternions of any length, misalignments of up to 3 rad, anisotropic inertia.
TEST(ThirteenStates, AllDerivativesAreThoseOfFiniteDifferences) {
  const std::uint64_t seed = 91;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  double worst = 0;
  for (int trial = 0; trial < 60; ++trial) {
    oracle::Model model;
    const Mat3 turn = rotation_matrix(quaternion_from_rotation_vector(random_vector(random, 1.5)));
    model.body.inertia_kg_m2 =
        turn * Vec3(uniform(random, 1, 5), uniform(random, 1, 5), uniform(random, 1, 5)).asDiagonal() * 1e-4 *
        turn.transpose();
    model.body.mass_kg = uniform(random, 0.05, 0.5);
    model.stiffness = uniform(random, 1, 1000);
    model.damping = trial % 3 == 0 ? 0 : uniform(random, 0, 1);
    Column x(18), v(18);
    for (Eigen::Index i = 0; i < 18; ++i) {
      x[i] = uniform(random, -0.05, 0.05);
      v[i] = uniform(random, -0.2, 0.2);
    }
    Vec13 y;
    y.head<3>() = random_vector(random, 0.05);
    const bool aligned = trial % 20 == 7;  // to the bit
    Vec4 q(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
    if (aligned) q = {1, 0, 0, 0};
    y.segment<4>(3) = q.normalized() * uniform(random, 0.5, 2);
    y.segment<3>(7) = random_vector(random, 0.05);
    y.tail<3>() = random_vector(random, 1e-3);
    Vec3 away = random_vector(random, 1);
    away *= uniform(random, trial % 4 == 0 ? 1e-5 : 0.1, trial % 4 == 0 ? 1e-3 : 3.0) / away.norm();
    if (aligned) away.setZero();
    const Quaternion tool = normalised({q[0], q[1], q[2], q[3]});
    model.device.orientation = quaternion_from_rotation_vector(away) * tool;
    model.device.position = random_vector(random, 0.05);
    model.device.linear_velocity = random_vector(random, 0.2);
    model.device.angular_velocity = random_vector(random, 2);
    for (int s = 0; s < 3; ++s) {
      oracle::Spring spring;
      double sum = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        spring.nodes[k] = static_cast<std::int32_t>((s + static_cast<int>(k)) % 6);
        sum += spring.weights[k] = uniform(random, 0, 1);
      }
      for (double& w : spring.weights) w /= sum;
      spring.arm = random_vector(random, 0.06);
      const Vec3 n = random_vector(random, 1).normalized();
      const double a = s == 0 ? 0 : s == 1 ? 1 : uniform(random, 0, 1);
      spring.n = a * Mat3::Identity() + (1 - a) * n * n.transpose();
      model.springs.push_back(spring);
    }
    const auto j = model.jacobians(x, v, y);
    const auto check = [&](const char* name, const Dense& derivative, const Column& at, double eps, auto f) {
      const double error = error_of(derivative, at, eps, f);
      EXPECT_LT(error, 1e-6) << name << ", trial " << trial;
      worst = std::fmax(worst, error);
    };
    check("f by x", j.f_x, x, 1e-5, [&](const Column& c) { return model.tissue_forces(c, v, y); });
    check("f by v", j.f_v, v, 1e-5, [&](const Column& c) { return model.tissue_forces(x, c, y); });
    check("g by x", j.g_x, x, 1e-5, [&](const Column& c) { return Column(model.rate(c, v, y)); });
    check("g by v", j.g_v, v, 1e-5, [&](const Column& c) { return Column(model.rate(x, c, y)); });
    // y in parts, whose sizes differ by orders: position, quaternion, momentum, angular momentum
    const int first[4] = {0, 3, 7, 10}, count[4] = {3, 4, 3, 3};
    const double eps[4] = {1e-5, 1e-5, 1e-5, 1e-7};
    for (int part = 0; part < 4; ++part) {
      const auto with = [&](const Column& c) {
        Vec13 moved = y;
        moved.segment(first[part], count[part]) = c;
        return moved;
      };
      const Column at = y.segment(first[part], count[part]);
      check("f by y", j.f_y.middleCols(first[part], count[part]), at, eps[part],
            [&](const Column& c) { return model.tissue_forces(x, v, with(c)); });
      for (int row = 0; row < 4; ++row) {
        check("g by y", j.g_y.block(first[row], first[part], count[row], count[part]), at, eps[part],
              [&](const Column& c) {
                return Column(model.rate(x, v, with(c)).segment(first[row], count[row]));
              });
      }
    }
  }
  RecordProperty("worst_relative_error", std::to_string(worst));
}

// A ball on a lever of 60 mm, pressed into a block by its handle, moved aside and tilted by half a radian.
SceneDescription lever_on_block(double stiffness, double anisotropy, double step_s) {
  SceneDescription d = block_on_springs({3, 3, 3}, step_s, 500, 1);
  Tool lever;
  lever.surface = sphere_tool(0.02, 3);
  for (Vec3& vertex : lever.surface.vertices) vertex -= Vec3(0, 0, 0.06);
  lever.body.inertia_kg_m2 = Vec3(5e-4, 3e-4, 2e-4).asDiagonal();
  d.tools.push_back(lever);
  d.detection = ContactDetection::surface_nodes;
  d.contact = {
      .stiffness_N_m = stiffness, .damping_N_s_m = 0.1, .anisotropy = anisotropy, .tension_rule = false};
  d.solver.tolerance = 1e-11;
  d.solver.velocity_floor_m_s = 1e-15;
  return d;
}

DeviceSample hand(double time_s) {
  const auto ramp = [&](double from_s, double to_s) {
    return std::fmin(std::fmax((time_s - from_s) / (to_s - from_s), 0.0), 1.0);
  };
  DeviceSample sample;
  sample.position = {0.03 + 0.01 * ramp(0.6, 1.2), 0.03, 0.142 - 0.022 * ramp(0, 0.5)};
  sample.orientation = quaternion_from_rotation_vector(Vec3(0, 0.5 * ramp(0.6, 1.2), 0));
  sample.linear_velocity_valid = sample.angular_velocity_valid = true;
  return sample;
}

// Advances (x, v, y) by one step of the 13-state form, with the contacts that the engine's detection finds.
// Returns the force of the tissue on the tool at the end of the step.
Vec3 oracle_step(const Scene& scene, const DeviceSample& device, Column& x, Column& v, Vec13& y) {
  const double h = scene.settings.step_s;
  oracle::Model model;
  model.body = scene.settings.tools[0].body;
  model.coupling = scene.settings.tools[0].coupling;
  model.stiffness = scene.settings.contact.stiffness_N_m;
  model.damping = scene.settings.contact.damping_N_s_m;
  model.device = device;
  RigidBodyState pose;
  pose.position = y.head<3>();
  pose.orientation = {y[3], y[4], y[5], y[6]};
  std::vector<std::uint8_t> boundary(scene.mesh.rest_positions.size());
  for (std::size_t n = 0; n < boundary.size(); ++n)
    boundary[n] = on_boundary(scene.boundary_mesh(), {}, static_cast<std::int32_t>(n));
  std::vector<Contact> contacts;
  find_node_contacts(scene.boundary_mesh(), {}, boundary,
                     std::span<const double>(x.data(), boundary.size() * 3), scene.tool_distances[0], pose, 0,
                     contacts);
  for (const Contact& contact : contacts) {
    const double a = scene.settings.contact.anisotropy;
    model.springs.push_back({scene.mesh.tets[static_cast<std::size_t>(contact.tet)], contact.weights,
                             rotation_matrix(pose.orientation).transpose() * contact.arm,
                             a * Mat3::Identity() + (1 - a) * contact.normal * contact.normal.transpose()});
  }
  Dense k;
  Column f0;
  oracle::stiffness(scene, x, k, f0);
  const auto j = model.jacobians(x, v, y);
  const auto n = x.size();
  const double beta = scene.settings.damping.beta_s;
  Column f = -(k * x - f0) - beta * (k * v) + model.tissue_forces(x, v, y);
  Dense f_x = -k + j.f_x, f_v = -beta * k + j.f_v;
  for (const NodeSpring& spring : scene.settings.springs) {
    for (Eigen::Index d = 3 * spring.node; d < 3 * spring.node + 3; ++d) {
      const double rest = scene.mesh.rest_positions[static_cast<std::size_t>(spring.node)][d % 3];
      f[d] -= spring.stiffness_N_m * (x[d] - rest) + spring.damping_N_s_m * v[d];
      f_x(d, d) -= spring.stiffness_N_m;
      f_v(d, d) -= spring.damping_N_s_m;
    }
  }
  const Vec13 g = model.rate(x, v, y);
  Dense a(n + 13, n + 13);
  a.topLeftCorner(n, n) = -h * f_v - h * h * f_x;
  for (Eigen::Index i = 0; i < n; ++i) a(i, i) += scene.elements.node_mass[static_cast<std::size_t>(i / 3)];
  a.topRightCorner(n, 13) = -h * j.f_y;
  a.bottomLeftCorner(13, n) = -h * j.g_v - h * h * j.g_x;
  a.bottomRightCorner(13, 13) = Mat13::Identity() - h * j.g_y;
  Column b(n + 13);
  b.head(n) = h * (f + h * (f_x * v));
  b.tail(13) = h * (g + h * (j.g_x * v));
  const Column solution = a.partialPivLu().solve(b);
  v += solution.head(n);
  x += h * v;
  const Vec13 before = y;
  y += solution.tail<13>();
  y.segment<4>(3).normalize();
  const Vec3 velocity = y.segment<3>(7) / model.body.mass_kg;
  const Vec3 coupling = model.coupling.stiffness_N_m * (device.position - y.head<3>()) +
                        model.coupling.damping_N_s_m * (device.linear_velocity - velocity);
  return (y.segment<3>(7) - before.segment<3>(7)) / h - coupling;
}

// The largest differences of a run of 1.4 s between the engine's step and the 13-state form, both from rest.
struct Difference {
  double turn_rad = 0, way_m = 0, force_N = 0;  // effective values: of the tool, and of the contact force
  double largest_force_N = 0;
};

Difference compare(const SceneDescription& description) {
  const Scene scene = build(description);
  const double h = scene.settings.step_s;
  DeviceSample sample = hand(0);
  State state = initial_state(scene, std::span(&sample, 1));
  WorkspacePtr workspace = make_workspace(scene, 1);
  StepReport report = make_report(scene);
  Column x =
      Eigen::Map<const Column>(state.positions.data(), static_cast<Eigen::Index>(state.positions.size()));
  Column v = Column::Zero(x.size());
  Vec13 y = Vec13::Zero();
  y.head<3>() = sample.position;
  y[3] = 1;
  const int steps = static_cast<int>(1.4 / h);
  Difference sum;
  for (int n = 1; n <= steps; ++n) {
    sample = hand(n * h);
    step(scene, std::span(&sample, 1), state, report, *workspace);
    const Vec3 force = oracle_step(scene, sample, x, v, y);
    const RigidBodyState tool = tool_state(state, 0);
    sum.turn_rad +=
        rotation_vector(tool.orientation * conjugate(Quaternion{y[3], y[4], y[5], y[6]})).squaredNorm();
    sum.way_m += (tool.position - y.head<3>()).squaredNorm();
    sum.force_N += (report.tools[0].contact_force - force).squaredNorm();
    sum.largest_force_N = std::fmax(sum.largest_force_N, force.norm());
  }
  for (double* square : {&sum.turn_rad, &sum.way_m, &sum.force_N}) *square = std::sqrt(*square / steps);
  return sum;
}

// What equations.md 4 found for the form with the signed lever term: up to 0.16 mrad, 6e-4 N and 9 um.
TEST(ThirteenStates, StepFollowsTheirTrajectory) {
  const struct {
    double stiffness, anisotropy, step_s;
  } cases[] = {{50, 0, .017}, {50, 1, .017}, {1000, 0, .017}, {1000, 1, .033}, {1000, 0, .033}};
  for (const auto& c : cases) {
    SCOPED_TRACE(testing::Message() << c.stiffness << " N/m, a " << c.anisotropy << ", " << c.step_s << " s");
    const Difference d = compare(lever_on_block(c.stiffness, c.anisotropy, c.step_s));
    EXPECT_GT(d.largest_force_N, 0.5);
    EXPECT_LT(d.turn_rad, 0.16e-3);
    EXPECT_LT(d.force_N, 6e-4);
    EXPECT_LT(d.way_m, 9e-6);
  }
}

// Both forms are of first order, and so is what the symmetric one leaves out of the contact's torque.
TEST(ThirteenStates, TheDifferenceToThemShrinksAsTheStepDoes) {
  Difference before = compare(lever_on_block(50, 0, 0.02));
  for (const double step_s : {0.01, 0.005}) {
    SCOPED_TRACE(step_s);
    const Difference d = compare(lever_on_block(50, 0, step_s));
    EXPECT_LT(d.turn_rad, before.turn_rad / 1.9);
    EXPECT_LT(d.force_N, before.force_N / 1.9);
    EXPECT_LT(d.way_m, before.way_m / 1.9);
    before = d;
  }
}

// Without contact what is left is how a step turns the quaternion, exactly or in a line: of second order.
TEST(ThirteenStates, AFreeToolDiffersBySecondOrder) {
  const auto free_tool = [](double step_s) {
    SceneDescription d = lever_on_block(0, 0, step_s);
    d.contact.damping_N_s_m = 0;
    return compare(d);
  };
  Difference before = free_tool(0.01);
  EXPECT_GT(before.turn_rad, 1e-8);
  for (const double step_s : {0.005, 0.0025}) {
    SCOPED_TRACE(step_s);
    const Difference d = free_tool(step_s);
    EXPECT_LT(d.turn_rad, before.turn_rad / 3.4);
    EXPECT_LT(d.way_m, 1e-12);
    before = d;
  }
}

}  // namespace
}  // namespace sulcus
