#include <cmath>

#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using Verb = Request::Verb;

/// Limits, readiness and faults outside of a run and after it, on the whole virtual rig.
class StatesTest : public RigFixture {
 protected:
  sim::Truth truth() { return virtual_rig->rig().truth(); }
  [[nodiscard]] int count(const char* code) const {
    int n = 0;
    for (const auto& e : events) n += std::strcmp(e.code, code) == 0 ? 1 : 0;
    return n;
  }
  [[nodiscard]] bool listed(const char* code) const {
    const auto s = virtual_rig->core().status();
    for (std::uint32_t i = 0; i < s.fault_count; ++i) {
      if (std::strcmp(s.faults[i].code, code) == 0) return true;
    }
    return false;
  }
  void hold() {
    start(kHold);
    ASSERT_TRUE(run_until(20.0, [&] { return std::abs(truth().pressure_psi - 10.0) < 0.05; }));
    run_for(1.0);
  }
};

TEST_F(StatesTest, ARigUnderPressureIsNotReadyAndDoesNotStart) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  auto& air = virtual_rig->rig().pneumatics();
  air.fill_stuck_open = air.vent_stuck_shut = air.dump_stuck_shut = true;
  ASSERT_TRUE(run_until(10.0, [&] { return truth().pressure_psi > 1.0; }));
  run_for(0.1);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kIdle);
  EXPECT_NE(std::string(virtual_rig->core().status().not_ready).find("pressure"), std::string::npos)
      << virtual_rig->core().status().not_ready;
  EXPECT_FALSE(ask(Verb::kStart, &plan).accepted);
  // Nobody asked for it, and the limit holds all the same.
  ASSERT_TRUE(reach(RunState::kFaulted, 60.0));
  EXPECT_TRUE(run_until(60.0, [&] { return listed("limit.pressure"); }));
}

TEST_F(StatesTest, ARigThatCannotVentIsAFaultAndNeverReady) {
  hold();
  virtual_rig->rig().pneumatics().vent_stuck_shut = virtual_rig->rig().pneumatics().dump_stuck_shut = true;
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kFaulted, config.core.vent_time_max_s + 1.0));
  run_for(0.1);
  // The guard is sooner than the time that venting may take.
  EXPECT_TRUE(event("pressure.no_vent") != nullptr || event("vent.stuck") != nullptr);
  EXPECT_EQ(event("stopped"), nullptr);
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kAborted) << "how the run ended stays";
}

TEST_F(StatesTest, TheForceLimitIsArmedInReady) {
  config.core.supervisor.limits.force_max_N = 3.0;
  config.core.supervisor.limits.force_min_N = -3.0;
  config.sim->frame.force_offset_N = 2.9;
  rebuild();
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  virtual_rig->rig().frame().start_segment({900, 4.0F, 1.0F});  // at its own panel
  ASSERT_TRUE(reach(RunState::kFaulted, 6.0)) << truth().force_N;
  run_for(0.5);
  EXPECT_NE(event("limit.force"), nullptr);
  EXPECT_EQ(event("limit.force")->severity, Severity::kSafeState);
  EXPECT_LT(std::abs(truth().velocity_mm_s), 0.03) << "stopped";
}

TEST_F(StatesTest, ARigWhoseCrossheadIsMovedIsNotReady) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  virtual_rig->rig().frame().start_segment({900, 3.0F, 0.5F});
  ASSERT_TRUE(reach(RunState::kIdle, 0.3));
  EXPECT_NE(std::string(virtual_rig->core().status().not_ready).find("moves"), std::string::npos);
  ASSERT_TRUE(reach(RunState::kReady, 8.0));
  EXPECT_NEAR(truth().position_mm, 3.0, 0.01);
}

TEST_F(StatesTest, AnAbortVentsWhateverTheState) {
  ASSERT_TRUE(ask(Verb::kAbort).accepted) << "idle";
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  ASSERT_TRUE(ask(Verb::kAbort).accepted) << "ready";
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  hold();
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);  // a program stop: held
  run_for(0.1);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 10.0));
  EXPECT_LT(truth().pressure_psi, 0.6);
  // Faulted with the run over: still nobody is told that there is nothing to abort.
  hold();
  virtual_rig->rig().interlock().estop_closed = false;
  run_for(0.1);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_TRUE(ask(Verb::kAbort).accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted) << "the cause stays latched";
}

TEST_F(StatesTest, EveryFaultIsAnEventOnceAndStandsInTheList) {
  hold();
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
  run_for(0.3);
  virtual_rig->rig().interlock().estop_closed = false;
  run_for(1.0);
  virtual_rig->rig().pressure().faults.sensor_fault = true;
  run_for(1.0);
  for (const char* code : {"loop.late", "interlock.estop", "interlock.frame", "stale.pressure"}) {
    EXPECT_EQ(count(code), 1) << code;
    EXPECT_TRUE(listed(code)) << code;
  }
  const auto s = virtual_rig->core().status();
  EXPECT_EQ(std::string(s.fault).substr(0, 9), "loop.late") << "the first cause";
  EXPECT_STREQ(s.faults[0].code, "loop.late");
  for (std::uint32_t i = 1; i < s.fault_count; ++i) EXPECT_GE(s.faults[i].mono_ns, s.faults[i - 1].mono_ns);
  virtual_rig->rig().interlock().estop_closed = true;
  virtual_rig->rig().pressure().faults.sensor_fault = false;
  run_for(1.0);
  ASSERT_TRUE(ask(Verb::kReset).accepted);
  run_for(0.1);
  EXPECT_EQ(virtual_rig->core().status().fault_count, 0U);
}

TEST_F(StatesTest, TheDriversWordsStandInTheFault) {
  hold();
  virtual_rig->rig().frame().faults.silent = true;
  ASSERT_TRUE(reach(RunState::kFaulted, 1.0));
  run_for(0.6);
  ASSERT_NE(event("stale.frame"), nullptr);
  EXPECT_NE(std::string(event("stale.frame")->text).find("simulated frame: no answer"), std::string::npos)
      << event("stale.frame")->text;
  EXPECT_NE(std::string(virtual_rig->core().status().fault).find("no answer"), std::string::npos);
  EXPECT_NE(event("error.frame"), nullptr);
  virtual_rig->rig().frame().faults.silent = false;
  run_for(3.0);
  EXPECT_NE(event("reconnect.frame"), nullptr);
}

// Told ten seconds after it happened, it must not read as if the device had failed now.
TEST_F(StatesTest, AnErrorThatIsToldLateSaysHowLongAgoItWas) {
  hold();
  for (int i = 0; i < 2; ++i) {
    virtual_rig->rig().frame().faults.silent = true;
    run_for(0.01);
    virtual_rig->rig().frame().faults.silent = false;
    run_for(1.0);
  }
  run_for(12.0);
  ASSERT_EQ(count("error.frame"), 2);
  std::vector<std::string> texts;
  for (const auto& e : events) {
    if (std::strcmp(e.code, "error.frame") == 0) texts.emplace_back(e.text);
  }
  EXPECT_EQ(texts[0].find("simulated frame: no answer"), 0U) << texts[0];
  EXPECT_NE(texts[1].find(" more by now, the last "), std::string::npos) << texts[1];
  EXPECT_NE(texts[1].find(" s ago: simulated frame: no answer"), std::string::npos) << texts[1];
  EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning);
}

TEST_F(StatesTest, ALatchOfTheTeensyIsSeenAfterAStallAndCanBeReset) {
  hold();
  virtual_rig->hang_core = true;  // 1 s: frame and Teensy have stopped and vented by themselves
  run_for(1.0);
  virtual_rig->hang_core = false;
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 1'000'000'000, 0);
  run_for(0.5);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_NE(event("pressure.watchdog"), nullptr) << virtual_rig->core().status().fault;
  EXPECT_FALSE(virtual_rig->core().status().run_loaded) << "there is no pressure to go on with";
  EXPECT_TRUE(virtual_rig->core().status().vented_fault);
  ASSERT_TRUE(run_until(3.0, [&] { return ask(Verb::kReset).accepted; }));
  ASSERT_TRUE(reach(RunState::kReady, 10.0)) << virtual_rig->core().status().fault;
}

TEST_F(StatesTest, BeyondALimitAResetLetsOnlyTheWayBack) {
  config.core.supervisor.limits.travel_max_mm = 2.0;
  rebuild();
  start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 1 },)");
  ASSERT_TRUE(reach(RunState::kFaulted, 20.0));
  run_for(1.0);
  ASSERT_NE(event("limit.travel"), nullptr);
  ASSERT_TRUE(ask(Verb::kReset).accepted);
  ASSERT_TRUE(ask(Verb::kResume).accepted) << "the ramp leads further out";
  run_for(0.5);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_EQ(count("limit.travel"), 2);
  EXPECT_LT(truth().position_mm, 2.1) << "not a step further";
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 10.0));
  EXPECT_GT(truth().position_mm, 2.0);
  start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(truth().position_mm) < 0.01; })) << "back in by the approach";
  EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning) << virtual_rig->core().status().fault;
}

TEST_F(StatesTest, ARunThatNobodyComesBackToIsVented) {
  config.core.supervisor.held_max_s = 30.0;
  rebuild();
  hold();
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  run_for(29.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kPaused);
  ASSERT_TRUE(reach(RunState::kFaulted, 2.0));
  run_for(8.0);
  EXPECT_NE(event("held.expired"), nullptr);
  EXPECT_LT(truth().pressure_psi, 1.0);
}

TEST_F(StatesTest, AFrameThatWasRestartedWaitsForItsZero) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  virtual_rig->rig().frame().power_cycle(3.0);
  ASSERT_TRUE(reach(RunState::kIdle, 2.0));
  run_for(10.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kIdle);
  EXPECT_NE(std::string(virtual_rig->core().status().not_ready).find("confirm-zero"), std::string::npos)
      << virtual_rig->core().status().not_ready;
  EXPECT_NE(event("restart.frame"), nullptr);
  EXPECT_FALSE(virtual_rig->core().status().zero_confirmed);
  EXPECT_FALSE(ask(Verb::kStart, &plan).accepted);
  ASSERT_TRUE(ask(Verb::kConfirmZero).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 1.0));
  run_for(0.1);
  EXPECT_NE(event("zero.confirmed"), nullptr);
  EXPECT_TRUE(virtual_rig->core().status().zero_confirmed);
}

TEST_F(StatesTest, ARealFramesFirstZeroIsConfirmedToo) {
  config.core.frame_zero = FrameZero::kConfirm;
  rebuild();
  EXPECT_FALSE(ask(Verb::kConfirmZero).accepted) << "nothing has been seen to confirm";
  run_for(5.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kIdle);
  ASSERT_TRUE(ask(Verb::kConfirmZero).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 1.0));
}

TEST_F(StatesTest, AFrameThatRestartsInARunIsTheSafeState) {
  hold();
  virtual_rig->rig().frame().power_cycle(0.1);
  ASSERT_TRUE(reach(RunState::kFaulted, 2.0));
  run_for(5.0);
  EXPECT_TRUE(listed("frame.reference") || listed("stale.frame")) << virtual_rig->core().status().fault;
  EXPECT_LT(truth().pressure_psi, 1.0);
  ASSERT_TRUE(ask(Verb::kReset).accepted);
  run_for(5.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kIdle) << "the zero is not confirmed";
}

TEST_F(StatesTest, AFrameInAFaultStateWithoutAFaultBitIsTheSafeState) {
  hold();
  virtual_rig->rig().frame().faults.fault_state = true;
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  run_for(5.0);
  EXPECT_NE(event("frame.fault"), nullptr);
  EXPECT_LT(truth().pressure_psi, 1.0);
}

TEST_F(StatesTest, ANumberThatIsNoneIsNamed) {
  hold();
  virtual_rig->rig().frame().faults.not_a_number = true;
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  run_for(0.1);
  EXPECT_NE(event("frame.number"), nullptr) << virtual_rig->core().status().fault;
}

TEST_F(StatesTest, ARefusedHeartbeatDoesNotStopThePolling) {
  hold();
  virtual_rig->rig().frame().faults.heartbeat_refused = true;
  ASSERT_TRUE(reach(RunState::kFaulted, 1.0));
  run_for(0.1);
  ASSERT_NE(event("frame.heartbeat"), nullptr) << virtual_rig->core().status().fault;
  EXPECT_NE(std::string(event("frame.heartbeat")->text).find("the heartbeat: "), std::string::npos)
      << event("frame.heartbeat")->text;
  EXPECT_EQ(event("stale.frame"), nullptr) << "samples went on coming";
}

TEST_F(StatesTest, ADeadLoadCellIsNoticedAtRest) {
  hold();
  virtual_rig->rig().frame().faults.frozen_force = true;
  ASSERT_TRUE(reach(RunState::kFaulted, config.core.supervisor.frozen_force_max_s + 0.5));
  run_for(0.1);
  EXPECT_NE(event("force.frozen"), nullptr);
}

TEST_F(StatesTest, AnotherCalibrationIsNoForceRateAndIsJudgedAtOnce) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  Request request;
  request.verb = Verb::kCalibrate;
  request.id = 4711;
  request.calibration = config.core.calibration;
  request.calibration.force_offset_N += 20.0;
  virtual_rig->core().requests.push(request);
  run_for(1.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kReady) << virtual_rig->core().status().fault;
  request.calibration.force_offset_N += 200.0;
  virtual_rig->core().requests.push(request);
  run_for(0.1);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_NE(event("limit.force"), nullptr);
}

}  // namespace
}  // namespace isorig::daemon::test
