#include "base/number_text.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <clocale>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>

namespace isorig::base {
namespace {

TEST(NumberText, SignificantDigitsWithoutTrailingZeros) {
  EXPECT_EQ(number_text(12.5), "12.5");
  EXPECT_EQ(number_text(12.50000001), "12.5");
  EXPECT_EQ(number_text(1.0 / 3.0, 3), "0.333");
  EXPECT_EQ(number_text(1e6), "1e+06");
  EXPECT_EQ(number_text(999999.0), "999999");
  EXPECT_EQ(number_text(-0.00012345, 4), "-0.0001234");
  EXPECT_EQ(number_text(0.0), "0");
  EXPECT_EQ(number_text(std::numeric_limits<double>::infinity()), "inf");
  EXPECT_EQ(number_text(std::nan("")), "nan");
}

// It stands where printf stood: the same text for any double and number of digits.
TEST(NumberText, IsWhatPrintfWrites) {
  std::mt19937_64 random(20261122);
  for (int i = 0; i < 100'000; ++i) {
    const double value =
        i % 2 == 0 ? std::bit_cast<double>(random())
                   : static_cast<double>(static_cast<std::int64_t>(random() % 2'000'001) - 1'000'000) / 1000.0;
    if (!std::isfinite(value)) continue;
    const int digits = 1 + static_cast<int>(random() % 17);
    char text[64];
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    ASSERT_EQ(number_text(value, digits), text) << digits;
  }
}

TEST(NumberText, ExactReadsBackAsTheSameDouble) {
  EXPECT_EQ(exact_number_text(0.1), "0.1");
  EXPECT_EQ(exact_number_text(120.0), "120");
  std::mt19937_64 random(20261123);
  for (int i = 0; i < 100'000; ++i) {
    const double value = std::bit_cast<double>(random());
    if (!std::isfinite(value)) continue;
    ASSERT_EQ(std::strtod(exact_number_text(value).c_str(), nullptr), value);
  }
}

TEST(NumberText, DigitsOutOfRangeAreHeldWithinIt) {
  EXPECT_EQ(number_text(1.25, 0), "1");
  EXPECT_EQ(number_text(0.1, 99), "0.10000000000000001");
  EXPECT_EQ(number_text(-std::numeric_limits<double>::denorm_min(), 99), "-4.9406564584124654e-324");
}

}  // namespace
}  // namespace isorig::base
