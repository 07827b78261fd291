#include "verify/check.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

Check compared(std::string name, std::string kind, double value, double bound, double margin,
               std::string unit, std::int64_t comparisons, std::string detail) {
  Check check;
  check.name = std::move(name);
  check.kind = std::move(kind);
  check.value = value;
  check.bound = bound;
  check.unit = std::move(unit);
  check.margin = margin;
  check.comparisons = comparisons;
  check.detail = std::move(detail);
  check.passed = comparisons > 0 && margin >= 0;  // false for NaN
  if (comparisons <= 0)
    check.detail = "nothing was compared" + (check.detail.empty() ? "" : ": " + check.detail);
  return check;
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

[[noreturn]] void fail_write(const std::filesystem::path& path, int error) {
  throw EnvironmentError(path.string() + ": cannot be written (" + std::strerror(error) +
                         "); free space there or choose a place that can be written to");
}

}  // namespace

Check check_at_most(std::string name, std::string kind, double value, double bound, std::string unit,
                    std::int64_t comparisons, std::string detail) {
  return compared(std::move(name), std::move(kind), value, bound, value == bound ? 0.0 : bound - value,
                  std::move(unit), comparisons, std::move(detail));
}

Check check_at_least(std::string name, std::string kind, double value, double bound, std::string unit,
                     std::int64_t comparisons, std::string detail) {
  return compared(std::move(name), std::move(kind), value, bound, value == bound ? 0.0 : value - bound,
                  std::move(unit), comparisons, std::move(detail));
}

Check failed_check(std::string name, std::string kind, std::string detail) {
  Check check;
  check.name = std::move(name);
  check.kind = std::move(kind);
  check.detail = std::move(detail);
  return check;
}

bool all_passed(std::span<const Check> checks) {
  return !checks.empty() &&
         std::all_of(checks.begin(), checks.end(), [](const Check& check) { return check.passed; });
}

std::string check_line(const Check& check) {
  const std::string unit = check.unit.empty() ? "" : " " + check.unit;
  std::string line = (check.passed ? "PASS  " : "FAIL  ") + check.name;
  if (!std::isnan(check.value)) line += "  " + number(check.value) + unit;
  if (!std::isnan(check.bound)) line += "  (bound " + number(check.bound) + unit + ")";
  if (!check.detail.empty()) line += "  " + check.detail;
  return line;
}

void write_file_atomically(const std::filesystem::path& path, std::string_view text) {
  const std::filesystem::path partial = path.string() + ".part";
  const int file = ::open(partial.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) fail_write(path, errno);
  int error = 0;
  while (!text.empty() && error == 0) {
    const ssize_t written = ::write(file, text.data(), text.size());
    if (written > 0)
      text.remove_prefix(static_cast<std::size_t>(written));
    else if (written == 0 || errno != EINTR)
      error = written == 0 ? EIO : errno;
  }
  if (error == 0 && ::fsync(file) != 0 && errno != EINVAL) error = errno;
  if (::close(file) != 0 && error == 0) error = errno;
  if (error == 0 && ::rename(partial.c_str(), path.c_str()) != 0) error = errno;
  if (error != 0) {
    ::unlink(partial.c_str());
    fail_write(path, error);
  }
}

}  // namespace sulcus
