// Linear tetrahedra with corotational elasticity: rest data (equations.md 2.1; thesis 3.1-3.5).
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <span>
#include <vector>

#include "engine/mesh/embedding.h"

namespace sulcus {

// A linear elastic material. Laws that need more join here.
struct Material {
  double youngs_modulus_Pa = 1000;                                         // Pa, > 0
  double poisson_ratio = 0.45;                                             // in (-1, 0.5)
  double density_kg_m3 = 1000;                                             // kg/m^3, > 0
  double fracture_threshold_Pa = std::numeric_limits<double>::infinity();  // Pa, > 0; infinite: never tears
};

struct RayleighDamping {
  double alpha_1_s = 0;  // 1/s, of the mass
  double beta_s = 0;     // s, of the stiffness
};

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
};

// material_of_tet: [tets] index into materials. Throws InputError for an impossible material or a flat rest
// element.
ElementData build_elements(const EmbeddingMesh& mesh, std::span<const Material> materials,
                           std::span<const std::int32_t> material_of_tet);

}  // namespace sulcus
