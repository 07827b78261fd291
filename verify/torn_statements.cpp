#include "verify/torn_statements.h"

#include <algorithm>
#include <cmath>

#include "engine/fracture/singularity.h"
#include "engine/mesh/topology.h"

namespace sulcus {
namespace {

const std::string statement = "statement";

std::string at_step(std::int64_t step) {
  return "at step " + std::to_string(step);
}

// The number of elements present falls from step to step, and frames lose elements only.
Check check_torn_stays_torn(const RunData& run) {
  const std::string name = "torn_stays_torn";
  const Series* present = run.find("tissue/alive_tets");
  if (present == nullptr) return failed_check(name, statement, "series tissue/alive_tets is not recorded");
  std::int64_t compared = 0, returned = 0;
  std::string first;
  for (std::size_t n = 1; n < present->values.size(); ++n) {
    ++compared;
    if (present->values[n] <= present->values[n - 1]) continue;
    if (returned++ == 0) first = at_step(static_cast<std::int64_t>(n));
  }
  for (std::size_t f = 1; f < run.frames.size(); ++f) {
    const auto &before = run.frames[f - 1].alive, &now = run.frames[f].alive;
    ++compared;
    for (std::size_t t = 0; t < std::min(before.size(), now.size()); ++t) {
      if (before[t] || !now[t]) continue;
      if (returned++ == 0) first = "element " + std::to_string(t) + " " + at_step(run.frames[f].step);
    }
  }
  return check_at_most(name, statement, static_cast<double>(returned), 0, "", compared,
                       returned > 0 ? "first: " + first : "elements that came back");
}

Check check_manifold(const RunData& run) {
  const std::string name = "manifold";
  const auto tets = static_cast<std::size_t>(run.header.tet_count());
  std::vector<std::array<std::int32_t, 4>> elements(tets);
  for (std::size_t t = 0; t < tets; ++t) std::copy_n(&run.header.tets[4 * t], 4, elements[t].begin());
  const NodeStars around = build_node_stars(elements, run.header.node_count());
  const MeshStars mesh{elements, around.start, around.incident};
  std::size_t singular = 0;
  std::string first;
  for (const Frame& frame : run.frames) {
    const Singularities found = find_singularities(mesh, frame.alive);
    if (singular == 0 && !found.vertices.empty()) {
      first = "vertex " + std::to_string(found.vertices.front()) + " " + at_step(frame.step);
    } else if (singular == 0 && !found.edges.empty()) {
      first = "edge " + std::to_string(found.edges.front()[0]) + "-" +
              std::to_string(found.edges.front()[1]) + " " + at_step(frame.step);
    }
    singular += found.vertices.size() + found.edges.size();
  }
  return check_at_most(name, statement, static_cast<double>(singular), 0, "",
                       static_cast<std::int64_t>(run.frames.size()),
                       singular > 0 ? "first: " + first : "singular vertices and edges over all frames");
}

}  // namespace

std::vector<Check> check_torn(const RunData& run, const TornBounds& bounds) {
  std::vector<Check> checks{check_torn_stays_torn(run)};
  if (bounds.manifold) checks.push_back(check_manifold(run));
  const double torn = static_cast<double>(
      std::count(run.final_state.alive.begin(), run.final_state.alive.end(), std::uint8_t{0}));
  const auto elements = static_cast<std::int64_t>(run.final_state.alive.size());
  if (bounds.min_elements) {
    checks.push_back(check_at_least("torn_elements_at_least", statement, torn,
                                    static_cast<double>(*bounds.min_elements), "", elements, "at the end"));
  }
  if (bounds.max_elements) {
    checks.push_back(check_at_most("torn_elements_at_most", statement, torn,
                                   static_cast<double>(*bounds.max_elements), "", elements, "at the end"));
  }
  for (const std::int32_t label : bounds.labels_stay) {
    const auto lost = run.numbers.find("torn/label_" + std::to_string(label));
    checks.push_back(
        lost == run.numbers.end()
            ? failed_check("labels_stay", statement, "the run has no cell of label " + std::to_string(label))
            : check_at_most("labels_stay", statement, lost->second, 0, "", elements,
                            "elements removed from cells of label " + std::to_string(label)));
  }
  const auto number = [&](const std::string& name) {
    const auto found = run.numbers.find(name);
    return found == run.numbers.end() ? std::nan("") : found->second;  // NaN fails
  };
  const auto frames = static_cast<std::int64_t>(run.frames.size());
  if (bounds.max_hanging_elements) {
    checks.push_back(check_at_most("hanging_elements", statement, number("hanging/most_elements"),
                                   static_cast<double>(*bounds.max_hanging_elements), "", frames,
                                   "most elements of a frame that hang on a vertex or an edge"));
  }
  if (bounds.min_hanging_energy_J) {
    checks.push_back(check_at_least(
        "hanging_energy", statement, number("hanging/peak_kinetic_energy_J"), *bounds.min_hanging_energy_J,
        "J", frames, "largest kinetic energy in a frame of what hangs on a vertex or an edge"));
  }
  return checks;
}

}  // namespace sulcus
