#include "verify/junit.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>

namespace sulcus {

namespace {

// Length of the UTF-8 sequence at the front of `text` that encodes a character XML 1.0 allows; 0 if there is
// none.
std::size_t xml_character_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned first = byte(0);
  if (first < 0x80)
    return first >= 0x20 && first != 0x7f ? 1 : (first == '\t' || first == '\n' || first == '\r');
  const std::size_t length = first >= 0xf0 && first < 0xf8 ? 4 : first >= 0xe0 ? 3 : first >= 0xc2 ? 2 : 0;
  if (first >= 0xf8 || length == 0 || text.size() < length) return 0;
  unsigned code = first & (0xffu >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
    code = code << 6 | (byte(i) & 0x3f);
  }
  const bool overlong = (length == 3 && code < 0x800) || (length == 4 && code < 0x10000);
  const bool surrogate = code >= 0xd800 && code <= 0xdfff;
  const bool noncharacter = code == 0xfffe || code == 0xffff || code > 0x10ffff;
  return overlong || surrogate || noncharacter ? 0 : length;
}

std::string escaped(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const std::size_t length = xml_character_length(text);
    if (length == 0)
      result += '?';
    else if (text[0] == '&')
      result += "&amp;";
    else if (text[0] == '<')
      result += "&lt;";
    else if (text[0] == '>')
      result += "&gt;";
    else if (text[0] == '"')
      result += "&quot;";
    else if (text[0] == '\n' || text[0] == '\r' || text[0] == '\t')
      result += "&#" + std::to_string(static_cast<int>(text[0])) + ";";
    else
      result += text.substr(0, length);
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return result;
}

std::string counts_of(std::size_t tests, std::ptrdiff_t failures) {
  return " tests=\"" + std::to_string(tests) + "\" failures=\"" + std::to_string(failures) +
         "\" errors=\"0\" skipped=\"0\"";
}

std::ptrdiff_t failures_in(std::span<const Check> checks) {
  return std::count_if(checks.begin(), checks.end(), [](const Check& c) { return !c.passed; });
}

std::string test_case(const Check& check) {
  const std::string start =
      "    <testcase classname=\"" + escaped(check.kind) + "\" name=\"" + escaped(check.name) + "\"";
  if (check.passed) return start + "/>\n";
  return start + ">\n      <failure message=\"" + escaped(check.detail) + "\">" + escaped(check_line(check)) +
         "</failure>\n    </testcase>\n";
}

}  // namespace

std::string junit_xml(std::span<const JunitSuite> suites) {
  std::size_t tests = 0;
  std::ptrdiff_t failures = 0;
  for (const JunitSuite& suite : suites) {
    tests += suite.checks.size();
    failures += failures_in(suite.checks);
  }
  std::string xml =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites" + counts_of(tests, failures) + ">\n";
  for (const JunitSuite& suite : suites) {
    char time[40] = "";
    if (suite.wall_s >= 0) std::snprintf(time, sizeof time, " time=\"%.3f\"", suite.wall_s);
    xml += "  <testsuite name=\"" + escaped(suite.name) + "\"" +
           counts_of(suite.checks.size(), failures_in(suite.checks)) + time + ">\n";
    for (const Check& check : suite.checks) xml += test_case(check);
    xml += "  </testsuite>\n";
  }
  return xml + "</testsuites>\n";
}

std::string junit_xml(const std::string& suite, std::span<const Check> checks) {
  const JunitSuite only{suite, checks};
  return junit_xml(std::span(&only, 1));
}

void write_junit(const std::filesystem::path& path, const std::string& suite, std::span<const Check> checks) {
  write_file_atomically(path, junit_xml(suite, checks));
}

}  // namespace sulcus
