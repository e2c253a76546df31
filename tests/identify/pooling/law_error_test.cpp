// An error of the law that all recordings share: in every actuator's number as in the mean.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "identify/pooling/pool.hpp"

namespace isorig::identify::pooling {
namespace {

constexpr double kError = 0.1;          // the stated standard error of each recording
constexpr double kShared = 0.89 * 0.1;  // that of what they share
constexpr std::size_t kActuators = 6;
constexpr double kTrue = 10.0, kTrue_psi = 0.5;

/// Twenty recordings of each actuator at each pressure, all of them off by what `shared` says of their pressure.
template <typename Shared>
Quantity measured(const std::vector<double>& pressures_psi, double mean_psi, Shared shared) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  Quantity out;
  for (std::size_t i = 0; i < kActuators; ++i)
    for (const double p : pressures_psi)
      for (int k = 0; k < 20; ++k)
        out.measurements.push_back(
            {i, p, kTrue + kTrue_psi * (p - mean_psi) + shared(p) + kError * normal(random), kError});
  out.pooled = pool_quantity(out.measurements, kActuators);
  return out;
}

bool holds(const Estimate& of, double truth) {
  return of.low95 <= truth && truth <= of.high95;
}

TEST(LawError, AnActuatorsIntervalHoldsWhatTheMeansHolds) {
  // 1.5 standard deviations of the shared error, which the mean's interval has to hold.
  Quantity q = measured({10.0}, 10.0, [](double) { return 1.5 * kShared; });
  const Pooled before = q.pooled;
  EXPECT_FALSE(holds(before.level, kTrue)) << "many recordings that agree, on a value that is off";
  widen_by_law_error(q);
  EXPECT_TRUE(holds(q.pooled.level, kTrue));
  for (std::size_t i = 0; i < kActuators; ++i) {
    const Pooled::Actuator& one = q.pooled.actuators[i];
    EXPECT_TRUE(holds(one.level, kTrue)) << i;
    EXPECT_EQ(one.level.value, before.actuators[i].level.value);
    EXPECT_GE(one.level.high95 - one.level.value, kZ95 * kShared);
    EXPECT_NEAR(one.unpooled_error, std::hypot(before.actuators[i].unpooled_error, kShared), 1e-12);
  }
}

TEST(LawError, SoDoesTheIntervalOfItsChangeWithThePressure) {
  // Errors of 0.89 standard errors at 10, 15 and 20 psi, none the other's: the slope's is theirs over sqrt(2) 5 psi.
  constexpr double kSlope_psi = kShared / (1.41421356 * 5.0);
  Quantity q = measured({10.0, 15.0, 20.0}, 15.0, [](double p) { return 1.5 * kSlope_psi * (p - 15.0); });
  EXPECT_FALSE(holds(*q.pooled.slope, kTrue_psi));
  widen_by_law_error(q);
  EXPECT_TRUE(holds(*q.pooled.slope, kTrue_psi));
  for (const Pooled::Actuator& one : q.pooled.actuators) {
    EXPECT_TRUE(holds(*one.slope, kTrue_psi));
    EXPECT_GE(one.slope->high95 - one.slope->value, kZ95 * kSlope_psi * 0.999);
  }
}

}  // namespace
}  // namespace isorig::identify::pooling
