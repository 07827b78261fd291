// The stand-in itself: kinematics, and strictness where the real driver is strict.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "hw_phantom/hdapi.h"
#include "hw_phantom/standin_access.h"

namespace sulcus {
namespace {

class Standin : public testing::Test {
 protected:
  void SetUp() override {
    standin_control().reset(true);
    api_ = hd::load(standin_path());
    device_ = api_.init_device(nullptr);
    ASSERT_EQ(hd::drain(api_).count, 0);
  }
  void TearDown() override { standin_control().reset(true); }

  unsigned int error() {
    const hd::Errors errors = hd::drain(api_);
    return errors.count == 0 ? 0 : errors.records[0].code;
  }

  hd::Api api_{};
  hd::Handle device_ = 0;
};

TEST_F(Standin, ArmAtZeroAnglesStandsWhereTheModelSays) {
  const double zero[3] = {0, 0, 0};
  double transform[16];
  standin_control().kinematics(zero, zero, transform);
  EXPECT_NEAR(transform[12], 0, 1e-12);
  EXPECT_NEAR(transform[13], -110, 1e-12);
  EXPECT_NEAR(transform[14], -35, 1e-12);
}

TEST_F(Standin, ElbowAngleIsAbsolute) {
  // Lifting the thigh alone moves the gimbal along the thigh's circle: the shin keeps its direction.
  double joints[3] = {0, 0, 0.3};
  const double gimbals[3] = {0, 0, 0};
  double low[16], high[16];
  standin_control().kinematics(joints, gimbals, low);
  joints[1] = 0.5;
  standin_control().kinematics(joints, gimbals, high);
  EXPECT_NEAR(high[13] - low[13], 133.35 * std::sin(0.5), 1e-9);
  EXPECT_NEAR(high[14] - low[14], 133.35 * (std::cos(0.5) - 1), 1e-9);
  for (int i = 0; i < 12; ++i) EXPECT_NEAR(high[i], low[i], 1e-12);
}

TEST_F(Standin, TurretTurnsPositionAndStylusAboutTheVertical) {
  double joints[3] = {0, 0.4, 0.6};
  const double gimbals[3] = {0.2, 0.3, -0.4};
  double before[16], after[16];
  standin_control().kinematics(joints, gimbals, before);
  joints[0] = 0.5;
  standin_control().kinematics(joints, gimbals, after);
  const double c = std::cos(-0.5), s = std::sin(-0.5);
  // About the vertical axis through z = -35 - 133.35 mm.
  const double z = before[14] + 35 + 133.35;
  EXPECT_NEAR(after[12], s * z, 1e-9);
  EXPECT_NEAR(after[14], c * z - 35 - 133.35, 1e-9);
  for (int axis = 0; axis < 3; ++axis) {
    const double* b = before + 4 * axis;
    EXPECT_NEAR(after[4 * axis], c * b[0] + s * b[2], 1e-12);
    EXPECT_NEAR(after[4 * axis + 2], -s * b[0] + c * b[2], 1e-12);
  }
}

TEST_F(Standin, WrongGetterGivesAnErrorAndLeavesTheOutput) {
  int integer = 42;
  api_.get_integer(hd::current_inkwell_switch, &integer);
  EXPECT_EQ(error(), 0x0103u);
  EXPECT_EQ(integer, 42);
  double real = 4.5;
  api_.get_double(hd::current_buttons, &real);
  EXPECT_EQ(error(), 0x0103u);
  EXPECT_EQ(real, 4.5);
  api_.get_double(0x2999, &real);
  EXPECT_EQ(error(), 0x0100u);
}

TEST_F(Standin, FramesAreBegunAndEndedOnce) {
  api_.start_scheduler();
  api_.begin_frame(device_);
  EXPECT_EQ(error(), 0u);
  api_.begin_frame(device_);
  EXPECT_EQ(error(), 0x0400u);
  api_.end_frame(device_);
  EXPECT_EQ(error(), 0u);
  api_.end_frame(device_);
  EXPECT_EQ(error(), 0x0401u);
  const double force[3] = {0.1, 0, 0};
  api_.set_double(hd::current_force, force);
  EXPECT_EQ(error(), 0x0402u);
}

TEST_F(Standin, OneFrameATick) {
  struct Work {
    hd::Api* api;
    hd::Handle device;
    unsigned int code;
  } work{&api_, device_, 0};
  api_.schedule_asynchronous(
      [](void* user) -> unsigned int {
        auto& w = *static_cast<Work*>(user);
        w.api->begin_frame(w.device);
        w.api->end_frame(w.device);
        w.api->begin_frame(w.device);
        w.code = hd::drain(*w.api).records[0].code;
        return hd::callback_done;
      },
      &work, 32767);
  api_.start_scheduler();
  standin_control().step(1);
  EXPECT_EQ(work.code, 0x0400u);
}

TEST_F(Standin, ErrorsComeNewestFirst) {
  double real = 0;
  int integer = 0;
  api_.get_double(0x2999, &real);
  api_.get_integer(hd::current_transform, &integer);
  const hd::Errors errors = hd::drain(api_);
  ASSERT_EQ(errors.count, 2);
  EXPECT_EQ(errors.records[0].code, 0x0103u);
  EXPECT_EQ(errors.records[1].code, 0x0100u);
}

TEST_F(Standin, SecondInitOfADeviceIsRefused) {
  api_.init_device(nullptr);
  EXPECT_EQ(error(), 0x0301u);
  EXPECT_NE(api_.init_device("Second Device"), device_);
  EXPECT_EQ(error(), 0u);
  api_.init_device("Third Device");
  EXPECT_EQ(error(), 0x0300u);
}

TEST_F(Standin, FrameWithoutASetStopsTheMotors) {
  api_.enable(hd::force_output);
  api_.start_scheduler();
  const double force[3] = {0.5, 0, 0};
  api_.begin_frame(device_);
  api_.set_double(hd::current_force, force);
  api_.end_frame(device_);
  EXPECT_EQ(observe().force_N[0], 0.5);
  standin_control().step(1);
  api_.begin_frame(device_);
  api_.end_frame(device_);
  EXPECT_EQ(observe().force_N[0], 0);
}

}  // namespace
}  // namespace sulcus
