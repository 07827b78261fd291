// The fingerprint tree of a step: a hash for every array that each of its stages leaves, in the order in
// which a step makes them. Where two runs part is the first leaf that differs: it names the stage and the
// array.
//
//   sample     device
//   contacts   contacts (tetrahedron, gap, normal, arm and weights of each)
//   assembly   rotations*, forces, matrix, diagonal, inverse
//   solve      increments, tool_increments, positions*, velocities*, step*, tool_poses*, tool_momenta*,
//              past_increments*, past_impulses*
//   coupling   filtered_forces*
//   fracture   alive*, steps_above*
//
// * arrays of the state; they alone make the run's fingerprint (verify/fingerprint.h). A stage that a step
// passes several times (solved again without contacts that pull) chains its hashes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/scene/step.h"
#include "verify/recording.h"

namespace sulcus {

// An array with its bytes, as a stage left it.
struct LeafArray {
  std::string type;  // "f64", "f32", "i64", "u8"
  std::vector<std::byte> bytes;
  std::size_t count() const;
};

// The stages' own arrays, in order: "sample/device", "contacts/contacts", "assembly/forces", ... One hash
// each.
const std::vector<std::string>& stage_leaf_names();

// Hashes what the stages leave; the observer of step(). Allocates only at the first steps.
class StepTree : public StageObserver {
 public:
  // keep: also keeps a copy of every array, of its last pass.
  explicit StepTree(const Workspace& workspace, bool keep = false);
  void begin(std::span<const DeviceSample> samples);  // before each step
  void stage_done(Stage stage) override;
  std::span<const std::uint64_t> hashes() const { return hashes_; }  // [stage_leaf_names().size()]
  const std::vector<LeafArray>& arrays() const { return arrays_; }   // likewise; empty unless kept

 private:
  template <class T>
  void leaf(std::size_t index, std::span<const T> values);
  template <class Numbers>
  void matrix(const Numbers& numbers);

  const Workspace& workspace_;
  bool keep_;
  std::vector<std::uint64_t> hashes_;
  std::vector<LeafArray> arrays_;
  std::vector<double> numbers_;
};

// All leaves in the order above, "stage/field".
const std::vector<std::string>& tree_leaf_names();

// The hashes of all leaves in that order; nothing where a recording has none. stage_hashes may be empty.
using TreeRow = std::vector<std::optional<std::uint64_t>>;
TreeRow tree_row(std::span<const std::uint64_t> stage_hashes, std::span<const std::uint64_t> field_hashes);
TreeRow recorded_tree_row(const RunData& run, std::int64_t steps_done);

// Numbers in tree_leaf_names of the leaves that both have and that differ.
std::vector<std::size_t> differing_leaves(const TreeRow& a, const TreeRow& b);

// The array of a leaf: of the stages' kept ones, or of the state.
LeafArray leaf_array(std::size_t leaf, const StepTree& tree, const State& state);

// "index 1234 (node 411, y): 1.25 (0x3ff4...) against 1.5 (0x3ff8...), 12 ulps apart; 17 of 1530 numbers
// differ", or what else is different; "no difference" if nothing is. first, second: what the two are called.
std::string describe_difference(const std::string& leaf, const LeafArray& a, const LeafArray& b);

}  // namespace sulcus
