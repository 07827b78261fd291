// The set-up of the fault matrix: a Phantom on the stand-in driver, in time that moves by ticks.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

#include "hw_phantom/emergency.h"
#include "hw_phantom/hdapi.h"
#include "hw_phantom/standin_access.h"

namespace sulcus {

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

}  // namespace sulcus
