// The bodies that benchmarks measure on, by name.
#pragma once

#include <optional>
#include <string>

#include "engine/solver/test_pressed_body.h"

namespace sulcus {

// Where a tool would press: a place on the boundary (m, rest) and a direction (unit).
struct PressPlace {
  Vec3 point = Vec3::Zero(), push = -Vec3::UnitZ();
};

struct BenchMesh {
  std::string name;
  EmbeddingMesh mesh;
  PressPlace place;
};

// "cubes_NXxNYxNZ": cubes of 5 mm, 5 tetrahedra each, pressed on top. "jhu189_Hmm": the brain of scenario
// brain_sylvian_retraction with cells of H mm; "spl_Hmm": the SPL atlas with all pairs of its Sylvian
// fissures; both pressed down on the lower bank of the left fissure. Nothing where the image is absent.
// Throws InputError for other names.
std::optional<BenchMesh> bench_mesh(const std::string& name);

}  // namespace sulcus
