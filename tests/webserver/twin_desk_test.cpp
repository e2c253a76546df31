#include "webserver/twin/twin_desk.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace isorig::web {
namespace {

constexpr double kStiffness_N_mm = 1.5, kNoise_N = 0.01;

/// A spring with a tare, as a diagnosis writes it; what it has seen holds a day.
model::ModelSpec spring() {
  return model::parse_model(R"(format = "isorig-model/1"
name = "spring"
part = [{ physics = "spring", law = "linear", stiffness_N_mm = 1.5 }]
[seen]
position_mm = [-3, 3]
rate_mm_s = 20
travel_mm = 1e9
pressure_psi = [4, 6]
duration_s = 1e6
error_N = 0.01
covariance = [1e-10]
nominal = [{ physics = "spring", law = "linear", stiffness_N_mm = 1.5 }]
)",
                            "spring.toml");
}

nlohmann::json plan() {
  const auto step = [](const char* what, nlohmann::json session) {
    return nlohmann::json{{"do", what}, {"session", std::move(session)}, {"text", std::string("to ") + what}};
  };
  return {{"run", "r1"},
          {"references",
           {{{"pressure_psi", 5.0}, {"elongation_at_zero_mm", 1.0}},
            {{"pressure_psi", 5.0}, {"elongation_at_zero_mm", 1.0}}}},
          {"steps",
           {step("pressurize", 0), step("settle", 0), step("ramp", 0), step("hold", 0), step("pressurize", 1),
            step("ramp", 1), step("mark", nullptr)}}};
}

/// A rig at `hz` that moves to and fro by 1 mm in 2 s, whose muscle pulls `more_N` more than the spring.
class Rig {
 public:
  explicit Rig(TwinDesk& desk, double hz = 200.0) : desk_(desk), period_ns_(std::llround(1e9 / hz)) {
    run(daemon::RunState::kRunning);
  }
  void run(daemon::RunState state) {
    daemon::ControlRecord control;
    control.state = state;
    desk_.add(control);
  }
  /// Rows that came meanwhile.
  std::size_t go(double seconds, std::uint32_t step, double more_N = 0.0) {
    std::size_t rows = 0;
    for (const auto end = now_ns + std::llround(seconds * 1e9); now_ns < end; now_ns += period_ns_) {
      const double phase = std::fmod(1e-9 * static_cast<double>(now_ns), 2.0);
      const double x = phase < 1.0 ? phase : 2.0 - phase;
      desk_.add(daemon::PressureRecord{.mono_ns = now_ns, .step = step, .pressure_psi = 5.0});
      daemon::FrameRecord frame;
      frame.mono_ns = now_ns;
      frame.step = step;
      frame.position_mm = x;
      frame.force_N = kStiffness_N_mm * (x + 1.0) + more_N + kNoise_N * normal_(random_);
      rows += desk_.add(frame).size();
      most_bytes = std::max(most_bytes, desk_.bytes());
    }
    return rows;
  }
  std::int64_t now_ns = 0;
  std::size_t most_bytes = 0;

 private:
  TwinDesk& desk_;
  std::int64_t period_ns_;
  std::mt19937_64 random_{4};
  std::normal_distribution<double> normal_;
};

TEST(TwinDesk, BeginsAfterFillingIsJudgedFromTheFirstMoveAndEndsWithTheSession) {
  TwinDesk desk;
  desk.plan(plan());
  Rig rig(desk);
  EXPECT_EQ(rig.go(1.0, 2), 0U) << "without a model";
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  EXPECT_EQ(rig.go(1.0, 0), 0U);
  EXPECT_EQ(desk.state()["phase"], "waits");
  EXPECT_GT(rig.go(2.0, 1), 300U);
  EXPECT_EQ(desk.state()["phase"], "settles");
  rig.go(5.0, 2);
  const auto state = desk.state();
  EXPECT_EQ(state["phase"], "judged");
  EXPECT_GT(state["judged"], 900);
  EXPECT_GT(state["covered"].get<double>() / state["judged"].get<double>(), 0.9);
  rig.run(daemon::RunState::kPaused);
  rig.go(1.0, 3);
  EXPECT_EQ(desk.state()["phase"], "stands");
  rig.run(daemon::RunState::kRunning);
  EXPECT_EQ(rig.go(1.0, 4), 0U) << "the next session fills";
  rig.go(2.0, 5);
  EXPECT_LT(desk.state()["judged"], 450) << "counted from its own beginning";
  EXPECT_EQ(rig.go(1.0, 6), 0U);
  EXPECT_EQ(rig.go(1.0, daemon::kNoStep), 0U);
  EXPECT_FALSE(desk.take_found());
}

TEST(TwinDesk, APartingIsToldOnceWithItsStep) {
  TwinDesk desk;
  desk.plan(plan());
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kPause, false});
  Rig rig(desk);
  rig.go(65.0, 2);  // the correlation is known by then
  EXPECT_FALSE(desk.take_found());
  EXPECT_EQ(desk.state()["learning"], false);
  const auto began_ns = rig.now_ns;
  rig.go(10.0, 3, 0.06);  // six standard errors
  const auto found = desk.take_found();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->parting.step, 3U);
  EXPECT_NEAR(1e-9 * static_cast<double>(found->parting.mono_ns - began_ns), 0.0, 0.2);
  // h = 34 is reached by (34 - 14) / 1.1 = 18 blocks: the first innovation is 14, each further one adds 6 x 0.22 - k.
  EXPECT_LT(1e-9 * static_cast<double>(found->parting.found_mono_ns - began_ns), 3.0);
  EXPECT_NEAR(found->parting.residual_N, 0.06, 0.01);
  EXPECT_EQ(found->on_parting, TwinDesk::OnParting::kPause);
  EXPECT_NE(found->text.find("part in step 4 (to hold): measured minus predicted +0.0"), std::string::npos)
      << found->text;
  EXPECT_EQ(desk.state()["phase"], "parted");
  rig.go(5.0, 3, 0.06);
  EXPECT_FALSE(desk.take_found());
  rig.go(1.0, 4);
  rig.go(5.0, 5, 0.0);
  EXPECT_EQ(desk.state()["phase"], "judged") << "a new session begins anew";
}

TEST(TwinDesk, ASecondFillingWithinASessionBeginsAnew) {
  auto again = plan();
  again["steps"][3]["do"] = "pressurize";
  TwinDesk desk;
  desk.plan(again);
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  Rig rig(desk);
  rig.go(2.0, 1);
  rig.go(5.0, 2);
  EXPECT_GT(desk.state()["judged"], 900);
  EXPECT_EQ(rig.go(3.0, 3, 2.0), 0U) << "what filling does is no prediction's";
  EXPECT_EQ(desk.state()["phase"], "waits");
  rig.go(2.0, 1, 2.0);  // that step again: another pressure, at rest
  EXPECT_EQ(desk.state()["phase"], "settles") << "it has not moved since";
  EXPECT_EQ(desk.state()["judged"], 0);
  EXPECT_FALSE(desk.take_found());
  rig.go(65.0, 2);
  EXPECT_FALSE(desk.take_found());
  rig.go(3.0, 3);
  // Six standard errors from the first block on, with the longest correlation: h = 94 is reached by 94 / (5 x 0.071) =
  // 27 s.
  rig.go(40.0, 2, 0.06);
  EXPECT_TRUE(desk.take_found()) << "a parting after it is told";
}

TEST(TwinDesk, ThePlanThatThereWasChangesNothing) {
  TwinDesk desk;
  EXPECT_TRUE(desk.plan(plan()));
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  Rig rig(desk);
  rig.go(5.0, 2);
  const auto before = desk.state();
  EXPECT_FALSE(desk.plan(plan())) << "as after a poll that failed";
  EXPECT_EQ(desk.state(), before);
  auto other = plan();
  other["steps"][0]["text"] = "to something else";
  EXPECT_TRUE(desk.plan(other));
  EXPECT_EQ(desk.state()["phase"], "waits");
  EXPECT_TRUE(desk.plan({{"run", nullptr}}));
  EXPECT_TRUE(desk.plan(plan()));
}

TEST(TwinDesk, WhatAPersonDecidedHoldsForTheRunAndNotForTheNext) {
  TwinDesk desk;
  desk.plan(plan());
  EXPECT_FALSE(desk.overruled());
  desk.overrule();
  auto changed = plan();
  changed["steps"].erase(6);
  EXPECT_TRUE(desk.plan(changed));
  EXPECT_TRUE(desk.overruled()) << "the same run";
  changed["run"] = "r2";
  EXPECT_TRUE(desk.plan(changed));
  EXPECT_FALSE(desk.overruled());
}

TEST(TwinDesk, AModelThatSaysNoNumberIsPutAwayWithAReason) {
  auto infinite = spring();
  infinite.parts.front().coefficients.front() = 1.7e308;  // 1.7e308 N/mm at 2 mm is beyond a double
  auto without_width = spring();
  without_width.seen->error_N = 0.0;
  without_width.seen->covariance = {0.0};
  for (const auto& spec : {infinite, without_width}) {
    TwinDesk desk;
    desk.plan(plan());
    desk.choose({"bad.toml", spec, TwinDesk::OnParting::kAbort, false});
    Rig rig(desk);
    rig.go(3.0, 2);
    const auto why = desk.take_fault();
    EXPECT_NE(why.find("twin bad.toml is put away in step 3 (to ramp): the model predicts "), std::string::npos) << why;
    EXPECT_EQ(desk.take_fault(), "");
    EXPECT_FALSE(desk.take_found());
    EXPECT_EQ(desk.state()["model"], nullptr);
    EXPECT_EQ(desk.state()["why"], why);
  }
}

TEST(TwinDesk, AReadingThatIsNoNumberEndsItToo) {
  TwinDesk desk;
  desk.plan(plan());
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  Rig rig(desk);
  rig.go(3.0, 2);
  rig.go(0.005, 2, std::nan(""));
  EXPECT_NE(desk.take_fault().find("a reading of the frame is no number"), std::string::npos);
}

TEST(TwinDesk, AfterAGapItBeginsAnew) {
  TwinDesk desk;
  desk.plan(plan());
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  Rig rig(desk);
  rig.go(5.0, 2);
  rig.now_ns += 5'000'000'000;
  rig.go(2.0, 2);
  EXPECT_LT(desk.state()["judged"], 450);
  rig.now_ns -= 100'000'000'000;  // another clock
  EXPECT_GT(rig.go(2.0, 2), 300U);
}

TEST(TwinDesk, AModelWhoseNumbersDoNotBelongTogetherIsRefusedAndTheOldOneStays) {
  TwinDesk desk;
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  auto wrong = spring();
  wrong.seen->covariance = {1.0, 2.0};
  EXPECT_THROW(desk.choose({"wrong.toml", wrong, TwinDesk::OnParting::kMark, false}), std::invalid_argument);
  EXPECT_EQ(desk.state()["model"], "spring.toml");
}

TEST(TwinDesk, AnHourAtThisRateTakesNoMoreMemoryThanAMinuteAndDoesNotPart) {
  TwinDesk desk;
  desk.plan(plan());
  desk.choose({"spring.toml", spring(), TwinDesk::OnParting::kMark, false});
  Rig rig(desk, 25.0);
  rig.go(1.0, 1);
  rig.go(300.0, 2);
  const auto after_minutes = rig.most_bytes;
  rig.go(3300.0, 2);
  // One false alarm in 1000 h: 0.001 are expected in one.
  EXPECT_FALSE(desk.take_found());
  EXPECT_LE(rig.most_bytes, after_minutes + 4096) << "a stamp more or less in a window";
}

}  // namespace
}  // namespace isorig::web
