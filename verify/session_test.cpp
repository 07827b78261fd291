#include "verify/session.h"

#include <gtest/gtest.h>

#include <cmath>

namespace sulcus {
namespace {

TEST(Histogram, CountsEveryValueOnceAndTheFarOnesAtTheEnd) {
  const Histogram h = make_histogram("h", 0.001, {0.0005, 0.0015, 0.0015, 5.0, -0.1, std::nan("")});
  EXPECT_EQ(h.counts[0], 2u);  // also what is below zero
  EXPECT_EQ(h.counts[1], 2u);
  EXPECT_EQ(h.counts[Histogram::bins - 1], 1u);
  EXPECT_EQ(h.total(), 5u);
  EXPECT_EQ(h.median_s, 0.0015);
  EXPECT_EQ(h.max_s, 5.0);
}

TEST(Histogram, OfNothingIsEmpty) {
  const Histogram h = make_histogram("h", 0.001, {});
  EXPECT_EQ(h.total(), 0u);
  EXPECT_EQ(h.max_s, 0);
}

ServoTick tick(std::uint64_t number, double time_s, std::int64_t step) {
  ServoTick t;
  t.number = number;
  t.time_s = time_s;
  t.work_s = 1e-5;
  t.coupling_step = step;
  return t;
}

// Two steps read at 10 and 20 ms, rendered first at 13 and 24 ms.
TEST(SessionTiming, MeasuresAgesAndLatencies) {
  SessionTiming timing(1);
  timing.add_step({0.010, 0.010, 0.012});
  timing.add_step({0.020, 0.021, 0.035});
  const double times_ms[] = {11, 12, 13, 14, 24, 25};
  const std::int64_t steps[] = {-1, -1, 1, 1, 2, 2};
  for (std::size_t i = 0; i < 6; ++i)
    timing.add_tick(0, tick(i + (i > 3 ? 9 : 0), 1e-3 * times_ms[i], steps[i]));
  const std::vector<Histogram> all = timing.histograms();
  const auto find = [&](const std::string& name) {
    for (const Histogram& h : all) {
      if (h.name == name) return h;
    }
    ADD_FAILURE() << name;
    return Histogram();
  };
  EXPECT_EQ(find("servo_interval_s").total(), 4u);  // not across the gap
  EXPECT_NEAR(find("servo_interval_s").max_s, 0.001, 1e-12);
  EXPECT_EQ(find("coupling_age_s").total(), 4u);
  EXPECT_NEAR(find("coupling_age_s").max_s, 0.004, 1e-12);  // 14 - 10, 25 - 21
  EXPECT_EQ(find("force_latency_s").total(), 2u);
  EXPECT_NEAR(find("force_latency_s").max_s, 0.003 + 1e-5, 1e-12);
  EXPECT_NEAR(find("step_lateness_s").max_s, 0.001, 1e-12);
  EXPECT_NEAR(find("step_time_s").max_s, 0.014, 1e-12);
  EXPECT_EQ(find("servo_work_s").total(), 6u);
  EXPECT_EQ(timing.missing_ticks(), 9u);
  EXPECT_EQ(timing.missed_deadlines(0.010), 1);  // due at 20, published at 35
  EXPECT_EQ(timing.missed_deadlines(0.020), 0);
}

}  // namespace
}  // namespace sulcus
