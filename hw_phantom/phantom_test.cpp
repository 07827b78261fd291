#include "hw_phantom/phantom.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>
#include <thread>

#include "engine/device/conformance_test.h"
#include "hw_phantom/emergency.h"
#include "hw_phantom/standin_access.h"

namespace sulcus {
namespace {

standin::Motion still() {
  standin::Motion motion{};
  motion.joints[1] = 0.6;
  motion.joints[2] = 0.5;
  motion.gimbals[0] = 0.3;
  motion.gimbals[1] = -0.2;
  return motion;
}

standin::Motion swinging() {
  standin::Motion motion = still();
  for (int i = 0; i < 3; ++i) motion.joint_amplitude[i] = 0.05, motion.gimbal_amplitude[i] = 0.1;
  motion.frequency_Hz = 1;
  return motion;
}

class PhantomWithStandin : public testing::Test {
 protected:
  void SetUp() override {
    standin_control().reset(true);
    const standin::Motion motion = still();
    standin_control().set_motion(0, &motion);
  }
  void TearDown() override {
    device_.reset();
    allow_forces();
    standin_control().reset(true);
  }

  void arm(PhantomSettings settings = manual_settings()) {
    device_ = make_phantom_device(settings);
    device_->open();
    device_->calibrate();
    device_->arm();
  }

  // `ticks` ticks with this command, written anew before each.
  void push(const Vec3& force, int ticks, const Vec3& torque = Vec3::Zero()) {
    for (int i = 0; i < ticks; ++i) {
      device_->write({force, torque, 1e9});
      standin_control().step(1);
    }
  }

  DeviceSample newest() {
    DeviceSample sample;
    EXPECT_EQ(device_->read(0, sample), DeviceError::none);
    return sample;
  }

  static Vec3 motor_force() {
    const standin::Observation seen = observe();
    return {seen.force_N[0], seen.force_N[1], seen.force_N[2]};
  }

  std::unique_ptr<PhantomDevice> device_;
};

TEST_F(PhantomWithStandin, SampleIsTheGimbalCentreInMetresInTheScene) {
  PhantomSettings settings = manual_settings();
  settings.mount = {{1, 2, 3}, quaternion_from_rotation_vector({0, 1.5, 0}), 0};
  arm(settings);
  const standin::Motion motion = still();
  double transform[16];
  standin_control().kinematics(motion.joints, motion.gimbals, transform);
  const Vec3 gimbal = 1e-3 * Vec3(transform[12], transform[13], transform[14]);
  const DeviceSample sample = newest();
  EXPECT_LT((sample.position - Vec3(1, 2, 3) - rotation_matrix(settings.mount.orientation) * gimbal).norm(),
            1e-14);
  const Mat3 r = rotation_matrix(conjugate(settings.mount.orientation) * sample.orientation);
  for (int i = 0; i < 9; ++i) EXPECT_NEAR(r(i % 3, i / 3), transform[4 * (i / 3) + i % 3], 1e-14);
}

// By the driver's angles and its transform, which come from two sides: the stand-in's model is its own.
TEST_F(PhantomWithStandin, JointsTellTheSamePoseAsTheTransform) {
  constexpr std::uint64_t seed = 79;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  device_ = make_phantom_device(manual_settings());
  device_->open();
  for (int i = 0; i < 300; ++i) {
    standin::Motion motion{};
    motion.joints[0] = draw(-0.98, 0.98);  // within an Omni's limits
    motion.joints[1] = draw(0, 1.75);
    motion.joints[2] = motion.joints[1] + draw(-0.81, 1.25);
    for (double& g : motion.gimbals) g = draw(-2.4, 2.4);
    standin_control().set_motion(0, &motion);
    standin_control().step(1);
    const PhantomStatus status = device_->status();
    ASSERT_TRUE(status.joints_known);
    ASSERT_LT(status.joints_off_m, 1e-15);
    ASSERT_LT(status.joints_off_rad, 1e-14);
    EXPECT_EQ(status.joints.turret, -motion.joints[0]);
    EXPECT_EQ(status.joints.elbow, motion.joints[1] - motion.joints[2]);
  }
}

TEST_F(PhantomWithStandin, ADriverThatKnowsNoJointsIsNoFault) {
  standin::Faults faults{};
  faults.no_joints = true;
  standin_control().set_faults(&faults);
  arm();
  push({0, 0.1, 0}, 600);
  EXPECT_FALSE(device_->status().joints_known);
  EXPECT_EQ(device_->state(), DeviceState::armed);
  EXPECT_GT(motor_force().norm(), 0.05);
}

TEST_F(PhantomWithStandin, AngularVelocityIsDerivedFromTheOrientation) {
  const standin::Motion motion = swinging();
  standin_control().set_motion(0, &motion);
  arm();
  DeviceSample first = newest(), before = first;
  Vec3 turned = Vec3::Zero();
  for (int i = 0; i < 100; ++i) {
    standin_control().step(1);
    const DeviceSample sample = newest();
    ASSERT_TRUE(sample.angular_velocity_valid);
    turned += sample.angular_velocity * (sample.time_s - before.time_s);
    before = sample;
  }
  const Vec3 turn = rotation_vector(before.orientation * conjugate(first.orientation));
  EXPECT_GT(turn.norm(), 0.02);
  // The filter lags by 5.3 ms.
  EXPECT_LT((turned - turn).norm(), 0.007 * (before.angular_velocity - first.angular_velocity).norm() + 1e-4);
}

TEST_F(PhantomWithStandin, TipVelocityIsThatOfTheTip) {
  const standin::Motion motion = swinging();
  standin_control().set_motion(0, &motion);
  PhantomSettings settings = manual_settings();
  settings.mount.tip_offset_m = 0.1;
  arm(settings);
  const DeviceSample first = newest();
  DeviceSample before = first;
  Vec3 way = Vec3::Zero();
  for (int i = 0; i < 100; ++i) {
    standin_control().step(1);
    const DeviceSample sample = newest();
    way += sample.linear_velocity * (sample.time_s - before.time_s);
    before = sample;
  }
  const Vec3 expected = before.position - first.position;
  EXPECT_GT(expected.norm(), 0.002);
  // The driver's smoothing lags by 2.3 ms, the turn by 5.3 ms.
  EXPECT_LT((way - expected).norm(), 0.007 * (before.linear_velocity - first.linear_velocity).norm() + 1e-5);
}

TEST_F(PhantomWithStandin, ForceReachesTheMotorsInTheDriversFrame) {
  PhantomSettings settings = manual_settings();
  settings.mount.orientation =
      quaternion_from_rotation_vector({0, 0, 1.5707963267948966});  // driver's x is world's y
  arm(settings);
  push({0, 0.5, 0}, 1000);
  EXPECT_LT((motor_force() - Vec3(0.5, 0, 0)).norm(), 1e-12);
  EXPECT_LT((newest().force_sent - Vec3(0, 0.5, 0)).norm(), 1e-12);
}

TEST_F(PhantomWithStandin, ForceStartsSoftlyAndStaysBelowTheContinuousForce) {
  arm();
  push({10, 0, 0}, 1000);
  const standin::Observation seen = observe();
  EXPECT_NEAR(seen.largest_force_N, 0.88, 1e-12);
  EXPECT_LT(seen.largest_step_N, 0.002);  // half a second of soft start
  EXPECT_EQ(seen.sets_outside_frames, 0u);
}

TEST_F(PhantomWithStandin, NoForceBeforeArming) {
  device_ = make_phantom_device(manual_settings());
  device_->open();
  push({0.5, 0, 0}, 300);
  device_->calibrate();
  push({0.5, 0, 0}, 300);
  EXPECT_FALSE(observe().motors_on);
  EXPECT_EQ(observe().largest_force_N, 0);
}

TEST_F(PhantomWithStandin, OldCommandFadesToNothing) {
  arm();
  push({0.5, 0, 0}, 1000);
  standin_control().step(25);
  EXPECT_NEAR(motor_force().norm(), 0.5, 1e-12);
  standin_control().step(15);
  EXPECT_LT(motor_force().norm(), 0.35);
  EXPECT_GT(motor_force().norm(), 0.15);
  standin_control().step(15);
  EXPECT_EQ(motor_force().norm(), 0);
  EXPECT_GT(device_->status().max_command_age_s, 0.05);
}

TEST_F(PhantomWithStandin, ExpiredCommandSendsNothing) {
  arm();
  push({0.5, 0, 0}, 1000);
  device_->write({{0.5, 0, 0}, Vec3::Zero(), newest().time_s + 0.0045});
  standin_control().step(4);
  EXPECT_NEAR(motor_force().norm(), 0.5, 1e-12);
  standin_control().step(3);
  EXPECT_EQ(motor_force().norm(), 0);
}

TEST_F(PhantomWithStandin, PauseSendsNothingAndThenStartsSoftly) {
  arm();
  push({0.5, 0, 0}, 1000);
  device_->pause(true);
  push({0.5, 0, 0}, 1);
  EXPECT_EQ(motor_force().norm(), 0);
  device_->pause(false);
  push({0.5, 0, 0}, 10);
  EXPECT_NEAR(motor_force().norm(), 0.5 * 10 / 500, 1e-9);
}

TEST_F(PhantomWithStandin, HoldToRunButtonMustBeDown) {
  PhantomSettings settings = manual_settings();
  settings.hold_button = 1;
  arm(settings);
  push({0.5, 0, 0}, 1000);
  EXPECT_EQ(motor_force().norm(), 0);
  standin::Faults faults{};
  faults.buttons = 2;
  standin_control().set_faults(&faults);
  push({0.5, 0, 0}, 1000);
  EXPECT_NEAR(motor_force().norm(), 0.5, 1e-12);
  faults.buttons = 1;
  standin_control().set_faults(&faults);
  push({0.5, 0, 0}, 6);
  EXPECT_EQ(motor_force().norm(), 0);
}

TEST_F(PhantomWithStandin, TorqueIsIgnoredAndCountedWithThreeOutputs) {
  arm();
  EXPECT_FALSE(device_->capabilities().renders_torque);
  push({0.1, 0, 0}, 10, {0, 0, 0.01});
  EXPECT_GE(device_->status().torques_ignored, 10u);
  EXPECT_EQ(observe().torque_mN_m[2], 0);
}

TEST_F(PhantomWithStandin, TorqueIsSentInMillinewtonMetresWithSixOutputs) {
  standin::Faults faults{};
  faults.output_dof = 6;
  standin_control().set_faults(&faults);
  arm();
  EXPECT_TRUE(device_->capabilities().renders_torque);
  push({0.1, 0, 0}, 1000, {0, 0, 0.01});
  EXPECT_NEAR(observe().torque_mN_m[2], 10, 1e-9);
}

TEST_F(PhantomWithStandin, ServoFunctionAnswersEveryTick) {
  struct Seen {
    int calls = 0;
    std::uint64_t last = 0;
    Vec3 sent = Vec3::Zero();  // as the newest sample tells it
  } seen;
  device_ = make_phantom_device(manual_settings());
  EXPECT_TRUE(device_->set_servo(
      [](void* user, const DeviceSample& sample) {
        auto& s = *static_cast<Seen*>(user);
        ++s.calls;
        s.last = sample.sequence;
        s.sent = sample.force_sent;
        return DeviceCommand{{0.2, 0, 0}, Vec3::Zero(), sample.time_s + 0.005};
      },
      &seen));
  device_->open();
  device_->calibrate();
  EXPECT_EQ(seen.calls, 0);
  device_->arm();
  const int before = seen.calls;
  standin_control().step(1000);
  EXPECT_EQ(seen.calls - before, 1000);
  EXPECT_EQ(seen.last, newest().sequence);
  EXPECT_NEAR(motor_force().x(), 0.2, 1e-12);
  EXPECT_NEAR(seen.sent.x(), 0.2, 1e-12);
}

TEST_F(PhantomWithStandin, CloseSendsZeroAndDisablesInOrder) {
  arm();
  push({0.5, 0, 0}, 1000);
  device_->close();
  const standin::Observation seen = observe();
  EXPECT_EQ(motor_force().norm(), 0);
  EXPECT_FALSE(seen.motors_on);
  EXPECT_FALSE(seen.initialised);
  EXPECT_EQ(seen.disables, 1);
  EXPECT_FALSE(standin_control().scheduler_runs());
  EXPECT_EQ(standin_control().errors_on_stack(), 0);
}

TEST_F(PhantomWithStandin, StoppingAllForcesReachesTheMotorsWithTheNextTick) {
  arm();
  push({0.5, 0, 0}, 1000);
  stop_all_forces();
  push({0.5, 0, 0}, 1);
  EXPECT_EQ(motor_force().norm(), 0);
}

TEST_F(PhantomWithStandin, SampleOfADeadServoIsStaleThenFatal) {
  arm();
  newest();
  standin::Faults faults{};
  faults.never_ticks = true;
  standin_control().set_faults(&faults);
  standin_control().sleep(0.1);
  DeviceSample sample;
  EXPECT_EQ(device_->read(0, sample), DeviceError::recoverable);
  standin_control().sleep(0.5);
  EXPECT_EQ(device_->read(0, sample), DeviceError::fatal);
  EXPECT_EQ(device_->state(), DeviceState::faulted);
}

TEST_F(PhantomWithStandin, DiagnosisNeverTurnsTheMotorsOn) {
  const auto findings = diagnose_phantom(manual_settings(), 5);
  ASSERT_GE(findings.size(), 5u);
  for (const Finding& finding : findings) EXPECT_TRUE(finding.good) << finding.text;
  EXPECT_NE(findings[2].text.find("servo 1000 Hz"), std::string::npos) << findings[2].text;
  EXPECT_NE(findings[4].text.find("turret 0.0, thigh -34.4, elbow 5.7, gimbal 17.2 11.5 0.0 degrees"),
            std::string::npos)
      << findings[4].text;
  EXPECT_EQ(observe().largest_force_N, 0);
  EXPECT_GE(observe().frames, 5000u);
  PhantomSettings absent = manual_settings();
  absent.library = "/nowhere/libHD.so";
  const auto failure = diagnose_phantom(absent, 5);
  ASSERT_EQ(failure.size(), 1u);
  EXPECT_FALSE(failure[0].good);
}

// The same with the servo in a thread of its own and real time: for the thread sanitizer.
TEST(PhantomThreads, WritesReadsAndClosesBesideARunningServo) {
  standin_control().reset(false);
  const standin::Motion motion = swinging();
  standin_control().set_motion(0, &motion);
  PhantomSettings settings;
  settings.library = standin_path();
  settings.safety.soft_start_s = 0.01;
  const auto device = make_phantom_device(settings);
  for (int session = 0; session < 2; ++session) {
    device->open();
    device->calibrate();
    device->arm();
    double largest_N = 0;
    std::uint64_t last = 0;
    for (int i = 0; i < 2000 && largest_N < 0.2; ++i) {
      device->write({{0.3, 0, 0}, Vec3::Zero(), 1e9});
      DeviceSample sample;
      const DeviceError error = device->read(0, sample);
      ASSERT_TRUE(error == DeviceError::none || error == DeviceError::recoverable);
      ASSERT_GE(sample.sequence, last);
      last = sample.sequence;
      largest_N = std::max(largest_N, sample.force_sent.norm());
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_GE(largest_N, 0.2);
    device->close();
    EXPECT_EQ(observe().force_N[0], 0);
  }
  standin_control().reset(true);
}

std::unique_ptr<Device> conformance_subject() {
  standin_control().reset(true);
  standin::Motion motion = swinging();
  standin_control().set_motion(0, &motion);
  return make_phantom_device(manual_settings());
}

INSTANTIATE_TEST_SUITE_P(Phantom, DeviceConformance,
                         testing::Values(DeviceUnderTest{"Standin", conformance_subject,
                                                         [](double s) { standin_control().sleep(s); }}),
                         conformance_name);

}  // namespace
}  // namespace sulcus
