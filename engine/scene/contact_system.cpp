#include "engine/scene/contact_system.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace sulcus {
namespace {

constexpr std::int64_t enough_for_threads = 16;  // contacts: fewer cost less than a team's start

Mat3 skew(const Vec3& u) {
  Mat3 m;
  m << 0, -u[2], u[1], u[2], 0, -u[0], -u[1], u[0], 0;
  return m;
}

// Velocity of the body's place minus that of the tissue's.
Vec3 gap_velocity(const Contact& contact, const EmbeddingMesh& mesh, std::span<const double> velocities,
                  const Vec6& body) {
  Vec3 rate = body.head<3>() + body.tail<3>().cross(contact.arm);
  const auto& nodes = mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c) rate -= contact.weights[c] * node_vector(velocities, nodes[c]);
  return rate;
}

// Velocity at the start of the step of the body that a contact is with: obstacles stand.
Vec6 body_velocity(const Contact& contact, const Workspace& workspace) {
  const auto tool = static_cast<std::size_t>(contact.tool);
  return tool < workspace.tools.size() ? workspace.tools[tool].velocity : Vec6(Vec6::Zero());
}

Vec3 along(const Vec3& normal, const Vec3& v) {
  return v - normal.dot(v) * normal;
}

// Friction of a fast slip: mu times the normal force of the spring at the start of the step, N.
double full_friction(const ContactLaw& law, const Contact& contact) {
  return law.friction * std::fmax(-law.stiffness_N_m * contact.gap.dot(contact.normal), 0.0);
}

// Calls visit(number, its saved copy) for all that the tissue's part holds at a contact's nodes and edges.
template <class Real, class Visit>
void for_each_saved(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace, std::size_t contact,
                    Visit&& visit) {
  const auto visit_all = [&](auto* now, auto* saved, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) visit(now[i], saved[i]);
  };
  const auto tet = static_cast<std::size_t>(numbers.saved_tets[contact]);
  for (std::size_t k = 0; k < 12; ++k) {
    const auto block = 2 * static_cast<std::size_t>(scene.sparsity.tet_edges[6 * tet + k / 2]) + k % 2;
    const auto place = static_cast<std::size_t>(scene.sparsity.place_of_block[block]);
    Real* now = &numbers.system.values[place / 16 * 144 + place % 16];
    for (std::size_t i = 0; i < 9; ++i) visit(now[16 * i], numbers.saved_blocks[9 * (12 * contact + k) + i]);
  }
  for (std::size_t c = 0; c < 4; ++c) {
    const auto node = static_cast<std::size_t>(scene.mesh.tets[tet][c]);
    visit_all(&numbers.system.node_terms[16 * node], &numbers.saved_terms[9 * (4 * contact + c)], 9);
    visit_all(&workspace.forces[3 * node], &numbers.saved_forces[3 * (4 * contact + c)], 3);
  }
}

// Lists the nodes that touch a tool as rows of its border, and gives each its number in row_of_node.
template <class Real>
void make_rows(const Scene& scene, std::size_t t, std::vector<typename ToolBorder<Real>::Row>& rows,
               Workspace& workspace) {
  workspace.touched.clear();
  rows.clear();
  for (const Contact& contact : workspace.contacts) {
    if (contact.tool != static_cast<std::int32_t>(t)) continue;
    for (std::size_t c = 0; c < 4; ++c) {
      const std::int32_t node = scene.mesh.tets[static_cast<std::size_t>(contact.tet)][c];
      std::int32_t& row = workspace.row_of_node[static_cast<std::size_t>(node)];
      if (row < 0 && contact.weights[c] != 0) {
        row = 0;
        workspace.touched.push_back(node);
      }
    }
  }
  const auto slot = [&](std::int32_t node) {
    return scene.sparsity.slot_of_node[static_cast<std::size_t>(node)];
  };
  std::sort(workspace.touched.begin(), workspace.touched.end(),
            [&](std::int32_t a, std::int32_t b) { return slot(a) < slot(b); });
  for (std::size_t r = 0; r < workspace.touched.size(); ++r) {
    const std::int32_t node = workspace.touched[r];
    workspace.row_of_node[static_cast<std::size_t>(node)] = static_cast<std::int32_t>(r);
    typename ToolBorder<Real>::Row row;
    row.chunk = slot(node) / 16;
    row.offset = row.chunk * 48 + slot(node) % 16;
    rows.push_back(row);
  }
}

// Adds a contact to matrix and right-hand side of the tissue, and to those of the tool and its border (none
// of an obstacle).
template <class Real>
void add_contact(const Scene& scene, const State& state, const Contact& contact, Numbers<Real>& numbers,
                 Workspace& workspace, ToolSystem* tool, ToolBorder<Real>* border) {
  static constexpr int corner_pairs[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
  const double h = scene.settings.step_s;
  const ContactLaw& law = law_of(scene, contact.tool);
  const ContactResponse response = respond(scene, contact);
  const double weight = response.weight_kg;
  const Vec3 rate = gap_velocity(contact, scene.mesh, state.velocities, body_velocity(contact, workspace));
  Vec3 push = response.direction * (h * law.stiffness_N_m * contact.gap +
                                    (law.explicit_forces ? h * law.damping_N_s_m : weight) * rate);
  if (response.slides) push += h * (response.friction + response.friction_rate * rate);

  // what the velocity of the body does at its place, whose Jacobian is (I, -skew(arm))
  const Mat3 block = weight * response.matrix, arm = skew(contact.arm), turned = -(block * arm);
  if (tool != nullptr) {
    tool->matrix.topLeftCorner<3, 3>() += block;
    tool->matrix.topRightCorner<3, 3>() += turned;
    tool->matrix.bottomLeftCorner<3, 3>() += turned.transpose();
    tool->matrix.bottomRightCorner<3, 3>() += arm * turned;
    tool->right_hand_side.head<3>() -= push;
    tool->right_hand_side.tail<3>() -= contact.arm.cross(push);
  }
  const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c) {
    if (contact.weights[c] == 0) continue;
    const auto node = static_cast<std::size_t>(nodes[c]);
    for (std::size_t d = 0; d < 3; ++d) {
      workspace.forces[3 * node + d] += contact.weights[c] * push[static_cast<Eigen::Index>(d)];
    }
    if (weight == 0) continue;
    Real* terms = &numbers.system.node_terms[16 * node];
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) terms[3 * i + j] += static_cast<Real>(contact.weights[c] * block(i, j));
    }
    if (border == nullptr) continue;
    auto& b = border->rows[static_cast<std::size_t>(workspace.row_of_node[node])].b;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        Real* entry = &b[static_cast<std::size_t>(6 * i + j)];
        entry[0] -= static_cast<Real>(contact.weights[c] * block(i, j));
        entry[3] -= static_cast<Real>(contact.weights[c] * turned(i, j));
      }
    }
  }
  for (std::size_t k = 0; k < 6; ++k) {
    const double scale = contact.weights[static_cast<std::size_t>(corner_pairs[k][0])] *
                         contact.weights[static_cast<std::size_t>(corner_pairs[k][1])];
    if (scale != 0 && weight != 0) {
      add_edge_block(scene.sparsity, scene.sparsity.tet_edges[6 * static_cast<std::size_t>(contact.tet) + k],
                     scale * block, numbers.system);
    }
  }
}

}  // namespace

std::size_t most_contacts(const Scene& scene) {
  const std::size_t nodes = scene.mesh.rest_positions.size();
  std::size_t most = nodes * (scene.tool_distances.size() + scene.obstacle_distances.size());
  if (!scene.tool_distances.empty()) return most;
  for (const Tool& tool : scene.settings.tools) most += tool.surface.vertices.size();
  return most;
}

const ContactLaw& law_of(const Scene& scene, std::int32_t body) {
  const auto number = static_cast<std::size_t>(body), tools = scene.settings.tools.size();
  return number < tools ? scene.settings.contact : scene.settings.obstacles[number - tools].contact;
}

ContactResponse respond(const Scene& scene, const Contact& contact) {
  const double h = scene.settings.step_s;
  const ContactLaw& law = law_of(scene, contact.tool);
  const Vec3& n = contact.normal;
  ContactResponse response;
  if (!law.explicit_forces) response.weight_kg = h * (law.damping_N_s_m + h * law.stiffness_N_m);
  response.direction = law.anisotropy * Mat3::Identity() + (1 - law.anisotropy) * (n * n.transpose());
  response.matrix = response.direction;
  if (law.friction > 0) {
    const Vec3& slip = contact.slip;
    const double speed2 = slip.squaredNorm() + law.friction_speed_m_s * law.friction_speed_m_s;
    const double drag = full_friction(law, contact) / std::sqrt(speed2);  // N s/m
    response.slides = true;
    response.friction = drag * slip;
    if (!law.explicit_forces) {
      response.friction_rate =
          drag * (Mat3::Identity() - n * n.transpose() - slip * slip.transpose() / speed2);
      response.friction -= response.friction_rate * slip;
      if (response.weight_kg > 0) response.matrix += h / response.weight_kg * response.friction_rate;
    }
  }
  return response;
}

template <class Real>
void save_tissue(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace) {
  const std::size_t count = workspace.contacts.size();
  numbers.saved_tets.clear();
  for (const Contact& contact : workspace.contacts) numbers.saved_tets.push_back(contact.tet);
  numbers.saved_blocks.resize(108 * count);
  numbers.saved_terms.resize(36 * count);
  numbers.saved_forces.resize(12 * count);
  const auto contacts = static_cast<std::int64_t>(count);
#pragma omp parallel for num_threads(workspace.threads) schedule(static) if (contacts >= enough_for_threads)
  for (std::int64_t c = 0; c < contacts; ++c) {
    for_each_saved(scene, numbers, workspace, static_cast<std::size_t>(c),
                   [](auto now, auto& saved) { saved = now; });
  }
}

// Backwards, so that of several copies of a place the first one saved is the last one restored.
template <class Real>
void restore_tissue(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace) {
  for (std::size_t c = numbers.saved_tets.size(); c-- > 0;) {
    for_each_saved(scene, numbers, workspace, c, [](auto& now, auto saved) { now = saved; });
  }
}

template <class Real>
void assemble_contacts(const Scene& scene, const State& state, Numbers<Real>& numbers, Workspace& workspace) {
  const std::size_t tools = workspace.tools.size();
  for (std::size_t t = 0; t < tools; ++t) {
    make_rows<Real>(scene, t, numbers.borders[t].rows, workspace);
    for (const Contact& contact : workspace.contacts) {
      if (contact.tool == static_cast<std::int32_t>(t))
        add_contact(scene, state, contact, numbers, workspace, &workspace.tools[t], &numbers.borders[t]);
    }
    for (std::int32_t node : workspace.touched) workspace.row_of_node[static_cast<std::size_t>(node)] = -1;
  }
  if (scene.settings.obstacles.empty()) return;
  for (const Contact& contact : workspace.contacts) {
    if (contact.tool >= static_cast<std::int32_t>(tools))
      add_contact<Real>(scene, state, contact, numbers, workspace, nullptr, nullptr);
  }
}

Vec3 contact_rate(const Scene& scene, const State& state, const Contact& contact,
                  const Workspace& workspace) {
  const auto tool = static_cast<std::size_t>(contact.tool);
  Vec6 velocity = body_velocity(contact, workspace);
  if (tool < workspace.tools.size()) velocity += workspace.tools[tool].increment;
  Vec3 rate = gap_velocity(contact, scene.mesh, state.velocities, velocity);
  const auto& nodes = scene.mesh.tets[static_cast<std::size_t>(contact.tet)];
  for (std::size_t c = 0; c < 4; ++c)
    rate -= contact.weights[c] * node_vector(workspace.increments, nodes[c]);
  return rate;
}

Vec3 contact_force(const Scene& scene, const State& state, const Contact& contact,
                   const Workspace& workspace) {
  const ContactLaw& law = law_of(scene, contact.tool);
  const ContactResponse response = respond(scene, contact);
  Vec3 rate;
  double damping = law.damping_N_s_m;
  if (law.explicit_forces) {
    rate = gap_velocity(contact, scene.mesh, state.velocities, body_velocity(contact, workspace));
  } else {
    rate = contact_rate(scene, state, contact, workspace);
    damping += scene.settings.step_s * law.stiffness_N_m;
  }
  Vec3 force = response.direction * (law.stiffness_N_m * contact.gap + damping * rate);
  if (response.slides) force += response.friction + response.friction_rate * rate;
  return force;
}

void begin_friction(const Scene& scene, const State& state, Workspace& workspace) {
  for (Contact& contact : workspace.contacts) {
    if (!(law_of(scene, contact.tool).friction > 0)) continue;
    Vec6 velocity = Vec6::Zero();
    if (const auto t = static_cast<std::size_t>(contact.tool); t < workspace.tools.size()) {
      const RigidBodyState tool = tool_state(state, t);
      const RigidBody& body = scene.settings.tools[t].body;
      velocity << linear_velocity(body, tool), angular_velocity(body, tool);
    }
    contact.slip = along(contact.normal, gap_velocity(contact, scene.mesh, state.velocities, velocity));
  }
}

bool correct_friction(const Scene& scene, const State& state, Workspace& workspace) {
  constexpr double tolerated = 0.05;  // of the full friction
  bool any = false;
  for (Contact& contact : workspace.contacts) {
    const ContactLaw& law = law_of(scene, contact.tool);
    if (!(law.friction > 0) || law.explicit_forces) continue;
    const ContactResponse response = respond(scene, contact);
    const Vec3 slip = along(contact.normal, contact_rate(scene, state, contact, workspace));
    const double full = full_friction(law, contact);
    const double speed = std::sqrt(slip.squaredNorm() + law.friction_speed_m_s * law.friction_speed_m_s);
    const Vec3 error = response.friction + response.friction_rate * slip - full / speed * slip;
    if (!(error.squaredNorm() > tolerated * tolerated * full * full)) continue;
    contact.slip = slip.dot(contact.slip) < 0 ? Vec3(Vec3::Zero()) : slip;
    any = true;
  }
  return any;
}

#define SULCUS_INSTANTIATE(Real)                                                \
  template void save_tissue<Real>(const Scene&, Numbers<Real>&, Workspace&);    \
  template void restore_tissue<Real>(const Scene&, Numbers<Real>&, Workspace&); \
  template void assemble_contacts<Real>(const Scene&, const State&, Numbers<Real>&, Workspace&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
