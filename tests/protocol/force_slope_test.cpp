#include "protocol/force_slope.hpp"

#include <gtest/gtest.h>

#include <random>

namespace isorig::protocol {
namespace {

constexpr std::int64_t kTick_ns = 1'000'000;

TEST(ForceSlope, IsThatOfALineExactlyAndNotBeforeTheWindowIsFull) {
  ForceSlope slope;
  slope.reset(0, 10.0);
  std::int64_t full_at_ns = 0;
  for (std::int64_t t_ns = 0; t_ns <= 60'000'000'000; t_ns += kTick_ns) {
    slope.add(t_ns, 100.0 + 0.05 * static_cast<double>(t_ns) * 1e-9);
    if (full_at_ns == 0 && slope.full()) full_at_ns = t_ns;
  }
  EXPECT_NEAR(static_cast<double>(full_at_ns) * 1e-9, 10.0, 0.002);
  EXPECT_NEAR(slope.slope_N_s(), 0.05, 1e-9);
}

TEST(ForceSlope, ScattersAsStated) {
  // sigma * sqrt(12 / n) / T: averaging in bins gives nothing away but (N^2 - 1) / N^2.
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, 0.03);
  ForceSlope slope;
  slope.reset(0, 2.0);
  double sum2 = 0.0;
  int windows = 0;
  for (std::int64_t t_ns = 0; windows < 2000; t_ns += kTick_ns) {
    slope.add(t_ns, noise(random));
    if (t_ns % 2'000'000'000 == 0 && slope.full()) {
      sum2 += slope.slope_N_s() * slope.slope_N_s();
      ++windows;
    }
  }
  const double expected_N_s = 0.03 * std::sqrt(12.0 / 2000.0) / 2.0;
  // The standard deviation of 2000 estimates is known to 1/sqrt(4000) = 1.6 %.
  EXPECT_NEAR(std::sqrt(sum2 / windows) / expected_N_s, 1.0, 0.06);
}

TEST(ForceSlope, RoundingDoesNotAddUpOverADay) {
  ForceSlope slope;
  slope.reset(0, 20.0);
  for (std::int64_t i = 0; i < 864'000; ++i) {  // 10 Hz for a day
    slope.add(i * 100'000'000, 150.0 + 10.0 * std::sin(0.37 * static_cast<double>(i)));
  }
  for (std::int64_t i = 864'000; i < 864'400; ++i) slope.add(i * 100'000'000, 150.0);
  EXPECT_NEAR(slope.slope_N_s(), 0.0, 1e-9);
}

TEST(ForceSlope, MissingDataEmptiesTheWindow) {
  ForceSlope slope;
  slope.reset(0, 2.0);
  std::int64_t t_ns = 0;
  for (; t_ns < 3'000'000'000; t_ns += kTick_ns) slope.add(t_ns, 1.0);
  ASSERT_TRUE(slope.full());
  t_ns += 500'000'000;  // several bins of 0.1 s without a sample
  slope.add(t_ns, 1.0);
  EXPECT_FALSE(slope.full());
}

TEST(ForceSlope, TakesSamplesThatComeInBursts) {
  ForceSlope slope;  // a frame polled at 20 Hz
  slope.reset(0, 2.0);
  for (std::int64_t t_ns = 0; t_ns < 5'000'000'000; t_ns += 50'000'000)
    slope.add(t_ns, 3e-9 * static_cast<double>(t_ns));
  EXPECT_TRUE(slope.full());
  EXPECT_NEAR(slope.slope_N_s(), 3.0, 1e-6);
}

}  // namespace
}  // namespace isorig::protocol
