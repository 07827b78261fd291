#include "verify/suite_index.h"

#include <gtest/gtest.h>

namespace sulcus {
namespace {

std::vector<SuiteEntry> two_entries() {
  SuiteEntry good, bad;
  good.name = "good";
  good.checks = {check_at_most("finite", "statement", 0, 0, "", 5, "fine"),
                 check_at_most("golden/force", "values", 0, 1, "N", 5, "fine")};
  good.report = "good/report.html";
  bad.name = "bad <&>";
  bad.checks = {failed_check("penetration", "statement", "a < b"),
                check_at_most("golden/force", "values", 0, 1, "N", 5, "fine")};
  bad.reproduce = "sulcus suite --filter bad";
  return {good, bad};
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(SuiteIndex, EachKindOfGoldenHasItsOwnVerdict) {
  const auto entries = two_entries();
  EXPECT_EQ(verdict_of(entries[0], "statement"), "holds");
  EXPECT_EQ(verdict_of(entries[0], "bits"), "–");
  EXPECT_EQ(verdict_of(entries[1], "statement"), "fails");
  EXPECT_EQ(verdict_of(entries[1], "values"), "holds");
}

TEST(SuiteIndex, AScenarioWithoutChecksFails) {
  const SuiteEntry nothing;
  EXPECT_EQ(totals_of(std::span(&nothing, 1)).failed, 1u);
}

TEST(SuiteIndex, ThePageSaysFirstHowManyFailAndWhy) {
  const std::string html = suite_html(two_entries(), 3);
  EXPECT_TRUE(contains(html, "1 of 2 scenarios fails"));
  EXPECT_TRUE(contains(html, "a &lt; b"));
  EXPECT_TRUE(contains(html, "bad &lt;&amp;&gt;"));
  EXPECT_FALSE(contains(html, "bad <&>"));
  EXPECT_LT(html.find("a &lt; b"), html.find("<table")) << "what failed stands above the table";
  EXPECT_TRUE(contains(html, "href=\"good/report.html\""));
}

TEST(SuiteIndex, TheSummaryListsEveryFailedCheckAndHowToSeeItAgain) {
  const std::string markdown = suite_markdown(two_entries(), 3);
  EXPECT_TRUE(contains(markdown, "| good | holds | holds | – |"));
  EXPECT_TRUE(contains(markdown, "FAIL  penetration"));
  EXPECT_TRUE(contains(markdown, "    sulcus suite --filter bad\n"));
}

}  // namespace
}  // namespace sulcus
