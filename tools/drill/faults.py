"""The deliberate faults of the mutation drill: what stands in the source, and what stands there instead.

FAULT in a replacement becomes a test whether this fault is chosen. The text to find must occur exactly once in its
file. `scenario`: the cheapest one that meets the fault. `kinds`: which kinds of golden must catch it.
"""

from collections import namedtuple

Fault = namedtuple("Fault", "name file find replace scenario kinds")

SYSTEM = "engine/scene/system.cpp"
CONTACTS = "engine/scene/contact_system.cpp"
STEP = "engine/scene/step.cpp"
KERNELS = "engine/fem/kernels.cpp"
ASSEMBLY = "engine/fem/assembly.cpp"
EMBEDDED = "engine/contact/embedded.cpp"
FRACTURE = "engine/fracture/fracture.cpp"
GRADIENTS = "engine/solver/conjugate_gradients.cpp"
CYLINDER = "cylinder_retraction"
TEARS = "fracture_pull_hinges"

FAULTS = [
    Fault("sign of the contact force on the tissue", CONTACTS,
          "workspace.forces[3 * node + d] += contact.weights[c] *",
          "workspace.forces[3 * node + d] += (FAULT ? -1.0 : 1.0) * contact.weights[c] *", CYLINDER, "values"),
    Fault("contact damping missing from the matrix", CONTACTS,
          "response.weight_kg = h * (law.damping_N_s_m +",
          "response.weight_kg = h * ((FAULT ? 0.0 : law.damping_N_s_m) +", CYLINDER, "values"),
    Fault("sign of the lever of the contact torque", CONTACTS,
          "tool->right_hand_side.tail<3>() -= contact.arm.cross(push);",
          "tool->right_hand_side.tail<3>() -= (FAULT ? -1.0 : 1.0) * contact.arm.cross(push);", CYLINDER, "values"),
    Fault("tool moved by nine tenths of the tissue's answer", SYSTEM,
          "change[static_cast<Eigen::Index>(j)] -= static_cast<double>(row.b[6 * i + j]) * x;",
          "change[static_cast<Eigen::Index>(j)] -= (FAULT ? 0.9 : 1.0) * static_cast<double>(row.b[6 * i + j]) * x;",
          CYLINDER, "statement"),
    Fault("tool not eliminated from the right-hand side", SYSTEM,
          "+ 16 * i] -= static_cast<Real>(sum);", "+ 16 * i] -= FAULT ? Real(0) : static_cast<Real>(sum);",
          CYLINDER, "values"),
    Fault("sign of the rotational coupling", SYSTEM,
          "h * (coupling.rotational_stiffness_N_m_rad * tool.misalignment +",
          "h * ((FAULT ? -1.0 : 1.0) * coupling.rotational_stiffness_N_m_rad * tool.misalignment +", CYLINDER, "values"),
    Fault("damping of the boundary's springs dropped", SYSTEM,
          "const double weight = h * (spring.damping_N_s_m +",
          "const double weight = h * ((FAULT ? 0.0 : spring.damping_N_s_m) +", CYLINDER, "values"),
    Fault("sign of the forces on paths", SYSTEM,
          "workspace.motion_forces[m] = impulse /", "workspace.motion_forces[m] = (FAULT ? -1.0 : 1.0) * impulse /",
          TEARS, "values"),
    Fault("Rayleigh term missing from the forces", ASSEMBLY,
          "const double ahead = h + coefficients.damping.beta_s;",
          "const double ahead = h + (FAULT ? 0.0 : coefficients.damping.beta_s);", CYLINDER, "values"),
    Fault("Rayleigh term missing from the matrix", ASSEMBLY,
          "static_cast<Real>(coefficients.damping.beta_s * h + h * h)",
          "static_cast<Real>((FAULT ? 0.0 : coefficients.damping.beta_s) * h + h * h)", CYLINDER, "values"),
    Fault("a tenth of the inertia lost", ASSEMBLY,
          "elements.drag_kg_s.empty() ? mass_scale * elements.node_mass[n]",
          "elements.drag_kg_s.empty() ? (FAULT ? 0.9 : 1.0) * mass_scale * elements.node_mass[n]", CYLINDER, "values"),
    Fault("missing transpose of the rotation", "engine/fem/laws.h",
          "m[3 * i + j] = r[i] * gradient[j] + r[3 + i] * gradient[3 + j] + r[6 + i] * gradient[6 + j];",
          "m[3 * i + j] = FAULT ? r[3 * i] * gradient[j] + r[3 * i + 1] * gradient[3 + j] + r[3 * i + 2] * gradient[6 + j]\n"
          "                                 : r[i] * gradient[j] + r[3 + i] * gradient[3 + j] + r[6 + i] * gradient[6 + j];", CYLINDER, "values"),
    Fault("shear modulus halved in the stress", "engine/fem/laws.h",
          "const V mu2 = mu + mu;", "const V mu2 = FAULT ? mu : mu + mu;", CYLINDER, "values"),
    Fault("missing transpose of the blocks below the diagonal", KERNELS,
          "store(values + 16 * (3 * i + j) + l, transposed ? upper : lower);",
          "store(values + 16 * (3 * i + j) + l, FAULT ? lower : (transposed ? upper : lower));", CYLINDER, "values"),
    Fault("sum in another order", KERNELS,
          "identity + (d1 * g[j] + d2 * g[3 + j] + d3 * g[6 + j]);",
          "FAULT ? (identity + d1 * g[j]) + (d2 * g[3 + j] + d3 * g[6 + j])\n"
          "                             : identity + (d1 * g[j] + d2 * g[3 + j] + d3 * g[6 + j]);", CYLINDER, "bits"),
    Fault("held nodes let go", KERNELS,
          "if (nodes[l] >= 0 && pass.free_node[nodes[l]]) continue;",
          "if (nodes[l] >= 0 && (FAULT || pass.free_node[nodes[l]])) continue;", TEARS, "values"),
    Fault("torn elements still pull", KERNELS,
          "if (pass.alive != nullptr) remove_dead", "if (pass.alive != nullptr && !FAULT) remove_dead", TEARS, "values"),
    Fault("wrong tetrahedron among superimposed ones", EMBEDDED,
          "(nearest < 0 || away < nearest)", "(nearest < 0 || FAULT || away < nearest)", CYLINDER, "values"),
    Fault("surface point on the far side", EMBEDDED,
          "map.to_world(point_voxel) - sample.distance * rest_normal",
          "map.to_world(point_voxel) - (FAULT ? -1.0 : 1.0) * sample.distance * rest_normal", CYLINDER, "statement"),
    Fault("contact handed to the wrong copy of a cell", EMBEDDED,
          "copy = mesh.cell_of_voxel[inside.index];", "if (!FAULT) copy = mesh.cell_of_voxel[inside.index];",
          CYLINDER, "values"),
    Fault("penetration reported as half", EMBEDDED,
          "contact.depth_m = -sample.distance;", "contact.depth_m = (FAULT ? -0.5 : -1.0) * sample.distance;",
          CYLINDER, "values"),
    Fault("contacts that pull are kept", STEP,
          "const bool dropped = drop_pulling_contacts(scene, state, workspace, report);",
          "const bool dropped = !FAULT && drop_pulling_contacts(scene, state, workspace, report);", CYLINDER, "statement"),
    Fault("output filter left out", STEP,
          "filtered[d] += scene.filter_alpha[t] *", "filtered[d] += (FAULT ? 1.0 : scene.filter_alpha[t]) *",
          "cube_sphere_b", "values"),
    Fault("positions moved by the old velocity", STEP,
          "state.positions[i] += h * state.velocities[i];",
          "state.positions[i] += h * (state.velocities[i] - (FAULT ? workspace.increments[i] : 0.0));", CYLINDER, "values"),
    Fault("singularity check skipped", FRACTURE,
          "if (settings.avoid_singularities) {\n    report.passes", "if (settings.avoid_singularities && !FAULT) {\n    report.passes",
          "fracture_pull", "statement"),
    Fault("a torn element returns", FRACTURE,
          "for (std::int32_t element : scratch.removed) alive[at(element)] = 0;\n  std::size_t counted",
          "for (std::int32_t element : scratch.removed) alive[at(element)] = 0;\n"
          "  for (std::size_t e = 0; FAULT && scratch.removed.empty() && e < alive.size(); ++e) {\n"
          "    if (!alive[e]) {\n      alive[e] = 1;\n      break;\n    }\n  }\n  std::size_t counted", TEARS, "statement"),
    Fault("tissue tears five per cent late", FRACTURE,
          "const bool above = ratio > 1;", "const bool above = ratio > (FAULT ? 1.05 : 1.0);", TEARS, "values"),
    Fault("solver stops a hundred times too early", GRADIENTS,
          "const double goal = std::fmax(tolerance * start, floor);",
          "const double goal = std::fmax((FAULT ? 100 : 1) * tolerance * start, floor);", CYLINDER, "statement"),
    Fault("sum in single precision and in the order of the threads", GRADIENTS,
          "return ordered_sum(workspace.pq) - border_term;",
          "return (FAULT ? sulcus_drill::sum_by_threads(workspace.pq, workspace.threads) : ordered_sum(workspace.pq)) -\n"
          "             border_term;", "brain_sylvian_retraction", "bits"),
]
