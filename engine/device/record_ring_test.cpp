#include "engine/device/record_ring.h"

#include <gtest/gtest.h>

#include <random>
#include <thread>

namespace sulcus {
namespace {

std::vector<std::byte> record(std::uint64_t number, std::size_t size) {
  std::vector<std::byte> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::byte>((number * 31 + i * 7) & 0xff);
  return bytes;
}

std::vector<std::vector<std::byte>> split(const std::vector<std::byte>& bytes) {
  std::vector<std::vector<std::byte>> records;
  for (std::size_t at = 0; at < bytes.size();) {
    std::uint32_t size = 0;
    std::memcpy(&size, &bytes[at], sizeof size);
    at += sizeof size;
    records.emplace_back(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                         bytes.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  }
  return records;
}

TEST(RecordRing, GivesRecordsInOrderAlsoAcrossItsEnd) {
  RecordRing ring(256);
  std::vector<std::byte> bytes;
  for (std::uint64_t n = 0; n < 200; ++n) {
    const auto in = record(n, n % 97);
    ASSERT_TRUE(ring.push(in)) << n;
    bytes.clear();
    ring.drain(bytes);
    const auto out = split(bytes);
    ASSERT_EQ(out.size(), 1u);
    ASSERT_EQ(out[0], in) << n;
  }
  EXPECT_EQ(ring.lost(), 0u);
}

TEST(RecordRing, WhatDoesNotFitIsCountedAndLeavesTheRestWhole) {
  RecordRing ring(64);
  EXPECT_TRUE(ring.push(record(1, 28)));
  EXPECT_TRUE(ring.push(record(2, 28)));  // full to the last byte
  EXPECT_FALSE(ring.push(record(3, 0)));
  EXPECT_FALSE(ring.push(record(4, 1000)));
  EXPECT_EQ(ring.lost(), 2u);
  std::vector<std::byte> bytes;
  EXPECT_EQ(ring.drain(bytes), 64u);
  const auto out = split(bytes);
  ASSERT_EQ(out.size(), 2u);
  EXPECT_EQ(out[1], record(2, 28));
  EXPECT_TRUE(ring.push(record(5, 60)));
}

TEST(RecordRing, TwoThreadsLoseNothingThatWasTaken) {
  RecordRing ring(4096);
  constexpr std::uint64_t count = 200000;
  std::atomic<bool> done = false;
  std::vector<std::uint64_t> taken;
  std::thread writer([&] {
    std::mt19937_64 random(7);
    for (std::uint64_t n = 0; n < count; ++n) {
      std::vector<std::byte> bytes = record(n, 8 + random() % 120);
      std::memcpy(bytes.data(), &n, sizeof n);
      if (ring.push(bytes)) taken.push_back(n);
    }
    done.store(true, std::memory_order_release);
  });
  std::vector<std::byte> bytes;
  std::vector<std::uint64_t> seen;
  for (bool last = false; !last;) {
    last = done.load(std::memory_order_acquire);
    bytes.clear();
    ring.drain(bytes);
    for (const auto& r : split(bytes)) {
      std::uint64_t n = 0;
      std::memcpy(&n, r.data(), sizeof n);
      std::vector<std::byte> expected = record(n, r.size());
      std::memcpy(expected.data(), &n, sizeof n);
      ASSERT_EQ(r, expected) << n;
      seen.push_back(n);
    }
  }
  writer.join();
  EXPECT_EQ(seen, taken);
  EXPECT_EQ(taken.size() + ring.lost(), count);
}

}  // namespace
}  // namespace sulcus
