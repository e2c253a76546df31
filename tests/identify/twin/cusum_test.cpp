#include "identify/twin/cusum.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace isorig::identify::twin {
namespace {

/// Blocks until the alarm of a CUSUM that is fed with an AR(1) process of standard deviation one about `mean`.
double blocks_to_alarm(const CusumDesign& design, double mean, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Cusum cusum(design);
  double z = normal(random);
  for (int block = 1;; ++block) {
    if (cusum.add(z + mean)) return block;
    z = design.phi * z + std::sqrt(1.0 - design.phi * design.phi) * normal(random);
  }
}

double mean_run(const CusumDesign& design, double mean, int runs, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  double sum = 0.0;
  for (int i = 0; i < runs; ++i) sum += blocks_to_alarm(design, mean, random);
  return sum / runs;
}

TEST(Cusum, RunLengthsAreThoseOfTheTables) {
  // Montgomery 2009, section 9.1.3: k = 1/2, h = 5: 465 blocks with two sides, 10.4 to find a shift of one sigma.
  EXPECT_NEAR(0.5 * run_length(0.5, 5.0), 465.0, 0.02 * 465.0);
  EXPECT_NEAR(run_length(0.5, 5.0, 1.0), 10.4, 0.1);
  // h = 4: 168 and 8.38.
  EXPECT_NEAR(0.5 * run_length(0.5, 4.0), 168.0, 0.02 * 168.0);
  EXPECT_NEAR(run_length(0.5, 4.0, 1.0), 8.38, 0.1);
}

TEST(Cusum, CorrelatedResidualsAlarmAsSeldomAsWasAskedFor) {
  for (const double phi : {0.0, 0.9, 0.99}) {
    const CusumDesign design = cusum_design(phi, kShift, 2000.0);
    // Run lengths are nearly exponential: the mean of 900 errs by 3.3 %, three times that and the 3 % of the formula.
    EXPECT_NEAR(mean_run(design, 0.0, 900, 7), 2000.0, 0.13 * 2000.0) << phi;
  }
}

TEST(Cusum, WithoutCorrelationTakenIntoAccountItWouldAlarmOften) {
  CusumDesign design = cusum_design(0.0, kShift, 2000.0);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  double sum = 0.0;
  for (int i = 0; i < 100; ++i) {
    Cusum cusum(design);
    double z = normal(random);
    int block = 1;
    for (; !cusum.add(z); ++block) z = 0.9 * z + std::sqrt(0.19) * normal(random);
    sum += block;
  }
  EXPECT_LT(sum / 100.0, 200.0);
}

TEST(Cusum, AShiftIsFoundWithinTheRunLengthOfItsSize) {
  const double phi = std::exp(-kBlock_s / kShortest_s);
  const CusumDesign design = cusum_design(phi);
  // The first block has the whole shift in its innovation, the others what correlation leaves of it.
  for (const double shift : {2.0, 4.0}) {
    const double each = shift * std::sqrt((1.0 - phi) / (1.0 + phi));
    const double expected = run_length(design.k, design.h, each);
    const double first = shift / std::sqrt(1.0 - phi * phi) - each;
    const double found = mean_run(design, shift, 400, 11);
    EXPECT_LT(found, expected) << shift;
    EXPECT_GT(found, 0.9 * (expected - first / (each - design.k))) << shift;
  }
}

TEST(Cusum, AShiftBeganInTheBlocksSinceTheSumWasZero) {
  const CusumDesign design = cusum_design(std::exp(-kBlock_s / kShortest_s));
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  double worst = 0.0, z = 0.0;
  for (int run = 0; run < 100; ++run) {
    Cusum cusum(design);
    int block = 0;
    for (bool alarm = false; !alarm; ++block) {
      z = design.phi * z + std::sqrt(1.0 - design.phi * design.phi) * normal(random);
      alarm = cusum.add(z + (block >= 300 ? 4.0 : 0.0));
      ASSERT_TRUE(!alarm || block >= 300);
    }
    worst = std::max(worst, std::fabs(static_cast<double>(block) - static_cast<double>(cusum.since()) - 300.0));
  }
  // In control the sum is a walk that goes back to zero; between two zeros lie some 1/k^2 = 20 blocks, seldom 10 times
  // as many.
  EXPECT_LT(worst, 10.0 / (design.k * design.k));
}

TEST(Correlation, IsThatOfTheProcess) {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  const double phi = std::exp(-kBlock_s / 3.0);
  Correlation correlation;
  double z = 0.0;
  for (int block = 0; block < 20'000; ++block) {
    z = phi * z + std::sqrt(1.0 - phi * phi) * normal(random);
    correlation.add(z);
  }
  // Its standard error: sqrt((1 - phi^2) / n) = 0.0018.
  EXPECT_NEAR(correlation.phi(), phi, 0.0055);
}

TEST(Correlation, OfWhiteOrOfShiftedResidualsIsHeldWithinItsBounds) {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  Correlation white, shifted;
  for (int block = 0; block < 600; ++block) {
    white.add(normal(random));
    shifted.add(30.0 + normal(random));
  }
  EXPECT_DOUBLE_EQ(white.phi(), std::exp(-kBlock_s / kShortest_s));
  EXPECT_DOUBLE_EQ(shifted.phi(), std::exp(-kBlock_s / kLongest_s));
}

}  // namespace
}  // namespace isorig::identify::twin
