// Pictures of a scenario's states.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <vector>

#include "engine/mesh/surface.h"
#include "engine/scene/step.h"
#include "scenarios/loader/images.h"
#include "scenarios/loader/scenario.h"
#include "verify/png.h"

namespace sulcus {

struct ShotFrame {
  Shot shot;
  State state;
  std::vector<Vec3>
      forces;  // N, of the tissue on each tool, then on each obstacle, in the step that led there
};
std::vector<Vec3> contact_forces(const StepReport& report);

class ShotRenderer {
 public:
  ShotRenderer(const Scenario& scenario, const Scene& scene);
  Image image(const ShotFrame& frame);

 private:
  const EmbeddedSurface& surface_of(const std::vector<std::uint8_t>& alive);
  const GreyImage& grey();

  const Scenario& scenario_;
  const Scene& scene_;
  std::vector<std::uint8_t> alive_;
  std::optional<EmbeddedSurface> surface_;
  std::optional<GreyImage> grey_;
};

// Widens a range of colours by the values that a state shows, for one scale in all frames of a film. None for
// labels.
void widen_range(const Scene& scene, const State& state, const Shot& shot,
                 std::optional<std::array<double, 2>>& range);

// One PNG file each, numbered.
void render_shots(const Scenario& scenario, const Scene& scene, const std::vector<ShotFrame>& frames,
                  const std::filesystem::path& directory);

}  // namespace sulcus
