#include "engine/fem/elements.h"

#include <Eigen/LU>
#include <cmath>
#include <string>

#include "engine/mesh/topology.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

void check_material(const Material& m) {
  const auto refuse = [](const char* what, double value, const char* expected) {
    throw InputError(std::string("material: ") + what + " is " + std::to_string(value) + "; give " +
                     expected);
  };
  if (!(m.youngs_modulus_Pa > 0) || !std::isfinite(m.youngs_modulus_Pa)) {
    refuse("Young's modulus", m.youngs_modulus_Pa, "a positive number in Pa");
  }
  if (!(m.poisson_ratio > -1 && m.poisson_ratio < 0.5)) {
    refuse("Poisson's ratio", m.poisson_ratio, "a number above -1 and below 0.5 (tissue: 0.4 to 0.499)");
  }
  if (!(m.density_kg_m3 > 0) || !std::isfinite(m.density_kg_m3)) {
    refuse("density", m.density_kg_m3, "a positive number in kg/m^3");
  }
}

}  // namespace

ElementData build_elements(const EmbeddingMesh& mesh, std::span<const Material> materials,
                           std::span<const std::int32_t> material_of_tet) {
  for (const Material& material : materials) check_material(material);
  constexpr std::int64_t lanes = ElementData::lanes;
  const auto count = static_cast<std::int64_t>(mesh.tets.size());
  const std::int64_t blocks = (count + lanes - 1) / lanes;
  ElementData data;
  data.count = count;
  data.nodes.resize(static_cast<std::size_t>(blocks * 4 * lanes));
  data.rest_double.resize(static_cast<std::size_t>(blocks * 12 * lanes));
  data.node_mass.assign(mesh.rest_positions.size(), 0.0);
  for (std::int64_t slot = 0; slot < blocks * lanes; ++slot) {
    const std::int64_t e = slot < count ? slot : count - 1;
    const auto& tet = mesh.tets[static_cast<std::size_t>(e)];
    const Vec3& x0 = mesh.rest_positions[static_cast<std::size_t>(tet[0])];
    Mat3 shape;
    for (int a = 0; a < 3; ++a) shape.col(a) = mesh.rest_positions[static_cast<std::size_t>(tet[a + 1])] - x0;
    const double volume = shape.determinant() / 6;
    if (!(volume > 0)) {
      throw InputError("mesh: element " + std::to_string(e) + " has a volume of " + std::to_string(volume) +
                       " m^3; its rest shape must not be flat or inverted");
    }
    const Mat3 inverse = shape.inverse();
    const Material& m = materials[static_cast<std::size_t>(material_of_tet[static_cast<std::size_t>(e)])];
    const double mu = m.youngs_modulus_Pa / (2 * (1 + m.poisson_ratio));
    const double lambda =
        m.youngs_modulus_Pa * m.poisson_ratio / ((1 + m.poisson_ratio) * (1 - 2 * m.poisson_ratio));
    const double stiffness_volume = slot < count ? volume : 0;

    const std::int64_t block = slot / lanes;
    const std::int64_t lane = slot % lanes;
    const auto rest = [&](int component) -> double& {
      return data.rest_double[static_cast<std::size_t>((block * 12 + component) * lanes + lane)];
    };
    for (int k = 0; k < 9; ++k) rest(k) = inverse(k / 3, k % 3);
    rest(9) = lambda * stiffness_volume;
    rest(10) = mu * stiffness_volume;
    rest(11) = stiffness_volume;
    for (int a = 0; a < 4; ++a) data.nodes[static_cast<std::size_t>((block * 4 + a) * lanes + lane)] = tet[a];
    if (slot < count) {
      for (int a = 0; a < 4; ++a) {
        data.node_mass[static_cast<std::size_t>(tet[a])] += 0.25 * m.density_kg_m3 * volume;
      }
    }
  }
  data.rest_single.assign(data.rest_double.begin(), data.rest_double.end());

  NodeStars stars = build_node_stars(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
  data.incident_start = std::move(stars.start);
  data.incident = std::move(stars.incident);
  return data;
}

}  // namespace sulcus
