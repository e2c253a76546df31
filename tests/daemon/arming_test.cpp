#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "daemon/host/host.hpp"
#include "recording_rig.hpp"
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

/// The host beside a loop that hangs when the test says so. One thread.
class LateLoopTest : public RigFixture {
 protected:
  LateLoopTest() { config.core.operating.arming_required = true; }

  void SetUp() override {
    RigFixture::SetUp();
    Host::Options options;
    options.runs_root = folder.path();
    options.breathe = [this] {
      if (!hangs) tick();
    };
    host = std::make_unique<Host>(config, virtual_rig->core(), virtual_rig->streams, options);
    ASSERT_TRUE(reach(RunState::kReady, 5.0)) << virtual_rig->core().status().not_ready;
  }
  static StartOptions protocol(const std::string& steps) {
    StartOptions o;
    o.protocol_text = "format = \"isorig-protocol/1\"\nname = \"p\"\nsteps = [\n" + steps + "\n]\n";
    return o;
  }
  Host::Result while_it_hangs(const std::function<Host::Result()>& call) {
    hangs = true;
    auto result = call();
    hangs = false;
    run_for(0.5);
    return result;
  }

  daemon::testing::TemporaryDirectory folder{"late-loop"};
  bool hangs = false;
  std::unique_ptr<Host> host;
};

/// Whoever was told that there is no answer does not stand back from a rig that is armed, or begins to move, after all.
TEST_F(LateLoopTest, WhatIsAskedOfALoopThatHangsDoesNotBeginAfterItsTime) {
  const auto late = while_it_hangs([&] { return host->start(protocol(kHold)); });
  EXPECT_FALSE(late.ok);
  EXPECT_NE(late.text.find("did not answer within 2 s; if it goes on, it will not begin"), std::string::npos)
      << late.text;
  EXPECT_EQ(virtual_rig->core().state(), RunState::kReady) << "armed after its time";
  EXPECT_EQ(event("armed"), nullptr);
  ASSERT_NE(event("request.late"), nullptr);

  ASSERT_TRUE(host->start(protocol(kHold)).ok);
  EXPECT_FALSE(while_it_hangs([&] { return host->go(); }).ok);
  EXPECT_EQ(event("countdown.begin"), nullptr);
  EXPECT_EQ(virtual_rig->core().status().runs_started, 0U);

  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().state() == RunState::kReady; }));
  ASSERT_TRUE(host->verb(Request::Verb::kSetup).ok);
  const double from_mm = double{virtual_rig->core().status().control.position_mm};
  EXPECT_FALSE(while_it_hangs([&] {
                 Request jog;
                 jog.verb = Request::Verb::kJog;
                 jog.relative = true;
                 jog.target_mm = 0.5;
                 const auto number = host->submit(jog);
                 const auto deadline = std::chrono::steady_clock::now() + kVerbPatience;
                 while (std::chrono::steady_clock::now() < deadline) EXPECT_FALSE(host->answer_to(number));
                 return host->without_answer(number, jog.verb);
               }).ok);
  EXPECT_NEAR(double{virtual_rig->core().status().control.position_mm}, from_mm, 0.01);
  EXPECT_EQ(event("jog"), nullptr);
}

/// To stop is never too late.
TEST_F(LateLoopTest, APauseThatCameTooLateStopsAllTheSame) {
  ASSERT_TRUE(host->start(protocol(kHold)).ok);
  const auto late = while_it_hangs([&] { return host->verb(Request::Verb::kPause); });
  EXPECT_FALSE(late.ok);
  EXPECT_NE(late.text.find("it does this as soon as it goes on"), std::string::npos) << late.text;
  ASSERT_NE(event("disarmed"), nullptr);
  EXPECT_EQ(event("disarmed")->text, std::string("taken back by the operator"));
}

/// The loop may be armed without a start that was answered: what `go` opens is never what an earlier one has left.
TEST_F(LateLoopTest, GoOpensNothingThatAnEarlierStartHasLeft) {
  ASSERT_TRUE(host->start(protocol(kHold)).ok);
  ASSERT_TRUE(host->verb(Request::Verb::kPause).ok);
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().state() == RunState::kReady; }));
  EXPECT_THROW((void)host->start(protocol("{ do = \"no such step\" }")), base::ConfigError);
  ASSERT_TRUE(host->verb(Request::Verb::kArm).ok);  // as of a start whose answer was lost on its way
  ASSERT_EQ(virtual_rig->core().state(), RunState::kArmed);
  const auto went = host->go();
  EXPECT_FALSE(went.ok);
  EXPECT_NE(went.text.find("nothing is armed any more"), std::string::npos) << went.text;
  EXPECT_EQ(virtual_rig->core().status().runs_started, 0U);
}

}  // namespace
}  // namespace isorig::daemon::test
