#include "tools/sulcus/fuzz_scenario.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

namespace sulcus {
namespace {

using Json = nlohmann::ordered_json;

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}
  double share() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }  // [0, 1)
  double between(double low, double high) { return round(low + (high - low) * share(), 1e-4); }
  int whole(int low, int high) { return low + static_cast<int>(share() * (high - low + 1)); }
  bool chance(double of) { return share() < of; }
  // Standard normal, nearly: the sum of twelve.
  double normal() {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += share();
    return sum;
  }
  static double round(double value, double to) { return std::round(value / to) * to; }

 private:
  std::mt19937_64 engine_;
};

constexpr double step_s = 0.02, wander_s = 1.2, leave_s = 1.6, end_s = 2.6;

Json tissue(Dice& dice, int labels, bool tears) {
  const auto material = [&] {
    Json m = {{"youngs_modulus_Pa", dice.between(300, 5000)},
              {"poisson_ratio", dice.between(0.1, 0.48)},
              {"density_kg_m3", dice.between(900, 1100)}};
    if (tears && dice.chance(0.5)) m["fracture_threshold_Pa"] = dice.between(60, 600);
    return m;
  };
  Json tissue = {{"default", material()},
                 {"rayleigh_alpha_1_s", dice.between(0, 2)},
                 {"rayleigh_beta_s", dice.between(0.02, 0.15)}};
  for (int label = 2; label <= labels; ++label) {
    if (dice.chance(0.6)) tissue["labels"][std::to_string(label)] = material();
  }
  if (tears && !tissue["default"].contains("fracture_threshold_Pa"))
    tissue["default"]["fracture_threshold_Pa"] = dice.between(60, 600);
  return tissue;
}

// The map: a block with boxes of other labels, and a few holes below its surface.
Json label_map(Dice& dice, const double size[3], double voxel, int labels) {
  Json operations = Json::array();
  for (int box = dice.whole(1, 6); box > 0; --box) {
    Json low = Json::array(), high = Json::array();
    const bool hole = dice.chance(0.2);
    for (int axis = 0; axis < 3; ++axis) {
      const double width = dice.between(0.2, 0.7) * size[axis], half = 0.5 * size[axis];
      double from = dice.between(-half, half - width);
      if (hole && axis == 2) from = -half;  // open below, so that the hand always finds something
      low.push_back(from);
      high.push_back(from + (hole && axis == 2 ? 0.5 * width : width));
    }
    operations.push_back(
        {{"paint_box_mm", {{"min", low}, {"max", high}, {"label", hole ? 0 : dice.whole(1, labels)}}}});
  }
  operations.push_back({{"drop_pieces_below", {{"voxels", 30}}}});
  return {{"generate",
           {{"box", {{"size_mm", {size[0], size[1], size[2]}}, {"voxel_size_mm", voxel}, {"label", 1}}}}},
          {"operations", operations}};
}

// A hand that wanders about a point in the tissue, then leaves and rests.
Json way(Dice& dice, const double size[3], double away_mm) {
  const double pull_1_s = dice.between(1, 6), noise_mm = dice.between(5, 40);
  const double home[3] = {dice.between(-0.25, 0.25) * size[0], dice.between(-0.25, 0.25) * size[1],
                          0.5 * size[2] + away_mm};
  double at[3] = {home[0], home[1], home[2]};
  const double target[3] = {home[0], home[1], home[2] - away_mm - dice.between(1, 6)};
  const double coarse_mm = dice.chance(0.3) ? dice.between(0.05, 1) : 1e-3;  // steps of an encoder
  Json points = Json::array({{{"time_s", 0},
                              {"position_mm", {home[0], home[1], home[2]}},
                              {"axis", {dice.between(-1, 1), dice.between(-1, 1), 1.5}},
                              {"angle_deg", dice.between(-180, 180)}}});
  int stuck = 0;
  for (int n = 1; n * 2 * step_s <= wander_s; ++n) {
    const double h = 2 * step_s;
    for (int axis = 0; axis < 3; ++axis)
      at[axis] += pull_1_s * h * (target[axis] - at[axis]) + noise_mm * std::sqrt(h) * 0.3 * dice.normal();
    if (stuck == 0 && dice.chance(0.06))
      stuck = dice.whole(1, 6);  // lost samples: the old one stays, then it jumps
    if (stuck > 0) {
      --stuck;
      continue;
    }
    Json position = Json::array();
    for (const double x : at) position.push_back(Dice::round(x, coarse_mm));
    points.push_back({{"time_s", n * h}, {"position_mm", position}, {"path", "linear"}});
  }
  points.push_back({{"time_s", leave_s}, {"position_mm", {home[0], home[1], home[2] + 10}}});
  points.push_back({{"time_s", end_s}, {"path", "hold"}});
  return {{"scripted", {{"waypoints", points}}}};
}

}  // namespace

std::string fuzz_scenario(std::uint64_t seed) {
  Dice dice(seed);
  const double voxel = dice.chance(0.5) ? 2 : 2.5;
  double size[3];
  for (double& edge : size) edge = voxel * dice.whole(12, 24);
  const int labels = dice.whole(1, 4);
  const bool tears = dice.chance(0.3), ball = dice.chance(0.6);

  Json scenario;
  scenario["sulcus"] = 1;
  scenario["name"] = "fuzz_" + std::to_string(seed);
  scenario["title"] = "Random scenario " + std::to_string(seed);
  scenario["description"] =
      "Made by `sulcus fuzz` from seed " + std::to_string(seed) + "; judged by statements only.";
  scenario["label_map"] = label_map(dice, size, voxel, labels);
  Json pairs = Json::array();
  for (int a = 1; a <= labels; ++a) {
    for (int b = a + 1; b <= labels; ++b) {
      if (dice.chance(0.4)) pairs.push_back({a, b});
    }
  }
  scenario["separation_pairs"] = pairs;
  scenario["mesh"] = {{"size_mm", dice.between(7, 16)},
                      {"split", dice.chance(0.5) ? "five" : "six"},
                      {"min_island_cells", 2}};
  scenario["tissue"] = tissue(dice, labels, tears);
  if (tears) {
    scenario["fracture"] = {{"criterion", dice.chance(0.5) ? "tensile" : "largest_absolute"},
                            {"steps_above", dice.whole(1, 4)}};
  }
  scenario["boundary"]["fixed"] = {
      {{"below_mm", {{"axis", "z"}, {"value", -0.5 * size[2] + 0.25 * size[2]}}}}};
  const double radius = dice.between(4, 9);
  Json tool;
  tool["name"] = "tool";
  if (ball) {
    tool["shape"] = {{"sphere", {{"radius_mm", radius}, {"subdivisions", dice.whole(1, 3)}}}};
  } else {
    tool["shape"] = {{"box", {{"size_mm", {radius, 2 * radius, 2 * radius}}}}};
  }
  tool["output_filter_Hz"] = dice.between(2, 30);
  tool["device"] = way(dice, size, 2 * radius + 4);
  scenario["tools"] = Json::array({tool});
  scenario["contact"] = {{"stiffness_N_m", dice.between(0.5, 20)},
                         {"damping_N_s_m", dice.between(0, 0.2)},
                         {"anisotropy", dice.chance(0.5) ? 1 : 0},
                         {"tension_rule", true}};
  if (scenario.contains("fracture") || dice.chance(0.25)) scenario["contact"]["detection"] = "surface_nodes";
  scenario["time"] = {{"step_s", step_s}, {"duration_s", end_s}};
  scenario["solver"] = {{"precision", dice.chance(0.7) ? "single" : "double"}, {"tolerance", 1e-3}};
  scenario["record"] = {{"frame_every_steps", 10}, {"energy_ledger", true}};
  return scenario.dump(1) + "\n";
}

}  // namespace sulcus
