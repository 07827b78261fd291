// Fingerprint: a 64-bit hash of every array of the state after every step, chained. Two runs are the same if
// their chains are; where they part, the hashes of the single fields say which array parted first.
//
// Hashed are (name, element type, length, elements) of each array, never a struct; doubles are canonical
// before: -0.0 counts as +0.0, every NaN as the one quiet NaN. XXH3 (64 bits), little endian.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/scene/state.h"

namespace sulcus {

std::uint64_t hash_field(std::string_view name, std::span<const double> values);
std::uint64_t hash_field(std::string_view name, std::span<const float> values);  // bytes as they are
std::uint64_t hash_field(std::string_view name, std::span<const std::int64_t> values);
std::uint64_t hash_field(std::string_view name, std::span<const std::uint8_t> values);

// Names of the state's arrays, in the order of for_each_field.
const std::vector<std::string>& state_field_names();

// One hash for each array of the state, in that order. hashes: [state_field_names().size()].
void hash_state(const State& state, std::span<std::uint64_t> hashes);

// Next link of the chain; `previous` is 0 before the initial state.
std::uint64_t chain_hash(std::uint64_t previous, std::span<const std::uint64_t> field_hashes);

std::string hex16(std::uint64_t value);                         // 16 lower-case hexadecimal digits
bool parse_hex16(std::string_view text, std::uint64_t& value);  // false if not exactly that

// Where two chains part: the first step (0 = the initial state) whose hashes differ, and the fields that
// differ then. step = -1 if nothing parts within the shorter of the two. field_hashes are step-major,
// [steps+1][fields].
struct Divergence {
  std::int64_t step = -1;
  std::vector<std::string> fields;
};
Divergence first_divergence(std::span<const std::uint64_t> field_hashes_a,
                            std::span<const std::uint64_t> field_hashes_b,
                            const std::vector<std::string>& field_names);

// XXH3 (128 bits) of a file's bytes as 32 hexadecimal digits, for the list of input files of a recording.
// Throws InputError if the file cannot be read.
std::string hash_file(const std::string& path);

}  // namespace sulcus
