#include "verify/fingerprint.h"

#include <xxhash.h>

#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <memory>
#include <new>

#include "engine/numerics/error.h"

namespace sulcus {

// Bytes are hashed as they lie in memory, so "little endian" is a demand on the machine.
static_assert(std::endian::native == std::endian::little,
              "the fingerprint is defined on little-endian machines");
static_assert(sizeof(double) == 8 && std::numeric_limits<double>::is_iec559);

namespace {

struct HasherDeleter {
  void operator()(XXH3_state_t* state) const { XXH3_freeState(state); }
};
using Hasher = std::unique_ptr<XXH3_state_t, HasherDeleter>;

Hasher make_hasher() {
  Hasher hasher(XXH3_createState());
  if (!hasher) throw std::bad_alloc();
  return hasher;
}

enum class ElementType : std::uint8_t { float64 = 1, int64 = 2, uint8 = 3, float32 = 4 };

// Name with its length, type, number of elements: so that no two arrays can be confused.
void begin_field(XXH3_state_t* hasher, std::string_view name, ElementType type, std::size_t count) {
  const std::uint64_t name_length = name.size();
  const std::uint64_t length = count;
  XXH3_64bits_reset(hasher);
  XXH3_64bits_update(hasher, &name_length, sizeof name_length);
  XXH3_64bits_update(hasher, name.data(), name.size());
  XXH3_64bits_update(hasher, &type, sizeof type);
  XXH3_64bits_update(hasher, &length, sizeof length);
}

std::uint64_t hash_plain(std::string_view name, ElementType type, std::size_t count, const void* data,
                         std::size_t bytes) {
  thread_local const Hasher hasher = make_hasher();
  begin_field(hasher.get(), name, type, count);
  if (bytes > 0) XXH3_64bits_update(hasher.get(), data, bytes);
  return XXH3_64bits_digest(hasher.get());
}

double canonical(double value) {
  if (value == 0) return 0.0;  // -0.0 too
  if (std::isnan(value)) return std::numeric_limits<double>::quiet_NaN();
  return value;
}

}  // namespace

std::uint64_t hash_field(std::string_view name, std::span<const double> values) {
  thread_local const Hasher hasher = make_hasher();
  begin_field(hasher.get(), name, ElementType::float64, values.size());
  std::array<double, 1024> buffer;
  for (std::size_t begin = 0; begin < values.size(); begin += buffer.size()) {
    const std::size_t count = std::min(buffer.size(), values.size() - begin);
    for (std::size_t i = 0; i < count; ++i) buffer[i] = canonical(values[begin + i]);
    XXH3_64bits_update(hasher.get(), buffer.data(), count * sizeof(double));
  }
  return XXH3_64bits_digest(hasher.get());
}

std::uint64_t hash_field(std::string_view name, std::span<const float> values) {
  return hash_plain(name, ElementType::float32, values.size(), values.data(), values.size_bytes());
}

std::uint64_t hash_field(std::string_view name, std::span<const std::int64_t> values) {
  return hash_plain(name, ElementType::int64, values.size(), values.data(), values.size_bytes());
}

std::uint64_t hash_field(std::string_view name, std::span<const std::uint8_t> values) {
  return hash_plain(name, ElementType::uint8, values.size(), values.data(), values.size_bytes());
}

const std::vector<std::string>& state_field_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    State state;
    for_each_field(state, [&](std::string_view name, auto) { list.emplace_back(name); });
    return list;
  }();
  return names;
}

void hash_state(const State& state, std::span<std::uint64_t> hashes) {
  assert(hashes.size() == state_field_names().size());
  std::size_t field = 0;
  for_each_field(state,
                 [&](std::string_view name, auto values) { hashes[field++] = hash_field(name, values); });
}

std::uint64_t chain_hash(std::uint64_t previous, std::span<const std::uint64_t> field_hashes) {
  thread_local const Hasher hasher = make_hasher();
  XXH3_64bits_reset(hasher.get());
  XXH3_64bits_update(hasher.get(), &previous, sizeof previous);
  XXH3_64bits_update(hasher.get(), field_hashes.data(), field_hashes.size_bytes());
  return XXH3_64bits_digest(hasher.get());
}

std::string hex16(std::uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

bool parse_hex16(std::string_view text, std::uint64_t& value) {
  if (text.size() != 16) return false;
  std::uint64_t parsed = 0;
  for (const char c : text) {
    int digit = -1;
    if (c >= '0' && c <= '9') digit = c - '0';
    if (c >= 'a' && c <= 'f') digit = c - 'a' + 10;
    if (digit < 0) return false;
    parsed = parsed << 4 | static_cast<std::uint64_t>(digit);
  }
  value = parsed;
  return true;
}

Divergence first_divergence(std::span<const std::uint64_t> field_hashes_a,
                            std::span<const std::uint64_t> field_hashes_b,
                            const std::vector<std::string>& field_names) {
  Divergence divergence;
  const std::size_t fields = field_names.size();
  if (fields == 0) return divergence;
  const std::size_t rows = std::min(field_hashes_a.size(), field_hashes_b.size()) / fields;
  for (std::size_t row = 0; row < rows && divergence.step < 0; ++row) {
    for (std::size_t field = 0; field < fields; ++field) {
      if (field_hashes_a[row * fields + field] == field_hashes_b[row * fields + field]) continue;
      divergence.step = static_cast<std::int64_t>(row);
      divergence.fields.push_back(field_names[field]);
    }
  }
  return divergence;
}

std::string hash_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path + ": cannot be opened; check the path and its permissions");
  const Hasher hasher = make_hasher();
  XXH3_128bits_reset(hasher.get());
  std::vector<char> buffer(1 << 20);
  while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || file.gcount() > 0)
    XXH3_128bits_update(hasher.get(), buffer.data(), static_cast<std::size_t>(file.gcount()));
  if (file.bad()) throw InputError(path + ": reading failed; check the file and its disk");
  const XXH128_hash_t hash = XXH3_128bits_digest(hasher.get());
  return hex16(hash.high64) + hex16(hash.low64);
}

}  // namespace sulcus
