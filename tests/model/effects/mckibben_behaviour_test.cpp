// What the laws of muscles and dampers are there for, seen from outside.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "judge.hpp"
#include "ways.hpp"

namespace isorig::test {
namespace {

/// The force of one law alone, at every grid point.
Curve alone(model::Part law, const Track& track) {
  return all_rows({"", {std::move(law)}}, track);
}

/// Out by 1 mm in 10 ms from the position to_mm - 1, hold of 2 s; the row at which the hold begins.
Track ramp_to(double to_mm, std::size_t& hold) {
  const double wait_s = 60.0;  // all that the way there left has relaxed
  Track track = go(1e-2, {{to_mm - 1.0, 1.0}, {to_mm - 1.0, wait_s}, {to_mm, 1e-2}, {to_mm, 2.0}});
  hold = track.size() - 201;
  return track;
}

TEST(QuasiLinear, WithoutAnExponentIsTheLinearArm) {
  const Track track = closed_track(4);
  const Curve linear = alone(part("maxwell", "linear", {0.8}, {2.0}), track);
  for (const std::string_view law : {"fung_arm", "relaxation_time"}) {
    const Curve force = alone(part("quasi_linear_viscoelasticity", law, {0.8, 0.0}, {2.0}), track);
    for (std::size_t i = 0; i < force.size(); ++i) ASSERT_NEAR(force[i], linear[i], 1e-12) << law;
  }
}

TEST(QuasiLinear, FungsArmRelaxesByTheSameShareEverywhereFromAnotherForce) {
  const double b = 0.4, tau_s = 0.8;
  std::size_t hold = 0;
  const Track low = ramp_to(0.0, hold), high = ramp_to(2.0, hold);
  const model::Part law = part("quasi_linear_viscoelasticity", "fung_arm", {tau_s, b}, {2.0});
  const Curve at_low = alone(law, low), at_high = alone(law, high);
  EXPECT_NEAR(at_high[hold] / at_low[hold], std::exp(2.0 * b), 1e-9);
  for (const std::size_t after : {50U, 150U}) {
    const double share = std::exp(-static_cast<double>(after) * low.step_s / tau_s);
    EXPECT_NEAR(at_low[hold + after] / at_low[hold], share, 1e-9);
    EXPECT_NEAR(at_high[hold + after] / at_high[hold], share, 1e-9);
  }
}

TEST(QuasiLinear, RelaxationTimeIsLongerByItsExponential) {
  const double b = 0.4, tau_s = 0.8;
  for (const double to_mm : {-1.0, 2.0}) {
    std::size_t hold = 0;
    const Track track = ramp_to(to_mm, hold);
    const Curve force = alone(part("quasi_linear_viscoelasticity", "relaxation_time", {tau_s, b}, {2.0}), track);
    EXPECT_NEAR(force[hold + 100] / force[hold], std::exp(-1.0 / (tau_s * std::exp(b * to_mm))), 1e-9);
  }
}

/// Steps of any length, time constants far below them included: nothing overflows.
TEST(QuasiLinear, StaysFiniteFarOutsideOfItsRange) {
  for (const std::string_view law : {"fung_arm", "relaxation_time"}) {
    for (const double b : {-1.0, 1.0}) {
      for (const double tau_s : {1e-3, 1e4}) {
        const Track track = go(100.0, {{400.0, 1000.0}, {-400.0, 1000.0}, {-400.0, 1000.0}});
        for (const double f : alone(part("quasi_linear_viscoelasticity", law, {tau_s, b}, {1.0}), track))
          ASSERT_TRUE(std::isfinite(f)) << law << ", b " << b << ", tau " << tau_s;
      }
    }
  }
}

TEST(DirectionalDamping, RelaxesAfterLengtheningAndShorteningEachWithItsOwnTime) {
  const double tau_s = 0.8, ratio = 0.4;
  const model::Part law = part("directional_damping", "series", {tau_s, ratio}, {2.0});
  for (const double to_mm : {1.0, -1.0}) {
    const Curve force = alone(law, go(1e-2, {{to_mm, 0.1}, {to_mm, 2.0}}));
    const double expected_s = to_mm > 0.0 ? tau_s : tau_s * ratio;
    EXPECT_NEAR(force[110] / force[10], std::exp(-1.0 / expected_s), 1e-9) << to_mm;
  }
}

TEST(DirectionalDamping, InParallelPullsByTheCoefficientOfItsDirection) {
  const Curve force =
      alone(part("directional_damping", "parallel", {}, {0.05, 0.02}), go(1e-2, {{2.0, 0.5}, {0.0, 0.5}, {0.0, 1.0}}));
  EXPECT_NEAR(force[25], 0.05 * 4.0, 1e-12);
  EXPECT_NEAR(force[75], -0.02 * 4.0, 1e-12);
  EXPECT_EQ(force.back(), 0.0);
}

/// Out to 2 mm, back, again, then on to 3 mm, back and again; a second of 100 instants a millimetre.
Track growing() {
  return go(1e-2, {{2.0, 2.0}, {0.0, 2.0}, {2.0, 2.0}, {3.0, 1.0}, {0.0, 3.0}, {3.0, 3.0}});
}

TEST(Mullins, RetracesItsUnloadingAndIsAsStiffAsEverOnFirstLoading) {
  Track track = growing();
  track.elongation_at_zero_mm = 5.0;
  const Curve force = all_rows({"", {spring(2.5), part("mullins_softening", "ogden_roxburgh", {4.0}, {-0.5})}}, track);
  EXPECT_NEAR(force[100], 2.5 * 6.0, 1e-9);
  EXPECT_LT(force[300], 2.5 * 6.0 - 0.5);
  EXPECT_NEAR(force[500], force[300], 1e-9) << "the second loading to 2 mm runs along the first unloading";
  EXPECT_NEAR(force[650], 2.5 * 7.5, 1e-9) << "beyond the old largest strain it is the first loading again";
  EXPECT_LT(force[900], force[300] - 1e-3) << "after a larger one it is softer at the same place";
  EXPECT_NEAR(force[1100], force[900], 1e-9);
}

TEST(Mullins, DamageGrowsWithTheLargestStrainAndNotWithRepetition) {
  Track track = growing();
  track.elongation_at_zero_mm = 5.0;
  const double scale_mm = 1.5;
  const Curve force = all_rows({"", {spring(2.5), part("mullins_softening", "damage", {scale_mm}, {-0.5})}}, track);
  const auto left_N_mm = [&](double largest_mm) { return 2.5 - 0.5 * (1.0 - std::exp(-largest_mm / scale_mm)); };
  EXPECT_NEAR(force[100], left_N_mm(1.0) * 6.0, 1e-9);
  EXPECT_NEAR(force[300], left_N_mm(2.0) * 6.0, 1e-9);
  EXPECT_NEAR(force[500], force[300], 1e-9);
  EXPECT_NEAR(force[1100], left_N_mm(3.0) * 6.0, 1e-9);
}

TEST(PermanentSet, LosesAForceToTheLargestExtensionAndKeepsItLost) {
  const Track track = growing();
  const auto at = [&](std::string_view law, std::vector<double> p, std::size_t row) {
    return alone(part("permanent_set", law, std::move(p), {-0.3}), track)[row];
  };
  EXPECT_NEAR(at("proportional", {}, 400), -0.3 * 2.0, 1e-9);
  EXPECT_NEAR(at("proportional", {}, 1000), -0.3 * 3.0, 1e-9);
  EXPECT_EQ(at("yield", {2.5}, 600), 0.0);
  EXPECT_NEAR(at("yield", {2.5}, 1000), -0.3 * 0.5, 1e-9);
  EXPECT_NEAR(at("saturating", {0.5}, 1300), -0.3 * (1.0 - std::exp(-6.0)), 1e-9);
  // Shortening lengthens nothing.
  EXPECT_EQ(alone(part("permanent_set", "proportional", {}, {-0.3}), go(1e-2, {{-3.0, 3.0}, {0.0, 3.0}})).back(), 0.0);
}

TEST(FrictionWithLoad, MakesALoopAsHighAsItsShareOfTheForce) {
  const double share = 0.1;
  for (const double elongation_mm : {5.0, 20.0}) {
    Track track = go(1e-2, {{2.0, 2.0}, {0.0, 2.0}});
    track.elongation_at_zero_mm = elongation_mm;
    const Curve force = all_rows({"", {part("friction_with_load", "capstan", {0.02, share}, {}), spring(2.5)}}, track);
    // Both ways at 1 mm, fifty presliding lengths after each turn.
    EXPECT_NEAR(force[100] - force[300], 2.0 * share * 2.5 * (elongation_mm + 1.0), 1e-9) << elongation_mm;
  }
}

constexpr double kRest_mm = 90.0, kAngle_deg = 28.0, kAbsolute_psi = 15.0 + 14.696;

model::Part gas(double valve_s, double exponent = 1.2) {
  return part("trapped_gas", "polytropic", {valve_s, kAngle_deg, exponent, kRest_mm}, {0.7});
}

/// Of a braid, as a share of that at rest.
double volume(double x_mm) {
  const double thread_mm = kRest_mm / std::cos(kAngle_deg * M_PI / 180.0), length_mm = kRest_mm + x_mm;
  return length_mm * (thread_mm * thread_mm - length_mm * length_mm) /
         (kRest_mm * (thread_mm * thread_mm - kRest_mm * kRest_mm));
}
double lever(double x_mm) {
  return (volume(x_mm + 1e-4) - volume(x_mm - 1e-4)) / (volume(1e-4) - volume(-1e-4));
}

TEST(TrappedGas, BehindAShutValveFollowsThePolytrope) {
  for (const double exponent : {1.0, 1.2, 1.4}) {
    const Curve force = alone(gas(1000.0, exponent), go(1e-2, {{3.0, 0.1}, {-3.0, 0.2}}));
    EXPECT_NEAR(force[10] / (0.7 * lever(3.0) * kAbsolute_psi * (std::pow(volume(3.0), -exponent) - 1.0)), 1.0, 1e-3);
    EXPECT_NEAR(force[30] / (0.7 * lever(-3.0) * kAbsolute_psi * (std::pow(volume(-3.0), -exponent) - 1.0)), 1.0, 1e-3);
  }
}

/// F = kappa p0 V'^2 / V z, by the force for each psi f = -V'.
TEST(TrappedGas, InAShortStrokeIsAMaxwellArm) {
  const double size_mm = 1e-3, share_1_mm = (volume(-1e-4) - volume(1e-4)) / 2e-4, valve_s = 0.5;
  const Track track = go(1e-2, {{size_mm, 0.2}, {size_mm, 1.0}, {-size_mm, 0.2}, {0.0, 1.0}});
  const Curve force = alone(gas(valve_s), track);
  const Curve arm = alone(part("maxwell", "linear", {valve_s}, {0.7 * 1.2 * kAbsolute_psi * share_1_mm}), track);
  for (std::size_t i = 0; i < force.size(); ++i) ASSERT_NEAR(force[i], arm[i], 2e-4 * 0.7 * size_mm * kAbsolute_psi);
}

/// The pressure inside is late by the valve's time constant, and the gauge shows the rest.
TEST(TrappedGas, AddsWhatTheGaugeDoesNotShow) {
  Track track = go(1e-2, {{0.0, 2.0}});
  for (std::size_t i = 0; i < track.size(); ++i) track.excess_psi[i] = 0.1 * track.t_s(i);
  EXPECT_NEAR(alone(gas(0.01), track).back(), -0.7 * 0.1 * 0.01, 1e-9);
}

/// No step is too long for a straight motion, a whole stroke of 6 mm included.
TEST(TrappedGas, DoesNotDependOnTheSamplingRate) {
  for (const double valve_s : {0.05, 0.5, 50.0}) {
    const Curve fine = alone(gas(valve_s), go(1e-3, {{3.0, 0.5}, {-3.0, 1.0}, {0.0, 0.5}}));
    const Curve coarse = alone(gas(valve_s), go(0.5, {{3.0, 0.5}, {-3.0, 1.0}, {0.0, 0.5}}));
    for (std::size_t i = 0; i < coarse.size(); ++i) EXPECT_NEAR(coarse[i], fine[500 * i], 1e-6 * kAbsolute_psi);
  }
}

/// Where the threads end the gas is still there; far beyond nothing overflows.
TEST(TrappedGas, StaysFiniteFarOutsideOfItsRange) {
  for (const double f : alone(gas(0.5), go(10.0, {{400.0, 100.0}, {-400.0, 100.0}, {0.0, 100.0}})))
    ASSERT_TRUE(std::isfinite(f));
}

}  // namespace
}  // namespace isorig::test
