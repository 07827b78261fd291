#include "device_sim/csv.h"

#include <gtest/gtest.h>

#include <clocale>
#include <sstream>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

ScriptedTrajectory parse(const std::string& text) {
  std::istringstream in(text);
  return read_trajectory_csv(in, "hand.csv");
}

std::string failure(const std::string& text) {
  try {
    parse(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

const std::string header = "time_s,x_m,y_m,z_m,qs,qx,qy,qz";

TEST(Csv, ReadsSamplesExactly) {
  const auto trajectory = parse("# a comment\n" + header + ",buttons\r\n\n0,0.1,-2e-3,0,1,0,0,0,0\n" +
                                "0.001, 0.30000000000000004 ,0,0,0.8,0.6,0,0,3\n");
  ASSERT_EQ(trajectory.waypoints.size(), 2u);
  EXPECT_EQ(trajectory.waypoints[0].position_m, Vec3(0.1, -2e-3, 0));
  EXPECT_EQ(trajectory.waypoints[1].position_m.x(), 0.30000000000000004);
  EXPECT_EQ(trajectory.waypoints[1].orientation.x, 0.6);
  EXPECT_EQ(trajectory.waypoints[1].buttons, 3u);
  EXPECT_EQ(trajectory.waypoints[1].path, Path::linear);
}

TEST(Csv, IsResampledLinearlyWithButtonsOfTheEarlierSample) {
  const ScriptedPath path(parse(header + ",buttons\n0,0,0,0,1,0,0,0,2\n1,0.4,0,0,1,0,0,0,0\n"));
  const HandMotion motion = path.at(0.25);
  EXPECT_NEAR(motion.position.x(), 0.1, 1e-16);
  EXPECT_NEAR(motion.linear_velocity.x(), 0.4, 1e-16);
  EXPECT_EQ(motion.buttons, 2u);
}

TEST(Csv, FailuresNameTheFileAndTheLine) {
  const std::string good = "0,0,0,0,1,0,0,0\n";
  EXPECT_EQ(failure(header + "\n" + good), "");
  EXPECT_NE(failure("t,x,y\n").find("hand.csv: line 1: found 't,x,y'"), std::string::npos);
  EXPECT_NE(failure(header + "\n0,0,zero,0,1,0,0,0\n").find("line 2: column 3"), std::string::npos);
  EXPECT_NE(failure(header + "\n0,0,0,0,1,0,0\n").find("7 columns; expected 8"), std::string::npos);
  EXPECT_NE(failure(header + "\n0;0,0,0,1,0,0,0\n").find("expected a comma"), std::string::npos);
  EXPECT_NE(failure(header + "\n" + good + good).find("line 3"), std::string::npos);
  EXPECT_NE(failure(header + "\n" + good + "1,0,0,0,1,1,0,0\n").find("line 3"), std::string::npos);
  EXPECT_NE(failure(header + "\n" + good + "nan,0,0,0,1,0,0,0\n").find("line 3"), std::string::npos);
  EXPECT_NE(failure(header + ",buttons\n0,0,0,0,1,0,0,0,1.5\n").find("bit mask"), std::string::npos);
  EXPECT_NE(failure(header + ",buttons\n0,0,0,0,1,0,0,0,-1\n").find("bit mask"), std::string::npos);
  EXPECT_NE(failure(header + "\n").find("no samples"), std::string::npos);
  EXPECT_THROW(read_trajectory_csv("/nowhere/hand.csv"), EnvironmentError);
}

}  // namespace
}  // namespace sulcus
