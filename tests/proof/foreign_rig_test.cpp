#include <gtest/gtest.h>

#include <numbers>

#include "foreign_drive.hpp"
#include "proof/foreign_laws/path.hpp"

/// Laws of the second generator outside of the specimen's material, against closed forms.
namespace isorig::proof::foreign {
namespace {

constexpr double kIntegrated = 1e-4;

Signal line(const Signal& t_s, double slope) {
  Signal out;
  for (const double t : t_s) out.push_back(slope * t);
  return out;
}

TEST(ForeignKinematics, PlayIsHalfItsWidthBehindAndComplianceMore) {
  const Drive d = ramp(2.0, 1.0);
  EXPECT_NEAR(spread_play(d.position_mm, 0.3).back(), 2.0 - 0.15 * (1.0 + 2.0 + 3.0 + 4.0 + 5.0 + 6.0) / 36.0, 1e-12);
  EXPECT_NEAR(compliant_play(d, 0.3, 0.02).back(), 2.0 - 0.15 - 2.0 * 0.02, kIntegrated);
  const Drive inside = sine(0.07, 1.0, 2);
  for (const double y : compliant_play(inside, 0.15, 0.02)) ASSERT_NEAR(y, 0.0, 1e-12);  // never in contact
}

/// Along a ramp the grip lies on the upper flank, wherever the screw is worn, and a turn crosses the gap of that place.
TEST(ForeignKinematics, AWornScrewHasItsPlayWhereItIsWorn) {
  Signal x;
  for (int i = 0; i <= 4000; ++i) x.push_back(-2.0 + 1e-3 * i);
  for (int i = 0; i <= 300; ++i) x.push_back(2.0 - 1e-3 * i);
  const Signal grip = worn_play(x, 0.3, 0.5);
  const auto width = [](double at_mm) { return 0.1 * (1.0 + 2.0 * std::exp(-4.0 * at_mm * at_mm)); };
  for (std::size_t i = 1000; i <= 4000; i += 7) ASSERT_NEAR(x[i] - grip[i], 0.5 * width(x[i]), 1e-12);
  EXPECT_NEAR(grip[4001 + 90], grip[4000], 1e-12);  // 0.09 mm back: still within the gap of 0.1 mm
  EXPECT_NEAR(grip.back() - x.back(), 0.5 * width(x.back()), 1e-12);
}

TEST(ForeignKinematics, SlipsAreSettledDisplacements) {
  const Signal t_s = ramp(1.0, 4.0).t_s;
  const SlipEvent events[] = {{0.5, 1.0}, {1.5, 0.4}};
  const Signal slipped = stick_slips(t_s, 0.2, events, 0.02);
  EXPECT_EQ(slipped[500], 0.0);
  EXPECT_NEAR(slipped[520], -0.2 * (1.0 - std::exp(-1.0)), 1e-9);
  EXPECT_NEAR(slipped.back(), -0.2 * 1.4, 1e-9);
  const Signal after = afterslip(t_s, 0.2, 1.0, 0.5);
  EXPECT_EQ(after[1000], 0.0);
  EXPECT_NEAR(after[1500] - after[1002], -0.2 * 0.5 / 3.4 * (std::log(2.0) - std::log1p(0.002 / 0.5)), 1e-9);
}

TEST(ForeignSensor, FiltersDelayARampByTheirMeanAndASineByTheirGain) {
  const Drive d = ramp(1.0, 2.0);
  const Signal f = line(d.t_s, 5.0);
  EXPECT_NEAR(two_pole(d, f, 0.03).back(), 5.0 * (2.0 - 0.03), kIntegrated);
  EXPECT_NEAR(four_pole(d, f, 0.03).back(), 5.0 * (2.0 - 0.03), kIntegrated);
  EXPECT_NEAR(hann_filter(d.t_s, f, 0.03).back(), 5.0 * (2.0 - 0.03), 1e-9);
  const Signal beating = beating_delay(d.t_s, f, 0.03, 0.5, 0.7);
  for (std::size_t i = 100; i < beating.size(); i += 37) {
    const double phase = std::fmod(d.t_s[i], 0.7) / 0.7;
    ASSERT_NEAR(beating[i], 5.0 * (d.t_s[i] - 0.03 * (1.0 + 0.5 * (2.0 * phase - 1.0))), 1e-9);
  }
  // Gain of a Hann window of width T = 60 ms at 10 Hz: sinc(w T / 2) / (1 - (w T / 2 pi)^2).
  constexpr double kHz = 10.0;
  Signal wave;
  for (const double t : d.t_s) wave.push_back(std::sin(2.0 * std::numbers::pi * kHz * t));
  const double half = std::numbers::pi * kHz * 0.06;
  const double gain = std::sin(half) / half / (1.0 - std::pow(half / std::numbers::pi, 2.0));
  const Signal out = hann_filter(d.t_s, wave, 0.03);
  // Straight lines between nodes of 1 ms cut (w h)^2 / 8 of the wave: 0.05 %.
  for (std::size_t i = 200; i < out.size(); ++i)
    ASSERT_NEAR(out[i], gain * std::sin(2.0 * std::numbers::pi * kHz * (d.t_s[i] - 0.03)), 1e-3);
  // A step: 1 - (1 + t / tau) exp(-t / tau) for two poles.
  Signal step(d.size(), 1.0);
  step[0] = 0.0;
  const Signal risen = two_pole(d, step, 0.04);
  for (std::size_t i = 10; i < risen.size(); i += 10) {
    const double u = (d.t_s[i] - 0.5e-3) / 0.02;  // the step takes a node's distance: its middle
    ASSERT_NEAR(risen[i], 1.0 - (1.0 + u) * std::exp(-u), 2e-4);
  }
}

TEST(ForeignFixture, MassesFollowNewton) {
  Drive d = ramp(0.0, 1.0);
  d.acceleration_mm_s2.assign(d.size(), 400.0);
  EXPECT_NEAR(sprung_mass(d, 2.0, 30.0, 0.5).back(), 2.0 * 0.4, kIntegrated);
  const Drive s = sine(1.0, 6.0, 30);
  const Signal f = sprung_mass(s, 2.0, 30.0, 0.5);
  const double ratio = 0.2, gain = 1.0 / std::hypot(1.0 - ratio * ratio, 2.0 * 0.5 * ratio);
  const double phase = std::atan2(2.0 * 0.5 * ratio, 1.0 - ratio * ratio);
  const double omega = 2.0 * std::numbers::pi * 6.0, peak = 2.0 * 1e-3 * omega * omega;
  for (std::size_t i = 3000; i < f.size(); i += 7)  // straight between nodes: (w h)^2 / 8, 0.02 %
    ASSERT_NEAR(f[i], -peak * gain * std::sin(omega * s.t_s[i] - phase), 5e-4 * peak);
  const Signal both = two_masses(s, 4.0, 30.0, 0.5);
  for (std::size_t i = 0; i < both.size(); i += 7)
    ASSERT_NEAR(both[i], f[i] + 2e-3 * s.acceleration_mm_s2[i], 1e-12 * peak);
  const Signal chain = growing_mass(s, 2.0, 10.0);
  for (std::size_t i = 1; i + 1 < s.size(); i += 11) {
    const auto momentum = [&s](std::size_t n) { return 2e-3 * (1.0 + s.position_mm[n] / 10.0) * s.velocity_mm_s[n]; };
    ASSERT_NEAR(chain[i], (momentum(i + 1) - momentum(i - 1)) / 2e-3, 1e-3 * peak);  // (w h)^2 / 6: 0.03 %
  }
}

TEST(ForeignSensor, ForceMapsAreWhatTheySay) {
  for (const double f : {-5.0, -0.2, 0.0, 0.3, 8.0}) {
    const double soft = hyperbolic_slack_N(f, 0.4);
    EXPECT_NEAR(soft * (soft - f), 0.04, 1e-12);
    EXPECT_NEAR(saturated_N(f, 2.0, 0.4), 2.0 - hyperbolic_slack_N(2.0 - f, 0.4), 1e-12);
    EXPECT_EQ(bimodular_N(f, 0.1), f < 0.0 ? 0.1 * f : f);
  }
  // Up from rest beyond every play: each is half its span behind.
  Signal f;
  for (int n = 0; n <= 400; ++n) f.push_back(0.1 * (n < 200 ? n : 400 - n));
  const Signal out = cell_hysteresis(f, 0.2, 4.0);
  const double mean_half = 0.5 * 4.0 * 4.5 / 8.0;
  EXPECT_NEAR(out[150], f[150] - 0.2 * mean_half, 1e-9);
  EXPECT_NEAR(out[250], f[250] + 0.2 * mean_half, 1e-9);
}

TEST(ForeignDrift, ShapesAreTheirFormulas) {
  const Signal t_s = ramp(0.0, 10.0).t_s;
  EXPECT_NEAR(logarithmic_creep(t_s, 2.0, 10.0)[4000], std::log(3.0) / std::log(6.0), 1e-12);
  EXPECT_NEAR(diffusing_heat(t_s, 10.0)[2500], 0.5, 1e-12);
  // Until the room is warm: two first-order stages in a row under a heater of 1.5.
  const Signal warm = thermostat(t_s, 3.0, 1.0);
  const double t = 2.0, closed = 1.5 * (1.0 - (3.0 * std::exp(-t / 3.0) - std::exp(-t)) / 2.0);
  EXPECT_NEAR(warm[2000], closed, 1e-4);
  EXPECT_LE(*std::ranges::max_element(warm), 1.0);
  EXPECT_EQ(random_walk(t_s, 7, 10.0), random_walk(t_s, 7, 10.0));
  double squares = 0.0;
  constexpr int kWalks = 400;
  for (std::uint64_t seed = 0; seed < kWalks; ++seed) squares += std::pow(random_walk(t_s, seed, 10.0).back(), 2.0);
  EXPECT_NEAR(squares / kWalks, 1.0, 4.0 * std::sqrt(2.0 / kWalks));  // four deviations of a chi-square
}

TEST(ForeignDrift, AnotherRecordingSeesTheSameFunctionOfTimeAndAnotherWalk) {
  const Signal whole = ramp(0.0, 10.0).t_s, half(whole.begin(), whole.begin() + 2501);
  const Signal creep = logarithmic_creep(whole, 2.0, 10.0), heat = diffusing_heat(whole, 10.0);
  EXPECT_EQ(logarithmic_creep(half, 2.0, 10.0), Signal(creep.begin(), creep.begin() + 2501));
  EXPECT_EQ(diffusing_heat(half, 10.0), Signal(heat.begin(), heat.begin() + 2501));
  const Signal walk = random_walk(whole, 7, 10.0);
  EXPECT_NE(random_walk(half, 7, 10.0), Signal(walk.begin(), walk.begin() + 2501));
}

TEST(ForeignPressure, GasIsIsothermalWhenSlowAndAdiabaticWhenFast) {
  constexpr double kAtmosphere = 14.696;
  const double filled = 20.0 + kAtmosphere;
  const double slow = trapped_gas(ramp(0.01, 100.0), 20.0, 0.2, 1.0, 0.05).back();
  // One heat time late, 0.05 s of 100: 0.01 % of the change, and the adiabatic part of as much.
  EXPECT_NEAR(slow, filled / 0.8 - kAtmosphere, 1e-2);
  const double fast = trapped_gas(ramp(100.0, 0.01), 20.0, 0.2, 1.0, 1e4).back();
  EXPECT_NEAR(fast, filled * std::pow(0.8, -1.4) - kAtmosphere, 1e-3);
  const Drive d = ramp(2.0, 3.0);
  EXPECT_NEAR(regulator_droop(d, 0.1, 1.5).back(), 0.1 * 2.0 * 1.5 * (1.0 - std::exp(-2.0)), kIntegrated);
  const Signal swing = hunting(d.t_s, 0.3, 1.0, 0.25);
  EXPECT_NEAR(swing[250], 0.3, 1e-9);
  EXPECT_NEAR(swing[1000], -0.3, 1e-9);
  EXPECT_NEAR(leak_and_refill(d.t_s, 20.0, 100.0, 5.0).back(), 20.0 * std::expm1(-0.03), 1e-9);
  const Signal refilled = leak_and_refill(d.t_s, 20.0, 10.0, 1.0);
  EXPECT_GT(*std::ranges::min_element(refilled), -1.0 - 20.0 * 1e-3 / 10.0);
}

TEST(ForeignPressure, CouplingsVanishAtTheNominalPressure) {
  Drive d = ramp(1.0, 1.0);
  for (double& p : d.pressure_psi) p = 17.0;
  EXPECT_NEAR(braid_pressure_N(d, 2.0, 15.0, 100.0, 120.0).back(),
              2.0 * 2.0 * 0.5 * (3.0 * std::pow(101.0 / 120.0, 2.0) - 1.0), 1e-12);
  EXPECT_NEAR(braid_pressure_N(d, 2.0, 15.0, 99.0, 100.0 * std::numbers::sqrt3).back(), 0.0,
              1e-9);  // the neutral angle
  EXPECT_NEAR(power_pressure_N(d, 2.0, 15.0, 1.0).back(), 4.0, 1e-12);
  EXPECT_NEAR(power_pressure_N(d, 2.0, 15.0, 2.0).back(), (17.0 * 17.0 - 225.0) / 15.0, 1e-9);
  d.pressure_psi[0] = 15.0;
  const Signal tube = tube_pressure_N(d, 2.0, 15.0, 0.3);
  EXPECT_NEAR(tube[600], 4.0 * (1.0 - std::exp(-(0.6 - 0.5e-3) / 0.3)), kIntegrated);
  d.pressure_psi.assign(d.size(), 15.0);
  for (const Signal& f : {braid_pressure_N(d, 2.0, 15.0, 100.0, 120.0), power_pressure_N(d, 2.0, 15.0, 1.7),
                          tube_pressure_N(d, 2.0, 15.0, 0.3)})
    for (const double one : f) ASSERT_EQ(one, 0.0);
}

TEST(ForeignOutside, EachDoesWhatItIsCalled) {
  EXPECT_NEAR(eccentric_position({0.0, 0.5, 2.0}, 0.1, 2.0)[1], 0.6, 1e-12);
  EXPECT_NEAR(eccentric_position({0.0, 0.5, 2.0}, 0.1, 2.0)[2], 2.0, 1e-12);
  EXPECT_NEAR(cogging_N(2.0, 0.5, 2.0), 2.0 * 0.7, 1e-12);
  EXPECT_NEAR(cogging_N(2.0, 1.3, 2.0), cogging_N(2.0, 3.3, 2.0), 1e-12);
  // The truss: derivative of half k (sqrt(a^2 + w^2) - l0)^2.
  const auto energy = [](double w) {
    return 0.5 * 3.0 * std::pow(std::hypot(0.4, w) - 0.4 * std::numbers::sqrt2, 2.0);
  };
  for (const double w : {-0.5, -0.1, 0.2, 0.4})
    EXPECT_NEAR(von_mises_truss_N(3.0, w, 0.4), (energy(w + 1e-5) - energy(w - 1e-5)) / 2e-5, 1e-7);
  // Its jump: at the position where it snapped on the way up it has not snapped back on the way down.
  const Drive d = sine(2.0, 0.05, 1);
  const Signal f = snapping_truss(d, 6.0, 0.0, 0.4);
  const auto at = [&](double t) { return f[static_cast<std::size_t>(t * 1000.0)]; };
  double widest_N = 0.0;
  for (double t = 0.0; t < 5.0; t += 0.01) widest_N = std::fmax(widest_N, at(t) - at(10.0 - t));
  EXPECT_GT(widest_N, 0.1);

  Drive s = sine(2.0, 0.25, 2);
  s.stiffness_N_mm = 3.0;
  const Signal set = permanent_set(s, 0.2, 0.5);
  EXPECT_EQ(set[100], 0.0);
  EXPECT_NEAR(set.back(), -3.0 * 0.2 * 1.5, 1e-6);
  EXPECT_NEAR(one_way_damping(ramp(2.0, 0.1), 0.7).back(), 1.4, 1e-12);
  EXPECT_EQ(one_way_damping(ramp(-2.0, 0.1), 0.7).back(), 0.0);
  EXPECT_NEAR(bladder_contact(ramp(-2.0, 0.5), 3.0, -0.5, 0.1).back(), -3.0 * std::pow(0.5, 1.5) * 1.2, 1e-9);
  EXPECT_EQ(bladder_contact(ramp(2.0, 0.5), 3.0, -0.5, 0.1).back(), 0.0);
  const Signal warm = self_heating(ramp(-2.0, 3.0), 0.1, 4.0, 1.5);
  EXPECT_NEAR(warm.back(), -0.1 * 10.0 * 2.0 * 1.5 / 4.0 * (1.0 - std::exp(-2.0)), kIntegrated);
}

TEST(ForeignPath, VelocityAndAccelerationAreDerivativesAndEveryWaveComesBack) {
  Path path(200.0);
  path.rest(1.0);
  path.ramp(2.0, 8.0);
  path.triangle(1.0, 3.0, 2);
  path.ramp(2.001, 8.0);  // too short a way for its speed
  path.sine(1.5, 0.8, 4);
  path.multisine(1.0, 0.3, 3);
  path.rest(1.0);
  EXPECT_NEAR(path.at(path.end_s()).position_mm, 2.001, 1e-9);
  const double h = 1e-5;
  for (double t = 0.5; t < path.end_s() - 0.5; t += 0.0137) {
    const Path::Point before = path.at(t - h), now = path.at(t), after = path.at(t + h);
    ASSERT_NEAR(now.velocity_mm_s, (after.position_mm - before.position_mm) / (2.0 * h), 1e-3) << t;
    // Jerk jumps at the ends of corners: an error of h times it.
    ASSERT_NEAR(now.acceleration_mm_s2, (after.velocity_mm_s - before.velocity_mm_s) / (2.0 * h), 1.0) << t;
    ASSERT_LT(std::abs(now.acceleration_mm_s2), 200.0 + 1e-6) << t;
  }
  const auto grid = path.grid_s();
  for (std::size_t i = 1; i < grid.size(); ++i) ASSERT_GT(grid[i], grid[i - 1]);
  EXPECT_EQ(grid.back(), path.end_s());
}

}  // namespace
}  // namespace isorig::proof::foreign
