// Pictures of a scenario's states.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "engine/mesh/surface.h"
#include "engine/scene/state.h"
#include "scenarios/loader/scenario.h"
#include "verify/png.h"

namespace sulcus {

class ShotRenderer {
 public:
  ShotRenderer(const Scenario& scenario, const Scene& scene);
  Image image(const Shot& shot, const State& state);

 private:
  const EmbeddedSurface& surface_of(const std::vector<std::uint8_t>& alive);

  const Scenario& scenario_;
  const Scene& scene_;
  std::vector<std::uint8_t> alive_;
  std::optional<EmbeddedSurface> surface_;
};

struct ShotFrame {
  Shot shot;
  State state;
};
// One PNG file each, numbered.
void render_shots(const Scenario& scenario, const Scene& scene, const std::vector<ShotFrame>& frames,
                  const std::filesystem::path& directory);

}  // namespace sulcus
