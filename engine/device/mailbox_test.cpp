#include "engine/device/mailbox.h"

#include <gtest/gtest.h>

#include <thread>

#include "engine/device/device.h"

namespace sulcus {
namespace {

TEST(Mailbox, GivesTheNewestValueOnce) {
  Mailbox<int> box;
  int value = -1;
  EXPECT_FALSE(box.read(value));
  EXPECT_EQ(value, -1);
  for (int i = 0; i < 5; ++i) box.write(i);
  EXPECT_TRUE(box.read(value));
  EXPECT_EQ(value, 4);
  EXPECT_FALSE(box.read(value));
  box.write(7);
  EXPECT_TRUE(box.read(value));
  EXPECT_EQ(value, 7);
}

// Run under ThreadSanitizer, this also shows that there is no data race.
TEST(Mailbox, NeverTearsAndNeverGoesBackUnderTwoThreads) {
  constexpr std::uint64_t last = 200000;
  Mailbox<DeviceSample> box;
  std::thread writer([&] {
    DeviceSample sample;
    for (std::uint64_t n = 1; n <= last; ++n) {
      const double x = static_cast<double>(n);
      sample.sequence = n;
      sample.position = {x, x, x};
      sample.force_sent = {x, x, x};
      sample.motor_temperature = x;
      box.write(sample);
    }
  });
  DeviceSample sample;
  std::uint64_t before = 0;
  while (before < last) {
    if (!box.read(sample)) continue;
    const double x = static_cast<double>(sample.sequence);
    if (sample.sequence <= before || sample.position != Vec3(x, x, x) || sample.force_sent != Vec3(x, x, x) ||
        sample.motor_temperature != x) {
      ADD_FAILURE() << "torn or old value " << sample.sequence << " after " << before;
      break;
    }
    before = sample.sequence;
  }
  writer.join();
}

}  // namespace
}  // namespace sulcus
