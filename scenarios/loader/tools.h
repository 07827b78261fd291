// Surfaces of tools: closed, consistently oriented triangle meshes (Euler characteristic 2, every edge in two
// triangles, outward normals) in body axes, centre of mass of the homogeneous solid at the origin. SI units.
//
// Body axes of every elongated tool: its tip points along -z, its handle along +z.
#pragma once

#include "engine/tool/rigid_body.h"

namespace sulcus {

// Brain spatula: a thin blade of constant thickness with rounded edges and a rounded tip, bent to an arc of a
// circle about an axis parallel to x. The broad faces look along +y and -y, the width runs along x, the tip
// along -z; a positive bend turns the tip towards +y (concave face +y). 712 vertices and 1,420 triangles at
// the standard subdivision, the size of the retractor of thesis 5.3.5 (712 vertices).
struct RetractorShape {
  double length_m = 0.080;      // m, along the blade's middle line
  double width_m = 0.012;       // m
  double thickness_m = 0.0015;  // m, < width
  // rad (10 degrees), angle between the blade's directions at both ends; |bend| < pi
  double bend_rad = 0.17453292519943295;
};

struct SphereShape {
  double radius_m = 0.005;  // m
  int subdivisions = 3;     // of an icosahedron, 0..5; 10*4^s + 2 vertices
};

struct BoxShape {
  Vec3 size_m = Vec3::Constant(0.01);  // m
  double edge_m = 0.002;               // m, longest edge of the square grid on the faces
};

// A cylinder along z with half-spheres at its ends.
struct CapsuleShape {
  double radius_m = 0.003;  // m
  double length_m = 0.040;  // m, tip to tip, > 2 radii
};

// A ring about the z axis.
struct TorusShape {
  double radius_m = 0.03;       // m, of the tube's middle line
  double tube_radius_m = 0.01;  // m, < radius
};

// A plate whose upper face lies in the plane z = 0 of its body axes: the one shape that is not centred.
struct FloorShape {
  double size_m = 1;  // m, edge of the square; a fifth as thick
};

// Throw InputError for sizes that are not positive and finite or contradict each other, and for meshes of
// more than a million vertices.
ToolSurface retractor_surface(const RetractorShape& shape);
ToolSurface sphere_surface(const SphereShape& shape);
ToolSurface box_surface(const BoxShape& shape);
ToolSurface capsule_surface(const CapsuleShape& shape);
ToolSurface torus_surface(const TorusShape& shape);
ToolSurface floor_surface(const FloorShape& shape);

// Volume [m^3], centre of mass [m] and inertia tensor per density [m^5] about the centre of mass of the
// homogeneous solid that a closed surface bounds.
struct SolidMoments {
  double volume_m3 = 0;
  Vec3 centre_m = Vec3::Zero();
  Mat3 inertia_m5 = Mat3::Zero();
};
SolidMoments solid_moments(const ToolSurface& surface);

}  // namespace sulcus
