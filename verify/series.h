// Looking into the series of a recording. Private to this room.
#pragma once

#include "verify/recording.h"

namespace sulcus {

// A recorded series of the right size, or nullptr.
inline const Series* series_of(const RunData& run, const std::string& name, int components) {
  const Series* series = run.find(name);
  const auto size = static_cast<std::size_t>(run.steps * components);
  return series != nullptr && series->components == components && series->values.size() == size ? series
                                                                                                : nullptr;
}

inline Vec3 vector_at(const Series& series, std::int64_t step) {
  const double* v = &series.values[static_cast<std::size_t>(3 * step)];
  return {v[0], v[1], v[2]};
}

}  // namespace sulcus
