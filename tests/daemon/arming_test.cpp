#include "rig_fixture.hpp"

/// Two acts and a countdown before anything moves or fills (docs/states.md).
namespace isorig::daemon::test {
namespace {

class ArmingTest : public RigFixture {
 protected:
  ArmingTest() { config.core.operating.arming_required = true; }

  void SetUp() override {
    RigFixture::SetUp();
    plan = protocol::compile(
        base::TomlDocument::parse_text(
            "format = \"isorig-protocol/1\"\nname = \"test\"\nrecording.policy = \"round_ramps\"\nsteps = [\n" +
                std::string(kHold) + "\n]\n",
            "test.toml"),
        config.limits);
    ASSERT_TRUE(reach(RunState::kReady, 5.0)) << virtual_rig->core().status().not_ready;
  }

  void arm() {
    const auto reply = ask(Request::Verb::kArm);
    ASSERT_TRUE(reply.accepted) << reply.text;
    ASSERT_EQ(virtual_rig->core().state(), RunState::kArmed);
  }
  void go() {
    const auto reply = ask(Request::Verb::kGo, &plan);
    ASSERT_TRUE(reply.accepted) << reply.text;
    ASSERT_EQ(virtual_rig->core().state(), RunState::kCountdown);
  }
  [[nodiscard]] bool at_rest() {
    const auto s = virtual_rig->core().status().control;
    return std::abs(double{s.position_mm} - rest_mm) < 0.01 && s.pressure_psi < 0.3F && s.fill_permille == 0;
  }
  void note_rest() { rest_mm = double{virtual_rig->core().status().control.position_mm}; }

  double rest_mm = 0.0;
};

TEST_F(ArmingTest, AStartMovesNothingUntilASecondActAndACountdown) {
  note_rest();
  const auto at_once = ask(Request::Verb::kStart, &plan);
  EXPECT_FALSE(at_once.accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kReady);

  arm();
  run_for(9.0);
  EXPECT_TRUE(at_rest());
  EXPECT_FALSE(virtual_rig->core().status().run_loaded);
  go();
  EXPECT_TRUE(virtual_rig->core().status().run_loaded);
  run_for(4.5);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kCountdown);
  EXPECT_TRUE(at_rest());
  EXPECT_NEAR(double{virtual_rig->core().status().operator_left_s}, 0.5, 0.1);
  ASSERT_TRUE(reach(RunState::kRunning, 1.0));
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.pressure_psi > 5.0F; }));

  int seconds = 0;
  for (const auto& e : events) {
    if (std::strcmp(e.code, "countdown") != 0) continue;
    EXPECT_EQ(e.value, 5.0 - seconds);
    ++seconds;
  }
  EXPECT_EQ(seconds, 5);
  ASSERT_NE(event("armed"), nullptr);
  ASSERT_NE(event("run.start"), nullptr);
  EXPECT_NEAR(static_cast<double>(event("run.start")->mono_ns - event("countdown.begin")->mono_ns) * 1e-9, 5.0, 0.01);
}

TEST_F(ArmingTest, WithoutTheSecondActTheRigIsReadyAgain) {
  arm();
  EXPECT_TRUE(reach(RunState::kReady, 10.1));
  EXPECT_EQ(virtual_rig->core().status().runs_started, 0U);
  ASSERT_NE(event("disarmed"), nullptr);
  const auto late = ask(Request::Verb::kGo, &plan);
  EXPECT_FALSE(late.accepted);
  EXPECT_STREQ(late.text, "the rig is ready: a start has to be armed first (isorig start)");
}

TEST_F(ArmingTest, PauseAbortAndEveryTripEndTheCountdownAtRest) {
  note_rest();
  for (const auto verb : {Request::Verb::kPause, Request::Verb::kAbort}) {
    arm();
    go();
    run_for(2.0);
    ASSERT_TRUE(ask(verb).accepted);
    EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kNotStarted);
    ASSERT_TRUE(reach(RunState::kReady, 5.0));
    EXPECT_TRUE(at_rest());
    EXPECT_FALSE(virtual_rig->core().status().run_loaded);
  }
  arm();
  go();
  run_for(2.0);
  virtual_rig->rig().interlock().guard_closed = false;
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kNotStarted);
  virtual_rig->rig().interlock().guard_closed = true;
  run_for(6.0);
  EXPECT_TRUE(at_rest());
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  // A program stop holds a run, but there is none yet that could go on.
  arm();
  go();
  run_for(2.0);
  virtual_rig->around_core = [](Core& core, std::int64_t now_ns) { core.tick(now_ns, 400'000'000, 0); };
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  virtual_rig->around_core = nullptr;
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kNotStarted);
  EXPECT_FALSE(virtual_rig->core().status().run_loaded);
  run_for(1.0);
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  EXPECT_TRUE(reach(RunState::kReady, 5.0));
  EXPECT_TRUE(at_rest());
}

TEST_F(ArmingTest, WhatIsNotReadyAnyMoreIsNotArmed) {
  arm();
  virtual_rig->rig().interlock().guard_closed = false;
  ASSERT_TRUE(reach(RunState::kIdle, 0.1));
  virtual_rig->rig().interlock().guard_closed = true;
  ASSERT_TRUE(reach(RunState::kReady, 1.0));
  run_for(15.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kReady);
  EXPECT_EQ(virtual_rig->core().status().runs_started, 0U);
}

TEST_F(ArmingTest, APausedRunGoesOnByTheSameTwoActs) {
  arm();
  go();
  ASSERT_TRUE(reach(RunState::kRunning, 6.0));
  ASSERT_TRUE(run_until(30.0, [&] { return virtual_rig->core().status().control.pressure_psi > 9.0F; }));
  ASSERT_TRUE(ask(Request::Verb::kPause).accepted);
  run_for(1.0);
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kArmed);
  ASSERT_TRUE(reach(RunState::kPaused, 10.1));  // nobody said go
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  ASSERT_TRUE(ask(Request::Verb::kGo).accepted);
  run_for(2.0);
  ASSERT_TRUE(ask(Request::Verb::kPause).accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kPaused);
  EXPECT_TRUE(virtual_rig->core().status().run_loaded);
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  ASSERT_TRUE(ask(Request::Verb::kGo).accepted);
  EXPECT_FALSE(reach(RunState::kRunning, 4.9));
  EXPECT_TRUE(reach(RunState::kRunning, 0.2));
  ASSERT_TRUE(ask(Request::Verb::kAbort).accepted);
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kAborted);
}

TEST_F(ArmingTest, AnAbortFromOutsideReachesEveryNewState) {
  for (const bool counting : {false, true}) {
    arm();
    if (counting) go();
    virtual_rig->core().request_abort();
    tick();
    EXPECT_EQ(virtual_rig->core().state(), RunState::kStopping);
    ASSERT_TRUE(reach(RunState::kReady, 5.0));
  }
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kNotStarted);
}

}  // namespace
}  // namespace isorig::daemon::test
