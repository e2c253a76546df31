#include <algorithm>
#include <cmath>

#include "rig_fixture.hpp"

/// The pressure loop on the simulated pneumatics with their stated leak and valve delays, judged by the true pressure
/// in the actuator, not by the reading.
namespace isorig::daemon::test {
namespace {

class PressureLoopTest : public RigFixture {
 protected:
  struct Extremes {
    double min = 1e9, max = -1e9;
    void take(double value) {
      min = std::min(min, value);
      max = std::max(max, value);
    }
  };
};

TEST_F(PressureLoopTest, FromRestTo20PsiWithoutOvershootBeyondThreeTenths) {
  start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 20, settled_for_s = 1, timeout_s = 30 },
  { do = "hold", duration_s = 5 },)");
  Extremes p;
  virtual_rig->before_core = [&](VirtualRig& r) { p.take(r.rig().truth().pressure_psi); };
  ASSERT_TRUE(run_until(30.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  EXPECT_GT(p.max, 19.9);
  EXPECT_LT(p.max, 20.3);
}

TEST_F(PressureLoopTest, HoldsWithinFiveHundredthsThroughTenMillimetresPerSecond) {
  for (const double pressure_psi : {5.0, 20.0}) {
    rebuild();
    const std::string target = std::to_string(pressure_psi);
    start("  { do = \"pressurize\", pressure_psi = " + target +
          R"(, rate_psi_s = 20, settled_for_s = 1, timeout_s = 30 },
  { do = "hold", duration_s = 3 },
  { do = "ramp", to_mm = 2, velocity_mm_s = 10 },
  { do = "hold", duration_s = 3 },
  { do = "ramp", to_mm = -2, velocity_mm_s = 10 },
  { do = "hold", duration_s = 3 },)");
    ASSERT_TRUE(run_until(60.0, [&] { return virtual_rig->core().status().control.step >= 2; }));
    Extremes p, x;
    virtual_rig->before_core = [&](VirtualRig& r) {
      if (r.core().outcome() != Outcome::kNone) return;
      p.take(r.rig().truth().pressure_psi);
      x.take(r.rig().truth().position_mm);
    };
    ASSERT_TRUE(run_until(30.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
    EXPECT_LT(x.min, -1.99);  // it did move
    EXPECT_GT(x.max, 1.99);
    EXPECT_GT(p.min, pressure_psi - 0.05);
    EXPECT_LT(p.max, pressure_psi + 0.05);
  }
}

TEST_F(PressureLoopTest, ASettledStepIsTrulySettled) {
  start(
      R"(  { do = "pressurize", pressure_psi = 15, rate_psi_s = 8, tolerance_psi = 0.1, settled_for_s = 2, timeout_s = 30 },
  { do = "hold", duration_s = 1 },)");
  std::int64_t outside_ns = 0;
  virtual_rig->before_core = [&](VirtualRig& r) {
    if (std::abs(r.rig().truth().pressure_psi - 15.0) > 0.1) outside_ns = r.now_ns();
  };
  ASSERT_TRUE(run_until(30.0, [&] { return virtual_rig->core().status().control.step == 1; }));
  // 20 ms of filter and one status period lie between the truth and the step's end.
  EXPECT_NEAR(static_cast<double>(virtual_rig->now_ns() - outside_ns) * 1e-9, 2.0, 0.2);
}

TEST_F(PressureLoopTest, HoldsAgainstALeakFiftyTimesAsLarge) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.step == 1; }));
  virtual_rig->rig().pneumatics().leak_factor = 50.0;
  run_for(3.0);
  Extremes p;
  virtual_rig->before_core = [&](VirtualRig& r) { p.take(r.rig().truth().pressure_psi); };
  run_for(5.0);
  EXPECT_GT(p.min, 9.95);
  EXPECT_LT(p.max, 10.05);
}

TEST(PressureLoop, IntegralDoesNotWindUpWhileTheValveIsSaturated) {
  PressureLoopConfig config;
  PressureLoop loop(config);
  loop.set_target(20.0, 1000.0, 0);
  std::int64_t now_ns = 0;
  for (int i = 0; i < 3000; ++i) loop.update(now_ns += 1'000'000, 5.0, 0.0);  // 3 s stuck far below
  EXPECT_EQ(loop.command().fill_permille, 1000);
  // At the target the fill valve has to close at once, not after the integral has run off.
  const auto command = loop.update(now_ns += 1'000'000, 20.2, 0.0);
  EXPECT_EQ(command.fill_permille, 0);
}

TEST(PressureLoop, ReferenceKeepsTheRateLimit) {
  PressureLoopConfig config;
  config.rate_limit_psi_s = 4.0;
  PressureLoop loop(config);
  loop.set_target(10.0, 100.0, 0);
  std::int64_t now_ns = 0;
  loop.update(now_ns, 0.0, 0.0);
  for (int i = 0; i < 1000; ++i) loop.update(now_ns += 1'000'000, 0.0, 0.0);
  EXPECT_NEAR(loop.reference_psi(), 4.0, 0.01);
}

TEST(PressureLoop, AReadingThatIsNoNumberChangesNothing) {
  PressureLoop loop{PressureLoopConfig{}};
  loop.set_target(10.0, 5.0, 0);
  const auto before = loop.update(1'000'000, 2.0, 0.0);
  const auto after = loop.update(2'000'000, std::nan(""), 0.0);
  EXPECT_EQ(before.fill_permille, after.fill_permille);
  EXPECT_EQ(before.vent_permille, after.vent_permille);
}

TEST(PressureLoop, ARegulatorGetsTheReferenceAndASlowTrim) {
  PressureLoopConfig config;
  config.actuator = PressureLoopConfig::Actuator::kRegulator;
  PressureLoop loop(config);
  loop.set_target(10.0, 5.0, 0);
  std::int64_t now_ns = 0;
  pressure::Command c;
  // A regulator that is 0.3 psi low: the trim takes it out.
  for (int i = 0; i < 10'000; ++i)
    c = loop.update(now_ns += 1'000'000, std::max(0.0, double{c.regulator_psi} - 0.3), 0.0);
  EXPECT_NEAR(double{c.regulator_psi}, 10.3, 0.01);
  EXPECT_EQ(c.fill_permille, 1000);  // the regulator's supply
  EXPECT_EQ(c.vent_permille, 0);
  EXPECT_FALSE(loop.unreachable());
  // One that does not come there.
  for (int i = 0; i < 10'000; ++i) c = loop.update(now_ns += 1'000'000, 7.0, 0.0);
  EXPECT_TRUE(loop.unreachable());
  loop.vent();
  EXPECT_EQ(loop.command().fill_permille, 0);
  EXPECT_EQ(loop.command().vent_permille, 1000);
  EXPECT_FALSE(loop.unreachable());
}

}  // namespace
}  // namespace isorig::daemon::test
