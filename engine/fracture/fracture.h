// Fracture by removing elements (thesis 3.5): criterion, removal, and the removal of hinges that follows it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/fem/elements.h"
#include "engine/fracture/kernels.h"
#include "engine/fracture/singularity.h"

namespace sulcus {

// Principal stresses sigma_1 >= sigma_2 >= sigma_3 of the corotated stress (equations.md 2.4) against the
// threshold of the element's material (Material::fracture_threshold_Pa).
enum class FractureCriterion {
  tensile,           // sigma_1 > threshold
  largest_absolute,  // max |sigma_i| > threshold: the thesis' wording (3.29); tears under pressure too
};

struct FractureSettings {
  FractureCriterion criterion = FractureCriterion::tensile;
  int steps_above = 1;  // an element tears after so many steps in a row above its threshold, 1..255
  bool avoid_singularities = true;  // false: hinges stay, to show what they do (thesis Fig. 3.12 b)
  bool remove_detached = false;     // single elements that touch no other go too
};

// What never changes. Made for scenes that fracture only.
struct FractureData {
  std::vector<double> threshold;     // [tets], Pa; infinite: never tears
  std::vector<float> worth_a_look;   // [16*blocks] bound above which the stress itself is computed, Pa
  std::vector<std::int32_t> wanted;  // blocks of 16 elements of which any can tear, ascending
};

// materials, material_of_tet: as for build_elements. Throws InputError for a threshold that is not above zero
// (NaN included), naming the material by its number, or if no material can tear.
FractureData build_fracture_data(const ElementData& elements, std::span<const Material> materials,
                                 std::span<const std::int32_t> material_of_tet);

inline constexpr double widest_margin = 0.1;

struct FractureReport {
  std::int32_t by_criterion = 0;  // elements removed because of their stress
  std::int32_t by_avoidance = 0;  // ... because they hung on a singular vertex or edge
  std::int32_t detached = 0;      // ... because they touched no other
  std::int32_t passes = 0;        // of singularity avoidance that removed something
  double margin = widest_margin;  // smallest |stress / threshold - 1| of the elements that were present, at
                                  // most widest_margin: below it a rounding could have changed the decision
  double lost_volume_m3 = 0;      // m^3, rest volume of the elements removed now
};

// Scratch; its content has no meaning between calls.
struct FractureScratch {
  std::vector<float> bounds;                     // [16*blocks]
  std::vector<std::vector<std::int32_t>> parts;  // [threads] elements whose stress is computed
  std::vector<std::int32_t> close;               // the same, one behind the other
  std::vector<double> stress;                    // of these
  std::vector<std::int32_t> removed;
  StarScratch star;
  FractureKernels kernels;
  int threads = 1;
};
FractureScratch make_fracture_scratch(const ElementData& elements, const MeshStars& mesh, Isa isa,
                                      int threads);

// Removes from `alive` [tets] what tears in the state of `positions` [3*nodes] and what then hangs on hinges;
// scratch.removed lists it: by criterion, by avoidance, detached. steps_above: [tets], counters of the
// hysteresis; left alone where settings.steps_above is 1. A stress that is not finite tears nothing. Does not
// allocate. Cost: a pass over the elements that can tear, an SVD for those near their threshold.
FractureReport tear(const ElementData& elements, const FractureData& data, const FractureSettings& settings,
                    const MeshStars& mesh, std::span<const Vec3> rest, std::span<const double> positions,
                    std::span<std::uint8_t> alive, std::span<std::uint8_t> steps_above,
                    FractureScratch& scratch);

// Removes the singular vertices and edges that the mesh has before anything tears (cells that touch by an
// edge only); lists what it removed in scratch.removed.
void clear_singularities(const MeshStars& mesh, std::span<std::uint8_t> alive, FractureScratch& scratch);

}  // namespace sulcus
