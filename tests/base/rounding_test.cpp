#include "base/rounding.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace isorig::base {
namespace {

TEST(Rounding, IsLlroundNextToHalves) {
  // Every exponent at which a double still has halves, both signs, a half and its neighbours.
  for (int exponent = 0; exponent <= 52; ++exponent) {
    const double whole = exponent == 0 ? 0.0 : std::ldexp(1.0, exponent - 1);
    for (const double half : {whole + 0.5, whole - 0.5, whole + 1.5}) {
      for (const double toward : {-1e300, 1e300}) {
        for (const double value : {half, std::nextafter(half, toward)}) {
          EXPECT_EQ(rounded(value), std::llround(value)) << value;
          EXPECT_EQ(rounded(-value), std::llround(-value)) << -value;
        }
      }
    }
  }
}

TEST(Rounding, IsLlroundOfAnyNumber) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> mantissa(-1.0, 1.0);
  std::uniform_int_distribution<int> exponent(-60, 62);
  for (int i = 0; i < 1'000'000; ++i) {
    const double value = std::ldexp(mantissa(random), exponent(random));
    ASSERT_EQ(rounded(value), std::llround(value)) << value;
  }
  EXPECT_EQ(rounded(std::numeric_limits<double>::denorm_min()), 0);
  EXPECT_EQ(rounded(-0.0), 0);
}

}  // namespace
}  // namespace isorig::base
