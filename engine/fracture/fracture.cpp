#include "engine/fracture/fracture.h"

#include <omp.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <string>

#include "engine/fem/rotation.h"
#include "engine/fem/stress.h"
#include "engine/numerics/error.h"
#include "engine/numerics/team.h"

namespace sulcus {

namespace isa_sse2 {
FractureKernels fracture_table();
}
namespace isa_avx2 {
FractureKernels fracture_table();
}
namespace isa_avx512 {
FractureKernels fracture_table();
}

FractureKernels fracture_kernels(Isa isa) {
  return compiled_for(isa, isa_sse2::fracture_table, isa_avx2::fracture_table, isa_avx512::fracture_table)();
}

namespace {

constexpr std::int64_t lanes = ElementData::lanes;

std::size_t at(std::int64_t number) {
  return static_cast<std::size_t>(number);
}

std::size_t block_count(const ElementData& elements) {
  return at((elements.count + lanes - 1) / lanes);
}

// Rest volume, first and second Lame constant of an element.
struct RestMaterial {
  double volume_m3, lambda_Pa, mu_Pa;
};
RestMaterial rest_material(const ElementData& elements, std::int64_t element) {
  const double* rest = &elements.rest_double[at(element / lanes * 12 * lanes + element % lanes)];
  const double volume = rest[11 * lanes];
  return {volume, rest[9 * lanes] / volume, rest[10 * lanes] / volume};
}

double decisive_stress(const ElementData& elements, FractureCriterion criterion, std::span<const Vec3> rest,
                       std::span<const double> positions, std::int64_t element) {
  const RestMaterial material = rest_material(elements, element);
  const Vec3 s = signed_svd(deformation_gradient(elements, rest, positions, element)).s;
  const double volumetric = material.lambda_Pa * (s[0] + s[1] + s[2] - 3);
  const double first = 2 * material.mu_Pa * (s[0] - 1) + volumetric;
  if (criterion == FractureCriterion::tensile) return first;
  const double last = 2 * material.mu_Pa * (s[2] - 1) + volumetric;
  return std::fmax(std::fabs(first), std::fabs(last));
}

// Elements whose stress may come near their threshold: scratch.close, ascending.
void find_close(const ElementData& elements, const FractureData& data, const FractureSettings& settings,
                std::span<const double> positions, std::span<const std::uint8_t> alive,
                FractureScratch& scratch) {
  StressBoundPass pass;
  pass.nodes = elements.nodes.data();
  pass.rest = elements.rest_single.data();
  pass.positions = positions.data();
  pass.nodes_count = static_cast<std::int64_t>(positions.size() / 3);
  pass.wanted = data.wanted.data();
  pass.bounds = scratch.bounds.data();
  const auto kernel = settings.criterion == FractureCriterion::tensile ? scratch.kernels.tensile_bounds
                                                                       : scratch.kernels.absolute_bounds;
#pragma omp parallel num_threads(scratch.threads)
  {
    const int thread = omp_get_thread_num();
    const Range own = share(static_cast<std::int64_t>(data.wanted.size()), thread, scratch.threads);
    kernel(pass, own.first, own.last);
    auto& close = scratch.parts[at(thread)];
    close.clear();
    for (std::int64_t w = own.first; w < own.last; ++w) {
      const std::int64_t first = data.wanted[at(w)] * lanes;
      for (std::int64_t e = first; e < std::min(first + lanes, elements.count); ++e) {
        const bool far = scratch.bounds[at(e)] <= data.worth_a_look[at(e)];  // false for NaN
        if (!far && alive[at(e)]) close.push_back(static_cast<std::int32_t>(e));
      }
    }
  }
  scratch.close.clear();
  for (const auto& part : scratch.parts) scratch.close.insert(scratch.close.end(), part.begin(), part.end());
}

// Which of the close elements tear now.
void list_torn(const FractureData& data, const FractureSettings& settings,
               std::span<std::uint8_t> steps_above, FractureScratch& scratch, FractureReport& report) {
  scratch.removed.clear();
  std::size_t next = 0;
  for (std::size_t i = 0; i < scratch.close.size(); ++i) {
    const std::size_t element = at(scratch.close[i]);
    const double ratio = scratch.stress[i] / data.threshold[element];
    const bool above = ratio > 1;
    if (std::isfinite(ratio)) report.margin = std::fmin(report.margin, std::fabs(ratio - 1));
    bool tears = above;
    if (!steps_above.empty()) {
      while (next < element) steps_above[next++] = 0;  // what is not close is below
      next = element + 1;
      steps_above[element] =
          above ? static_cast<std::uint8_t>(std::min(steps_above[element] + 1, 255)) : std::uint8_t{0};
      tears = steps_above[element] >= settings.steps_above;
    }
    if (tears) scratch.removed.push_back(scratch.close[i]);
  }
  while (next < steps_above.size()) steps_above[next++] = 0;
}

// Elements around the removed ones that share no node with any other.
void remove_detached(const MeshStars& mesh, std::span<std::uint8_t> alive, FractureScratch& scratch) {
  const auto alone = [&](std::int32_t element) {
    for (std::int32_t node : mesh.tets[at(element)]) {
      for (std::int32_t i = mesh.start[at(node)]; i < mesh.start[at(node) + 1]; ++i) {
        const std::int32_t other = mesh.incident[at(i)] / 4;
        if (other != element && alive[at(other)]) return false;
      }
    }
    return true;
  };
  const std::size_t count = scratch.removed.size();
  for (std::size_t r = 0; r < count; ++r) {
    for (std::int32_t node : mesh.tets[at(scratch.removed[r])]) {
      for (std::int32_t i = mesh.start[at(node)]; i < mesh.start[at(node) + 1]; ++i) {
        const std::int32_t element = mesh.incident[at(i)] / 4;
        if (!alive[at(element)] || !alone(element)) continue;
        alive[at(element)] = 0;
        scratch.removed.push_back(element);
      }
    }
  }
}

}  // namespace

FractureData build_fracture_data(const ElementData& elements, std::span<const Material> materials,
                                 std::span<const std::int32_t> material_of_tet) {
  bool any = false;
  for (std::size_t m = 0; m < materials.size(); ++m) {
    const double threshold = materials[m].fracture_threshold_Pa;
    if (!(threshold > 0)) {
      throw InputError("fracture: the threshold of material " + std::to_string(m) + " is " +
                       std::to_string(threshold) +
                       " Pa; give a positive one, or none for tissue that never tears");
    }
    any = any || std::isfinite(threshold);
  }
  if (!any) {
    throw InputError(
        "fracture: no material has a threshold, so nothing can tear; give one or leave fracture out");
  }
  FractureData data;
  const std::size_t blocks = block_count(elements);
  data.threshold.resize(at(elements.count));
  data.worth_a_look.assign(blocks * at(lanes), std::numeric_limits<float>::infinity());
  for (std::int64_t e = 0; e < elements.count; ++e) {
    const double threshold = materials[at(material_of_tet[at(e)])].fracture_threshold_Pa;
    data.threshold[at(e)] = threshold;
    if (!std::isfinite(threshold)) continue;
    if (data.wanted.empty() || data.wanted.back() != e / lanes)
      data.wanted.push_back(static_cast<std::int32_t>(e / lanes));
    // the bounds hold for lambda >= 0 only
    data.worth_a_look[at(e)] = rest_material(elements, e).lambda_Pa >= 0
                                   ? static_cast<float>((1 - widest_margin) * threshold)
                                   : -std::numeric_limits<float>::infinity();
  }
  return data;
}

FractureScratch make_fracture_scratch(const ElementData& elements, const MeshStars& mesh, Isa isa,
                                      int threads) {
  FractureScratch scratch;
  scratch.bounds.assign(block_count(elements) * at(lanes), 0.0F);
  scratch.close.reserve(mesh.tets.size());
  scratch.parts.resize(at(threads));
  for (auto& part : scratch.parts) part.reserve(mesh.tets.size() / at(threads) + 2 * at(lanes));
  scratch.stress.reserve(mesh.tets.size());
  scratch.removed.reserve(mesh.tets.size());
  scratch.star = make_star_scratch(mesh);
  scratch.kernels = fracture_kernels(isa);
  scratch.threads = threads;
  return scratch;
}

FractureReport tear(const ElementData& elements, const FractureData& data, const FractureSettings& settings,
                    const MeshStars& mesh, std::span<const Vec3> rest, std::span<const double> positions,
                    std::span<std::uint8_t> alive, std::span<std::uint8_t> steps_above,
                    FractureScratch& scratch) {
  if (settings.steps_above == 1) steps_above = {};
  FractureReport report;
  find_close(elements, data, settings, positions, alive, scratch);
  scratch.stress.resize(scratch.close.size());
  const auto close = static_cast<std::int64_t>(scratch.close.size());
#pragma omp parallel for num_threads(scratch.threads) schedule(static) if (close > 64)
  for (std::int64_t i = 0; i < close; ++i) {
    scratch.stress[at(i)] =
        decisive_stress(elements, settings.criterion, rest, positions, scratch.close[at(i)]);
  }
  list_torn(data, settings, steps_above, scratch, report);
  for (std::int32_t element : scratch.removed) alive[at(element)] = 0;
  std::size_t counted = scratch.removed.size();
  report.by_criterion = static_cast<std::int32_t>(counted);
  if (settings.avoid_singularities) {
    report.passes = remove_singularities(mesh, alive, scratch.removed, scratch.star);
    report.by_avoidance = static_cast<std::int32_t>(scratch.removed.size() - counted);
    counted = scratch.removed.size();
  }
  if (settings.remove_detached) {
    remove_detached(mesh, alive, scratch);
    report.detached = static_cast<std::int32_t>(scratch.removed.size() - counted);
  }
  for (std::int32_t element : scratch.removed) {
    report.lost_volume_m3 += rest_material(elements, element).volume_m3;
    if (!steps_above.empty()) steps_above[at(element)] = 0;
  }
  return report;
}

void clear_singularities(const MeshStars& mesh, std::span<std::uint8_t> alive, FractureScratch& scratch) {
  scratch.removed.clear();
  const Singularities found = find_singularities(mesh, alive);
  if (found.vertices.empty() && found.edges.empty()) return;
  for (std::int32_t node : found.vertices)
    weaker_pieces_at_node(mesh, alive, node, scratch.star, scratch.removed);
  for (const auto& edge : found.edges)
    weaker_pieces_at_edge(mesh, alive, edge[0], edge[1], scratch.star, scratch.removed);
  std::sort(scratch.removed.begin(), scratch.removed.end());
  scratch.removed.erase(std::unique(scratch.removed.begin(), scratch.removed.end()), scratch.removed.end());
  for (std::int32_t element : scratch.removed) alive[at(element)] = 0;
  remove_singularities(mesh, alive, scratch.removed, scratch.star);
}

}  // namespace sulcus
