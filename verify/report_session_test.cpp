#include <gtest/gtest.h>

#include "verify/report.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

TEST(ReportOfASession, TellsDeadlinesLossesAndEveryHistogram) {
  RunData run = test::small_run(20);
  RunReportInput input;
  input.name = "session";
  input.run = &run;
  const std::string without = report_html({input});
  EXPECT_EQ(without.find("In real time"), std::string::npos);

  run.header.session = SessionHeader{{"Phantom <Omni>"}, {ServoSettings()}};
  run.session.emplace();
  run.session->ticks = {std::vector<ServoTick>(1234)};
  run.session->histograms = {make_histogram("servo_interval_s", 50e-6, {0.001, 0.001, 0.0042}),
                             make_histogram("servo_work_s", 0.5e-6, {2e-6, 3e-6}),
                             make_histogram("coupling_age_s", 1e-3, {})};
  run.numbers["session_missed_deadlines"] = 7;
  run.numbers["session_ticks_lost"] = 40;
  run.numbers["session_frames_lost"] = 2;
  const std::string html = report_html({input});
  for (const char* words : {"In real time", "Phantom &lt;Omni&gt;", "1,234 ticks", "7 of 20 steps missed",
                            "lost 42 records", "Servo interval", "4.2 ms", "Age of the coupling"})
    EXPECT_NE(html.find(words), std::string::npos) << words;
}

}  // namespace
}  // namespace sulcus
