// Scenario -> Scene: label map, mesh, nodes of the boundary.
#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "engine/numerics/error.h"
#include "engine/volume/label_operations.h"
#include "engine/volume/separation.h"
#include "scenarios/loader/images.h"
#include "scenarios/loader/scenario.h"

namespace sulcus {

namespace {

constexpr double border_m = 1e-9;  // m, a region's border belongs to it in spite of rounding

bool within(const Vec3& point, const Vec3& low, const Vec3& high) {
  return (point.array() >= low.array() - border_m).all() && (point.array() <= high.array() + border_m).all();
}

std::string place_of(const Scenario& scenario) {
  return scenario.path.empty() ? "scenario " + scenario.name : scenario.path.string();
}

struct ReadSource {
  LabelMap operator()(const std::filesystem::path& path) const { return read_label_map(path); }
  template <class Shape>
  LabelMap operator()(const Shape& shape) const {
    return generate(shape);
  }
};

// Gives the labelled voxels for which wanted(voxel centre, m) holds the label `to`; returns how many changed.
template <class Wanted>
std::int64_t paint(LabelMap& map, std::int32_t to, Wanted&& wanted) {
  std::int64_t changed = 0;
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        std::int32_t& label = map.labels[map.index(i, j, k)];
        if (label == 0 || label == to || !wanted(map.to_world(Vec3(i, j, k)))) continue;
        label = to;
        ++changed;
      }
    }
  }
  return changed;
}

// Does an operation; returns the number of voxels that it changed.
struct Operate {
  LabelMap& map;
  const SeparationPairs& pairs;

  std::int64_t operator()(const FillVoidsOperation&) const { return fill_voids(map); }
  std::int64_t operator()(const CropOperation& crop) const {
    return crop_to_content(map, crop.margin_voxels);
  }
  std::int64_t operator()(const DropPiecesOperation& drop) const {
    const double voxels =
        std::ceil(drop.below_m3 / (map.spacing[0] * map.spacing[1] * map.spacing[2]) - 1e-9);
    return drop_small_pieces(map, pairs, std::max(drop.below_voxels, static_cast<std::int64_t>(voxels)));
  }
  std::int64_t operator()(const RelabelOperation& relabel) const {
    return relabel.to == 0 ? drop_labels(map, relabel.from) : merge_labels(map, relabel.from, relabel.to);
  }
  std::int64_t operator()(const KeepLabelsOperation& keep) const { return keep_labels(map, keep.labels); }
  std::int64_t operator()(const KeepBoxOperation& box) const {
    return paint(map, 0, [&](const Vec3& centre) { return !within(centre, box.min_m, box.max_m); });
  }
  std::int64_t operator()(const PaintBoxOperation& box) const {
    return paint(map, box.label, [&](const Vec3& centre) { return within(centre, box.min_m, box.max_m); });
  }

  std::int64_t operator()(const SpeckleOperation& speckle) const {
    std::mt19937_64 random(speckle.seed);
    std::int64_t changed = 0;
    for (std::int32_t& label : map.labels) {
      if (label == 0) continue;
      const double drawn = static_cast<double>(random() >> 11) * 0x1p-53;  // [0, 1)
      const std::int32_t to = speckle.to[random() % speckle.to.size()];
      if (!(drawn < speckle.share) || label == to) continue;
      label = to;
      ++changed;
    }
    return changed;
  }

  // Grows from the voxels at the faces of pairs, a voxel at a time, within the labelled ones.
  std::int64_t operator()(const LayerOperation& layer) const {
    const std::array<int, 3> step = {1, map.size[0], map.size[0] * map.size[1]};
    const std::vector<std::int32_t>& labels = map.labels;
    std::vector<std::uint8_t> chosen(labels.size(), 0);
    const auto for_faces = [&](auto&& visit) {
      for (int k = 0; k < map.size[2]; ++k) {
        for (int j = 0; j < map.size[1]; ++j) {
          for (int i = 0; i < map.size[0]; ++i) {
            const Index3 at{i, j, k};
            const std::size_t voxel = map.index(i, j, k);
            for (std::size_t axis = 0; axis < 3; ++axis) {
              if (at[axis] + 1 < map.size[axis]) visit(voxel, voxel + static_cast<std::size_t>(step[axis]));
            }
          }
        }
      }
    };
    for_faces([&](std::size_t a, std::size_t b) {
      if (labels[a] != 0 && labels[b] != 0 && labels[a] != labels[b] && pairs.contains(labels[a], labels[b]))
        chosen[a] = chosen[b] = 1;
    });
    for (int round = 1; round < layer.voxels; ++round) {
      const std::vector<std::uint8_t> inner = chosen;
      for_faces([&](std::size_t a, std::size_t b) {
        if (inner[a] != inner[b] && labels[a] != 0 && labels[b] != 0) chosen[a] = chosen[b] = 1;
      });
    }
    std::int64_t changed = 0;
    for (std::size_t v = 0; v < chosen.size(); ++v) {
      if (!chosen[v] || map.labels[v] == layer.label) continue;
      map.labels[v] = layer.label;
      ++changed;
    }
    return changed;
  }
};

// Numbers of the nodes in a region, ascending.
std::vector<std::int32_t> nodes_in(const NodeRegion& region, const EmbeddingMesh& mesh,
                                   const Scenario& scenario) {
  std::vector<std::int32_t> nodes;
  Vec3 low = mesh.rest_positions.front(), high = low;
  for (std::size_t node = 0; node < mesh.rest_positions.size(); ++node) {
    const Vec3& position = mesh.rest_positions[node];
    low = low.cwiseMin(position);
    high = high.cwiseMax(position);
    if (within(position, region.min_m, region.max_m)) nodes.push_back(static_cast<std::int32_t>(node));
  }
  if (!region.labels.empty()) {
    std::vector<std::uint8_t> of_label(mesh.rest_positions.size(), 0);
    for (std::size_t cell = 0; cell < mesh.cell_nodes.size(); ++cell) {
      if (std::find(region.labels.begin(), region.labels.end(), mesh.cell_label[cell]) == region.labels.end())
        continue;
      for (const std::int32_t node : mesh.cell_nodes[cell]) of_label[static_cast<std::size_t>(node)] = 1;
    }
    std::erase_if(nodes, [&](std::int32_t node) { return !of_label[static_cast<std::size_t>(node)]; });
  }
  if (nodes.empty()) {
    std::string extent;
    for (int axis = 0; axis < 3; ++axis) {
      extent += std::string(axis == 0 ? "" : ", ") + "xyz"[axis] + " " +
                std::to_string(std::lround(low[axis] * 1000)) + " .. " +
                std::to_string(std::lround(high[axis] * 1000));
    }
    throw InputError(place_of(scenario) + ": " + region.place + ": no node of the mesh lies in this region" +
                     (region.labels.empty() ? "" : " and belongs to its labels") + "; the mesh reaches " +
                     extent + " mm");
  }
  return nodes;
}

// Over the nodes of a region by the number of cells around each: on a plane face of the grid that is by area.
void spread_force(const ForceRegion& load, const EmbeddingMesh& mesh, const Scenario& scenario,
                  SceneDescription& description) {
  std::vector<double> cells(mesh.rest_positions.size(), 0.0);
  for (const auto& nodes : mesh.cell_nodes) {
    for (const std::int32_t node : nodes) cells[static_cast<std::size_t>(node)] += 1;
  }
  const std::vector<std::int32_t> nodes = nodes_in(load.nodes, mesh, scenario);
  double sum = 0;
  for (const std::int32_t node : nodes) sum += cells[static_cast<std::size_t>(node)];
  for (const std::int32_t node : nodes)
    description.forces.push_back({node, load.force_N * (cells[static_cast<std::size_t>(node)] / sum)});
}

void hold_nodes(const Scenario& scenario, const EmbeddingMesh& mesh, SceneDescription& description,
                std::vector<std::string>& warnings) {
  std::vector<std::uint8_t> fixed(mesh.rest_positions.size(), 0);
  for (const NodeRegion& region : scenario.fixed) {
    for (const std::int32_t node : nodes_in(region, mesh, scenario))
      fixed[static_cast<std::size_t>(node)] = 1;
  }
  for (std::size_t node = 0; node < fixed.size(); ++node) {
    if (fixed[node]) description.fixed_nodes.push_back(static_cast<std::int32_t>(node));
  }
  std::vector<std::uint8_t> sprung(fixed.size(), 0);
  for (const SpringRegion& springs : scenario.springs) {
    std::size_t held = 0, twice = 0;
    for (const std::int32_t node : nodes_in(springs.nodes, mesh, scenario)) {
      const auto at = static_cast<std::size_t>(node);
      held += fixed[at];
      twice += sprung[at];
      if (fixed[at] || sprung[at]) continue;
      sprung[at] = 1;
      description.springs.push_back({node, springs.stiffness_N_m, springs.damping_N_s_m});
    }
    if (held > 0)
      warnings.push_back(springs.nodes.place + ": " + std::to_string(held) + " nodes are fixed anyway");
    if (twice > 0) {
      warnings.push_back(springs.nodes.place + ": " + std::to_string(twice) +
                         " nodes have a spring of an earlier region, which stays");
    }
  }
  for (const ForceRegion& load : scenario.forces) spread_force(load, mesh, scenario, description);
  std::set<std::pair<std::int32_t, int>> kept;  // node and axis
  for (std::size_t p = 0; p < scenario.planes.size(); ++p) {
    const PlaneRegion& plane = scenario.planes[p];
    for (const std::int32_t node : nodes_in(plane.nodes, mesh, scenario)) {
      if (kept.insert({node, plane.axis}).second)
        description.sliding.push_back({node, plane.axis, static_cast<std::int32_t>(p)});
    }
  }
  for (const MotionRegion& region : scenario.motions) {
    PrescribedMotion motion{region.name, {}, region.centre_m, {}};
    std::size_t held = 0;
    for (const std::int32_t node : nodes_in(region.nodes, mesh, scenario)) {
      std::uint8_t& taken = fixed[static_cast<std::size_t>(node)];
      held += taken;
      if (!taken) motion.nodes.push_back(node);
      taken = 1;
    }
    if (held > 0) {
      warnings.push_back(region.nodes.place + ": " + std::to_string(held) +
                         " nodes are fixed, or moved by an earlier region, which stays");
    }
    const ScriptedPath path(region.script);
    for (std::int64_t n = 0; n <= scenario.steps(); ++n) {
      const HandMotion at = path.at(static_cast<double>(n) * scenario.scene.step_s);
      motion.path.push_back({at.position, at.orientation});
    }
    description.motions.push_back(std::move(motion));
  }
  if (description.fixed_nodes.empty() && description.springs.empty() && description.motions.empty() &&
      description.obstacles.empty()) {
    warnings.push_back("/boundary: nothing holds the tissue; it will float");
  }
}

// Nodes that are fixed or on a path start at rest, all others where the deformation takes them.
void deform(const InitialDeformation& initial, const EmbeddingMesh& mesh, SceneDescription& description) {
  std::vector<Vec3>& start = description.start_positions;
  for (const Vec3& rest : mesh.rest_positions)
    start.push_back(initial.centre_m + initial.gradient * (rest - initial.centre_m));
  const auto stay = [&](std::int32_t node) {
    start[static_cast<std::size_t>(node)] = mesh.rest_positions[static_cast<std::size_t>(node)];
  };
  for (const std::int32_t node : description.fixed_nodes) stay(node);
  for (const PrescribedMotion& motion : description.motions) {
    for (const std::int32_t node : motion.nodes) stay(node);
  }
}

// Cells with any voxel of a prevailing label are made of it, of the first such label in ascending order.
void prefer_labels(const LabelMap& map, std::vector<std::int32_t> labels, EmbeddingMesh& mesh) {
  std::sort(labels.rbegin(), labels.rend());
  for (const std::int32_t label : labels) {
    for (std::size_t v = 0; v < map.labels.size(); ++v) {
      const std::int32_t cell = mesh.cell_of_voxel[v];
      if (map.labels[v] == label && cell >= 0) mesh.cell_label[static_cast<std::size_t>(cell)] = label;
    }
  }
}

// Pairs of labels whose voxels share a face, smaller first.
std::set<std::pair<std::int32_t, std::int32_t>> touching_labels(const LabelMap& map) {
  std::set<std::pair<std::int32_t, std::int32_t>> touching;
  const std::size_t row = static_cast<std::size_t>(map.size[0]);
  const std::size_t slice = row * static_cast<std::size_t>(map.size[1]);
  for (int k = 0; k < map.size[2]; ++k) {
    for (int j = 0; j < map.size[1]; ++j) {
      for (int i = 0; i < map.size[0]; ++i) {
        const std::size_t at = map.index(i, j, k);
        const auto meet = [&](bool there, std::size_t other) {
          if (!there || map.labels[at] == map.labels[other]) return;
          touching.insert(std::minmax(map.labels[at], map.labels[other]));
        };
        meet(i + 1 < map.size[0], at + 1);
        meet(j + 1 < map.size[1], at + row);
        meet(k + 1 < map.size[2], at + slice);
      }
    }
  }
  return touching;
}

void check_labels(const Scenario& scenario, const LabelMap& map, std::vector<std::string>& warnings) {
  const std::set<std::int32_t> present(map.labels.begin(), map.labels.end());
  const auto touching = touching_labels(map);
  const bool filled =  // then the labels of pairs are apart on purpose
      std::any_of(scenario.map_operations.begin(), scenario.map_operations.end(),
                  [](const LabelOperation& o) { return std::holds_alternative<LayerOperation>(o); });
  for (const auto& [a, b] : scenario.scene.pairs.pairs) {
    const std::string pair = "/separation_pairs: [" + std::to_string(a) + ", " + std::to_string(b) + "]";
    if (present.count(a) == 0 || present.count(b) == 0) {
      const std::int32_t absent = present.count(a) == 0 ? a : b;
      warnings.push_back(pair + ": the label map has no voxel of label " + std::to_string(absent));
    } else if (touching.count({a, b}) == 0 && !filled) {
      warnings.push_back(pair + ": these labels touch nowhere");
    }
  }
  for (const auto& entry : scenario.scene.materials) {
    if (present.count(entry.first) == 0) {
      warnings.push_back("/tissue/labels/" + std::to_string(entry.first) +
                         ": the label map has no such voxel");
    }
  }
  for (const auto& entry : scenario.label_colours) {
    if (present.count(entry.first) == 0) {
      warnings.push_back("/label_colours/" + std::to_string(entry.first) +
                         ": the label map has no such voxel");
    }
  }
}

// A tool that starts inside the tissue is pushed out at once.
void check_tool_starts(const Scenario& scenario, const LabelMap& map, std::vector<std::string>& warnings) {
  for (std::size_t number = 0; number < scenario.scene.tools.size(); ++number) {
    if (scenario.hands[number].script.waypoints.empty()) continue;  // a recording that was not read
    const Waypoint& start = scenario.hands[number].script.waypoints.front();
    const Mat3 rotation = rotation_matrix(start.orientation);
    std::size_t inside = 0;
    for (const Vec3& vertex : scenario.scene.tools[number].surface.vertices) {
      const Vec3 voxel = map.to_voxel(start.position_m + rotation * vertex);
      Index3 at{};
      bool within = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double nearest = std::floor(voxel[static_cast<Eigen::Index>(axis)] + 0.5);
        within = within && nearest >= 0 && nearest < map.size[axis];
        if (within) at[axis] = static_cast<int>(nearest);
      }
      inside += within && map.labels[map.index(at[0], at[1], at[2])] != 0;
    }
    if (inside > 0) {
      warnings.push_back("/tools/" + std::to_string(number) + ": " + std::to_string(inside) +
                         " of its vertices start inside the tissue");
    }
  }
}

}  // namespace

LabelMap load_label_map(const Scenario& scenario, std::vector<std::string>* notes) {
  LabelMap map = std::visit(ReadSource{}, scenario.map_source);
  for (const LabelOperation& operation : scenario.map_operations) {
    const std::int64_t changed = std::visit(Operate{map, scenario.scene.pairs}, operation);
    if (notes == nullptr) continue;
    static constexpr std::array names = {"relabel",           "keep_labels",         "keep_box_mm",
                                         "paint_box_mm",      "layer_between_pairs", "fill_voids",
                                         "drop_pieces_below", "crop_to_content",     "speckle"};
    notes->push_back(std::string("label map: ") + names[operation.index()] + " changed " +
                     std::to_string(changed) + " voxels");
  }
  if (std::all_of(map.labels.begin(), map.labels.end(), [](std::int32_t label) { return label == 0; })) {
    throw InputError(place_of(scenario) + ": /label_map/operations: they leave no labelled voxel");
  }
  return map;
}

Scene make_scene(const Scenario& scenario, std::vector<std::string>* warnings,
                 std::vector<std::string>* notes) {
  std::vector<std::string> unheard;
  std::vector<std::string>& told = warnings != nullptr ? *warnings : unheard;
  SceneDescription description = scenario.scene;
  description.map = load_label_map(scenario, notes);
  check_labels(scenario, description.map, told);
  check_tool_starts(scenario, description.map, told);
  EmbeddingMesh mesh = build_embedding(description.map, description.pairs, description.embedding);
  if (!scenario.prevailing_labels.empty()) prefer_labels(description.map, scenario.prevailing_labels, mesh);
  hold_nodes(scenario, mesh, description, told);
  if (scenario.initial) deform(*scenario.initial, mesh, description);
  return build_scene(std::move(description), std::move(mesh));
}

}  // namespace sulcus
