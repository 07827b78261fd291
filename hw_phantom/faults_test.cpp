// The fault matrix of a running device, one test a row.
#include <filesystem>

#include "hw_phantom/faults_fixture.h"

namespace sulcus {
namespace {

TEST_F(Faults, PositionThatJumpsWhileRunningStopsTheForce) {
  arm();
  push(1000);
  standin::Motion motion{};
  motion.joints[0] = 0.3;
  motion.joints[1] = 0.6;
  motion.joints[2] = 0.5;
  standin_control().set_motion(0, &motion);
  push(1);
  EXPECT_EQ(motor_force_N(), 0);
  push(20);
  EXPECT_LT(motor_force_N(), 0.02);  // soft start
}

TEST_F(Faults, DockedStylusGetsNoForceAndStartsSoftlyWhenTaken) {
  standin::Faults faults{};
  faults.docked_ticks = 2000;
  inject(faults);
  arm();
  push(100);
  DeviceSample sample;
  ASSERT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_TRUE(sample.docked);
  push(2100 - static_cast<int>(standin_control().ticks()));
  ASSERT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_FALSE(sample.docked);
  EXPECT_NEAR(motor_force_N(), 0.5 * 100 / 500, 1e-9);
  EXPECT_EQ(observe().forces_while_docked, 0u);
}

TEST_F(Faults, NanInAReadIsNotPublishedAndStopsTheForce) {
  arm();
  push(1000);
  standin::Faults faults{};
  faults.nan_from = after(2);
  faults.nan_ticks = 3;
  inject(faults);
  push(2);
  EXPECT_EQ(motor_force_N(), 0);
  DeviceSample sample;
  ASSERT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_TRUE(sample.position.allFinite());
  push(5);
  EXPECT_EQ(device_->status().invalid_samples, 3u);
  EXPECT_GT(motor_force_N(), 0);
  EXPECT_LT(motor_force_N(), 0.01);
}

TEST_F(Faults, NanThatStaysIsAFault) {
  arm();
  standin::Faults faults{};
  faults.nan_from = after(1);
  faults.nan_ticks = 1000000;
  inject(faults);
  push(100);
  DeviceSample sample;
  EXPECT_EQ(device_->read(0, sample), DeviceError::fatal);
  EXPECT_EQ(device_->state(), DeviceState::faulted);
}

TEST_F(Faults, SlowServoIsMeasuredNotAssumed) {
  standin::Faults faults{};
  faults.period_s = 1 / 800.0;
  faults.jitter_s = 0.0002;
  inject(faults);
  arm();
  push(1000);
  DeviceSample before, sample;
  ASSERT_EQ(device_->read(0, before), DeviceError::none);
  double sum_s = 0;
  for (int i = 0; i < 100; ++i) {
    push(1);
    ASSERT_EQ(device_->read(0, sample), DeviceError::none);
    EXPECT_NEAR(sample.interval_s, 1 / 800.0, 0.0002 + 1e-9);
    sum_s += sample.interval_s;
  }
  EXPECT_NEAR(sum_s, sample.time_s - before.time_s, 1e-9);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, StallOfTheServoSendsNothingAndStartsSoftly) {
  arm();
  push(1000);
  standin::Faults faults{};
  faults.stall_from = after(2);
  faults.stall_s = 0.05;
  inject(faults);
  push(2);
  EXPECT_EQ(motor_force_N(), 0);
  EXPECT_EQ(device_->status().stalls, 1u);
  EXPECT_GT(device_->status().max_interval_s, 0.05);
  push(10);
  EXPECT_NEAR(motor_force_N(), 0.5 * 10 / 500, 1e-9);
}

TEST_F(Faults, WarmMotorsRestUntilTheyAreCool) {
  arm();
  push(1000);
  standin::Faults faults{};
  faults.error = 0x0200;
  faults.error_from = after(1);
  faults.temperature_fall = 0.0005;
  faults.temperature = 1 + 0.0005 * static_cast<double>(after(1));
  inject(faults);
  push(900);
  EXPECT_EQ(motor_force_N(), 0);
  EXPECT_EQ(device_->state(), DeviceState::armed);
  push(200);  // below 0.5 after a thousand ticks
  EXPECT_GT(motor_force_N(), 0);
  push(600);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, WarmMotorsOfAnUnknownTemperatureRestForHalfAMinute) {
  standin::Faults faults{};
  faults.no_temperature = true;
  inject(faults);
  arm();
  push(1000);
  faults.error = 0x0200;
  faults.error_from = after(1);
  inject(faults);
  push(29000);
  EXPECT_EQ(motor_force_N(), 0);
  EXPECT_EQ(device_->state(), DeviceState::armed);
  push(2000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, HotMotorsGetLess) {
  standin::Faults faults{};
  faults.temperature = 0.825;
  inject(faults);
  arm();
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.25, 1e-12);
}

TEST_F(Faults, UnknownTemperatureIsNoError) {
  standin::Faults faults{};
  faults.no_temperature = true;
  inject(faults);
  arm();
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, OneForceErrorIsSurvivedWithASoftStart) {
  for (const unsigned int code : {0x0201u, 0x0202u, 0x0203u, 0x0204u}) {
    SCOPED_TRACE(code);
    SetUp();
    arm();
    push(1000);
    standin::Faults faults{};
    faults.error = code;
    faults.error_from = after(1);
    inject(faults);
    push(1);
    EXPECT_EQ(motor_force_N(), 0);
    push(10);
    EXPECT_NEAR(motor_force_N(), 0.5 * 10 / 500, 1e-9);
    EXPECT_EQ(device_->status().last_error, code);
    EXPECT_EQ(device_->state(), DeviceState::armed);
    device_.reset();
  }
}

TEST_F(Faults, RepeatedForceErrorsAreAFault) {
  for (const unsigned int code : {0x0201u, 0x0202u, 0x0203u, 0x0204u}) {
    SCOPED_TRACE(code);
    SetUp();
    arm();
    push(1000);
    standin::Faults faults{};
    faults.error = code;
    faults.error_from = after(1);
    faults.error_every = 100;
    inject(faults);
    push(250);
    EXPECT_EQ(device_->state(), DeviceState::armed);
    push(100);
    EXPECT_EQ(device_->state(), DeviceState::faulted);
    EXPECT_EQ(motor_force_N(), 0);
    EXPECT_FALSE(observe().motors_on);
    device_.reset();
  }
}

TEST_F(Faults, LostCommunicationIsAFaultThatTheMainThreadNotices) {
  arm();
  push(1000);
  standin::Faults faults{};
  faults.error = 0x0302;
  faults.error_internal = -28;
  faults.error_from = after(1);
  faults.error_every = 1;
  inject(faults);
  push(1);
  EXPECT_EQ(motor_force_N(), 0);
  DeviceSample sample;
  EXPECT_EQ(device_->read(0, sample), DeviceError::fatal);
  EXPECT_EQ(device_->state(), DeviceState::faulted);
  push(50);
  EXPECT_EQ(device_->status().last_error, 0x0302u);
  EXPECT_EQ(device_->status().last_error_internal, -28);
  // The callback has returned "done": no more frames.
  const std::uint64_t frames = observe().frames;
  push(50);
  EXPECT_EQ(observe().frames, frames);
  // And the device comes back when the cable does.
  device_->close();
  inject({});
  arm();
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, EveryOtherErrorInTheServoIsAFault) {
  for (const unsigned int code : {0x0100u, 0x0102u, 0x0103u, 0x0104u, 0x0300u, 0x0303u, 0x0304u, 0x0400u,
                                  0x0401u, 0x0402u, 0x0600u, 0x0999u}) {
    SCOPED_TRACE(code);
    SetUp();
    arm();
    push(100);
    standin::Faults faults{};
    faults.error = code;
    faults.error_from = after(1);
    inject(faults);
    push(2);
    EXPECT_EQ(device_->state(), DeviceState::faulted);
    EXPECT_EQ(motor_force_N(), 0);
    device_.reset();
  }
}

TEST_F(Faults, DeviceThatIsGivenUpFromOutsideGetsItsMotorsSwitchedOff) {
  arm();
  push(1000);
  DeviceSample sample;
  EXPECT_EQ(device_->read(std::nan(""), sample), DeviceError::fatal);
  push(3);
  EXPECT_EQ(motor_force_N(), 0);
  EXPECT_FALSE(observe().motors_on);
}

TEST_F(Faults, SecondDeviceThatOpensTakesTheForceFromTheFirstFirst) {
  arm();
  push(1000);
  PhantomSettings settings = manual_settings();
  settings.device_name = "Second Device";
  const auto second = make_phantom_device(settings);
  second->open();
  EXPECT_EQ(observe(0).stops_with_force, 0u);
  push(10);
  EXPECT_LT(motor_force_N(), 0.5 * 150 / 500);  // a soft start, begun when the scheduler did again
}

// The loader knows one library, whatever name it is asked for; so must the driver's one scheduler.
TEST_F(Faults, OneLibraryByTwoNamesIsOneDriver) {
  const std::filesystem::path other = std::filesystem::path(SULCUS_BINARY_DIR) / "phantom_other_name.so";
  std::filesystem::remove(other);
  std::filesystem::create_symlink(standin_path(), other);
  arm();
  PhantomSettings settings = manual_settings();
  settings.library = other;
  const auto second = make_phantom_device(settings);
  EXPECT_THROW(second->open(), hd::OpenError);  // the first holds it
  EXPECT_EQ(observe().disables, 0);
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, TwoDevicesInOneCallbackGetEachItsForce) {
  arm();
  PhantomSettings settings = manual_settings();
  settings.device_name = "Second Device";
  const auto second = make_phantom_device(settings);
  second->open();
  second->calibrate();
  second->arm();
  for (int i = 0; i < 1000; ++i) {
    device_->write({{0.2, 0, 0}, Vec3::Zero(), 1e9});
    second->write({{0, 0.3, 0}, Vec3::Zero(), 1e9});
    standin_control().step(1);
  }
  EXPECT_NEAR(observe(0).force_N[0], 0.2, 1e-12);
  EXPECT_NEAR(observe(1).force_N[1], 0.3, 1e-12);
  EXPECT_EQ(observe(0).force_N[1], 0);
  DeviceSample a, b;
  ASSERT_EQ(device_->read(0, a), DeviceError::none);
  ASSERT_EQ(second->read(0, b), DeviceError::none);
  EXPECT_GT((a.position - b.position).norm(), 0.01);
  // One leaves, the other goes on; while the scheduler stands, no motor is left with a force.
  second->close();
  EXPECT_EQ(observe(0).stops_with_force, 0u);
  EXPECT_EQ(motor_force_N(), 0);
  push(1000, 0.2);
  EXPECT_NEAR(observe(0).force_N[0], 0.2, 1e-12);
  EXPECT_EQ(motor_force_N(1), 0);
}

TEST_F(Faults, DisablingCanBeSkippedWhereItCrashes) {
  PhantomSettings settings = manual_settings();
  settings.skip_disable = true;
  device_ = make_phantom_device(settings);
  arm();
  push(1000);
  standin::Faults faults{};
  faults.abort_on_disable = true;
  inject(faults);
  device_->close();
  EXPECT_EQ(motor_force_N(), 0);
  EXPECT_EQ(observe().disables, 0);
  inject({});
}

TEST_F(Faults, ButtonGlitchIsNotSeen) {
  arm();
  standin::Faults faults{};
  faults.glitch_from = after(3);
  faults.glitch_ticks = 4;
  inject(faults);
  DeviceSample sample;
  for (int i = 0; i < 30; ++i) {
    push(1);
    ASSERT_EQ(device_->read(0, sample), DeviceError::none);
    EXPECT_EQ(sample.buttons, 0u);
  }
  faults = {};
  faults.buttons = 2;
  inject(faults);
  push(4);
  ASSERT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_EQ(sample.buttons, 0u);
  push(1);
  ASSERT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_EQ(sample.buttons, 2u);
}

}  // namespace
}  // namespace sulcus
