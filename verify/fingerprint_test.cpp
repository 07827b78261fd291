#include "verify/fingerprint.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <set>

#include "engine/numerics/error.h"
#include "verify/test_run.h"

namespace sulcus {
namespace {

std::uint64_t fingerprint_of(const State& state) {
  std::vector<std::uint64_t> hashes(state_field_names().size());
  hash_state(state, hashes);
  return chain_hash(0, hashes);
}

TEST(Fingerprint, ZeroHasNoSign) {
  const std::vector<double> plus = {1.0, 0.0}, minus = {1.0, -0.0};
  EXPECT_EQ(hash_field("a", plus), hash_field("a", minus));
}

TEST(Fingerprint, EveryNaNIsTheSame) {
  const double quiet = std::numeric_limits<double>::quiet_NaN();
  const double payload = std::bit_cast<double>(std::uint64_t{0x7ff8'0000'0000'1234});
  const double negative = std::bit_cast<double>(std::uint64_t{0xfff8'0000'0000'0000});
  const double signalling = std::bit_cast<double>(std::uint64_t{0x7ff0'0000'0000'0001});
  const std::uint64_t expected = hash_field("a", std::span(&quiet, 1));
  for (const double nan : {payload, negative, signalling}) {
    ASSERT_TRUE(std::isnan(nan));
    EXPECT_EQ(hash_field("a", std::span(&nan, 1)), expected);
  }
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_NE(hash_field("a", std::span(&infinity, 1)), expected);
}

TEST(Fingerprint, SmallestChangeOfANumberChangesIt) {
  const double one = 1.0, next = std::nextafter(1.0, 2.0);
  EXPECT_NE(hash_field("a", std::span(&one, 1)), hash_field("a", std::span(&next, 1)));
  const double zero = 0.0, subnormal = std::numeric_limits<double>::denorm_min();
  EXPECT_NE(hash_field("a", std::span(&zero, 1)), hash_field("a", std::span(&subnormal, 1)));
}

TEST(Fingerprint, NameLengthAndTypeBelongToIt) {
  const std::vector<double> two = {0.0, 0.0}, one = {0.0}, none;
  std::set<std::uint64_t> hashes = {hash_field("a", two), hash_field("a", one), hash_field("a", none),
                                    hash_field("b", one), hash_field("", one)};
  const std::int64_t integer = 0;
  hashes.insert(hash_field("a", std::span(&integer, 1)));
  const std::vector<std::uint8_t> bytes(8, 0);
  hashes.insert(hash_field("a", bytes));
  EXPECT_EQ(hashes.size(), 7u);
}

TEST(Fingerprint, ArraysLongerThanTheBufferAreHashedInOnePiece) {
  std::vector<double> values(5000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i);
  const std::uint64_t hash = hash_field("a", values);
  for (const std::size_t i : {0u, 1023u, 1024u, 2047u, 4999u}) {
    std::vector<double> other = values;
    other[i] += 1;
    EXPECT_NE(hash_field("a", other), hash) << i;
  }
}

// Constants, computed by another program from the definition in the header: they must not depend on the
// machine, the compiler or the version of the library.
TEST(Fingerprint, IsTheSameOnEveryMachine) {
  const std::vector<double> values = {0.0, -0.0, 1.5, -3.25e300};
  EXPECT_EQ(hex16(hash_field("positions", values)), "6f3c607fcef6a8ae");
  EXPECT_EQ(hex16(fingerprint_of(test::small_state(test::small_header()))), "b13a4af46bd0eb6d");
}

TEST(Fingerprint, AnySingleEntryOfTheStateChangesIt) {
  const State state = test::small_state(test::small_header());
  const std::uint64_t before = fingerprint_of(state);
  std::size_t entries = 0;
  State copy = state;
  for_each_field(copy, [&](std::string_view name, auto values) {
    for (auto& value : values) {
      const auto old = value;
      value = old == 0 ? 1 : 0;
      EXPECT_NE(fingerprint_of(copy), before) << name;
      value = old;
      ++entries;
    }
  });
  EXPECT_EQ(entries, 1u + 15 + 15 + 8 + 2 + 2 + 7 + 6 + 6);
  EXPECT_EQ(fingerprint_of(copy), before);
}

TEST(Fingerprint, ChainDependsOnTheOrderOfTheSteps) {
  const std::vector<std::uint64_t> a = {1, 2}, b = {3, 4};
  EXPECT_NE(chain_hash(chain_hash(0, a), b), chain_hash(chain_hash(0, b), a));
  EXPECT_NE(chain_hash(0, a), chain_hash(1, a));
}

TEST(Fingerprint, FirstDivergenceNamesStepAndFields) {
  const std::vector<std::string> names = {"x", "v", "q"};
  const std::vector<std::uint64_t> a = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  std::vector<std::uint64_t> b = a;
  EXPECT_EQ(first_divergence(a, b, names).step, -1);
  b[4] = b[5] = b[6] = 0;
  const Divergence divergence = first_divergence(a, b, names);
  EXPECT_EQ(divergence.step, 1);
  EXPECT_EQ(divergence.fields, (std::vector<std::string>{"v", "q"}));
  EXPECT_EQ(first_divergence(a, std::span(b).first(3), names).step, -1);
}

TEST(Fingerprint, HexadecimalRoundTrips) {
  for (const std::uint64_t value : {std::uint64_t{0}, std::uint64_t{0xdeadbeef}, ~std::uint64_t{0}}) {
    std::uint64_t parsed = 1;
    EXPECT_TRUE(parse_hex16(hex16(value), parsed));
    EXPECT_EQ(parsed, value);
  }
  std::uint64_t parsed = 42;
  for (const char* wrong : {"", "123", "00000000000000000", "000000000000000g", "000000000000000F"})
    EXPECT_FALSE(parse_hex16(wrong, parsed)) << wrong;
  EXPECT_EQ(parsed, 42u);
}

TEST(Fingerprint, HashOfAFileIsOfItsBytes) {
  const auto dir = test::scratch_dir();
  test::write_text(dir / "a", "abc");
  test::write_text(dir / "b", "abc");
  test::write_text(dir / "c", "abd");
  test::write_text(dir / "empty", "");
  EXPECT_EQ(hash_file(dir / "a"), hash_file(dir / "b"));
  EXPECT_NE(hash_file(dir / "a"), hash_file(dir / "c"));
  EXPECT_EQ(hash_file(dir / "empty"),
            "99aa06d3014798d86001c324468d497f");  // published value of XXH3-128 of nothing
  EXPECT_THROW(hash_file(dir / "missing"), InputError);
  EXPECT_THROW(hash_file(dir), InputError);
}

}  // namespace
}  // namespace sulcus
