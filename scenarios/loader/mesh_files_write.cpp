#include <assimp/scene.h>

#include <assimp/Exporter.hpp>
#include <map>
#include <string>

#include "engine/numerics/error.h"
#include "scenarios/loader/mesh_files.h"

namespace sulcus {
namespace {

// Assimp's name of the format, by the ending.
const std::map<std::string, const char*> formats = {{".ply", "plyb"}, {".stl", "stlb"}, {".obj", "objnomtl"}};

}  // namespace

void check_surface_name(const std::filesystem::path& path) {
  if (formats.contains(path.extension().string())) return;
  throw InputError(path.string() + ": unknown format of a surface; let its name end in .ply, .stl or .obj");
}

std::string surface_file(const std::filesystem::path& path, std::span<const double> positions,
                         std::span<const std::array<std::int32_t, 3>> triangles) {
  check_surface_name(path);
  aiScene scene;  // owns all below
  scene.mRootNode = new aiNode;
  scene.mRootNode->mNumMeshes = 1;
  scene.mRootNode->mMeshes = new unsigned[1]{0};
  scene.mNumMaterials = 1;
  scene.mMaterials = new aiMaterial* [1] { new aiMaterial };
  scene.mNumMeshes = 1;
  scene.mMeshes = new aiMesh* [1] { new aiMesh };
  aiMesh& mesh = *scene.mMeshes[0];
  mesh.mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  mesh.mNumVertices = static_cast<unsigned>(positions.size() / 3);
  mesh.mVertices = new aiVector3D[mesh.mNumVertices];
  constexpr double mm = 1e3;
  for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
    const auto at = 3 * std::size_t{v};
    mesh.mVertices[v] = {static_cast<ai_real>(mm * positions[at]),
                         static_cast<ai_real>(mm * positions[at + 1]),
                         static_cast<ai_real>(mm * positions[at + 2])};
  }
  mesh.mNumFaces = static_cast<unsigned>(triangles.size());
  mesh.mFaces = new aiFace[mesh.mNumFaces];
  for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
    mesh.mFaces[f].mNumIndices = 3;
    mesh.mFaces[f].mIndices = new unsigned[3];
    for (std::size_t c = 0; c < 3; ++c) mesh.mFaces[f].mIndices[c] = static_cast<unsigned>(triangles[f][c]);
  }

  Assimp::Exporter exporter;
  const aiExportDataBlob* blob = exporter.ExportToBlob(&scene, formats.at(path.extension().string()));
  if (blob == nullptr)
    throw EnvironmentError(path.string() + ": cannot be made: " + exporter.GetErrorString());
  return std::string(static_cast<const char*>(blob->data), blob->size);
}

}  // namespace sulcus
