#include "engine/scene/prescribed_contact.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace sulcus {
namespace {

// First entry of a node's diagonal block in the matrix; the others follow at distances of 16.
std::size_t block_entry(const Scene& scene, std::int32_t node) {
  const auto slot = static_cast<std::size_t>(scene.sparsity.slot_of_node[static_cast<std::size_t>(node)]);
  return slot / 16 * 144 + slot % 16;
}

// Where a contact's place on the tissue has to go in the step, m.
Vec3 way_of(const Contact& contact, const DeviceSample& sample, const RigidBodyState& start) {
  const Mat3 turn =
      rotation_matrix(normalised(sample.orientation)) * rotation_matrix(start.orientation).transpose();
  const Vec3 carried = sample.position + turn * contact.arm - (start.position + contact.arm);
  return contact.gap + carried + touch_m * contact.normal;
}

}  // namespace

void lead_nodes(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                Workspace& workspace) {
  constexpr double least_weight = 0.25;
  const auto tools = static_cast<std::int32_t>(scene.settings.tools.size());
  const std::span<const std::uint8_t> free_node = free_nodes(scene, workspace.view);
  const bool sticks = scene.settings.contact.anisotropy == 1;
  workspace.led.clear();
  for (const Contact& contact : workspace.contacts) {
    if (contact.tool >= tools) continue;
    const auto t = static_cast<std::size_t>(contact.tool);
    const RigidBodyState start = tool_state(state, t);
    const Vec3 way = way_of(contact, samples[t], start);
    const Vec3 place = start.position + contact.arm;  // m, on the tool, at the start
    const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
    for (std::size_t c = 0; c < 4; ++c) {
      const auto node = static_cast<std::size_t>(nodes[c]);
      if (contact.weights[c] < least_weight || !free_node[node]) continue;
      std::int32_t& row = workspace.row_of_node[node];
      if (row < 0) {
        row = static_cast<std::int32_t>(workspace.led.size());
        workspace.led.push_back({.node = nodes[c], .tool = contact.tool});
      }
      LedNode& led = workspace.led[static_cast<std::size_t>(row)];
      if (led.tool != contact.tool) continue;  // the first tool that touches a node leads it
      led.way += contact.weights[c] * way;
      led.normal += contact.weights[c] * contact.normal;
      led.place += contact.weights[c] * place;
      led.weight += contact.weights[c];
    }
  }
  for (LedNode& led : workspace.led) {
    workspace.row_of_node[static_cast<std::size_t>(led.node)] = -1;
    led.way /= led.weight;
    led.place /= led.weight;
    const double length = std::sqrt(led.normal.squaredNorm());
    // contacts that push against each other leave a node no way to slide
    const bool agree = length > 0.7 * led.weight;
    led.normal = length > 0 ? Vec3(led.normal / length) : Vec3(Vec3::UnitZ());
    led.slides = agree && !sticks && scene.keeps.empty();
  }
  std::erase_if(workspace.contacts, [&](const Contact& contact) { return contact.tool < tools; });
}

template <class Real>
void impose_led(const Scene& scene, const State& state, Numbers<Real>& numbers, const Workspace& workspace) {
  numbers.solver.sliding.clear();
  for (const LedNode& led : workspace.led) {
    const std::size_t first = block_entry(scene, led.node);
    Mat3 inverse = Mat3::Zero();
    if (led.slides) {
      Mat3 block;
      for (int i = 0; i < 9; ++i)
        block(i / 3, i % 3) =
            static_cast<double>(numbers.system.diagonal[first + 16 * static_cast<std::size_t>(i)]);
      const Mat3 normal = led.normal * led.normal.transpose(), plane = Mat3::Identity() - normal;
      inverse = plane * (plane * block * plane + normal * block.trace()).inverse() * plane;
      const auto offset = static_cast<std::int64_t>(solver_entry(scene, led.node, 0));
      numbers.solver.sliding.push_back({offset / 48, offset, led.normal});
    }
    for (int i = 0; i < 9; ++i)
      numbers.system.inverse[first + 16 * static_cast<std::size_t>(i)] =
          static_cast<Real>(inverse(i / 3, i % 3));
    Vec3 increment = led.way / scene.settings.step_s - node_vector(state.velocities, led.node);
    if (led.slides) increment = led.normal.dot(increment) * led.normal;
    for (std::size_t d = 0; d < 3; ++d) {
      numbers.solver.prescribed[solver_entry(scene, led.node, d)] =
          static_cast<Real>(increment[static_cast<Eigen::Index>(d)]);
    }
  }
}

template <class Real>
void read_led_forces(const Scene& scene, const Numbers<Real>& numbers, Workspace& workspace) {
  for (LedNode& led : workspace.led) {
    for (std::size_t d = 0; d < 3; ++d) {
      led.force[static_cast<Eigen::Index>(d)] =
          -static_cast<double>(numbers.solver.r[solver_entry(scene, led.node, d)]) / scene.settings.step_s;
    }
    if (led.slides) led.force = led.normal.dot(led.force) * led.normal;
  }
}

bool release_led(const Scene& scene, Workspace& workspace, StepReport& report) {
  if (!scene.settings.contact.tension_rule) return false;
  const auto count = std::erase_if(workspace.led, [&](const LedNode& led) {
    if (!(led.force.dot(led.normal) > 0)) return false;
    ++report.tools[static_cast<std::size_t>(led.tool)].dropped_contacts;
    return true;
  });
  return count > 0;
}

void report_led(const Workspace& workspace, StepReport& report) {
  for (const LedNode& led : workspace.led) {
    ToolReport& tool = report.tools[static_cast<std::size_t>(led.tool)];
    const Vec3 arm = led.place - workspace.tools[static_cast<std::size_t>(led.tool)].start.position;
    tool.tissue_force += led.force;
    tool.contact_torque -= arm.cross(led.force);
    const double push = -led.force.dot(led.normal);
    tool.min_push_N = tool.contacts == 0 ? push : std::fmin(tool.min_push_N, push);
    ++tool.contacts;
  }
}

#define SULCUS_INSTANTIATE(Real)                                                                \
  template void impose_led<Real>(const Scene&, const State&, Numbers<Real>&, const Workspace&); \
  template void read_led_forces<Real>(const Scene&, const Numbers<Real>&, Workspace&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
