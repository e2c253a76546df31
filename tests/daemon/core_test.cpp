#include <gmock/gmock.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using CoreTest = RigFixture;
using Verb = Request::Verb;

TEST_F(CoreTest, GetsReadyOnceTheClocksAreMapped) {
  EXPECT_EQ(virtual_rig->core().state(), RunState::kIdle);
  ASSERT_TRUE(reach(RunState::kReady, 2.0));
  run_for(0.1);
  const auto s = virtual_rig->core().status();
  EXPECT_TRUE(s.frame.clock_ready && s.pressure.clock_ready);
  // Delays: 0.25 ms each way and more, so no honest bound is below 0.25 ms; after a burst none is above 1 ms.
  EXPECT_GT(s.frame.bound_ns, 0.2e6F);
  EXPECT_LT(s.frame.bound_ns, 1.0e6F);
}

TEST_F(CoreTest, VerbsAreRefusedOutsideTheirStatesAndSayWhy) {
  EXPECT_FALSE(ask(Verb::kStart, &plan).accepted);  // idle
  ASSERT_TRUE(reach(RunState::kReady, 2.0));
  for (const auto verb : {Verb::kPause, Verb::kResume, Verb::kReset}) {
    const auto reply = ask(verb);
    EXPECT_FALSE(reply.accepted);
    EXPECT_NE(std::string(reply.text).find("the rig is ready"), std::string::npos) << reply.text;
  }
}

/// With a loop on a thread of its own, as in the daemon: whoever has the answer and asks for the status at once.
TEST_F(CoreTest, AStatusAfterAnAnswerHoldsWhatTheAnswerSays) {
  start(kHold);
  auto& core = virtual_rig->core();
  std::atomic<bool> is_done = false;
  std::thread loop([&] {
    while (!is_done) tick();
  });
  for (int i = 0; i < 400; ++i) {
    Request request;
    request.verb = i % 2 == 0 ? Verb::kPause : Verb::kResume;
    request.id = ++last_id;
    core.requests.push(request);
    Reply reply;
    while (!core.replies.pop(reply)) {
    }
    const auto shown = core.status().control.state;
    EXPECT_TRUE(reply.accepted) << reply.text;
    EXPECT_EQ(shown, i % 2 == 0 ? RunState::kPaused : RunState::kRunning) << "after " << i << " answers";
    if (HasFailure()) break;
  }
  is_done = true;
  loop.join();
}

TEST_F(CoreTest, PauseHoldsFrameAndPressureAndResumeFinishesTheRamp) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 3, velocity_mm_s = 1 },
  { do = "hold", duration_s = 1 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 1.5; }));
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  run_for(1.0);
  const double held_mm = virtual_rig->rig().truth().position_mm;
  EXPECT_LT(held_mm, 1.7);
  run_for(5.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kPaused);
  EXPECT_NEAR(virtual_rig->rig().truth().position_mm, held_mm, 0.001);
  EXPECT_NEAR(virtual_rig->rig().truth().pressure_psi, 10.0, 0.05);
  ASSERT_TRUE(ask(Verb::kResume).accepted);
  ASSERT_TRUE(run_until(10.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  EXPECT_NEAR(virtual_rig->rig().truth().position_mm, 3.0, 0.005);
}

TEST_F(CoreTest, AbortStopsTheFrameAndVents) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.5 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 1.0; }));
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kStopping);
  ASSERT_TRUE(reach(RunState::kIdle, 10.0));
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kAborted);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 0.6);
  EXPECT_LT(virtual_rig->rig().truth().position_mm, 1.2);
  ASSERT_TRUE(reach(RunState::kReady, 1.0));  // and can start again
}

TEST_F(CoreTest, EveryStepAndSessionIsAnEvent) {
  start(R"(  { do = "mark", label = "here" },
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "hold", duration_s = 1 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  run_for(0.1);
  for (const char* code : {"run.start", "session.start", "mark", "step", "session.end", "run.done"}) {
    EXPECT_NE(event(code), nullptr) << code;
  }
  EXPECT_STREQ(event("mark")->text, "here");
}

/// The next session begins in the same tick: the end belongs to the one that is over, and so does a settle's time-out.
TEST_F(CoreTest, WhatEndsWithAStepIsAnEventOfThatStep) {
  start(R"(  { do = "repeat", unit = "session", for = { repetition = [1, 2] }, steps = [
    { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
    { do = "settle", force_slope_N_s = 1e-6, window_s = 1, settled_for_s = 0.2, expected_s = 1.2, timeout_s = 2, on_timeout = "continue" },
  ] },)");
  ASSERT_EQ(plan.sessions.size(), 2U);
  ASSERT_TRUE(run_until(40.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  run_for(0.1);
  std::vector<std::pair<std::string, std::uint32_t>> told;
  for (const auto& e : events) {
    const std::string code = e.code;
    if (code.starts_with("session.") || code == "settle.timeout") told.emplace_back(code, e.step);
  }
  using ::testing::Pair;
  EXPECT_THAT(told,
              ::testing::ElementsAre(Pair("session.start", 0U), Pair("settle.timeout", 1U), Pair("session.end", 1U),
                                     Pair("session.start", 2U), Pair("settle.timeout", 3U), Pair("session.end", 3U)));
}

/// While a disk hangs nobody empties the recorder's queues: what is of no run must not fill them.
TEST_F(CoreTest, TheRecorderGetsARunAndTheSecondsAfterIt) {
  ASSERT_TRUE(reach(RunState::kReady, 2.0));
  auto& queue = virtual_rig->streams.frame;
  run_for(1.0);
  EXPECT_EQ(frame_count, 0U) << "no run was open";
  start(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "hold", duration_s = 1 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  const auto ticks = [&](double seconds) {
    for (int i = 0; i < static_cast<int>(1000.0 * seconds); ++i) virtual_rig->tick();
  };
  ticks(6.0);
  const auto held = queue.size();
  EXPECT_GT(held, 5000U) << "a trip's evidence, and the last samples of a device";
  ticks(5.0);
  const auto most = queue.size();
  EXPECT_GT(most, held);
  ticks(60.0);
  EXPECT_EQ(queue.size(), most);
  EXPECT_EQ(virtual_rig->streams.dropped(), 0U);
  EXPECT_EQ(event("lost.record"), nullptr);
}

class TripTest : public RigFixture {
 protected:
  /// `or_code`: where the Teensy's own guard may come first.
  void expect_trip(const char* code, Severity severity, double within_s, const char* or_code = nullptr) {
    ASSERT_TRUE(reach(RunState::kFaulted, within_s)) << "no fault; wanted " << code;
    run_for(0.05);
    const auto* e = event(code);
    if (e == nullptr && or_code != nullptr) e = event(or_code);
    ASSERT_NE(e, nullptr) << "faulted for another reason: " << virtual_rig->core().status().fault;
    EXPECT_EQ(e->severity, severity);
    EXPECT_EQ(e->to, RunState::kFaulted);
    const double before_mm = virtual_rig->rig().truth().position_mm;
    run_for(6.0);
    EXPECT_NEAR(virtual_rig->rig().truth().position_mm, before_mm, 0.2) << "the frame has to stand";
    if (severity == Severity::kSafeState) {
      EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 1.0) << "a safe state vents";
    }
  }
};

TEST_F(TripTest, ForceLimitHoldsAndCanGoOnAfterReset) {
  // The specimen pulls about 15 N at 10 psi; stretched by 3 mm it passes the limit.
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "hold", duration_s = 5 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 1 },
  { do = "hold", duration_s = 1 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 0.2; }));
  const double force_N = virtual_rig->rig().truth().force_N;
  config.core.supervisor.limits.force_max_N = force_N + 2.0;
  // The limit belongs to the configuration: a second rig has it from the start.
  rebuild();
  start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "hold", duration_s = 5 },
  { do = "pressurize", pressure_psi = 10, rate_psi_s = 1, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 1 },
  { do = "hold", duration_s = 1 },)");
  expect_trip("limit.force", Severity::kProgramStop, 60.0);
  EXPECT_GT(virtual_rig->rig().truth().pressure_psi, 5.0) << "a program stop holds the pressure";
  EXPECT_EQ(ask(Verb::kStart, &plan).accepted, false);
}

TEST_F(TripTest, ProgramStopIsResetToPausedAndThenResumed) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(virtual_rig->rig().truth().pressure_psi - 10.0) < 0.05; }));
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);  // a tick that came 0.4 s late
  expect_trip("loop.late", Severity::kProgramStop, 0.1);
  EXPECT_NEAR(virtual_rig->rig().truth().pressure_psi, 10.0, 0.1);
  ASSERT_TRUE(ask(Verb::kReset).accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kPaused);
  ASSERT_TRUE(ask(Verb::kResume).accepted);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning);
}

TEST_F(TripTest, EmergencyStopVentsAndIsLatchedUntilClosedAndReset) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(virtual_rig->rig().truth().pressure_psi - 10.0) < 0.05; }));
  virtual_rig->rig().interlock().estop_closed = false;
  expect_trip("interlock.estop", Severity::kSafeState, 0.1);
  const auto refused = ask(Verb::kReset);
  EXPECT_FALSE(refused.accepted);
  virtual_rig->rig().interlock().estop_closed = true;
  run_for(0.5);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted) << "closing the chain alone must not re-arm";
  ASSERT_TRUE(ask(Verb::kReset).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kFailed);
}

TEST_F(TripTest, OpenGuardIsASafeState) {
  start(kHold);
  run_for(3.0);
  virtual_rig->rig().interlock().guard_closed = false;
  expect_trip("interlock.guard", Severity::kSafeState, 0.1);
}

TEST_F(TripTest, AFrameThatStopsSamplingIsStale) {
  start(kHold);
  run_for(3.0);
  virtual_rig->rig().frame().faults.frozen_samples = true;
  expect_trip("stale.frame", Severity::kSafeState, config.core.supervisor.frame_age_max_s + 0.1);
}

TEST_F(TripTest, AFrameThatIsGoneIsStale) {
  start(kHold);
  run_for(3.0);
  virtual_rig->rig().frame().faults.disconnected = true;
  expect_trip("stale.frame", Severity::kSafeState, config.core.supervisor.frame_age_max_s + 0.1);
}

TEST_F(TripTest, ASensorWithoutValidReadingsIsStale) {
  for (bool sim::PressureFaults::*fault :
       {&sim::PressureFaults::sensor_fault, &sim::PressureFaults::bus_low, &sim::PressureFaults::bus_high,
        &sim::PressureFaults::sensor_stale, &sim::PressureFaults::frozen_samples}) {
    rebuild();
    start(kHold);
    run_for(3.0);
    virtual_rig->rig().pressure().faults.*fault = true;
    expect_trip("stale.pressure", Severity::kSafeState, config.core.supervisor.pressure_age_max_s + 0.1,
                "teensy.sensor");
  }
}

TEST_F(TripTest, AnInterlockThatCannotBeReadIsOpen) {
  start(kHold);
  run_for(3.0);
  virtual_rig->rig().interlock().faulty = true;
  expect_trip("interlock.lost", Severity::kSafeState, 0.1);
}

TEST_F(TripTest, ATrippedDriveIsASafeState) {
  start(kHold);
  run_for(3.0);
  virtual_rig->rig().frame().faults.drive_fault = true;
  expect_trip("frame.fault", Severity::kSafeState, 0.2);
}

TEST_F(TripTest, AFrameThatDoesNotMoveIsCaughtBeforeTheStepTimesOut) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "hold", duration_s = 1 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 2 },)");
  virtual_rig->rig().frame().faults.ignores_segments = true;
  expect_trip("frame.following", Severity::kProgramStop, 30.0);
}

TEST_F(TripTest, AFrameThatStopsByItselfIsNotWaitedFor) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.5 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 1.0; }));
  virtual_rig->rig().frame().stop();  // somebody pressed stop on the frame's own panel
  expect_trip("frame.stopped", Severity::kProgramStop, 0.2);
  EXPECT_NEAR(virtual_rig->rig().truth().pressure_psi, 10.0, 0.1);
  ASSERT_TRUE(ask(Verb::kReset).accepted);
  ASSERT_TRUE(ask(Verb::kResume).accepted);
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 3.99; }));
}

TEST_F(TripTest, AFrozenLoadCellIsNoticedWhileTheCrossheadMoves) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "hold", duration_s = 3 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.5 },)");
  ASSERT_TRUE(run_until(30.0, [&] { return virtual_rig->rig().truth().position_mm > 1.0; }));
  virtual_rig->rig().frame().faults.frozen_force = true;
  expect_trip("force.frozen", Severity::kProgramStop, config.core.supervisor.frozen_force_max_s + 0.1);
}

TEST_F(TripTest, APressureThatIsStuckIsNoticedWhileItIsHeld) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(virtual_rig->rig().truth().pressure_psi - 10.0) < 0.05; }));
  run_for(2.0);
  virtual_rig->rig().pressure().faults.stuck_value = true;
  expect_trip("pressure.frozen", Severity::kSafeState, 5.1, "teensy.stuck");  // 5000 conversions at 1 kHz
}

TEST_F(TripTest, AStalledDaemonBlamesItselfAndNotTheFrame) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(virtual_rig->rig().truth().pressure_psi - 10.0) < 0.05; }));
  // The process was stopped for 3 s: nothing was read, then the loop wakes up late.
  virtual_rig->core().tick(virtual_rig->now_ns() + 3'000'000'000, 3'000'000'000, 0);
  drain();
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_NE(event("loop.late"), nullptr);
  EXPECT_EQ(event("stale.frame"), nullptr);
}

TEST_F(TripTest, AFaultWhileAnAbortVentsStandsBehindTheFaultThatHeldTheRun) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(virtual_rig->rig().truth().pressure_psi - 10.0) < 0.05; }));
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kStopping);
  virtual_rig->rig().interlock().estop_closed = false;
  expect_trip("interlock.estop", Severity::kSafeState, 0.2);
  const auto s = virtual_rig->core().status();
  EXPECT_EQ(std::string(s.fault).substr(0, 9), "loop.late") << s.fault;
  ASSERT_GE(s.fault_count, 2U);
  EXPECT_STREQ(s.faults[0].code, "loop.late");
  EXPECT_STREQ(s.faults[1].code, "interlock.estop");
}

TEST_F(TripTest, AnAnswerThatIsMissingOnceIsNoFault) {
  start(kHold);
  run_for(3.0);
  virtual_rig->rig().frame().faults.silent = true;
  run_for(0.015);
  virtual_rig->rig().frame().faults.silent = false;
  run_for(1.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning) << virtual_rig->core().status().fault;
  EXPECT_GE(virtual_rig->core().status().frame.errors, 1U);
  EXPECT_EQ(virtual_rig->core().status().frame.reconnects, 0U);
}

TEST_F(TripTest, PressureAboveItsLimitVents) {
  config.core.supervisor.limits.pressure_max_psi = 9.0;
  rebuild();
  start(kHold);  // compiled against the rig's 24 psi: the supervisor has the last word
  expect_trip("limit.pressure", Severity::kSafeState, 20.0);
}

TEST_F(TripTest, TravelLimitStops) {
  config.core.supervisor.limits.travel_max_mm = 1.0;
  rebuild();
  start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 2 },)");
  expect_trip("limit.travel", Severity::kProgramStop, 30.0);
  EXPECT_LT(virtual_rig->rig().truth().position_mm, 1.2);
}

TEST_F(TripTest, ForceRateLimitStops) {
  config.core.supervisor.limits.force_rate_max_N_s = 15.0;
  rebuild();
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 0.5, settled_for_s = 0.5, timeout_s = 40 },
  { do = "hold", duration_s = 5 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 10 },)");
  expect_trip("limit.force_rate", Severity::kProgramStop, 60.0);
}

TEST_F(TripTest, AnEmptySupplyIsASafeState) {
  start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 120 },)");
  virtual_rig->rig().pneumatics().supply_empty = true;
  expect_trip("pressure.no_response", Severity::kSafeState, 5.0);
}

TEST_F(TripTest, AStepsTimeOutEndsTheRunAndVents) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },
  { do = "settle", force_slope_N_s = 1e-9, window_s = 2, settled_for_s = 2, expected_s = 5, timeout_s = 8, on_timeout = "stop" },)");
  expect_trip("protocol", Severity::kSafeState, 30.0);
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kFailed);
}

TEST_F(TripTest, ARecorderThatCannotWriteStopsTheProgram) {
  start(kHold);
  run_for(3.0);
  virtual_rig->core().set_recorder_fault("the disk is full");
  expect_trip("recorder", Severity::kProgramStop, 0.1);
}

TEST_F(TripTest, AFaultEscalatesFromProgramStopToSafeState) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return std::abs(virtual_rig->rig().truth().pressure_psi - 10.0) < 0.05; }));
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
  run_for(0.2);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_NEAR(virtual_rig->rig().truth().pressure_psi, 10.0, 0.1);
  virtual_rig->rig().interlock().estop_closed = false;
  run_for(6.0);
  EXPECT_NE(event("interlock.estop"), nullptr);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 1.0);
}

TEST_F(TripTest, ALoopThatHangsIsStoppedByTheDevices) {
  start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.5 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 1.0; }));
  virtual_rig->hang_core = true;  // the I/O threads live on
  run_for(1.0);
  const double stopped_mm = virtual_rig->rig().truth().position_mm;
  EXPECT_LT(stopped_mm, 1.0 + 0.5 * (config.sim->frame.heartbeat_timeout_s + 0.2));
  run_for(5.0);
  EXPECT_NEAR(virtual_rig->rig().truth().position_mm, stopped_mm, 0.001);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 1.0);
}

TEST_F(CoreTest, TheSyncLineMeasuresTheClockMapping) {
  start(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "hold", duration_s = 40 },)");
  run_for(30.0);
  ASSERT_GT(sync.size(), 50U);
  for (const auto& r : sync) {
    EXPECT_TRUE(r.check.within) << r.check.error_us << " us, bound " << r.check.bound_us;
    EXPECT_LT(r.check.bound_us, 20'000.0);
  }
  const auto counts = virtual_rig->core().status().sync;
  EXPECT_EQ(counts.pairs, sync.back().counts.pairs);
  EXPECT_EQ(counts.outside + counts.unannounced + counts.ambiguous + counts.unseen, 0U);
  EXPECT_LT(counts.rms_us, 500.0);
}

TEST_F(CoreTest, EdgesThatTheInterlockMissedAreCountedAndShiftNothing) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  virtual_rig->rig().interlock().faulty = true;
  run_for(2.0);
  virtual_rig->rig().interlock().faulty = false;
  run_for(5.0);
  const auto counts = virtual_rig->core().status().sync;
  EXPECT_GE(counts.unseen, 3U);
  EXPECT_EQ(counts.outside, 0U);
  EXPECT_GE(counts.pairs, 8U);
}

}  // namespace
}  // namespace isorig::daemon::test
