#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numeric>
#include <sstream>

#include "protocol/compile.hpp"
#include "tree.hpp"

namespace isorig::protocol {
namespace {

std::string shipped(const std::string& name) {
  return isorig::test::source_path() + "/config/protocols/" + name + ".toml";
}

/// An Instron 5969 of 600 mm/min with an actuator of 90 mm and an ELVH of 30 psi.
Limits rig() {
  Limits limits;
  limits.travel_min_mm = -6.0;
  limits.travel_max_mm = 6.0;
  limits.speed_min_mm_s = 0.001;
  limits.speed_max_mm_s = 10.0;
  limits.pressure_max_psi = 22.0;
  limits.segment_interval_min_s = 0.05;
  return limits;
}

TEST(Isovelocity, IsThePapersProtocol) {
  const Plan plan = compile_file(shipped("vma-isovelocity"), rig());
  ASSERT_EQ(plan.sessions.size(), 20U);
  const double pressures_psi[] = {5, 10, 15, 20};
  std::size_t at = 0;
  for (int repetition = 1; repetition <= 5; ++repetition) {
    for (const double pressure_psi : pressures_psi) {
      const Session& session = plan.sessions[at++];
      SCOPED_TRACE(session.label);
      EXPECT_EQ(session.repetition, repetition);
      EXPECT_EQ(session.pressure_psi, pressure_psi);
      EXPECT_EQ(session.position_mm, 0.0);
      const double stroke_mm = pressure_psi == 5 ? 1.0 : 2.0;
      std::size_t i = session.first_step;
      const auto next = [&]() -> const Step& { return plan.steps.at(i++); };

      const Step& pressurize = next();
      EXPECT_EQ(pressurize.kind, StepKind::kPressurize);
      EXPECT_EQ(pressurize.position_before_mm, 0.0);
      EXPECT_EQ(pressurize.tolerance_psi, 0.1);
      EXPECT_EQ(next().kind, StepKind::kSettle);
      const Step& cycle = next();
      EXPECT_EQ(cycle.kind, StepKind::kWave);
      EXPECT_EQ(cycle.shape, WaveShape::kTriangle);
      EXPECT_EQ(cycle.cycles, 1U);
      EXPECT_EQ(cycle.amplitude_mm, 4.0);
      EXPECT_EQ(cycle.velocity_mm_s, 0.01);
      EXPECT_EQ(cycle.position_after_mm, 0.0);
      EXPECT_NEAR(cycle.nominal_s, 1600.0, 1e-9);
      EXPECT_EQ(next().kind, StepKind::kSettle);
      for (const double speed_mm_s : {2.0, 4.0, 6.0, 8.0, 10.0}) {
        for (const double sign : {1.0, -1.0}) {
          const Step& ramp = next();
          EXPECT_EQ(ramp.kind, StepKind::kRamp);
          EXPECT_EQ(ramp.position_before_mm, 0.0);
          EXPECT_EQ(ramp.target_mm, sign * stroke_mm);
          EXPECT_EQ(ramp.velocity_mm_s, speed_mm_s);
          EXPECT_NEAR(ramp.nominal_s, stroke_mm / speed_mm_s, 1e-12);
          EXPECT_EQ(ramp.keep, Keep::kFull);
          EXPECT_EQ(ramp.pressure_psi, pressure_psi);
          const Step& hold = next();
          EXPECT_EQ(hold.kind, StepKind::kHold);
          EXPECT_EQ(hold.duration_s, 30.0);
          const Step& back = next();
          EXPECT_EQ(back.kind, StepKind::kRamp);
          EXPECT_EQ(back.target_mm, 0.0);
          EXPECT_EQ(back.velocity_mm_s, 0.01);
          EXPECT_NEAR(back.nominal_s, stroke_mm / 0.01, 1e-9);
          EXPECT_EQ(back.keep, Keep::kAveraged);
          const Step& rest = next();
          EXPECT_EQ(rest.kind, StepKind::kHold);
          EXPECT_EQ(rest.duration_s, 30.0);
        }
      }
      EXPECT_EQ(i, session.last_step + 1U);
    }
  }
  EXPECT_EQ(plan.steps.size(), 880U);
}

TEST(Isovelocity, TakesWhatThePaperSaysItTakes) {
  const Plan plan = compile_file(shipped("vma-isovelocity"), rig());
  // Per session 1600 s of preconditioning and 10 times (30 s + return + 30 s) and the ramps; by hand:
  const double ramps_s = 2.0 * (1.0 / 2 + 1.0 / 4 + 1.0 / 6 + 1.0 / 8 + 1.0 / 10);  // per mm of stroke
  const double at_5_psi_s = 1600.0 + 10 * (30.0 + 100.0 + 30.0) + ramps_s;
  const double else_s = 1600.0 + 10 * (30.0 + 200.0 + 30.0) + 2 * ramps_s;
  EXPECT_NEAR(at_5_psi_s, 3202.28, 0.01);
  EXPECT_NEAR(else_s, 4204.57, 0.01);
  double moving_and_holding_s = 0.0, settling_s = 0.0;
  for (const Step& step : plan.steps) {
    const bool waits = step.kind == StepKind::kSettle || step.kind == StepKind::kPressurize;
    (waits ? settling_s : moving_and_holding_s) += step.nominal_s;
  }
  EXPECT_NEAR(moving_and_holding_s, 5 * (at_5_psi_s + 3 * else_s), 1e-6);
  EXPECT_NEAR(moving_and_holding_s / 3600.0, 21.97, 0.005);
  EXPECT_NEAR(plan.nominal_s, moving_and_holding_s + settling_s, 1e-6);
  EXPECT_NEAR(plan.nominal_s / 3600.0, 23.0, 0.1);  // "about 23 h of rig time per actuator"
  EXPECT_GT(plan.worst_s, plan.nominal_s);
  // 20 cycles of 16 mm and 10 ramps there and back: 20 mm at 5 psi, 40 mm above.
  EXPECT_NEAR(plan.travel_mm, 20 * 16.0 + 5 * (20.0 + 3 * 40.0), 1e-9);
  EXPECT_EQ(plan.peak_speed_mm_s, 10.0);
  EXPECT_EQ(plan.position_min_mm, -4.0);
  EXPECT_EQ(plan.position_max_mm, 4.0);
  EXPECT_EQ(plan.pressure_max_psi, 20.0);
}

TEST(Isovelocity, RecordsTheTwoSecondsBeforeEveryRampInFull) {
  const Plan plan = compile_file(shipped("vma-isovelocity"), rig());
  EXPECT_GE(plan.recording.before_s, 2.5);
  int ramps = 0;
  for (std::size_t i = 1; i < plan.steps.size(); ++i) {
    const Step& step = plan.steps[i];
    if (step.kind != StepKind::kRamp || step.keep != Keep::kFull) continue;
    ++ramps;
    EXPECT_EQ(step.full_after_s, plan.recording.after_s);
    // Whatever stands before a ramp is long enough to hold F0's 2 s and the relaxation before it.
    EXPECT_GE(plan.steps[i - 1].nominal_s, 30.0);
  }
  EXPECT_EQ(ramps, 200);
  // 200 ramps with 3 s before and 5 s after, and the ramps themselves.
  const double ramps_s = 5 * 7 * 2.0 * (1.0 / 2 + 1.0 / 4 + 1.0 / 6 + 1.0 / 8 + 1.0 / 10);
  EXPECT_NEAR(plan.full_rate_s, 200 * 8.0 + ramps_s, 1e-6);
}

TEST(Shipped, AllKeepAnInstronsLimits) {
  for (const char* name : {"vma-isovelocity", "vma-slow", "vma-cyclic", "vma-short", "vma-smoke", "first-motion"}) {
    SCOPED_TRACE(name);
    const Plan plan = compile_file(shipped(name), rig());
    EXPECT_EQ(plan.name, name);
    EXPECT_FALSE(plan.description.empty());
    EXPECT_EQ(plan.steps.back().position_after_mm, 0.0) << "ends away from the rest length";
    for (const Session& session : plan.sessions) EXPECT_EQ(session.position_mm, 0.0);
  }
}

TEST(Shipped, TheExampleOfTheDocumentationCompiles) {
  std::ostringstream page;
  page << std::ifstream(isorig::test::source_path("/docs/protocol.md")).rdbuf();
  const std::string text = page.str(), fence = "```toml\n";
  const auto begin = text.find(fence);
  ASSERT_NE(begin, std::string::npos);
  const auto from = begin + fence.size();
  const auto example = text.substr(from, text.find("```", from) - from);
  const Plan plan = compile(base::TomlDocument::parse_text(example, "docs/protocol.md"), rig());
  EXPECT_EQ(plan.sessions.size(), 6U);
}

TEST(Shipped, SlowGoesDownToATwentiethOfAMillimetrePerSecond) {
  const Plan plan = compile_file(shipped("vma-slow"), rig());
  double slowest_mm_s = 1e9;
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kRamp && step.keep == Keep::kFull) {
      slowest_mm_s = std::min(slowest_mm_s, step.velocity_mm_s);
    }
  }
  EXPECT_EQ(slowest_mm_s, 0.05);
}

TEST(Shipped, SmokeIsShortEnoughForARealTimeTest) {
  const Plan plan = compile_file(shipped("vma-smoke"), rig());
  EXPECT_GE(plan.nominal_s, 30.0);
  EXPECT_LE(plan.nominal_s, 40.0);
  EXPECT_EQ(plan.sessions.size(), 2U);
}

/// docs/commissioning.md has a person pause it in a ramp, a hand on the emergency stop.
TEST(Shipped, FirstMotionIsSlowAndEachStrokeLongEnoughToBePausedByHand) {
  const Plan plan = compile_file(shipped("first-motion"), rig());
  for (const Step& step : plan.steps) {
    if (step.kind != StepKind::kRamp) continue;
    EXPECT_LE(step.velocity_mm_s, 0.25);
    EXPECT_GE(step.nominal_s, 4.0);
    EXPECT_LE(std::abs(step.position_after_mm), 1.0);
  }
}

TEST(Shipped, ShortHasEveryKindOfStepInAFewMinutes) {
  const Plan plan = compile_file(shipped("vma-short"), rig());
  EXPECT_GE(plan.nominal_s, 120.0);
  EXPECT_LE(plan.nominal_s, 300.0);
  for (const auto kind :
       {StepKind::kPressurize, StepKind::kSettle, StepKind::kRamp, StepKind::kHold, StepKind::kWave, StepKind::kMark}) {
    EXPECT_TRUE(std::any_of(plan.steps.begin(), plan.steps.end(), [&](const Step& s) { return s.kind == kind; }))
        << name_of(kind);
  }
}

}  // namespace
}  // namespace isorig::protocol
