// The fault matrix: what can go wrong with a Phantom, one test a row, each brought about by the stand-in
// driver.
#include <gtest/gtest.h>

#include <clocale>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "hw_phantom/emergency.h"
#include "hw_phantom/hdapi.h"
#include "hw_phantom/standin_access.h"

namespace sulcus {
namespace {

class Faults : public testing::Test {
 protected:
  void SetUp() override {
    standin_control().reset(true);
    standin::Motion motion{};
    motion.joints[1] = 0.6;
    motion.joints[2] = 0.5;
    standin_control().set_motion(0, &motion);
    motion.joints[0] = 0.3;
    standin_control().set_motion(1, &motion);
    device_ = make_phantom_device(manual_settings());
  }
  void TearDown() override {
    device_.reset();
    allow_forces();
    standin_control().reset(true);
  }

  void inject(const standin::Faults& faults) { standin_control().set_faults(&faults); }

  void arm() {
    device_->open();
    device_->calibrate();
    device_->arm();
  }

  void push(int ticks, double force_N = 0.5) {
    for (int i = 0; i < ticks; ++i) {
      device_->write({{force_N, 0, 0}, Vec3::Zero(), 1e9});
      standin_control().step(1);
    }
  }

  // The tick from which on a fault shall come, counted as the stand-in counts.
  static std::uint64_t after(std::uint64_t ticks) { return standin_control().ticks() + ticks; }

  static double motor_force_N(int device = 0) {
    const standin::Observation seen = observe(device);
    return std::sqrt(seen.force_N[0] * seen.force_N[0] + seen.force_N[1] * seen.force_N[1] +
                     seen.force_N[2] * seen.force_N[2]);
  }

  hd::OpenError open_failure() {
    try {
      device_->open();
    } catch (const hd::OpenError& error) {
      EXPECT_EQ(device_->state(), DeviceState::closed);
      return error;
    }
    throw std::logic_error("open() did not fail");
  }

  void expect_open_failure(unsigned int code, hd::Failure failure, const std::string& remedy) {
    standin::Faults faults{};
    faults.init_error = code;
    inject(faults);
    const hd::OpenError error = open_failure();
    EXPECT_EQ(error.failure, failure);
    EXPECT_NE(std::string(error.what()).find(remedy), std::string::npos) << error.what();
  }

  std::unique_ptr<PhantomDevice> device_;
};

// Library, dependency and symbol missing: loading_test.cpp. Wrong getter, frames: standin/standin_test.cpp.

TEST_F(Faults, DeviceAbsentIsToldApart) {
  expect_open_failure(0x0300, hd::Failure::device, "connect the device");
}
TEST_F(Faults, NoDataIsToldApart) {
  expect_open_failure(0x0302, hd::Failure::device, "link-local");
}
TEST_F(Faults, ConfigurationIsToldApart) {
  expect_open_failure(0x0303, hd::Failure::configuration, "vendor's setup tool");
}
TEST_F(Faults, LicenceIsToldApart) {
  expect_open_failure(0x0600, hd::Failure::licence, "licence");
}

TEST_F(Faults, GarbageHandleWithoutAnErrorIsRefused) {
  standin::Faults faults{};
  faults.garbage_handle = true;
  inject(faults);
  EXPECT_EQ(open_failure().failure, hd::Failure::device);
}

TEST_F(Faults, OldDriverIsRefused) {
  standin::Faults faults{};
  faults.old_version = true;
  inject(faults);
  EXPECT_EQ(open_failure().failure, hd::Failure::version);
  EXPECT_FALSE(observe().initialised);
}

TEST_F(Faults, DeviceIsUsableAfterAFailedOpen) {
  standin::Faults faults{};
  faults.init_error = 0x0303;
  faults.init_errors = 1;
  inject(faults);
  open_failure();
  arm();
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, StaleErrorsAreNotBlamedOnInit) {
  const hd::Api api = hd::load(standin_path());
  int nothing = 0;
  for (int i = 0; i < 5; ++i) api.get_integer(0x2999, &nothing);
  EXPECT_EQ(standin_control().errors_on_stack(), 5);
  EXPECT_NO_THROW(device_->open());
}

TEST_F(Faults, DeviceLeftInitiatedIsTakenOverOnce) {
  const hd::Api api = hd::load(standin_path());
  api.init_device(nullptr);  // and never disabled
  arm();
  EXPECT_EQ(observe().inits, 2);
  EXPECT_EQ(observe().disables, 1);
}

TEST_F(Faults, DeviceHeldByAnotherObjectIsNotTakenAway) {
  arm();
  const auto second = make_phantom_device(manual_settings());
  EXPECT_THROW(second->open(), hd::OpenError);
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, ManualInputThenUpdateThenJumpWithoutAnyForce) {
  standin::Faults faults{};
  faults.manual_input_ticks = 3000;
  faults.needs_update = true;
  faults.jump_mm[0] = 40;
  inject(faults);
  device_->open();
  DeviceSample sample;
  device_->calibrate();
  EXPECT_GE(standin_control().ticks(), 3000u);
  EXPECT_EQ(observe().frames, standin_control().ticks());
  device_->arm();
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
  EXPECT_EQ(observe().forces_while_uncalibrated, 0u);
  // The position after the jump is the one given.
  ASSERT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_NEAR(sample.position.x(), 0, 1e-12);
}

TEST_F(Faults, CalibrationThatNeverComesTellsTheUserWhatToDo) {
  standin::Faults faults{};
  faults.manual_input_ticks = 1000000;
  inject(faults);
  device_->open();
  try {
    device_->calibrate();
    FAIL();
  } catch (const hd::OpenError& error) {
    EXPECT_EQ(error.failure, hd::Failure::calibration);
    EXPECT_NE(std::string(error.what()).find("inkwell"), std::string::npos) << error.what();
  }
  EXPECT_EQ(device_->state(), DeviceState::open);
  inject({});
  EXPECT_NO_THROW(device_->calibrate());  // it may be tried again
}

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

TEST_F(Faults, GarbageAtTheStartIsNotPublished) {
  standin::Faults faults{};
  faults.garbage_ticks = 130;
  inject(faults);
  device_->open();
  EXPECT_GT(standin_control().ticks(), 130u);
  EXPECT_GE(device_->status().invalid_samples, 29u);
}

TEST_F(Faults, DeviceThatGivesOnlyGarbageFailsToOpen) {
  standin::Faults faults{};
  faults.garbage_ticks = 1000000;
  inject(faults);
  EXPECT_EQ(open_failure().failure, hd::Failure::device);
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
  for (const unsigned int code : {0x0201u, 0x0202u, 0x0203u}) {
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
  for (const unsigned int code :
       {0x0100u, 0x0103u, 0x0104u, 0x0300u, 0x0304u, 0x0400u, 0x0402u, 0x0600u, 0x0999u}) {
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

TEST_F(Faults, MotorsThatStayOffFailTheArming) {
  standin::Faults faults{};
  faults.motors_stay_off = true;
  inject(faults);
  device_->open();
  device_->calibrate();
  EXPECT_THROW(device_->arm(), hd::OpenError);
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
  // One leaves, the other goes on.
  second->close();
  push(1000, 0.2);
  EXPECT_NEAR(observe(0).force_N[0], 0.2, 1e-12);
  EXPECT_EQ(motor_force_N(1), 0);
}

TEST_F(Faults, RefusedRateGoesOnAtTheDriversOwn) {
  standin::Faults faults{};
  faults.refuse_rate = true;
  inject(faults);
  arm();
  EXPECT_TRUE(device_->identity().rate_refused);
  push(1000);
  EXPECT_NEAR(motor_force_N(), 0.5, 1e-12);
}

TEST_F(Faults, ServoThatNeverTicksFailsToOpen) {
  standin::Faults faults{};
  faults.never_ticks = true;
  inject(faults);
  const hd::OpenError error = open_failure();
  EXPECT_NE(std::string(error.what()).find("does not tick"), std::string::npos) << error.what();
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

TEST_F(Faults, CommaInTheLocaleChangesNothing) {
  // A locale of our own, in case none with a comma is installed.
  const std::filesystem::path folder = std::filesystem::path(SULCUS_BINARY_DIR) / "locales";
  std::filesystem::create_directories(folder);
  const std::string command =
      "localedef -c -i de_DE -f UTF-8 '" + (folder / "de_DE.UTF-8").string() + "' >/dev/null 2>&1";
  if (!std::filesystem::exists(folder / "de_DE.UTF-8") && std::system(command.c_str()) == -1) GTEST_SKIP();
  setenv("LOCPATH", folder.c_str(), 1);
  if (std::setlocale(LC_NUMERIC, "de_DE.UTF-8") == nullptr || std::strtod("1.5", nullptr) == 1.5) {
    std::setlocale(LC_NUMERIC, "C");
    GTEST_SKIP()
        << "no locale with a decimal comma: localedef or the sources of de_DE (package locales) are missing";
  }
  standin::Faults faults{};
  faults.needs_decimal_point = true;
  inject(faults);
  device_->open();
  DeviceSample sample;
  device_->calibrate();
  device_->arm();
  EXPECT_EQ(device_->read(0, sample), DeviceError::none);
  EXPECT_GT((sample.position - Vec3(0, -0.11, -0.035)).norm(), 0.01);  // the joints are alive
  EXPECT_STREQ(std::setlocale(LC_NUMERIC, nullptr), "de_DE.UTF-8");
  std::setlocale(LC_NUMERIC, "C");
}

}  // namespace
}  // namespace sulcus
