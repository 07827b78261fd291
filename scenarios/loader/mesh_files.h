// Tool surfaces from files: OBJ, STL, PLY (and what else Assimp reads), checked.
#pragma once

#include <filesystem>

#include "engine/tool/rigid_body.h"

namespace sulcus {

// Reads a triangle mesh; unit_m is the length of the file's unit. Vertices at the same place are joined, flat
// triangles left out, a surface that is inside out is turned. The centre of mass of the homogeneous solid
// comes to the origin. Throws InputError with the file and the place in it: no such file, not readable,
// empty, more than a million triangles, larger than a metre or smaller than a tenth of a millimetre (a wrong
// unit), and what check_surface refuses.
ToolSurface read_surface(const std::filesystem::path& path, double unit_m);

// A rigid body's surface must be closed, manifold (two triangles of opposite direction at every edge, one fan
// around every vertex) and free of self-intersection. Throws InputError that begins with `name`, counts the
// faults and gives the place of the first. Cost: about 2 us a triangle.
void check_surface(const ToolSurface& surface, const std::string& name);

}  // namespace sulcus
