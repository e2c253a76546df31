#include "sim/pressure/pneumatics.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

namespace isorig::sim {
namespace {

constexpr double kActuator_mL = 7.4;

TEST(Orifice, FollowsIso6358) {
  const Orifice orifice(0.4);
  // Choked: proportional to the upstream pressure alone.
  EXPECT_DOUBLE_EQ(orifice.flow_L_s(0.03, 4.0, 1.0), 0.12);
  EXPECT_DOUBLE_EQ(orifice.flow_L_s(0.03, 4.0, 1.6), 0.12);
  // Subsonic: r = 0.7 is half-way from b = 0.4 to 1.
  EXPECT_NEAR(orifice.flow_L_s(0.03, 2.0, 1.4), 0.06 * std::sqrt(0.75), 1e-12);
  EXPECT_NEAR(orifice.flow_L_s(0.03, 1.4, 2.0), -0.06 * std::sqrt(0.75), 1e-12);
  EXPECT_EQ(orifice.flow_L_s(0.03, 2.0, 2.0), 0.0);
  // Continuous where the laminar part begins.
  const double edge = 2.0 * Orifice::kLaminarRatio;
  EXPECT_NEAR(orifice.flow_L_s(1.0, 2.0, edge - 1e-9), orifice.flow_L_s(1.0, 2.0, edge + 1e-9), 1e-6);
}

struct Trace {
  std::vector<double> pressure_psi;  // every ms
};

// Fills, holds, follows a 10 mm/s stroke, vents, dumps.
Trace session(const PneumaticParameters& p, double dt_s, bool moving = true) {
  Pneumatics air(p, kActuator_mL, dt_s);
  Trace trace;
  const auto per_ms = static_cast<int>(std::lround(1e-3 / dt_s));
  for (int ms = 0; ms < 8000; ++ms) {
    ValveTargets v{0.0, 0.0, 0.0};
    if (ms < 1200) v.fill = 1.0;
    if (ms >= 1200 && ms < 2000) v.fill = 0.03;
    if (ms >= 4000 && ms < 5000) v.vent = 0.2;
    if (ms >= 6000) v.dump = 1.0;
    for (int i = 1; i <= per_ms; ++i) {
      const double t_s = 1e-3 * ms + dt_s * i;
      const double stroke_mm = moving ? std::clamp(10.0 * (t_s - 3.0), 0.0, 2.0) : 0.0;
      air.step(v, kActuator_mL - 0.242 * stroke_mm);
    }
    trace.pressure_psi.push_back(air.pressure_psi());
  }
  return trace;
}

TEST(Pneumatics, OneMillisecondIsAsGoodAsATenthOfIt) {
  const Trace coarse = session({}, 1e-3);
  const Trace fine = session({}, 1e-4);
  double worst_psi = 0.0;
  for (std::size_t i = 0; i < coarse.pressure_psi.size(); ++i) {
    worst_psi = std::max(worst_psi, std::abs(coarse.pressure_psi[i] - fine.pressure_psi[i]));
  }
  RecordProperty("worst_psi", std::to_string(worst_psi));
  EXPECT_LT(worst_psi, 0.002);  // below one count of the sensor
}

TEST(Pneumatics, ConservesAir) {
  PneumaticParameters p;
  Pneumatics air(p, kActuator_mL, 1e-3);
  const double start_L = air.chamber_L() + air.supply_L();
  for (int i = 0; i < 100'000; ++i) {
    const double phase = 1e-3 * i;
    air.step({.fill = phase < 30.0 ? 0.5 : 0.0, .vent = phase > 20.0 ? 0.3 : 0.0, .dump = phase > 90.0 ? 1.0 : 0.0},
             kActuator_mL + 0.5 * std::sin(phase));
  }
  EXPECT_GT(air.taken_L(), 0.5);
  EXPECT_NEAR(air.chamber_L() + air.supply_L(), start_L + air.taken_L() - air.released_L(), 1e-9 * air.taken_L());
}

TEST(Pneumatics, ClosedAndTightItFollowsBoyle) {
  PneumaticParameters p;
  p.leak_mL_s_bar = 0.0;
  Pneumatics air(p, kActuator_mL, 1e-3);
  for (int i = 0; i < 1000; ++i) air.step({.fill = 1.0, .vent = 0.0, .dump = 0.0}, kActuator_mL);
  for (int i = 0; i < 200; ++i) air.step({.fill = 0.0, .vent = 0.0, .dump = 0.0}, kActuator_mL);
  const double before_bar = air.pressure_psi() * kBarPerPsi + p.ambient_bar;
  for (int i = 1; i <= 200; ++i) air.step({0.0, 0.0, 0.0}, kActuator_mL - 0.7 * i / 200.0);
  const double after_bar = air.pressure_psi() * kBarPerPsi + p.ambient_bar;
  const double v0 = p.manifold_volume_mL + kActuator_mL;
  EXPECT_NEAR(after_bar, before_bar * v0 / (v0 - 0.7), 1e-12);
}

double seconds_until(Pneumatics& air, const ValveTargets& v, const std::function<bool(double)>& reached) {
  for (int i = 1; i < 100'000; ++i) {
    air.step(v, kActuator_mL);
    if (reached(air.pressure_psi())) return 1e-3 * i;
  }
  return 1e9;
}

TEST(Pneumatics, FillsToTwentyPsiInOneToThreeSecondsAndDumpsFaster) {
  Pneumatics air({}, kActuator_mL, 1e-3);
  const double fill_s = seconds_until(air, {1.0, 0.0, 0.0}, [](double psi) { return psi > 20.0; });
  EXPECT_GT(fill_s, 1.0);
  EXPECT_LT(fill_s, 3.0);
  const double dump_s = seconds_until(air, {0.0, 0.0, 1.0}, [](double psi) { return psi < 1.0; });
  EXPECT_LT(dump_s, 1.5);
  EXPECT_LT(dump_s, fill_s);
}

TEST(Pneumatics, LeaksAtTheStatedRate) {
  PneumaticParameters p;
  Pneumatics air(p, kActuator_mL, 1e-3);
  seconds_until(air, {1.0, 0.0, 0.0}, [](double psi) { return psi > 20.0; });
  for (int i = 0; i < 100; ++i) air.step({0.0, 0.0, 0.0}, kActuator_mL);
  const double start_psi = air.pressure_psi();
  for (int i = 0; i < 60'000; ++i) air.step({0.0, 0.0, 0.0}, kActuator_mL);
  // dp/dt = -G p_gauge / V
  const double rate_1_s = p.leak_mL_s_bar / (p.manifold_volume_mL + kActuator_mL);
  EXPECT_NEAR(air.pressure_psi(), start_psi * std::exp(-60.0 * rate_1_s), 1e-5);
  EXPECT_NEAR(start_psi - air.pressure_psi(), 0.54, 0.05);  // psi per minute, as documented
}

TEST(Pneumatics, AnEmptySupplyCannotReachTheSetPoint) {
  Pneumatics air({}, kActuator_mL, 1e-3);
  air.supply_empty = true;
  for (int i = 0; i < 20'000; ++i) air.step({1.0, 0.0, 0.0}, kActuator_mL);
  EXPECT_LT(air.pressure_psi(), 13.0);  // what the line's 50 mL at 45 psi give
  EXPECT_NEAR(air.pressure_psi(), air.supply_psi(), 0.1);
}

}  // namespace
}  // namespace isorig::sim
