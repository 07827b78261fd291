// Linear tetrahedra: materials and rest data (equations.md 2.1; thesis 3.1-3.5).
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

struct RayleighDamping {
  double alpha_1_s = 0;  // 1/s, of the mass, >= 0
  double beta_s = 0;     // s, of the stiffness, >= 0
};

// How stress follows from deformation. Further laws join here and in engine/fem/laws.h, which says how;
// solver and assembly do not know them.
enum class Law {
  corotated,  // linear elasticity in the frame that turns with the element
  linear  // linear elasticity in the rest frame: wrong under rotation, for comparison (thesis Fig. 3.1, 3.2)
};

struct Material {
  double youngs_modulus_Pa = 1000;                                         // Pa, > 0
  double poisson_ratio = 0.45;                                             // in (-1, 0.5)
  double density_kg_m3 = 1000;                                             // kg/m^3, > 0
  double fracture_threshold_Pa = std::numeric_limits<double>::infinity();  // Pa, > 0; infinite: never tears
  Law law = Law::corotated;
  std::optional<RayleighDamping> damping{};  // its own, instead of the scene's
};

// Elements that are mixtures (thesis 2.8 and 6.2): what part of each is filled with which material, from the
// voxels in it (mesh/shares.h). Their stiffness and mass are the means over the element, empty parts counting
// nothing; but at least `least_share` of an element counts as its material_of_tet, so that no node is without
// stiffness.
struct ElementContent {
  std::vector<std::int64_t> first;     // [tets + 1] entries of element e: first[e] .. first[e + 1] - 1
  std::vector<std::int32_t> material;  // [entries] index into materials
  std::vector<double> share;           // [entries] 0..1; of one element they add up to at most 1
};
inline constexpr double least_share = 0.01;

// Rest data of the elements, structure of arrays in blocks of lanes elements: entry c of element e stands at
// [(e / lanes * components + c) * lanes + e % lanes]. The last block is filled up with copies of its last
// element and zero stiffness.
struct ElementData {
  static constexpr int lanes = 16;
  std::int64_t count = 0;
  std::vector<std::int32_t> nodes;  // 4 components
  std::vector<float> rest_single;   // 12 components: D_m^-1 (row major, 1/m), V lambda, V mu (N m), V (m^3)
  std::vector<double> rest_double;  // the same in double precision
  std::vector<double> node_mass;    // [nodes] kg, lumped: a quarter of each element's mass
  std::vector<std::int32_t> incident_start;  // [nodes+1] into incident
  std::vector<std::int32_t> incident;        // element*4 + corner, ascending

  // Empty unless a material asks for them, so that they cost nothing then.
  std::vector<std::uint8_t> linear;  // [elements rounded up to blocks] 1: Law::linear
  std::vector<double> beta_s;        // [elements rounded up to blocks] s, stiffness damping
  std::vector<double> drag_kg_s;  // [nodes] kg/s, mass damping: a quarter of each element's alpha times mass
};

// material_of_tet: [tets] index into materials: of the whole element, or with `content` (null: none) of what
// is no mean: law, damping, threshold. damping: of the materials that have none of their own. Throws
// InputError for an impossible material or a flat rest element.
ElementData build_elements(const EmbeddingMesh& mesh, std::span<const Material> materials,
                           std::span<const std::int32_t> material_of_tet, const RayleighDamping& damping = {},
                           const ElementContent* content = nullptr);

}  // namespace sulcus
