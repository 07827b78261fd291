// What single precision costs: for reports.
#pragma once

#include <span>

#include "engine/device/device.h"
#include "engine/scene/scene.h"
#include "engine/scene/state.h"

namespace sulcus {

// Relative difference, as measure_solver_error measures it (step.h), between the velocity increments of the
// coming step with matrix and Krylov vectors in single precision, solved to 1e-6, and in double, solved to
// 1e-10. 0 for scenes in double precision. Leaves the state alone. Slow.
double measure_precision_error(const Scene& scene, std::span<const DeviceSample> samples, const State& state,
                               int threads);

}  // namespace sulcus
