#include "engine/fem/elements.h"

#include <Eigen/LU>
#include <algorithm>
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
  if (!m.damping) return;
  if (!(m.damping->alpha_1_s >= 0) || !std::isfinite(m.damping->alpha_1_s)) {
    refuse("Rayleigh alpha", m.damping->alpha_1_s, "zero or a positive number in 1/s");
  }
  if (!(m.damping->beta_s >= 0) || !std::isfinite(m.damping->beta_s)) {
    refuse("Rayleigh beta", m.damping->beta_s, "zero or a positive number in s");
  }
}

// What an element takes from its material, or as a mean from its materials.
struct Constants {
  double lambda_Pa = 0, mu_Pa = 0, density_kg_m3 = 0;
};

Constants constants_of(const Material& m) {
  return {m.youngs_modulus_Pa * m.poisson_ratio / ((1 + m.poisson_ratio) * (1 - 2 * m.poisson_ratio)),
          m.youngs_modulus_Pa / (2 * (1 + m.poisson_ratio)), m.density_kg_m3};
}

Constants mean_constants(const ElementContent& content, std::span<const Material> materials,
                         const Material& own, std::size_t element) {
  Constants mean;
  double filled = 0;
  const auto add = [&](const Material& material, double share) {
    const Constants part = constants_of(material);
    mean.lambda_Pa += share * part.lambda_Pa;
    mean.mu_Pa += share * part.mu_Pa;
    mean.density_kg_m3 += share * part.density_kg_m3;
    filled += share;
  };
  for (std::int64_t n = content.first[element]; n < content.first[element + 1]; ++n) {
    const auto entry = static_cast<std::size_t>(n);
    add(materials[static_cast<std::size_t>(content.material[entry])], content.share[entry]);
  }
  if (filled < least_share) add(own, least_share - filled);
  return mean;
}

// The arrays that only some materials need. Elements of the padding are like the last one.
void add_laws_and_damping(const EmbeddingMesh& mesh, std::span<const Material> materials,
                          std::span<const std::int32_t> material_of_tet, const RayleighDamping& damping,
                          std::span<const Constants> constants, ElementData& data) {
  const auto any = [&](auto&& asks) { return std::any_of(materials.begin(), materials.end(), asks); };
  const std::size_t padded = data.nodes.size() / 4;
  const auto material = [&](std::size_t e) -> const Material& {
    const std::size_t tet = std::min(e, mesh.tets.size() - 1);
    return materials[static_cast<std::size_t>(material_of_tet[tet])];
  };
  if (any([](const Material& m) { return m.law == Law::linear; })) {
    for (std::size_t e = 0; e < padded; ++e) data.linear.push_back(material(e).law == Law::linear);
  }
  if (!any([](const Material& m) { return m.damping.has_value(); })) return;
  for (std::size_t e = 0; e < padded; ++e)
    data.beta_s.push_back(material(e).damping.value_or(damping).beta_s);
  data.drag_kg_s.assign(mesh.rest_positions.size(), 0.0);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    const double volume =
        data.rest_double[(e / ElementData::lanes * 12 + 11) * ElementData::lanes + e % ElementData::lanes];
    const double drag =
        0.25 * material(e).damping.value_or(damping).alpha_1_s * constants[e].density_kg_m3 * volume;
    for (std::int32_t node : mesh.tets[e]) data.drag_kg_s[static_cast<std::size_t>(node)] += drag;
  }
}

}  // namespace

ElementData build_elements(const EmbeddingMesh& mesh, std::span<const Material> materials,
                           std::span<const std::int32_t> material_of_tet, const RayleighDamping& damping,
                           const ElementContent* content) {
  for (const Material& material : materials) check_material(material);
  constexpr std::int64_t lanes = ElementData::lanes;
  const auto count = static_cast<std::int64_t>(mesh.tets.size());
  const std::int64_t blocks = (count + lanes - 1) / lanes;
  std::vector<Constants> constants;
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    const Material& own = materials[static_cast<std::size_t>(material_of_tet[e])];
    constants.push_back(content ? mean_constants(*content, materials, own, e) : constants_of(own));
  }
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
    const Constants& mean = constants[static_cast<std::size_t>(e)];
    const double stiffness_volume = slot < count ? volume : 0;

    const std::int64_t block = slot / lanes;
    const std::int64_t lane = slot % lanes;
    const auto rest = [&](int component) -> double& {
      return data.rest_double[static_cast<std::size_t>((block * 12 + component) * lanes + lane)];
    };
    for (int k = 0; k < 9; ++k) rest(k) = inverse(k / 3, k % 3);
    rest(9) = mean.lambda_Pa * stiffness_volume;
    rest(10) = mean.mu_Pa * stiffness_volume;
    rest(11) = stiffness_volume;
    for (int a = 0; a < 4; ++a) data.nodes[static_cast<std::size_t>((block * 4 + a) * lanes + lane)] = tet[a];
    if (slot < count) {
      for (int a = 0; a < 4; ++a) {
        data.node_mass[static_cast<std::size_t>(tet[a])] += 0.25 * mean.density_kg_m3 * volume;
      }
    }
  }
  add_laws_and_damping(mesh, materials, material_of_tet, damping, constants, data);
  data.rest_single.assign(data.rest_double.begin(), data.rest_double.end());

  NodeStars stars = build_node_stars(mesh.tets, static_cast<std::int64_t>(mesh.rest_positions.size()));
  data.incident_start = std::move(stars.start);
  data.incident = std::move(stars.incident);
  return data;
}

}  // namespace sulcus
