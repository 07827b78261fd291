#include "engine/device/conformance_test.h"

#include <sstream>

#include "device_sim/csv.h"
#include "device_sim/hand.h"
#include "device_sim/perturbed.h"
#include "device_sim/recorded.h"
#include "device_sim/scripted.h"
#include "device_sim/test_metronome.h"

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

std::unique_ptr<Device> recorded() {
  const auto device = scripted();
  return make_recorded_device(samples_of(*device));
}

std::unique_ptr<Device> from_csv() {
  std::istringstream table(
      "time_s,x_m,y_m,z_m,qs,qx,qy,qz,buttons\n"
      "0,0,0,0.05,1,0,0,0,0\n"
      "1,0.02,0,0,0.8,0.6,0,0,1\n"
      "3,0,0.03,0,1,0,0,0,0\n");
  return make_scripted_device(read_trajectory_csv(table, "table"));
}

std::unique_ptr<Device> shaking() {
  ScriptedTrajectory trajectory = swing();
  trajectory.tremor = {.position_rms_m = 2e-4, .rotation_rms_rad = 0.01};
  return make_scripted_device(trajectory);
}

INSTANTIATE_TEST_SUITE_P(
    Simulated, DeviceConformance,
    testing::Values(DeviceUnderTest{"Scripted", scripted}, DeviceUnderTest{"Shaking", shaking},
                    DeviceUnderTest{"Recorded", recorded}, DeviceUnderTest{"Csv", from_csv},
                    DeviceUnderTest{"Hand", [] { return make_hand_device(swing(), firm_hand); }},
                    DeviceUnderTest{"Push",
                                    [] {
                                      return make_push_device({.direction = {1, 0, 0}, .threshold_N = 1});
                                    }},
                    DeviceUnderTest{"PerturbedOff", [] { return make_perturbed_device(scripted(), {}); }},
                    DeviceUnderTest{"Metronome", [] { return std::make_unique<Metronome>(); }}),
    conformance_name);

}  // namespace
}  // namespace sulcus
