#include "verify/step_tree.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <type_traits>

#include "engine/scene/system.h"
#include "verify/fingerprint.h"

namespace sulcus {
namespace {

enum StageLeaf : std::size_t {
  device,
  contacts,
  forces,
  matrix_values,
  diagonal,
  inverse,
  increments,
  tool_increments
};

// Where a leaf of the tree comes from: a stage's own array, or an array of the state.
struct LeafSource {
  const char* name;
  bool of_state;
};
constexpr LeafSource sources[] = {
    {"sample/device", false},        {"contacts/contacts", false},       {"assembly/rotations", true},
    {"assembly/forces", false},      {"assembly/matrix", false},         {"assembly/diagonal", false},
    {"assembly/inverse", false},     {"solve/increments", false},        {"solve/tool_increments", false},
    {"solve/positions", true},       {"solve/velocities", true},         {"solve/step", true},
    {"solve/past_increments", true}, {"solve/past_impulses", true},      {"solve/tool_poses", true},
    {"solve/tool_momenta", true},    {"coupling/filtered_forces", true}, {"fracture/alive", true},
    {"fracture/steps_above", true},
};

std::string field_of(const std::string& leaf) {
  return leaf.substr(leaf.find('/') + 1);
}

// For each leaf of the tree, its number among the stages' leaves or among the state's fields.
std::vector<std::size_t> make_numbers() {
  std::vector<std::size_t> numbers;
  for (const LeafSource& source : sources) {
    const auto& names = source.of_state ? state_field_names() : stage_leaf_names();
    const std::string name = source.of_state ? field_of(source.name) : source.name;
    const auto found = std::find(names.begin(), names.end(), name);
    assert(found != names.end());
    numbers.push_back(static_cast<std::size_t>(found - names.begin()));
  }
  return numbers;
}

std::size_t number_of(std::size_t leaf) {
  static const std::vector<std::size_t> numbers = make_numbers();
  return numbers[leaf];
}

template <class T>
const char* type_name() {
  if (std::is_same_v<T, double>) return "f64";
  if (std::is_same_v<T, float>) return "f32";
  return sizeof(T) == 8 ? "i64" : "u8";
}

std::size_t width_of(const std::string& type) {
  return type == "u8" ? 1 : type == "f32" ? 4 : 8;
}

template <class T>
void copy_array(std::span<const T> values, LeafArray& array) {
  array.type = type_name<T>();
  array.bytes.resize(values.size_bytes());
  if (!values.empty()) std::memcpy(array.bytes.data(), values.data(), values.size_bytes());
}

// "number (hexadecimal)"
std::string number_text(const LeafArray& array, std::size_t index) {
  const std::byte* at = &array.bytes[index * width_of(array.type)];
  char text[64];
  if (array.type == "f64") {
    double value;
    std::uint64_t bits;
    std::memcpy(&value, at, 8);
    std::memcpy(&bits, at, 8);
    std::snprintf(text, sizeof text, "%.17g (0x%016llx)", value, static_cast<unsigned long long>(bits));
  } else if (array.type == "f32") {
    float value;
    std::uint32_t bits;
    std::memcpy(&value, at, 4);
    std::memcpy(&bits, at, 4);
    std::snprintf(text, sizeof text, "%.9g (0x%08x)", static_cast<double>(value), bits);
  } else if (array.type == "i64") {
    std::int64_t value;
    std::memcpy(&value, at, 8);
    std::snprintf(text, sizeof text, "%lld", static_cast<long long>(value));
  } else {
    std::snprintf(text, sizeof text, "%d", static_cast<int>(*at));
  }
  return text;
}

// Floating-point numbers in their order as integers: neighbours differ by one.
template <class Bits>
std::int64_t in_order(const std::byte* at) {
  Bits bits;
  std::memcpy(&bits, at, sizeof bits);
  const Bits sign = Bits{1} << (8 * sizeof bits - 1);
  const auto magnitude = static_cast<std::int64_t>(bits & ~sign);
  return bits & sign ? -magnitude : magnitude;
}

std::string ulps_text(const LeafArray& a, const LeafArray& b, std::size_t index) {
  if (a.type[0] != 'f') return "";
  const std::size_t at = index * width_of(a.type);
  const auto order = [&](const LeafArray& array) {
    return a.type == "f64" ? in_order<std::uint64_t>(&array.bytes[at])
                           : in_order<std::uint32_t>(&array.bytes[at]);
  };
  const auto ulps =
      static_cast<double>(std::abs(static_cast<long double>(order(a)) - static_cast<long double>(order(b))));
  char text[48];
  std::snprintf(text, sizeof text, ulps < 1e6 ? ", %.0f ulps apart" : ", %.3g ulps apart", ulps);
  return text;
}

// What stands at an index: "node 411, y".
std::string place_of(const std::string& field, std::size_t index) {
  const char* axes[] = {"x", "y", "z"};
  const char* pose[] = {"x", "y", "z", "orientation s", "orientation x", "orientation y", "orientation z"};
  const auto item = [&](const char* what, std::size_t width) {
    return what + (" " + std::to_string(index / width));
  };
  if (field == "positions" || field == "velocities" || field == "forces" || field == "increments")
    return " (" + item("node", 3) + ", " + axes[index % 3] + ")";
  if (field == "past_increments" || field == "past_impulses")
    return " (number " + std::to_string(index / 3) + " of the nodes of two steps, " + axes[index % 3] + ")";
  if (field == "rotations") return " (" + item("element", 4) + ", " + pose[3 + index % 4] + ")";
  if (field == "alive" || field == "steps_above") return " (" + item("element", 1) + ")";
  if (field == "tool_poses") return " (" + item("tool", 7) + ", " + pose[index % 7] + ")";
  if (field == "tool_momenta" || field == "filtered_forces" || field == "tool_increments")
    return " (" + item("tool", 6) + (index % 6 < 3 ? ", linear " : ", angular ") + axes[index % 3] + ")";
  return "";
}

}  // namespace

std::size_t LeafArray::count() const {
  return bytes.size() / width_of(type);
}

const std::vector<std::string>& stage_leaf_names() {
  static const std::vector<std::string> names = {
      "sample/device",     "contacts/contacts", "assembly/forces",  "assembly/matrix",
      "assembly/diagonal", "assembly/inverse",  "solve/increments", "solve/tool_increments"};
  return names;
}

const std::vector<std::string>& tree_leaf_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const LeafSource& source : sources) list.emplace_back(source.name);
    return list;
  }();
  return names;
}

StepTree::StepTree(const Workspace& workspace, bool keep)
    : workspace_(workspace), keep_(keep), hashes_(stage_leaf_names().size(), 0) {
  if (keep) arrays_.resize(hashes_.size());
}

template <class T>
void StepTree::leaf(std::size_t index, std::span<const T> values) {
  const std::uint64_t hash = hash_field(stage_leaf_names()[index], values);
  hashes_[index] = hashes_[index] == 0 ? hash : chain_hash(hashes_[index], std::span(&hash, 1));
  if (keep_) copy_array(values, arrays_[index]);
}

template <class Numbers>
void StepTree::matrix(const Numbers& numbers) {
  leaf(matrix_values, std::span(std::as_const(numbers.system.values)));
  leaf(diagonal, std::span(std::as_const(numbers.system.diagonal)));
  leaf(inverse, std::span(std::as_const(numbers.system.inverse)));
}

void StepTree::begin(std::span<const DeviceSample> samples) {
  std::fill(hashes_.begin(), hashes_.end(), 0);
  for (LeafArray& array : arrays_) array = {"f64", {}};
  numbers_.clear();
  for (const DeviceSample& s : samples) {
    for (const Vec3& v : {s.position, s.linear_velocity, s.angular_velocity})
      numbers_.insert(numbers_.end(), {v[0], v[1], v[2]});
    numbers_.insert(numbers_.end(), {s.orientation.s, s.orientation.x, s.orientation.y, s.orientation.z,
                                     static_cast<double>(s.linear_velocity_valid),
                                     static_cast<double>(s.angular_velocity_valid)});
  }
  leaf(device, std::span<const double>(numbers_));
}

void StepTree::stage_done(Stage stage) {
  numbers_.clear();
  if (stage == Stage::contacts) {
    for (const Contact& contact : workspace_.contacts) {
      numbers_.push_back(contact.tet);
      for (int d = 0; d < 3; ++d)
        numbers_.insert(numbers_.end(), {contact.gap[d], contact.normal[d], contact.arm[d]});
      numbers_.insert(numbers_.end(), contact.weights.begin(), contact.weights.end());
    }
    leaf(contacts, std::span<const double>(numbers_));
  } else if (stage == Stage::assembly) {
    leaf(forces, std::span<const double>(workspace_.forces));
    if (workspace_.single) {
      matrix(*workspace_.single);
    } else {
      matrix(*workspace_.twice);
    }
  } else if (stage == Stage::solve) {
    leaf(increments, std::span<const double>(workspace_.increments));
    for (const ToolSystem& tool : workspace_.tools)
      numbers_.insert(numbers_.end(), tool.increment.data(), tool.increment.data() + 6);
    leaf(tool_increments, std::span<const double>(numbers_));
  }
}

TreeRow tree_row(std::span<const std::uint64_t> stage_hashes, std::span<const std::uint64_t> field_hashes) {
  TreeRow row(std::size(sources));
  for (std::size_t leaf = 0; leaf < row.size(); ++leaf) {
    const auto from = sources[leaf].of_state ? field_hashes : stage_hashes;
    if (number_of(leaf) < from.size()) row[leaf] = from[number_of(leaf)];
  }
  return row;
}

TreeRow recorded_tree_row(const RunData& run, std::int64_t steps_done) {
  const std::size_t fields = run.field_names.size(), stages = run.header.stage_leaves.size();
  std::span<const std::uint64_t> of_stages, of_fields;
  if (run.field_names == state_field_names())
    of_fields = std::span(run.field_hashes).subspan(static_cast<std::size_t>(steps_done) * fields, fields);
  if (steps_done > 0 && run.header.stage_leaves == stage_leaf_names())
    of_stages =
        std::span(run.stage_hashes).subspan(static_cast<std::size_t>(steps_done - 1) * stages, stages);
  return tree_row(of_stages, of_fields);
}

std::vector<std::size_t> differing_leaves(const TreeRow& a, const TreeRow& b) {
  std::vector<std::size_t> differing;
  for (std::size_t leaf = 0; leaf < std::min(a.size(), b.size()); ++leaf) {
    if (a[leaf] && b[leaf] && *a[leaf] != *b[leaf]) differing.push_back(leaf);
  }
  return differing;
}

LeafArray leaf_array(std::size_t leaf, const StepTree& tree, const State& state) {
  if (!sources[leaf].of_state) return tree.arrays().at(number_of(leaf));
  LeafArray array;
  const std::string wanted = field_of(sources[leaf].name);
  for_each_field(state, [&]<class T, std::size_t extent>(std::string_view name, std::span<T, extent> values) {
    if (name == wanted) copy_array(std::span<const std::remove_const_t<T>>(values), array);
  });
  return array;
}

std::string describe_difference(const std::string& leaf, const LeafArray& a, const LeafArray& b) {
  if (a.type != b.type) return "numbers of type " + a.type + " against " + b.type;
  std::string lengths;
  if (a.bytes.size() != b.bytes.size())
    lengths = std::to_string(a.count()) + " numbers against " + std::to_string(b.count());
  const std::size_t width = width_of(a.type), common = std::min(a.count(), b.count());
  std::size_t first = common, differing = 0;
  for (std::size_t i = common; i-- > 0;) {
    if (std::memcmp(&a.bytes[i * width], &b.bytes[i * width], width) == 0) continue;
    first = i;
    ++differing;
  }
  if (first == common) return lengths.empty() ? "no difference" : lengths;
  return "index " + std::to_string(first) + place_of(field_of(leaf), first) + ": " + number_text(a, first) +
         " against " + number_text(b, first) + ulps_text(a, b, first) + "; " + std::to_string(differing) +
         " of " + std::to_string(common) + " numbers differ" + (lengths.empty() ? "" : "; " + lengths);
}

}  // namespace sulcus
