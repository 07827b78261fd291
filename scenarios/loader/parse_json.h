// How the parts of the parser take values out of a JSON document that has passed the schema.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "engine/numerics/error.h"
#include "engine/numerics/types.h"

namespace sulcus {

using nlohmann::json;
using Problems = std::vector<std::string>;

inline constexpr double radians_per_degree = 3.14159265358979323846 / 180;
// The member, or an empty object.
inline const json& part(const json& object, const char* key) {
  static const json nothing = json::object();
  const auto member = object.find(key);
  return member == object.end() ? nothing : *member;
}

// Replaces `value` if the key is there.
template <class T>
void read(const json& object, const char* key, T& value) {
  if (const auto member = object.find(key); member != object.end()) value = member->template get<T>();
}

inline void read_mm(const json& object, const char* key, double& value_m) {
  if (object.contains(key)) value_m = object[key].get<double>() / 1000;
}

inline Vec3 vector(const json& array) {
  return {array[0].get<double>(), array[1].get<double>(), array[2].get<double>()};
}

inline void read(const json& object, const char* key, Vec3& value) {
  if (object.contains(key)) value = vector(object[key]);
}

inline void read_mm(const json& object, const char* key, Vec3& value_m) {
  if (object.contains(key)) value_m = vector(object[key]) / 1000;
}

template <class T>
void read(const json& object, const char* key, std::optional<T>& value) {
  if (object.contains(key)) value = object[key].get<T>();
}

inline void read_mm(const json& object, const char* key, std::optional<double>& value_m) {
  if (object.contains(key)) value_m = object[key].get<double>() / 1000;
}

inline std::string text_of(double value) {
  return json(value).dump();
}

// Runs `action`; what it refuses becomes a problem at `pointer`.
template <class Action>
void collect(Problems& problems, const std::string& pointer, Action&& action) {
  try {
    action();
  } catch (const InputError& error) {
    problems.push_back(pointer + ": " + error.what());
  }
}

}  // namespace sulcus
