#include "verify/junit.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "engine/numerics/error.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

std::vector<Check> two_checks() {
  return {
      check_at_most("penetration", "statement", 1, 2, "mm", 5, "fine"),
      check_at_most("force <&> \"quoted\"", "values", 3, 2, "N", 5, "a < b & c > d \"e\" 'f'\nline\ttab")};
}

TEST(Junit, NamesEveryCheckAndCountsFailures) {
  const std::string xml = junit_xml("brain", two_checks());
  EXPECT_NE(xml.find("<testsuite name=\"brain\" tests=\"2\" failures=\"1\""), std::string::npos) << xml;
  EXPECT_NE(xml.find("<testcase classname=\"statement\" name=\"penetration\"/>"), std::string::npos) << xml;
  EXPECT_NE(xml.find("name=\"force &lt;&amp;&gt; &quot;quoted&quot;\""), std::string::npos) << xml;
  EXPECT_NE(xml.find("a &lt; b &amp; c &gt; d &quot;e&quot; 'f'&#10;line&#9;tab"), std::string::npos) << xml;
}

TEST(Junit, IsValidXmlWhateverTheTextsHold) {
  std::string every_byte;
  for (int byte = 0; byte < 256; ++byte) every_byte += static_cast<char>(byte);
  every_byte += "µ € 𝄞 \xed\xa0\x80 \xef\xbf\xbf \xc0\xaf \xf4\x90\x80\x80 ]]> \xe2\x82";
  std::vector<Check> checks = two_checks();
  checks.push_back(failed_check(every_byte, every_byte, every_byte));
  const std::string xml = junit_xml(every_byte, checks);
  EXPECT_NE(xml.find("µ € 𝄞 ??? ??? ?? ???? ]]&gt; ??"), std::string::npos);

  const auto path = test::scratch_dir() / "junit.xml";
  write_junit(path, every_byte, checks);
  EXPECT_EQ(test::read_text(path), xml);
  if (std::system("command -v xmllint > /dev/null 2>&1") != 0) GTEST_SKIP() << "xmllint is not installed";
  EXPECT_EQ(std::system(("xmllint --noout '" + path.string() + "'").c_str()), 0);
}

TEST(Junit, PlaceThatCannotBeWrittenToIsAnEnvironmentError) {
  EXPECT_THROW(write_junit("/proc/nowhere/junit.xml", "s", two_checks()), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
