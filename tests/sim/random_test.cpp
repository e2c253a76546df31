#include "sim/random.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace isorig::sim {
namespace {

TEST(Random, NormalHasTheMomentsAndTailsOfANormal) {
  Random random(1, 1);
  const int n = 4'000'000;
  double m1 = 0.0;
  double m2 = 0.0;
  double m3 = 0.0;
  double m4 = 0.0;
  int beyond2 = 0;
  int beyond3_6 = 0;  // in Marsaglia's tail (begins at 3.44)
  for (int i = 0; i < n; ++i) {
    const double x = random.normal();
    m1 += x;
    m2 += x * x;
    m3 += x * x * x;
    m4 += x * x * x * x;
    beyond2 += std::abs(x) > 2.0;
    beyond3_6 += std::abs(x) > 3.6;
  }
  // Four standard errors each.
  const double root = std::sqrt(static_cast<double>(n));
  EXPECT_NEAR(m1 / n, 0.0, 4.0 / root);
  EXPECT_NEAR(m2 / n, 1.0, 4.0 * std::sqrt(2.0) / root);
  EXPECT_NEAR(m3 / n, 0.0, 4.0 * std::sqrt(15.0) / root);
  EXPECT_NEAR(m4 / n, 3.0, 4.0 * std::sqrt(96.0) / root);
  const double p2 = std::erfc(2.0 / std::sqrt(2.0));
  const double p36 = std::erfc(3.6 / std::sqrt(2.0));
  EXPECT_NEAR(beyond2, n * p2, 4.0 * std::sqrt(n * p2));
  EXPECT_NEAR(beyond3_6, n * p36, 4.0 * std::sqrt(n * p36));
}

TEST(Random, NormalFollowsItsDistributionEverywhere) {
  // Chi-square over 100 bins of equal probability; 99.99 % quantile for 99 degrees of freedom is 161.3.
  Random random(3, 9);
  const int n = 1'000'000;
  std::vector<int> bins(100, 0);
  for (int i = 0; i < n; ++i) {
    const double p = 0.5 * std::erfc(-random.normal() / std::sqrt(2.0));
    ++bins[static_cast<std::size_t>(std::min(99.0, p * 100.0))];
  }
  double chi2 = 0.0;
  for (const int count : bins) chi2 += (count - n / 100.0) * (count - n / 100.0) / (n / 100.0);
  EXPECT_LT(chi2, 161.3);
  EXPECT_GT(chi2, 50.0);
}

TEST(Random, StreamsAreIndependentAndReproducible) {
  Random a(1, 1);
  Random again(1, 1);
  Random other_stream(1, 2);
  Random other_seed(2, 1);
  double correlation = 0.0;
  bool equal = false;
  const int n = 100'000;
  for (int i = 0; i < n; ++i) {
    const double x = a.normal();
    ASSERT_EQ(x, again.normal());
    const double y = other_stream.normal();
    equal = equal || x == y || x == other_seed.normal();
    correlation += x * y;
  }
  EXPECT_FALSE(equal);
  EXPECT_NEAR(correlation / n, 0.0, 4.0 / std::sqrt(n));
}

TEST(Random, ExponentialHasMeanAndVarianceOne) {
  Random random(4, 4);
  const int n = 1'000'000;
  double sum = 0.0;
  double squares = 0.0;
  for (int i = 0; i < n; ++i) {
    const double x = random.exponential();
    ASSERT_GE(x, 0.0);
    sum += x;
    squares += x * x;
  }
  EXPECT_NEAR(sum / n, 1.0, 4e-3);
  EXPECT_NEAR(squares / n, 2.0, 2e-2);
}

TEST(Quantise, RoundsToTheNearestMultiple) {
  EXPECT_DOUBLE_EQ(quantise(1.23456, 0.001, 1000.0), 1.235);
  EXPECT_DOUBLE_EQ(quantise(-1.23449, 0.001, 1000.0), -1.234);
  EXPECT_DOUBLE_EQ(quantise(0.0, 0.001, 1000.0), 0.0);
}

}  // namespace
}  // namespace isorig::sim
