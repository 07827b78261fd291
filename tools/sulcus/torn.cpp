#include "tools/sulcus/torn.h"

#include <algorithm>
#include <cstdio>
#include <map>

#include "engine/fracture/hanging.h"
#include "engine/mesh/resample.h"
#include "engine/mesh/topology.h"

namespace sulcus {
namespace {

void warn(const std::string& text, RunWriter& writer) {
  writer.add_warning(text);
  std::fprintf(stderr, "warning: %s\n", text.c_str());
}

// Pieces that nothing holds any more: they float, or fall where there is gravity.
void warn_of_loose_pieces(const Scene& scene, const Pieces& pieces, RunWriter& writer) {
  std::vector<std::uint8_t> held(pieces.item_count.size(), 0), springs(scene.free_node.size(), 0);
  for (const NodeSpring& spring : scene.settings.springs) springs[static_cast<std::size_t>(spring.node)] = 1;
  for (std::size_t t = 0; t < scene.mesh.tets.size(); ++t) {
    if (pieces.piece[t] < 0) continue;
    for (const std::int32_t node : scene.mesh.tets[t]) {
      const auto n = static_cast<std::size_t>(node);
      if (!scene.free_node[n] || springs[n]) held[static_cast<std::size_t>(pieces.piece[t])] = 1;
    }
  }
  std::int64_t loose = 0, elements = 0;
  for (std::size_t p = 0; p < held.size(); ++p) {
    loose += !held[p];
    if (!held[p]) elements += pieces.item_count[p];
  }
  writer.set_number("loose_pieces_at_end", static_cast<double>(loose));
  if (loose > 0) {
    warn(std::to_string(loose) + " torn-off pieces of together " + std::to_string(elements) +
             " elements are held by nothing at the end and float",
         writer);
  }
}

}  // namespace

void record_torn(const Scene& scene, const State& state, const HangingRecord& hanging, RunWriter& writer) {
  std::map<std::int32_t, std::int64_t> torn;
  for (const std::int32_t label : scene.mesh.cell_label) torn[label];
  for (std::size_t t = 0; t < state.alive.size(); ++t) {
    const auto cell = t / static_cast<std::size_t>(scene.mesh.tets_per_cell);
    if (!state.alive[t]) ++torn[scene.mesh.cell_label[cell]];
  }
  for (const auto& [label, count] : torn)
    writer.set_number("torn/label_" + std::to_string(label), static_cast<double>(count));
  const LabelMap left = without_torn_voxels(scene.settings.map, scene.mesh, state.alive);
  std::int64_t voxels = 0;
  for (std::size_t v = 0; v < left.labels.size(); ++v)
    voxels += left.labels[v] != scene.settings.map.labels[v];
  writer.set_number("torn_voxels", static_cast<double>(voxels));
  const Pieces pieces = mesh_pieces(scene.mesh.tets, scene.node_count(), state.alive);
  writer.set_number("mesh_pieces_at_end", static_cast<double>(pieces.item_count.size()));
  if (std::count(state.alive.begin(), state.alive.end(), 1) == 0) {
    warn("the whole tissue is torn: raise the thresholds, or shorten the pull", writer);
  }
  warn_of_loose_pieces(scene, pieces, writer);
  writer.set_number("hanging/most_elements", static_cast<double>(hanging.most_elements));
  writer.set_number("hanging/peak_kinetic_energy_J", hanging.peak_kinetic_energy_J);
  writer.set_number("hanging/kinetic_energy_at_end_J", hanging.kinetic_energy_at_end_J);
}

void look_at_hanging(const Scene& scene, const State& state, HangingRecord& record) {
  if (record.faces.across.empty()) record.faces = face_neighbours(scene.mesh.tets);
  std::vector<std::uint8_t> held(scene.free_node.size());
  for (std::size_t n = 0; n < held.size(); ++n) held[n] = !scene.free_node[n];
  for (const NodeSpring& spring : scene.settings.springs) held[static_cast<std::size_t>(spring.node)] = 1;
  const auto hanging = hanging_elements(scene.mesh.tets, record.faces, state.alive, held);
  double energy = 0;
  for (const std::int32_t element : hanging) {
    for (const std::int32_t node : scene.mesh.tets[static_cast<std::size_t>(element)]) {
      const auto n = static_cast<std::size_t>(node);
      // the share of the node's mass that is this element's: all of its elements weigh about the same
      const double share = 1.0 / (scene.elements.incident_start[n + 1] - scene.elements.incident_start[n]);
      energy += 0.5 * share * scene.elements.node_mass[n] * node_vector(state.velocities, node).squaredNorm();
    }
  }
  record.most_elements = std::max(record.most_elements, static_cast<std::int64_t>(hanging.size()));
  record.peak_kinetic_energy_J = std::max(record.peak_kinetic_energy_J, energy);
  record.kinetic_energy_at_end_J = energy;
}

}  // namespace sulcus
