// Numbers for people, text for HTML, bytes for data addresses.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "verify/report_parts.h"

namespace sulcus {

std::string escape_html(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        // Control characters have no place in HTML.
        if (static_cast<unsigned char>(c) >= 0x20 || c == '\n' || c == '\t') out += c;
    }
  }
  return out;
}

namespace report {
namespace {

std::string printed(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

// Three digits that count, without an exponent; for 0.001 <= |value| < 1e6.
std::string three_digits(double value) {
  const double size = std::abs(value);
  const int decimals = size >= 100    ? 0
                       : size >= 10   ? 1
                       : size >= 1    ? 2
                       : size >= 0.1  ? 3
                       : size >= 0.01 ? 4
                                      : 5;
  char digits[64];
  std::snprintf(digits, sizeof(digits), "%.*f", decimals, value);
  std::string text = digits;
  if (decimals > 0) {
    text.erase(text.find_last_not_of('0') + 1);
    if (text.back() == '.') text.pop_back();
  }
  return text;
}

std::string with_power(double value) {
  int power = static_cast<int>(std::floor(std::log10(std::abs(value))));
  std::string digits = printed("%.2g", value / std::pow(10.0, power));
  if (digits == "10" || digits == "-10") {
    digits.pop_back();
    ++power;
  }
  static constexpr std::array<const char*, 10> raised{"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string exponent(power < 0 ? "⁻" : "");
  for (const char digit : std::to_string(std::abs(power)))
    exponent += raised[static_cast<std::size_t>(digit - '0')];
  return digits + " × 10" + exponent;
}

bool takes_prefix(const std::string& unit) {
  for (const char* symbol : {"m", "s", "N", "Pa", "J"}) {
    const std::string one = symbol;
    if (unit == one || unit.starts_with(one + " ") || unit.starts_with(one + "/")) return true;
  }
  return false;
}

}  // namespace

std::string whole_number(double value) {
  std::string digits = printed("%.0f", std::abs(value));
  for (std::ptrdiff_t at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3) {
    digits.insert(static_cast<std::size_t>(at), 1, ',');
  }
  if (value < 0) digits.insert(digits.begin(), '-');
  return digits;
}

std::string quantity(double value, const std::string& unit) {
  if (std::isnan(value)) return "–";
  std::string after;
  if (!unit.empty()) after.append(" ").append(unit);
  if (std::isinf(value)) return std::string(value < 0 ? "-∞" : "∞").append(after);
  if (value == 0) return "0" + after;
  if (takes_prefix(unit)) {
    struct Prefix {
      double factor;
      const char* letter;
    };
    for (const Prefix& prefix :
         {Prefix{1e9, "G"}, {1e6, "M"}, {1e3, "k"}, {1, ""}, {1e-3, "m"}, {1e-6, "µ"}, {1e-9, "n"}}) {
      const double scaled = value / prefix.factor;
      if (std::abs(scaled) >= 0.09995 && std::abs(scaled) < 1e6) {
        return three_digits(scaled) + " " + prefix.letter + unit;
      }
    }
    return with_power(value) + after;
  }
  if (value == std::floor(value) && std::abs(value) < 1e15) return whole_number(value) + after;
  if (std::abs(value) < 1e-3 || std::abs(value) >= 1e6) return with_power(value) + after;
  return three_digits(value) + after;
}

std::string base64(const std::string& bytes) {
  static constexpr char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t b = 0; b < 3; ++b) {
      group = group << 8 | (b < count ? static_cast<unsigned char>(bytes[i + b]) : 0u);
    }
    for (std::size_t c = 0; c < 4; ++c) out += c <= count ? letters[group >> (18 - 6 * c) & 63] : '=';
  }
  return out;
}

}  // namespace report
}  // namespace sulcus
