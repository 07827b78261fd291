// Fronts, tables and the diagram of work against precision.
#include "verify/work_precision.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

namespace sulcus {
namespace {

WorkPrecisionRow row(std::vector<std::string> values, double step_ms, double displacement, double force) {
  WorkPrecisionRow r;
  r.values = std::move(values);
  r.step_ms = step_ms;
  r.per_second = step_ms / 20;
  r.displacement_error = displacement;
  r.force_error = force;
  return r;
}

WorkPrecisionStudy study() {
  WorkPrecisionStudy s;
  s.scenario = "bar";
  s.keys = {"/solver/tolerance", "/time/step_s"};
  s.reference = {"/solver/tolerance=1e-8"};
  s.reference_displacement_error = 1e-4;
  s.reference_force_error = 1e-3;
  s.rows = {row({"1e-1", "0.02"}, 1, 0.1, 0.3), row({"1e-1", "0.01"}, 1.1, 0.2, 0.2),
            row({"1e-3", "0.02"}, 2, 0.01, 0.2), row({"1e-3", "0.01"}, 2, 0.02, NAN)};
  s.rows[2].own = true;
  mark_fronts(s);
  return s;
}

TEST(WorkPrecision, FrontsHoldWhatNothingCheaperBeats) {
  const WorkPrecisionStudy s = study();
  const bool displacement[] = {true, false, true, false}, force[] = {true, true, false, false};
  for (std::size_t i = 0; i < s.rows.size(); ++i) {
    EXPECT_EQ(s.rows[i].on_displacement_front, displacement[i]) << i;
    EXPECT_EQ(s.rows[i].on_force_front, force[i]) << i;
  }
}

TEST(WorkPrecision, TheOwnSettingsAreHeldAgainstTheCheapestThatIsAsExact) {
  const WorkPrecisionStudy s = study();
  EXPECT_DOUBLE_EQ(s.own_over_displacement_front, 1.0);
  EXPECT_DOUBLE_EQ(s.own_over_force_front, 2 / 1.1);
  EXPECT_DOUBLE_EQ(s.own_over_front, 1.0);  // what is as exact in forces is not in displacements
  WorkPrecisionStudy better = study();
  better.rows[1].displacement_error = 0.01;
  mark_fronts(better);
  EXPECT_DOUBLE_EQ(better.own_over_front, 2 / 1.1);
  WorkPrecisionStudy no_forces = study();
  for (WorkPrecisionRow& r : no_forces.rows) r.force_error = NAN;
  mark_fronts(no_forces);
  EXPECT_TRUE(std::isnan(no_forces.own_over_force_front));
  EXPECT_DOUBLE_EQ(no_forces.own_over_front, 1.0);
  EXPECT_TRUE(std::isnan([] {
    WorkPrecisionStudy none = study();
    none.rows[2].own = false;
    mark_fronts(none);
    return none.own_over_force_front;
  }()));
}

TEST(WorkPrecision, ARunThatStoppedIsOnNoFront) {
  WorkPrecisionStudy s = study();
  s.rows[0].problem = "step 3: a position is not finite";
  mark_fronts(s);
  EXPECT_FALSE(s.rows[0].on_displacement_front);
  EXPECT_TRUE(s.rows[1].on_displacement_front);
  EXPECT_NE(work_precision_markdown(s, "p.png").find("step 3: a position is not finite"), std::string::npos);
}

TEST(WorkPrecision, TablesHoldEveryRow) {
  const WorkPrecisionStudy s = study();
  const std::string csv = work_precision_csv(s);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 5);
  EXPECT_NE(csv.find("1e-3,0.01,2,0.1,0.02,,0,1,0,0,0,0,0,\n"), std::string::npos) << csv;
  const auto json = nlohmann::json::parse(work_precision_json(s));
  EXPECT_EQ(json["rows"].size(), 4u);
  EXPECT_TRUE(json["rows"][3]["force_error"].is_null());
  EXPECT_EQ(json["rows"][2]["displacement_error"], 0.01);
  const std::string page = work_precision_markdown(s, "picture.png");
  EXPECT_NE(page.find("| **1e-3** | **0.02** | 2 | 0.1 | 0.01 | Ff | 0.2 | |"), std::string::npos) << page;
}

TEST(WorkPrecision, TheDiagramIsAPicture) {
  if (std::system("gnuplot --version > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "gnuplot is not installed (Debian: gnuplot-nox)";
  EXPECT_EQ(work_precision_png(study()).substr(1, 3), "PNG");
  WorkPrecisionStudy without_force = study();
  for (WorkPrecisionRow& r : without_force.rows) r.force_error = NAN;
  without_force.keys = {"/time/step_s"};
  EXPECT_EQ(work_precision_png(without_force).substr(1, 3), "PNG");
}

}  // namespace
}  // namespace sulcus
