// Bytes of a session's log, once for writing and reading. Used by session_log*.cpp alone. Little endian.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "verify/recording_fields.h"
#include "verify/session_log.h"

namespace sulcus::session_log {

inline constexpr std::array<char, 8> magic = {'S', 'U', 'L', 'C', 'U', 'S', 'L', 'G'};
struct FileStart {
  std::array<char, 8> magic{};
  std::uint32_t version = 0, reserved = 0;
};
static_assert(sizeof(FileStart) == 16);

inline constexpr std::uint64_t chunk_mark = 0x4b4e4843'53434c55;
struct ChunkStart {
  std::uint64_t mark = 0, number = 0;  // of the chunk, from 0
  std::uint64_t bytes = 0, hash = 0;   // of the records behind it; XXH3 (64 bits), seed = number
};
static_assert(sizeof(ChunkStart) == 32);

// A chunk is a row of records: size (u32, without itself), kind (u32), content.
enum class Kind : std::uint32_t { header, state, step, tick, event, number, warning, lost, end, solver_error };

// Appends to a vector whose memory is used again.
class Writer {
 public:
  explicit Writer(std::vector<std::byte>& out) : out_(out) {}

  template <class T>
  void number(T value) {
    static_assert(std::is_arithmetic_v<T>);
    bytes(&value, sizeof value);
  }
  template <class T>
  void array(std::span<const T> values) {
    number(static_cast<std::uint64_t>(values.size()));
    bytes(values.data(), values.size_bytes());
  }
  void text(const std::string& text) { array(std::span<const char>(text)); }
  void texts(const std::vector<std::string>& list) {
    number(static_cast<std::uint64_t>(list.size()));
    for (const std::string& item : list) text(item);
  }
  void map(const std::map<std::string, std::string>& map) {
    number(static_cast<std::uint64_t>(map.size()));
    for (const auto& [key, value] : map) {
      text(key);
      text(value);
    }
  }

 private:
  void bytes(const void* data, std::size_t size) {
    const auto* begin = static_cast<const std::byte*>(data);
    out_.insert(out_.end(), begin, begin + size);
  }
  std::vector<std::byte>& out_;
};

struct Cut {};  // a record ends before its content does

class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  T number() {
    T value{};
    const auto from = take(sizeof value);
    std::memcpy(&value, from.data(), sizeof value);
    return value;
  }
  template <class T>
  std::vector<T> array() {
    const auto count = number<std::uint64_t>();
    if (count > bytes_.size() / sizeof(T)) throw Cut{};
    const auto from = take(static_cast<std::size_t>(count) * sizeof(T));
    std::vector<T> values(static_cast<std::size_t>(count));
    if (!from.empty()) std::memcpy(values.data(), from.data(), from.size());
    return values;
  }
  std::string text() {
    const std::vector<char> letters = array<char>();
    return {letters.begin(), letters.end()};
  }
  std::vector<std::string> texts() {
    std::vector<std::string> list(count_of_texts());
    for (std::string& item : list) item = text();
    return list;
  }
  std::map<std::string, std::string> map() {
    std::map<std::string, std::string> map;
    for (std::size_t left = count_of_texts(); left > 0; --left) {
      const std::string key = text();
      map[key] = text();
    }
    return map;
  }
  std::span<const std::byte> take(std::size_t size) {
    if (size > bytes_.size()) throw Cut{};
    const auto taken = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return taken;
  }
  bool empty() const { return bytes_.empty(); }

 private:
  std::size_t count_of_texts() {
    const auto count = number<std::uint64_t>();
    if (count > bytes_.size() / sizeof(std::uint64_t)) throw Cut{};
    return static_cast<std::size_t>(count);
  }
  std::span<const std::byte> bytes_;
};

// A tick and a sample as a row of numbers of fixed length.
inline constexpr std::size_t tick_bytes = 512;  // at least what a tick takes

template <class Put>
void put_sample(const DeviceSample& sample, Put&& put) {
  for_each_sample_field([&](const char*, const char*, auto member) { put(to_numbers(sample.*member)); });
}

template <class Put>
void put_tick(const ServoTick& tick, Put&& put) {
  for_each_tick_field([&](const char*, const char*, auto member) { put(to_numbers(tick.*member)); });
  put_sample(tick.sample, put);
}

inline DeviceSample get_sample(Reader& in) {
  DeviceSample sample;
  for_each_sample_field([&](const char*, const char*, auto member) {
    decltype(to_numbers(sample.*member)) numbers;
    std::memcpy(numbers.data(), in.take(sizeof numbers).data(), sizeof numbers);
    from_numbers(numbers.data(), sample.*member);
  });
  return sample;
}

inline ServoTick get_tick(Reader& in) {
  ServoTick tick;
  for_each_tick_field([&](const char*, const char*, auto member) {
    decltype(to_numbers(tick.*member)) numbers;
    std::memcpy(numbers.data(), in.take(sizeof numbers).data(), sizeof numbers);
    from_numbers(numbers.data(), tick.*member);
  });
  tick.sample = get_sample(in);
  return tick;
}

inline void put_state(const State& state, Writer& out) {
  for_each_field(state, [&](std::string_view, auto values) {
    out.array(std::span<const typename decltype(values)::value_type>(values));
  });
}

inline State get_state(Reader& in, const RunHeader& header, const std::string& place) {
  State state = sized_state(header);
  for_each_field(state, [&]<class T, std::size_t extent>(std::string_view, std::span<T, extent> field) {
    const std::vector<T> values = in.array<T>();
    if (values.size() != field.size()) throw Cut{};
    std::copy(values.begin(), values.end(), field.begin());
  });
  check_state_sizes(state, header, place);
  return state;
}

void put_header(const RunHeader& header, Writer& out);
RunHeader get_header(Reader& in, const std::string& place);

}  // namespace sulcus::session_log
