// The fault matrix until the device is armed: what can go wrong at open(), calibrate() and arm(), one test a
// row.
#include <clocale>
#include <cstdlib>
#include <filesystem>

#include "hw_phantom/faults_fixture.h"

namespace sulcus {
namespace {

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

TEST_F(Faults, DeviceThatStaysInUseIsTriedTwiceAndTold) {
  expect_open_failure(0x0301, hd::Failure::device, "end it, then replug");
  EXPECT_EQ(standin_control().inits_failed(), 2);
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

TEST_F(Faults, InterruptEndsTheWaitForTheCalibration) {
  standin::Faults faults{};
  faults.manual_input_ticks = 1000000;
  inject(faults);
  device_->open();
  stop_all_forces();
  EXPECT_THROW(device_->calibrate(), hd::OpenError);
  EXPECT_LT(standin_control().ticks(), 1000u);
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

TEST_F(Faults, MotorsThatStayOffFailTheArming) {
  standin::Faults faults{};
  faults.motors_stay_off = true;
  inject(faults);
  device_->open();
  device_->calibrate();
  EXPECT_THROW(device_->arm(), hd::OpenError);
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
