#include <cmath>

#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using Verb = Request::Verb;

/// How the frame fails to stop, and how a stop comes about. What counts is the plant's truth.
struct Failure {
  const char* name;
  void (*switch_on)(sim::FrameFaults&);
  double stands_within_s;  ///< of the stop; negative: never
};

constexpr double kWatchdog_s = 0.5;  // of the simulated frame

const Failure kFailures[] = {
    {"none", [](sim::FrameFaults&) {}, 0.2},
    {"refused once", [](sim::FrameFaults& f) { f.stop_refused = 1; }, 0.2},
    {"refused 8 times", [](sim::FrameFaults& f) { f.stop_refused = 8; }, 0.25},
    {"refused for good", [](sim::FrameFaults& f) { f.stop_refused = -1; }, kWatchdog_s + 0.25},
    {"lost once", [](sim::FrameFaults& f) { f.stop_lost = 1; }, 0.2},
    {"lost for good", [](sim::FrameFaults& f) { f.stop_lost = -1; }, kWatchdog_s + 0.25},
    {"runs on", [](sim::FrameFaults& f) { f.runs_on = true; }, kWatchdog_s + 0.25},
};

class StopTest : public RigFixture {
 protected:
  static constexpr double kSpeed_mm_s = 1.0;

  /// On the way from 0 to 4 mm, at 1 mm.
  void move() {
    start(R"(  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 1 },
  { do = "hold", duration_s = 100 },)");
    ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().position_mm > 1.0; }));
  }
  sim::FrameFaults& faults() { return virtual_rig->rig().frame().faults; }
  sim::Truth truth() { return virtual_rig->rig().truth(); }
  bool moves() { return std::abs(truth().velocity_mm_s) > 0.025; }

  /// Runs on and looks at every millisecond: nothing may say that the rig is ready, or that it has stopped, while
  /// the crosshead moves.
  void watch(double seconds, const char* what) {
    bool said = false;
    run_until(seconds, [&] {
      const auto state = virtual_rig->core().state();
      if ((state == RunState::kReady || state == RunState::kIdle) && moves()) said = true;
      return said;
    });
    EXPECT_FALSE(said) << what << ": " << to_text(virtual_rig->core().state()) << " while the crosshead moves";
    drain();
  }

  /// From the moment of the stop on.
  void expect_stop(const Failure& failure, const char* cause, double from_mm) {
    const std::string what = std::string(cause) + ", stop " + failure.name;
    watch(failure.stands_within_s, what.c_str());
    EXPECT_FALSE(moves()) << what;
    EXPECT_LT(truth().position_mm - from_mm, kSpeed_mm_s * failure.stands_within_s) << what;
    watch(1.0, what.c_str());
    EXPECT_FALSE(moves()) << what << ", later";
    const bool late = failure.stands_within_s > config.core.supervisor.stop_confirm_max_s + 0.1;
    EXPECT_EQ(event("frame.stop") != nullptr, late) << what;
    if (late) {
      EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted) << what;
      EXPECT_FALSE(virtual_rig->core().status().run_loaded) << what;
      watch(8.0, what.c_str());
      EXPECT_LT(truth().pressure_psi, 1.0) << what << ": the safe state vents";
    }
  }
};

TEST_F(StopTest, APauseIsRepeatedUntilTheFrameStands) {
  for (const auto& failure : kFailures) {
    rebuild();
    move();
    failure.switch_on(faults());
    const double from_mm = truth().position_mm;
    ASSERT_TRUE(ask(Verb::kPause).accepted);
    expect_stop(failure, "pause", from_mm);
  }
}

/// "Paused" is what the plan is; that the crosshead stands is said when it was seen to.
TEST_F(StopTest, APauseDoesNotSayThatTheCrossheadStandsBeforeItWasSeenTo) {
  move();
  const auto paused = ask(Verb::kPause);
  ASSERT_TRUE(paused.accepted);
  EXPECT_STREQ(paused.text,
               "now paused: the crosshead is told to stop, and has not been seen to stand yet; if it does not, that is "
               "the fault frame.stop");
}

TEST_F(StopTest, AnAbortIsRepeatedUntilTheFrameStands) {
  for (const auto& failure : kFailures) {
    rebuild();
    move();
    failure.switch_on(faults());
    const double from_mm = truth().position_mm;
    ASSERT_TRUE(ask(Verb::kAbort).accepted);
    expect_stop(failure, "abort", from_mm);
  }
}

/// Of a crosshead that stands the stop is confirmed at once; the vent has its time all the same.
TEST_F(StopTest, AReadingThatLiesDoesNotMakeAnAbortedRunReadyAtOnce) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return truth().pressure_psi > 9.9; }));
  run_for(1.0);
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  run_for(1.0);
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  virtual_rig->rig().pressure().faults.tube_off = true;
  ASSERT_TRUE(run_until(2.0, [&] { return virtual_rig->core().state() == RunState::kReady; }));
  EXPECT_LT(truth().pressure_psi, 6.0);
}

/// What the daemon waits for before it leaves: a fault may stay.
TEST_F(StopTest, WithALatchedFaultTheRigCountsAsStoppedOnceItStandsAndIsVented) {
  for (const bool frame_answers : {true, false}) {
    rebuild();
    move();
    EXPECT_FALSE(virtual_rig->core().status().stopped);
    if (frame_answers) {
      faults().fault_state = true;
    } else {
      faults().stop_refused = -1;
      faults().fault_state = true;
    }
    ASSERT_TRUE(reach(RunState::kFaulted, 1.0));
    run_for(0.05);
    EXPECT_FALSE(virtual_rig->core().status().stopped) << "under pressure";
    run_for(5.0);
    virtual_rig->core().request_abort();
    run_for(0.05);
    EXPECT_EQ(virtual_rig->core().status().stopped, frame_answers);
    run_for(2.1);
    EXPECT_TRUE(virtual_rig->core().status().stopped) << "its watchdog has stopped it by now";
    EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  }
}

/// Idle is also the state of a rig whose devices say nothing, and of one under pressure.
TEST_F(StopTest, BetweenRunsOnlyWhatIsSeenCountsAsStopped) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  run_for(0.05);
  EXPECT_TRUE(virtual_rig->core().status().stopped);
  faults().silent = true;
  ASSERT_TRUE(reach(RunState::kIdle, 5.0));
  run_for(0.05);
  EXPECT_FALSE(virtual_rig->core().status().stopped) << "no frame";
  config.sim->pressure.offset_psi = 1.0;
  rebuild();
  run_for(5.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kIdle);
  EXPECT_FALSE(virtual_rig->core().status().stopped) << "under pressure, as far as is seen";
}

/// As a signal does.
TEST_F(StopTest, AnAbortFromOutsideBetweenRunsEndsNoRunAgain) {
  start("  { do = \"pressurize\", pressure_psi = 1, rate_psi_s = 8, settled_for_s = 0.1, timeout_s = 20 },");
  ASSERT_TRUE(run_until(30.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  ASSERT_TRUE(reach(RunState::kReady, 10.0));
  ASSERT_TRUE(ask(Verb::kSetup).accepted);
  run_for(0.5);
  events.clear();
  virtual_rig->core().request_abort();
  ASSERT_TRUE(reach(RunState::kReady, 10.0));
  EXPECT_EQ(event("run.done"), nullptr);
  ASSERT_NE(event("abort"), nullptr);
  EXPECT_EQ(event("abort")->to, RunState::kStopping);
}

/// Somebody leans on the abort button.
TEST_F(StopTest, AnAbortThatIsRepeatedAtRestLeavesTheRigReady) {
  for (const int every_ms : {1, 20, 50}) {
    rebuild();
    ASSERT_TRUE(reach(RunState::kReady, 5.0));
    run_for(0.5);
    events.clear();
    for (int i = 0; i < 2'000 / every_ms; ++i) {
      ASSERT_TRUE(ask(Verb::kAbort).accepted);
      run_for(1e-3 * (every_ms - 1));
      ASSERT_EQ(virtual_rig->core().state(), RunState::kReady)
          << every_ms << " ms, " << virtual_rig->core().status().not_ready;
    }
    EXPECT_EQ(event("frame.stop"), nullptr);
    EXPECT_EQ(event("not_ready"), nullptr);
    EXPECT_NE(event("abort"), nullptr);
    start(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 8, settled_for_s = 0.1, timeout_s = 20 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 1 },)");
    ASSERT_TRUE(reach(RunState::kStopping, 10.0));
    EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kDone);
    EXPECT_NEAR(truth().position_mm, 1.0, 0.02);
  }
}

TEST_F(StopTest, AnAbortThatIsRepeatedInAMotionStopsItInItsTime) {
  for (const int every_ms : {1, 20, 50}) {
    for (const auto& failure : kFailures) {
      rebuild();
      move();
      failure.switch_on(faults());
      const auto until_ns = virtual_rig->now_ns() + 1'200'000'000;
      std::int64_t stood_ns = 0, tripped_ns = 0;
      const auto began_ns = virtual_rig->now_ns();
      while (virtual_rig->now_ns() < until_ns) {
        ASSERT_TRUE(ask(Verb::kAbort).accepted);
        for (int i = 1; i < every_ms; ++i) tick();
        drain();
        if (stood_ns == 0 && !moves()) stood_ns = virtual_rig->now_ns();
        if (tripped_ns == 0 && event("frame.stop") != nullptr) tripped_ns = virtual_rig->now_ns();
      }
      const std::string what = std::string(failure.name) + ", every " + std::to_string(every_ms) + " ms";
      EXPECT_FALSE(moves()) << what;
      EXPECT_LT(1e-9 * static_cast<double>(stood_ns - began_ns), failure.stands_within_s + 0.06) << what;
      const bool late = failure.stands_within_s > config.core.supervisor.stop_confirm_max_s + 0.1;
      EXPECT_EQ(tripped_ns != 0, late) << what;
      if (late) {
        EXPECT_NEAR(1e-9 * static_cast<double>(tripped_ns - began_ns), 0.3, 0.07) << what;
      }
    }
  }
}

TEST_F(StopTest, ALimitIsRepeatedUntilTheFrameStands) {
  config.core.supervisor.limits.travel_max_mm = 1.5;
  for (const auto& failure : kFailures) {
    rebuild();
    move();
    failure.switch_on(faults());
    ASSERT_TRUE(reach(RunState::kFaulted, 2.0));
    const double from_mm = truth().position_mm;
    EXPECT_LT(from_mm, 1.55);
    expect_stop(failure, "limit", from_mm);
  }
}

TEST_F(StopTest, TheWayOutStopsTheFrameOrSaysThatItDoesNotStand) {
  for (const auto& failure : kFailures) {
    rebuild();
    move();
    failure.switch_on(faults());
    const double from_mm = truth().position_mm;
    const bool stood = virtual_rig->shut_down();
    EXPECT_EQ(stood, std::string(failure.name) != "refused for good") << failure.name;
    EXPECT_FALSE(moves()) << failure.name;
    EXPECT_LT(truth().position_mm - from_mm, kSpeed_mm_s * failure.stands_within_s) << failure.name;
  }
  rebuild();
  move();
  faults().runaway = true;
  const auto before_ns = virtual_rig->now_ns();
  EXPECT_FALSE(virtual_rig->shut_down());
  EXPECT_LE(virtual_rig->now_ns() - before_ns, FrameService::kLeaveNs);
}

TEST_F(StopTest, AStepsTimeOutWithAFrameThatIsBusyVents) {
  start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 4.5 },)");
  virtual_rig->rig().pneumatics().supply_empty = true;
  faults().stop_refused = -1;
  ASSERT_TRUE(reach(RunState::kFaulted, 10.0));
  run_for(0.4);
  EXPECT_TRUE(virtual_rig->core().status().vented_fault);
  EXPECT_NE(event("frame.stop"), nullptr);
  run_for(8.0);
  EXPECT_LT(truth().pressure_psi, 1.0);
}

TEST_F(StopTest, ASilentGatewayDoesNotSwallowAStop) {
  for (const double silent_s : {0.05, 0.26, 0.45, 0.9}) {
    rebuild();
    move();
    const double from_mm = truth().position_mm;
    faults().silent = true;
    ASSERT_TRUE(ask(Verb::kPause).accepted);
    watch(silent_s, "silent");
    faults().silent = false;
    watch(kWatchdog_s + 0.25 - std::min(silent_s, 0.5), "silent");
    EXPECT_FALSE(moves()) << silent_s;
    EXPECT_LT(truth().position_mm - from_mm, 0.75) << silent_s;
    EXPECT_EQ(virtual_rig->core().state() == RunState::kFaulted, silent_s > 0.2) << silent_s;
    watch(3.0, "silent, later");
    EXPECT_FALSE(moves()) << silent_s;
  }
}

TEST_F(StopTest, AStopFromFullSpeedIsConfirmedInTime) {
  start(R"(  { do = "pressurize", pressure_psi = 2, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 10 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 10 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return truth().position_mm > 1.0; }));
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  EXPECT_TRUE(run_until(0.28, [&] { return ask(Verb::kResume).accepted; }));
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  run_for(2.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kPaused) << virtual_rig->core().status().fault;
  EXPECT_TRUE(ask(Verb::kResume).accepted);
}

TEST_F(StopTest, AFrameThatNothingStopsIsNeverCalledStopped) {
  for (const double speed_mm_s : {1.0, 0.05}) {
    rebuild();
    start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = )" +
          std::to_string(speed_mm_s) + " },");
    ASSERT_TRUE(run_until(60.0, [&] { return truth().position_mm > 1.0; }));
    faults().runaway = true;
    ASSERT_TRUE(ask(Verb::kAbort).accepted);
    run_for(0.4);
    EXPECT_NE(event("frame.stop"), nullptr) << speed_mm_s;
    EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
    ASSERT_TRUE(moves());
    const auto reply = ask(Verb::kReset);
    EXPECT_FALSE(reply.accepted);
    EXPECT_NE(std::string(reply.text).find("stand"), std::string::npos) << reply.text;
    watch(speed_mm_s < 0.1 ? 40.0 : 2.0, "runaway");
    EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
    EXPECT_LT(truth().pressure_psi, 5.0) << "and vents meanwhile";
    // At its target it stands by itself: then it can be reset.
    ASSERT_TRUE(run_until(60.0, [&] { return truth().position_mm > 3.9999 && !moves(); }));
    faults().runaway = false;
    run_for(1.0);
    ASSERT_TRUE(ask(Verb::kReset).accepted) << speed_mm_s;
    ASSERT_TRUE(reach(RunState::kReady, 30.0)) << speed_mm_s;
  }
}

TEST_F(StopTest, ACrossheadThatIsMovedWhileTheRunIsHeldIsASafeState) {
  move();
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  run_for(1.0);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kPaused);
  virtual_rig->rig().frame().start_segment({999, 2.0F, 0.05F});  // somebody at the frame's own panel
  ASSERT_TRUE(reach(RunState::kFaulted, 2.0));
  EXPECT_NE(event("frame.stop"), nullptr);
  run_for(0.3);
  EXPECT_FALSE(moves());
}

TEST_F(StopTest, AStopOvertakesTheSegmentsThatWait) {
  move();
  faults().stop_refused = 10;  // 50 ms
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  EXPECT_FALSE(ask(Verb::kResume).accepted) << "the crosshead has not been seen to stand";
  run_for(0.29);
  const double held_mm = truth().position_mm;
  EXPECT_FALSE(moves());
  ASSERT_TRUE(ask(Verb::kResume).accepted);
  ASSERT_TRUE(run_until(1.0, [&] { return truth().position_mm > held_mm + 0.1; }));
  // Resumed and stopped within one turn of the frame's thread: the segment between the two never runs.
  ASSERT_TRUE(ask(Verb::kPause).accepted);
  run_for(0.3);
  const double second_mm = truth().position_mm;
  virtual_rig->core().requests.push({.verb = Verb::kResume, .id = 1001, .calibration = {}, .fill_limits = {}});
  tick();
  virtual_rig->core().requests.push({.verb = Verb::kPause, .id = 1002, .calibration = {}, .fill_limits = {}});
  run_for(1.0);
  EXPECT_NEAR(truth().position_mm, second_mm, 0.001);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kPaused);
}

TEST_F(StopTest, ARigThatDoesNotVentSaysSo) {
  config.sim->pneumatics.vent_conductance_L_s_bar = 1e-7;
  config.sim->pneumatics.dump_conductance_L_s_bar = 1e-7;
  rebuild();
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return truth().pressure_psi > 8.0; }));
  ASSERT_TRUE(ask(Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kFaulted, config.core.vent_time_max_s + 1.0));
  run_for(0.1);
  // The guard is sooner than the time that venting may take.
  EXPECT_TRUE(event("pressure.no_vent") != nullptr || event("vent.stuck") != nullptr);
  EXPECT_EQ(event("stopped"), nullptr);
}

}  // namespace
}  // namespace isorig::daemon::test
