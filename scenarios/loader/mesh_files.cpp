#include "scenarios/loader/mesh_files.h"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <assimp/Importer.hpp>
#include <cmath>
#include <cstdio>
#include <map>

#include "engine/numerics/error.h"
#include "scenarios/loader/tools.h"

namespace sulcus {

namespace {

constexpr std::size_t most_triangles = 1000000;
constexpr std::uintmax_t most_bytes = 500000000;

const Vec3& at(const ToolSurface& surface, std::int32_t vertex) {
  return surface.vertices[static_cast<std::size_t>(vertex)];
}

std::string place_of(const Vec3& x) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.3f, %.3f, %.3f) mm", 1e3 * x[0], 1e3 * x[1], 1e3 * x[2]);
  return text;
}

// Corner of a triangle at a vertex, for fans.
struct Corner {
  std::int32_t triangle, next, last;  // the other vertices in the triangle's order
};

void check_edges(const ToolSurface& surface, const std::string& name) {
  std::map<std::pair<std::int32_t, std::int32_t>, int> directed;
  for (const auto& t : surface.triangles) {
    for (std::size_t c = 0; c < 3; ++c) ++directed[{t[c], t[(c + 1) % 3]}];
  }
  std::size_t open = 0, crowded = 0;
  std::pair<std::int32_t, std::int32_t> first_open, first_crowded;
  for (const auto& [edge, count] : directed) {
    const auto back = directed.find({edge.second, edge.first});
    if (back == directed.end() && open++ == 0) first_open = edge;
    if (count > 1 && crowded++ == 0) first_crowded = edge;
  }
  const auto middle = [&](const auto& edge) {
    return place_of(0.5 * (at(surface, edge.first) + at(surface, edge.second)));
  };
  if (crowded > 0) {
    throw InputError(
        name + ": the surface is not manifold, or its triangles face both ways: " + std::to_string(crowded) +
        " edges belong to more than two triangles or twice to one side, the first at " +
        middle(first_crowded) + "; mend it in a mesh editor");
  }
  if (open > 0) {
    throw InputError(name + ": the surface is open: " + std::to_string(open) +
                     " edges have a triangle on one side only, the first at " + middle(first_open) +
                     "; close it in a mesh editor");
  }
}

// One fan of triangles around each vertex.
void check_fans(const ToolSurface& surface, const std::string& name) {
  std::vector<std::vector<Corner>> corners(surface.vertices.size());
  for (std::size_t n = 0; n < surface.triangles.size(); ++n) {
    const auto& t = surface.triangles[n];
    for (std::size_t c = 0; c < 3; ++c)
      corners[static_cast<std::size_t>(t[c])].push_back(
          {static_cast<std::int32_t>(n), t[(c + 1) % 3], t[(c + 2) % 3]});
  }
  for (std::size_t v = 0; v < corners.size(); ++v) {
    if (corners[v].empty()) continue;
    std::size_t passed = 0;
    std::int32_t next = corners[v][0].next;
    do {
      const auto corner =
          std::find_if(corners[v].begin(), corners[v].end(), [&](const Corner& c) { return c.next == next; });
      next = corner->last;
      ++passed;
    } while (next != corners[v][0].next && passed <= corners[v].size());
    if (passed != corners[v].size()) {
      throw InputError(name + ": the surface is not manifold: it only touches itself at the vertex " +
                       place_of(surface.vertices[v]) + "; mend it in a mesh editor");
    }
  }
}

// Whether the segment a-b passes through the triangle, both without their borders.
bool pierces(const Vec3& a, const Vec3& b, const Vec3& p, const Vec3& q, const Vec3& r) {
  const Vec3 normal = (q - p).cross(r - p);
  const double da = normal.dot(a - p), db = normal.dot(b - p);
  if (!(da * db < 0)) return false;
  const Vec3 x = a + da / (da - db) * (b - a);
  const double u = normal.dot((q - p).cross(x - p)), v = normal.dot((r - q).cross(x - q)),
               w = normal.dot((p - r).cross(x - r));
  return u > 0 && v > 0 && w > 0;
}

void check_crossings(const ToolSurface& surface, const std::string& name) {
  Vec3 low = surface.vertices[0], high = low;
  for (const Vec3& v : surface.vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
  // a grid with about a cell for each triangle of the mean size
  const double cells = std::cbrt(static_cast<double>(surface.triangles.size())) + 1;
  const double edge = std::max((high - low).maxCoeff() / std::min(2 * cells, 200.0), 1e-9);
  Index3 size;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto axis = static_cast<Eigen::Index>(a);
    size[a] = static_cast<int>((high[axis] - low[axis]) / edge) + 1;
  }
  std::vector<std::vector<std::int32_t>> grid(static_cast<std::size_t>(size[0]) *
                                              static_cast<std::size_t>(size[1] * size[2]));
  const auto corner = [&](std::int32_t t, std::size_t c) -> const Vec3& {
    return at(surface, surface.triangles[static_cast<std::size_t>(t)][c]);
  };
  const auto shares_vertex = [&](std::int32_t s, std::int32_t t) {
    for (const std::int32_t a : surface.triangles[static_cast<std::size_t>(s)]) {
      for (const std::int32_t b : surface.triangles[static_cast<std::size_t>(t)]) {
        if (a == b) return true;
      }
    }
    return false;
  };
  const auto crosses = [&](std::int32_t s, std::int32_t t) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (pierces(corner(s, c), corner(s, (c + 1) % 3), corner(t, 0), corner(t, 1), corner(t, 2)) ||
          pierces(corner(t, c), corner(t, (c + 1) % 3), corner(s, 0), corner(s, 1), corner(s, 2)))
        return true;
    }
    return false;
  };
  for (std::int32_t t = 0; t < static_cast<std::int32_t>(surface.triangles.size()); ++t) {
    const Vec3 from = corner(t, 0).cwiseMin(corner(t, 1)).cwiseMin(corner(t, 2)) - low;
    const Vec3 to = corner(t, 0).cwiseMax(corner(t, 1)).cwiseMax(corner(t, 2)) - low;
    for (int k = static_cast<int>(from[2] / edge); k <= static_cast<int>(to[2] / edge); ++k) {
      for (int j = static_cast<int>(from[1] / edge); j <= static_cast<int>(to[1] / edge); ++j) {
        for (int i = static_cast<int>(from[0] / edge); i <= static_cast<int>(to[0] / edge); ++i) {
          auto& cell = grid[static_cast<std::size_t>((k * size[1] + j) * size[0] + i)];
          for (const std::int32_t other : cell) {
            if (shares_vertex(t, other) || !crosses(t, other)) continue;
            throw InputError(name + ": the surface passes through itself, first found at " +
                             place_of((corner(t, 0) + corner(t, 1) + corner(t, 2)) / 3) +
                             "; mend it in a mesh editor");
          }
          cell.push_back(t);
        }
      }
    }
  }
}

}  // namespace

void check_surface(const ToolSurface& surface, const std::string& name) {
  if (surface.vertices.empty() || surface.triangles.empty())
    throw InputError(name + ": the surface is empty; give a closed triangle mesh");
  for (const Vec3& v : surface.vertices) {
    if (!v.allFinite()) throw InputError(name + ": a vertex is not finite");
  }
  check_edges(surface, name);
  check_fans(surface, name);
  check_crossings(surface, name);
}

ToolSurface read_surface(const std::filesystem::path& path, double unit_m) {
  const std::string name = path.string();
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (error) throw InputError(name + ": no such file (" + error.message() + ")");
  if (bytes > most_bytes)
    throw InputError(name + ": " + std::to_string(bytes / 1000000) + " MB; a tool's mesh has at most 500 MB");

  // normals, colours and the like would keep vertices at the same place apart
  Assimp::Importer importer;
  importer.SetPropertyInteger(AI_CONFIG_PP_RVC_FLAGS,
                              aiComponent_NORMALS | aiComponent_TANGENTS_AND_BITANGENTS | aiComponent_COLORS |
                                  aiComponent_TEXCOORDS | aiComponent_TEXTURES | aiComponent_MATERIALS);
  const aiScene* file = importer.ReadFile(name, aiProcess_RemoveComponent | aiProcess_PreTransformVertices |
                                                    aiProcess_Triangulate | aiProcess_JoinIdenticalVertices);
  if (file == nullptr) throw InputError(name + ": cannot be read: " + importer.GetErrorString());

  ToolSurface surface;
  std::map<std::array<double, 3>, std::int32_t> numbers;
  for (unsigned m = 0; m < file->mNumMeshes; ++m) {
    const aiMesh& mesh = *file->mMeshes[m];
    std::vector<std::int32_t> number_of(mesh.mNumVertices);
    for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
      const aiVector3D& x = mesh.mVertices[v];
      const std::array<double, 3> key{static_cast<double>(x.x), static_cast<double>(x.y),
                                      static_cast<double>(x.z)};
      const auto [entry, added] =
          numbers.try_emplace(key, static_cast<std::int32_t>(surface.vertices.size()));
      if (added) surface.vertices.push_back(unit_m * Vec3(key[0], key[1], key[2]));
      number_of[v] = entry->second;
    }
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices != 3) continue;  // points and lines
      const std::int32_t a = number_of[face.mIndices[0]], b = number_of[face.mIndices[1]],
                         c = number_of[face.mIndices[2]];
      if (a != b && b != c && c != a) surface.triangles.push_back({a, b, c});
    }
  }
  if (surface.triangles.size() > most_triangles)
    throw InputError(name + ": " + std::to_string(surface.triangles.size()) +
                     " triangles; a tool has at most a million, simplify it");
  check_surface(surface, name);

  Vec3 low = surface.vertices[0], high = low;
  for (const Vec3& v : surface.vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
  const double size = (high - low).maxCoeff();
  if (!(size <= 1 && size >= 1e-4)) {
    char text[160];
    std::snprintf(text, sizeof text,
                  ": the mesh is %.3g m long, expected 0.1 mm to 1 m; give the length of its unit in unit_mm",
                  size);
    throw InputError(name + text);
  }
  SolidMoments moments = solid_moments(surface);
  if (moments.volume_m3 < 0) {
    for (auto& t : surface.triangles) std::swap(t[1], t[2]);
    moments = solid_moments(surface);
  }
  for (Vec3& v : surface.vertices) v -= moments.centre_m;
  return surface;
}

}  // namespace sulcus
