// A scenario that runs in no time, for the tests of sessions.
#pragma once

namespace sulcus::test {

// A block of 40 mm and a ball that is pressed into it, 0.6 s in steps of 10 ms.
inline constexpr const char* tiny_scenario = R"({
  "sulcus": 1, "name": "tiny",
  "label_map": {"generate": {"box": {"size_mm": [40, 40, 40], "voxel_size_mm": 5}}},
  "mesh": {"size_mm": 20},
  "boundary": {"fixed": [{"below_mm": {"axis": "z", "value": -15}}]},
  "tools": [{"name": "ball", "shape": {"sphere": {"radius_mm": 5, "subdivisions": 1}}, "output_filter_Hz": 10,
    "device": {"scripted": {"waypoints": [
      {"time_s": 0, "position_mm": [0, 0, 27]}, {"time_s": 0.3, "position_mm": [1, 2, 20]},
      {"time_s": 0.6, "position_mm": [0, 0, 27]}]}}}],
  "time": {"step_s": 0.01, "duration_s": 0.6},
  "record": {"frame_every_steps": 5}
})";

}  // namespace sulcus::test
