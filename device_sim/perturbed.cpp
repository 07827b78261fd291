#include "device_sim/perturbed.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "device_sim/tremor.h"
#include "engine/numerics/error.h"

namespace sulcus {
namespace {

void check(const Perturbation& p) {
  const auto refuse = [](bool bad, const std::string& what) {
    if (bad) throw InputError("perturbation: " + what);
  };
  refuse(!(p.time_rate > 0) || !std::isfinite(p.time_rate), "time_rate must be positive");
  for (const double share : {p.lost_share, p.late_share}) {
    refuse(!(share >= 0 && share <= 1), "share " + std::to_string(share) + " is not within 0..1");
  }
  for (const double number :
       {p.jitter_s, p.late_s, p.stuck_for_s, p.nan_for_s, p.encoder_step_m, p.encoder_step_rad}) {
    refuse(!(number >= 0) || !std::isfinite(number), "durations and steps must be zero or positive");
  }
}

double rounded(double value, double step) {
  return step > 0 ? std::floor(value / step + 0.5) * step : value;
}

class PerturbedDevice final : public Device {
 public:
  PerturbedDevice(std::unique_ptr<Device> device, const Perturbation& perturbation)
      : device_(std::move(device)), p_(perturbation) {
    check(p_);
  }

  DeviceCapabilities capabilities() const override { return device_->capabilities(); }
  DeviceState state() const override { return disconnected_ ? DeviceState::faulted : device_->state(); }
  void open() override {
    device_->open();
    random_ = {p_.seed};
    count_ = 0;
    inner_time_s_ = -std::numeric_limits<double>::infinity();
    have_stuck_ = false;
  }
  void calibrate() override { device_->calibrate(); }
  void arm() override {
    if (disconnected_) throw EnvironmentError("device: disconnected by the perturbation; close it first");
    device_->arm();
  }
  void close() noexcept override {
    device_->close();
    disconnected_ = false;
  }
  void write(const DeviceCommand& command) override {
    if (disconnected_) return;
    DeviceCommand inner = command;
    inner.expiry_s *= p_.time_rate;  // to the clock of the device below
    device_->write(inner);
  }
  // A servo function would see the device below unperturbed; the caller drives this one itself.
  bool set_servo(ServoFunction, void*) override { return false; }

  DeviceError read(double time_s, DeviceSample& sample) override;

 private:
  static constexpr std::size_t kept = 64;

  static bool within(double time_s, double from_s, double for_s) {
    return for_s > 0 && time_s >= from_s && time_s < from_s + for_s;
  }
  void quantise(DeviceSample& sample) const;

  std::unique_ptr<Device> device_;
  Perturbation p_;
  SplitMix64 random_;
  std::array<DeviceSample, kept> past_{};  // ring of what the reads gave before delay, [count_ % kept]
  std::uint64_t count_ = 0;
  double inner_time_s_ = 0;
  DeviceSample delivered_, stuck_;
  bool have_stuck_ = false, disconnected_ = false;
};

void PerturbedDevice::quantise(DeviceSample& sample) const {
  for (int i = 0; i < 3; ++i) sample.position[i] = rounded(sample.position[i], p_.encoder_step_m);
  if (p_.encoder_step_rad > 0) {
    Vec3 turn = rotation_vector(sample.orientation);
    for (int i = 0; i < 3; ++i) turn[i] = rounded(turn[i], p_.encoder_step_rad);
    sample.orientation = quaternion_from_rotation_vector(turn);
  }
}

DeviceError PerturbedDevice::read(double time_s, DeviceSample& sample) {
  if (disconnected_) return DeviceError::fatal;
  const bool running = device_->state() == DeviceState::armed || device_->state() == DeviceState::running;
  if (running && p_.disconnect_at_s >= 0 && time_s >= p_.disconnect_at_s) {
    device_->write(DeviceCommand());
    disconnected_ = true;
    return DeviceError::fatal;
  }
  // The same number of draws at each read, so that one fault does not shift the others.
  const double jitter_s = p_.jitter_s * (2 * random_.uniform() - 1);
  const bool lost = random_.uniform() < p_.lost_share, late = random_.uniform() < p_.late_share;

  double inner_time_s = p_.time_rate * time_s;
  if (p_.jitter_s > 0 && std::isfinite(time_s))
    inner_time_s = std::max(inner_time_s + jitter_s, inner_time_s_);
  DeviceSample fresh;
  const DeviceError error = device_->read(inner_time_s, fresh);
  if (error == DeviceError::fatal || error == DeviceError::ended) return error;
  inner_time_s_ = inner_time_s;
  if (p_.time_rate != 1) {
    fresh.time_s /= p_.time_rate;
    fresh.interval_s /= p_.time_rate;
    fresh.linear_velocity *= p_.time_rate;
    fresh.angular_velocity *= p_.time_rate;
  }
  quantise(fresh);
  if (within(time_s, p_.nan_from_s, p_.nan_for_s))
    fresh.position.setConstant(std::numeric_limits<double>::quiet_NaN());
  past_[count_ % kept] = fresh;
  ++count_;

  if (late) {
    const std::uint64_t oldest = count_ > kept ? count_ - kept : 0;
    std::uint64_t n = count_ - 1;
    while (n > oldest && past_[n % kept].time_s > time_s - p_.late_s) --n;
    fresh = past_[n % kept];
  }
  if (within(time_s, p_.stuck_from_s, p_.stuck_for_s)) {
    if (!have_stuck_) stuck_ = fresh;
    have_stuck_ = true;
    fresh = stuck_;
  } else {
    have_stuck_ = false;
  }
  if (lost) {
    sample = delivered_;
    return DeviceError::recoverable;
  }
  sample = delivered_ = fresh;
  return error;
}

}  // namespace

std::unique_ptr<Device> make_perturbed_device(std::unique_ptr<Device> device,
                                              const Perturbation& perturbation) {
  return std::make_unique<PerturbedDevice>(std::move(device), perturbation);
}

}  // namespace sulcus
