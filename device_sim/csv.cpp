#include "device_sim/csv.h"

#include <charconv>
#include <fstream>
#include <vector>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

constexpr const char* header = "time_s,x_m,y_m,z_m,qs,qx,qy,qz";

// The numbers of a line; throws with the place.
std::vector<double> numbers(const std::string& line, std::size_t expected, const std::string& place) {
  std::vector<double> values;
  const char* at = line.data();
  const char* const end = at + line.size();
  for (;;) {
    while (at != end && *at == ' ') ++at;
    double value = 0;
    const auto [after, error] = std::from_chars(at, end, value);
    if (error != std::errc()) {
      throw InputError(place + "column " + std::to_string(values.size() + 1) + " is not a number: '" +
                       std::string(at, end) + "'");
    }
    values.push_back(value);
    at = after;
    while (at != end && *at == ' ') ++at;
    if (at == end) break;
    if (*at != ',') {
      throw InputError(place + "expected a comma after column " + std::to_string(values.size()) +
                       ", found '" + std::string(at, end) + "'");
    }
    ++at;
  }
  if (values.size() != expected) {
    throw InputError(place + std::to_string(values.size()) + " columns; expected " +
                     std::to_string(expected));
  }
  return values;
}

std::uint32_t button_mask(double value, const std::string& place) {
  const bool whole =
      value >= 0 && value <= 4294967295.0 && static_cast<double>(static_cast<std::uint32_t>(value)) == value;
  if (!whole) throw InputError(place + "buttons is not a bit mask: give a whole number from 0 to 4294967295");
  return static_cast<std::uint32_t>(value);
}

}  // namespace

ScriptedTrajectory read_trajectory_csv(std::istream& in, const std::string& name) {
  ScriptedTrajectory trajectory;
  std::string line;
  bool have_header = false, have_buttons = false;
  for (int number = 1; std::getline(in, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line[0] == '#') continue;
    const std::string place = name + ": line " + std::to_string(number) + ": ";
    if (!have_header) {
      have_buttons = line == std::string(header) + ",buttons";
      if (!have_buttons && line != header) {
        throw InputError(place + "found '" + line + "'; expected the header " + header + "[,buttons]");
      }
      have_header = true;
      continue;
    }
    const std::vector<double> v = numbers(line, have_buttons ? 9 : 8, place);
    trajectory.waypoints.push_back({v[0],
                                    {v[1], v[2], v[3]},
                                    {v[4], v[5], v[6], v[7]},
                                    Path::linear,
                                    have_buttons ? button_mask(v[8], place) : 0});
    // Checked here, where the line is known.
    try {
      const std::size_t n = trajectory.waypoints.size();
      const std::size_t first = n > 1 ? n - 2 : 0;
      ScriptedPath(
          {{trajectory.waypoints.begin() + static_cast<std::ptrdiff_t>(first), trajectory.waypoints.end()},
           {}});
    } catch (const InputError& error) {
      throw InputError(place + error.what());
    }
  }
  if (trajectory.waypoints.empty())
    throw InputError(name + ": no samples; expected a header and at least one line");
  return trajectory;
}

ScriptedTrajectory read_trajectory_csv(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw EnvironmentError(file + ": cannot be opened; check the path and the permission to read");
  return read_trajectory_csv(in, file);
}

}  // namespace sulcus
