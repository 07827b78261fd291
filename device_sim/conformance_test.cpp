#include "engine/device/conformance_test.h"

#include "device_sim/recorded.h"
#include "device_sim/scripted.h"

namespace sulcus {
namespace {

ScriptedTrajectory swing() {
  const Quaternion turn = quaternion_from_rotation_vector({0.3, 0.2, -0.5});
  return {{{0, {0, 0, 0.05}, {}, Path::hold},
           {1, {0.02, 0, 0}, turn, Path::minimum_jerk},
           {3, {0, 0.03, 0}, {}, Path::linear}}};
}

std::unique_ptr<Device> scripted() {
  return make_scripted_device(swing());
}

std::vector<DeviceSample> samples_of(Device& device) {
  device.open();
  device.calibrate();
  device.arm();
  std::vector<DeviceSample> samples(2500);
  for (std::size_t n = 0; n < samples.size(); ++n) device.read(static_cast<double>(n) * 0.001, samples[n]);
  return samples;
}

INSTANTIATE_TEST_SUITE_P(Simulated, DeviceConformance,
                         testing::Values(DeviceUnderTest{"Scripted", scripted},
                                         DeviceUnderTest{"Recorded",
                                                         [] {
                                                           const auto device = scripted();
                                                           return make_recorded_device(samples_of(*device));
                                                         }}),
                         conformance_name);

}  // namespace
}  // namespace sulcus
