// What contacts add to the system of one step, and the forces that they then exert. Private to this room.
//
// A contact acts between a place of the tissue, up to four nodes with weights w, and a place of a rigid body.
// The body moves (a tool, eliminated from the system as a 6x6 block) or stands (an obstacle). With the gap g
// between the two and its velocity g' at the end of the step, the force on the tissue is
//
//   f = N (k g + (b + h k) g') + t(s),   t(s) = mu f_n s / sqrt(|s|^2 + v_s^2),   s = (I - n n^T) g'
//
// so that node a and node b couple by w_a w_b weight * matrix, and the tool by the same matrix
// (equations.md 2.6 and 4). t is Coulomb's friction, regularised, with the normal force f_n of the spring at
// the start of the step. It is the gradient of a convex potential, so its derivative at any slip is symmetric
// and positive semidefinite; the step is solved again with the derivative at the slip found, where that
// matters.
#pragma once

#include "engine/scene/system.h"

namespace sulcus {

struct ContactResponse {
  double weight_kg = 0;               // h (b + h k); 0 for explicit contact: nothing enters the matrix
  bool slides = false;                // whether there is friction
  Mat3 direction;                     // N
  Mat3 matrix;                        // N + h t' / weight: times the weight, what enters the matrix
  Vec3 friction = Vec3::Zero();       // N, t(s_k) - t'(s_k) s_k, s_k: Contact::slip
  Mat3 friction_rate = Mat3::Zero();  // N s/m, t'(s_k)
};

// The most contacts that a step of the scene can have.
std::size_t most_contacts(const Scene& scene);

// The law of the body that a contact is with.
const ContactLaw& law_of(const Scene& scene, std::int32_t body);

// How a contact answers in the step.
ContactResponse respond(const Scene& scene, const Contact& contact);

// Velocity of the body's place minus that of the tissue's [m/s] at the end of the step, by the solution.
Vec3 contact_rate(const Scene& scene, const State& state, const Contact& contact, const Workspace& workspace);

// Friction is linearised at the slip of the start of the step, ...
void begin_friction(const Scene& scene, const State& state, Workspace& workspace);
// ... and after a solve, where the law at the slip found differs from its linear form by more than a
// twentieth of its full force, at that slip; at zero where the slip would turn round. Returns whether that
// was so anywhere.
bool correct_friction(const Scene& scene, const State& state, Workspace& workspace);

// Keeps what the tissue's part of the system holds where contacts will be added, and brings it back.
template <class Real>
void save_tissue(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace);
template <class Real>
void restore_tissue(const Scene& scene, Numbers<Real>& numbers, Workspace& workspace);

// Adds workspace.contacts to matrix, tool blocks, borders and right-hand sides.
template <class Real>
void assemble_contacts(const Scene& scene, const State& state, Numbers<Real>& numbers, Workspace& workspace);

}  // namespace sulcus
