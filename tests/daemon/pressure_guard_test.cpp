#include "daemon/core/pressure_guard.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "daemon/core/valve_flow.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kMs = 1'000'000;

/// A chamber that follows its valves by the very law of the configuration, times `gain`, after a delay.
class Chamber {
 public:
  explicit Chamber(const PressureLoopConfig& config, double gain = 1.0, int delay_ms = 15)
      : config_(config), gain_(gain), delay_ms_(delay_ms) {}
  double step(const pressure::Command& command) {
    pending_.push_back(command);
    if (static_cast<int>(pending_.size()) > delay_ms_) {
      now_ = pending_.front();
      pending_.erase(pending_.begin());
    }
    psi += gain_ * 1e-6 * now_.fill_permille * fill_rate_psi_s(config_.fill_gain_per_s, config_.supply_psi, psi);
    psi -= gain_ * 1e-6 * now_.vent_permille * vent_rate_psi_s(config_.vent_gain_per_s, psi);
    return psi;
  }
  double psi = 0.0;

 private:
  PressureLoopConfig config_;
  double gain_;
  int delay_ms_;
  std::vector<pressure::Command> pending_;
  pressure::Command now_;
};

class GuardTest : public ::testing::Test {
 protected:
  /// One reading a millisecond; returns when a doubt came up, in s, or -1.
  double run(double seconds, const pressure::Command& command, const std::function<double()>& reading,
             bool is_holding = false, double velocity_mm_s = 0.0) {
    const std::int64_t start_ns = now_ns;
    while (now_ns < start_ns + static_cast<std::int64_t>(seconds * 1e9)) {
      now_ns += kMs;
      guard.on_reading(now_ns, reading(), velocity_mm_s, is_holding);
      guard.on_command(now_ns, command);
      if (guard.doubt()) return static_cast<double>(now_ns - start_ns) * 1e-9;
    }
    return -1.0;
  }
  [[nodiscard]] std::string code() const { return guard.doubt() ? guard.doubt().code : ""; }
  static std::function<double()> stands_at(double psi) {
    return [psi] { return psi; };
  }

  static constexpr pressure::Command kFill{1000, 0, 0.0F}, kVent{0, 1000, 0.0F}, kShut{0, 0, 0.0F};
  static PressureLoopConfig nominal() {
    PressureLoopConfig c;
    c.fill_gain_per_s = c.vent_gain_per_s = 0.19;
    return c;
  }
  PressureLoopConfig config = nominal();
  PressureGuard guard{config, 24.0};
  std::int64_t now_ns = 0;
};

TEST_F(GuardTest, AFullFillThatDoesNotShowIsFoundInATenthAndItsDelay) {
  EXPECT_LT(run(0.5, kShut, stands_at(5.0)), 0.0);
  const double s = run(1.0, kFill, stands_at(5.0));
  EXPECT_GT(s, 0.1);
  EXPECT_LT(s, 0.25);
  EXPECT_EQ(code(), "pressure.no_response");
}

TEST_F(GuardTest, AChamberThatFollowsIsBelievedWhateverItsSize) {
  for (const double gain : {0.4, 1.0, 2.5}) {
    for (const int delay_ms : {0, 15, 80}) {
      guard = PressureGuard{config, 24.0};
      now_ns = 0;
      Chamber chamber(config, gain, delay_ms);
      std::mt19937 random(1);
      std::normal_distribution<double> noise(0.0, 0.0023);
      for (const auto& [command, seconds] : {std::pair{kShut, 0.5},
                                             {kFill, 1.5 / gain},
                                             {kShut, 2.0},
                                             {kVent, 0.3 / gain},
                                             {kFill, 0.2 / gain},
                                             {kVent, 5.0 / gain},
                                             {kShut, 1.0}}) {
        EXPECT_LT(run(seconds, command, [&, c = command] { return chamber.step(c) + noise(random); }), 0.0)
            << code() << " gain " << gain << " delay " << delay_ms << " at " << chamber.psi;
      }
    }
  }
}

TEST_F(GuardTest, WhileBothValvesAreShutTheReadingMayLeakAndNoMore) {
  double psi = 15.0;
  EXPECT_LT(run(10.0, kShut, [&] { return psi -= 0.5e-3; }), 0.0) << code();  // 0.5 psi/s, below the twentieth
  EXPECT_LT(run(0.5, kShut, [&] { return psi -= 4e-3; }), 0.2);
  EXPECT_EQ(code(), "pressure.falls");
  guard.restart();
  EXPECT_LT(run(0.5, kShut, [&] { return psi += 4e-3; }), 0.2);
  EXPECT_EQ(code(), "pressure.rises");
  // A crosshead that moves explains it.
  guard.restart();
  EXPECT_LT(run(
                0.2, kShut, [&] { return psi -= 2.5e-3; }, false, 10.0),
            0.0)
      << code();
}

TEST_F(GuardTest, AVentHasToLowerIt) {
  run(0.5, kShut, stands_at(15.0));
  EXPECT_LT(run(1.0, kVent, stands_at(15.0)), 0.5);
  EXPECT_EQ(code(), "pressure.no_vent");
  guard.restart();
  EXPECT_LT(run(100.0, kVent, stands_at(0.3)), 0.0)
      << "at rest there is nothing to lower; the sensor may be off by 0.3 psi";
}

TEST_F(GuardTest, AfterAFastFillingTheAirMayCool) {
  Chamber chamber(config);
  run(0.2, kShut, [&] { return chamber.step(kShut); });
  run(1.5, kFill, [&] { return chamber.step(kFill); });
  const double full_psi = chamber.psi;
  double after_s = 0.0;
  // 7 % of the change, lost within a second.
  EXPECT_LT(run(3.0, kShut,
                [&] {
                  after_s += 1e-3;
                  return full_psi * (1.0 - 0.07 * (1.0 - std::exp(-after_s)));
                }),
            0.0)
      << code();
}

TEST_F(GuardTest, AHoldThatWantsMoreThanALeakIsNotOne) {
  const pressure::Command leak{48, 0, 0.0F}, more{200, 0, 0.0F};
  EXPECT_LT(run(100.0, leak, stands_at(10.0), true), 0.0) << code();
  const double s = run(10.0, more, stands_at(10.0), true);
  EXPECT_GT(s, 0.3);
  EXPECT_LT(s, 2.0);
  EXPECT_EQ(code(), "pressure.hold");
  guard.restart();
  EXPECT_LT(run(100.0, {0, 80, 0.0F}, stands_at(10.0), true), 0.0) << code();
  EXPECT_GT(run(10.0, {0, 300, 0.0F}, stands_at(10.0), true), 0.3);
}

TEST_F(GuardTest, TheFillValveHasATimeWhateverTheReadingDoes) {
  EXPECT_NEAR(guard.fill_time_max_s(), 3.0 * fill_time_s(0.19, 45.0, 24.0), 1e-9);
  double psi = 0.0;
  const double s = run(60.0, kFill, [&] { return psi += 3.8e-3; });  // a third of what it should: believed
  EXPECT_EQ(code(), "pressure.fill_time");
  EXPECT_NEAR(s, guard.fill_time_max_s() / (1.0 - config.fill_allowance()), 0.2);
}

TEST_F(GuardTest, WhatHappenedInAGapIsNotJudged) {
  run(0.5, kShut, stands_at(5.0));
  now_ns += 500 * kMs;
  EXPECT_LT(run(1.0, kShut, stands_at(12.0)), 0.0);
}

TEST_F(GuardTest, ReadingsThatComeLateAreJudgedByTheCommandsOfTheirTime) {
  // A loop that was away for 0.3 s: the readings of that time come in one burst, and the commands were the old ones.
  Chamber chamber(config);
  run(0.3, kFill, [&] { return chamber.step(kFill); });
  const std::int64_t before_ns = now_ns;
  for (int i = 1; i <= 300; ++i) guard.on_reading(before_ns + i * kMs, chamber.step(kFill), 0.0, false);
  now_ns = before_ns + 300 * kMs;
  guard.on_command(now_ns, kShut);
  EXPECT_LT(run(0.5, kShut, [&] { return chamber.step(kShut); }), 0.0) << code();
}

TEST_F(GuardTest, TheFlowsOfARegulatorAreItsOwn) {
  config.actuator = PressureLoopConfig::Actuator::kRegulator;
  guard = PressureGuard{config, 24.0};
  EXPECT_LT(run(100.0, kFill, stands_at(10.0), true), 0.0);
}

TEST_F(GuardTest, SaysWhenTheCountHasToChange) {
  run(0.5, kShut, stands_at(10.0));
  EXPECT_EQ(guard.sure_rate_psi_s(), 0.0);
  run(0.15, kFill, stands_at(10.0));
  EXPECT_GT(guard.sure_rate_psi_s(), 2.0);
  guard.restart();
  run(0.5, {30, 0, 0.0F}, stands_at(10.0));
  EXPECT_EQ(guard.sure_rate_psi_s(), 0.0);
}

TEST(PressureLoopBounds, TheIntegralAsksForAQuarterOfTheFillRateAtMost) {
  PressureLoopConfig config;
  PressureLoop loop(config);
  loop.set_target(10.0, 1000.0, 0);
  std::int64_t now_ns = 0;
  // A reading that stands a little low: no saturation, so the integral goes on.
  pressure::Command command;
  for (int i = 0; i < 60'000; ++i) command = loop.update(now_ns += kMs, 9.97, 0.0);
  const double full = fill_rate_psi_s(config.fill_gain_per_s, config.supply_psi, 9.97);
  const double bound =
      PressureLoopConfig::kIntegralShare * config.fill_gain_per_s * (config.supply_psi + kAtmospherePsi) +
      config.proportional_per_s * 0.03;
  EXPECT_NEAR(command.fill_permille, 1000.0 * bound / full, 2.0);
}

TEST(PressureLoopBounds, AReadingThatDiedAtTheSetPointMovesNoValve) {
  PressureLoopConfig config;
  for (const double error_psi : {0.0, 0.002, -0.002, 0.0035}) {
    PressureLoop loop(config);
    loop.set_target(10.0, 1000.0, 0);
    std::int64_t now_ns = 0;
    pressure::Command command;
    for (int i = 0; i < 500; ++i) command = loop.update(now_ns += kMs, 9.9, 0.0);  // an integral for some leak
    const auto wound = command.fill_permille;
    for (int i = 0; i < 5'000; ++i) command = loop.update(now_ns += kMs, 10.0 - error_psi, 0.0);
    EXPECT_GT(wound, 50);
    EXPECT_EQ(command.fill_permille, 0) << error_psi;
    EXPECT_EQ(command.vent_permille, 0) << error_psi;
  }
}

/// The process was stopped for 3 s while 10 psi were held; the vent is open since, and what the kernel kept comes in.
TEST_F(GuardTest, ReadingsOfASilenceAreNotJudgedByTheCommandsBehindIt) {
  const auto readings_of_a_silence = [&](bool is_told) {
    EXPECT_LT(run(1.0, kShut, stands_at(10.0)), 0.0);
    const std::int64_t stopped_ns = now_ns, woken_ns = now_ns + 3000 * kMs;
    guard.restart(is_told ? woken_ns : -1);
    for (std::int64_t i = 1; i <= 300; ++i) {
      guard.on_command(woken_ns + i * kMs, kVent);
      guard.on_reading(stopped_ns + i * 10 * kMs, 10.0, 0.0, false);
    }
    now_ns = woken_ns + 300 * kMs;
    return code();
  };
  EXPECT_EQ(readings_of_a_silence(true), "");
  // What is read from then on is judged again.
  EXPECT_GT(run(0.5, kVent, stands_at(10.0)), 0.0);
  EXPECT_EQ(code(), "pressure.no_vent");
  guard = PressureGuard(config, 24.0);
  EXPECT_EQ(readings_of_a_silence(false), "pressure.no_vent") << "without the word of a silence";
}

}  // namespace
}  // namespace isorig::daemon
