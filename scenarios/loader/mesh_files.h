// Tool surfaces from files: OBJ, STL, PLY (and what else Assimp reads), checked.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "engine/tool/rigid_body.h"

namespace sulcus {

// Reads a triangle mesh; unit_m is the length of the file's unit. Vertices at the same place are joined, flat
// triangles left out, a surface that is inside out is turned. The centre of mass of the homogeneous solid
// comes to the origin. Throws InputError with the file and the place in it: no such file, not readable,
// empty, more than a million triangles, larger than a metre or smaller than a tenth of a millimetre (a wrong
// unit), and what check_surface refuses.
ToolSurface read_surface(const std::filesystem::path& path, double unit_m);

// Content of a file of a triangle mesh; the format follows the name: .ply, .stl (both binary) or .obj.
// positions: xyz interleaved, m; in the file they are millimetres. Throws InputError for another ending.
// check_surface_name: refuses other endings alone.
std::string surface_file(const std::filesystem::path& path, std::span<const double> positions,
                         std::span<const std::array<std::int32_t, 3>> triangles);
void check_surface_name(const std::filesystem::path& path);

// A rigid body's surface must be closed, manifold (two triangles of opposite direction at every edge, one fan
// around every vertex) and free of self-intersection. Throws InputError that begins with `name`, counts the
// faults and gives the place of the first. Cost: about 2 us a triangle.
void check_surface(const ToolSurface& surface, const std::string& name);

}  // namespace sulcus
