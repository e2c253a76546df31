#include <cmath>

#include "rig_fixture.hpp"

/// Setup: the crosshead jogged at reduced speed and force, and off a limit only away from it (docs/states.md).
namespace isorig::daemon::test {
namespace {

class SetupTest : public RigFixture {
 protected:
  Reply jog(double target_mm, bool relative, double velocity_mm_s = 0.0) {
    Request request;
    request.verb = Request::Verb::kJog;
    request.id = ++last_id;
    request.target_mm = target_mm;
    request.relative = relative;
    request.velocity_mm_s = velocity_mm_s;
    virtual_rig->core().requests.push(request);
    tick();
    Reply reply;
    EXPECT_TRUE(virtual_rig->core().replies.pop(reply));
    return reply;
  }
  void expect_refused(const Reply& reply, const std::string& why) {
    EXPECT_FALSE(reply.accepted);
    EXPECT_NE(std::string(reply.text).find(why), std::string::npos) << reply.text;
  }
  void enter() {
    ASSERT_TRUE(reach(RunState::kReady, 5.0)) << virtual_rig->core().status().not_ready;
    const auto reply = ask(Request::Verb::kSetup);
    ASSERT_TRUE(reply.accepted) << reply.text;
    ASSERT_EQ(virtual_rig->core().state(), RunState::kSetup);
    run_for(0.5);
  }
  [[nodiscard]] double position_mm() { return double{virtual_rig->core().status().control.position_mm}; }
  /// Until the jog has ended; the fastest speed in it.
  double fastest(double seconds) {
    double most = 0.0, last_mm = position_mm();
    events.clear();
    const auto until = virtual_rig->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (virtual_rig->now_ns() < until) {
      run_for(0.1);
      most = std::max(most, std::abs(position_mm() - last_mm) / 0.1);
      last_mm = position_mm();
      if (event("jog.done") != nullptr || event("jog.time") != nullptr || event("jog.force") != nullptr) break;
    }
    return most;
  }

  /// With the crosshead beyond the upper travel limit, ready.
  void drive_beyond() {
    auto wide = config.limits;
    wide.travel_max_mm = 9.0;
    plan = protocol::compile(
        base::TomlDocument::parse_text(
            "format = \"isorig-protocol/1\"\nname = \"far\"\nrecording.policy = \"round_ramps\"\nsteps = [\n"
            "  { do = \"pressurize\", pressure_psi = 0, rate_psi_s = 8, settled_for_s = 0.1, timeout_s = 20 },\n"
            "  { do = \"ramp\", to_mm = 8, velocity_mm_s = 2 },\n]\n",
            "far.toml"),
        wide);
    ASSERT_TRUE(reach(RunState::kReady, 5.0));
    ASSERT_TRUE(ask(Request::Verb::kStart, &plan).accepted);
    ASSERT_TRUE(reach(RunState::kFaulted, 10.0));
    ASSERT_TRUE(ask(Request::Verb::kAbort).accepted);
    run_for(1.0);
    if (virtual_rig->core().state() == RunState::kFaulted) {
      ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
    }
    run_for(2.0);
    ASSERT_GT(position_mm(), config.limits.travel_max_mm);
  }
};

TEST_F(SetupTest, AJogIsSlowAndEndsWhereItWasTold) {
  enter();
  ASSERT_TRUE(jog(2.0, false).accepted);
  expect_refused(jog(1.0, false), "a jog is under way");
  EXPECT_LT(fastest(10.0), 1.1);
  EXPECT_NEAR(position_mm(), 2.0, 0.02);
  ASSERT_NE(event("jog.done"), nullptr);
  run_for(0.5);
  ASSERT_TRUE(jog(-0.5, true, 0.2).accepted);
  EXPECT_LT(fastest(10.0), 0.25);
  EXPECT_NEAR(position_mm(), 1.5, 0.02);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
  EXPECT_LT(virtual_rig->core().status().control.pressure_psi, 0.3F);
}

TEST_F(SetupTest, TheStatusHasTheTargetOfTheJogAndItsVelocityWhileItMoves) {
  start(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 3, velocity_mm_s = 1 },
  { do = "hold", duration_s = 1 },)");
  ASSERT_TRUE(run_until(10.0, [&] { return virtual_rig->core().status().control.velocity_mm_s != 0.0F; }));
  EXPECT_EQ(virtual_rig->core().status().control.velocity_mm_s, 1.0F);
  EXPECT_EQ(virtual_rig->core().status().control.target_mm, 3.0F);
  ASSERT_TRUE(run_until(10.0, [&] { return virtual_rig->core().status().control.velocity_mm_s == 0.0F; }));
  EXPECT_NEAR(position_mm(), 3.0, 0.02) << "the hold, at rest";
  EXPECT_EQ(virtual_rig->core().status().control.target_mm, 3.0F);
  ASSERT_TRUE(run_until(10.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  enter();
  ASSERT_TRUE(jog(2.0, false, 0.5).accepted);
  run_for(0.5);
  EXPECT_EQ(virtual_rig->core().status().control.target_mm, 2.0F);
  EXPECT_EQ(virtual_rig->core().status().control.velocity_mm_s, -0.5F);
  run_for(5.0);
  EXPECT_EQ(virtual_rig->core().status().control.target_mm, 2.0F);
  EXPECT_EQ(virtual_rig->core().status().control.velocity_mm_s, 0.0F);
}

/// What held a run that was aborted is no cause of what happens in a setup afterwards.
TEST_F(SetupTest, BeginsWithoutTheFaultsOfARunBefore) {
  start(kHold);
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.pressure_psi > 9.9F; }));
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  ASSERT_TRUE(ask(Request::Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 20.0));
  EXPECT_STREQ(virtual_rig->core().status().faults[0].code, "loop.late") << "until somebody goes on, the last is told";
  ASSERT_EQ(virtual_rig->core().status().fault_count, 1U);
  enter();
  ASSERT_TRUE(ask(Request::Verb::kLeaveSetup).accepted);
  virtual_rig->rig().interlock().estop_closed = false;
  ASSERT_TRUE(reach(RunState::kFaulted, 0.5));
  run_for(0.05);
  const auto s = virtual_rig->core().status();
  ASSERT_GE(s.fault_count, 1U);
  EXPECT_STREQ(s.faults[0].code, "interlock.estop");
  EXPECT_EQ(std::string(s.fault).substr(0, 15), "interlock.estop") << s.fault;
}

TEST_F(SetupTest, OnlyInSetupOnlySlowlyOnlyInsideTheLimits) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  expect_refused(jog(1.0, false), "in setup only");
  enter();
  expect_refused(jog(1.0, false, 1.5), "faster than");
  expect_refused(jog(6.0, false), "outside the travel limits");
  expect_refused(jog(-6.0, false), "outside the travel limits");
  expect_refused(jog(std::nan(""), false), "numbers");
  expect_refused(jog(0.0, true), "there already");
  expect_refused(ask(Request::Verb::kStart, &plan), "");
  EXPECT_NEAR(position_mm(), 0.0, 0.01);
  ASSERT_TRUE(ask(Request::Verb::kLeaveSetup).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  expect_refused(ask(Request::Verb::kLeaveSetup), "not in setup");
}

TEST_F(SetupTest, ACommandMovesForItsLongestTimeAtMost) {
  enter();
  ASSERT_TRUE(jog(4.9, false, 0.5).accepted);
  (void)fastest(8.0);
  ASSERT_NE(event("jog.time"), nullptr);
  run_for(0.5);
  EXPECT_NEAR(position_mm(), 2.5, 0.1);
  ASSERT_TRUE(jog(4.9, false, 0.5).accepted);
  run_for(1.0);
  ASSERT_TRUE(ask(Request::Verb::kPause).accepted);
  run_for(0.5);
  const double stopped_mm = position_mm();
  run_for(1.0);
  EXPECT_NEAR(position_mm(), stopped_mm, 0.005);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
}

TEST_F(SetupTest, AJogEndsAtItsForce) {
  config.core.operating.jog_force_max_N = 0.5;
  config.core.operating.jog_time_max_s = 60.0;
  rebuild();
  enter();
  for (int i = 0; i < 3 && event("jog.force") == nullptr; ++i) {
    const auto reply = jog(4.9, false);
    ASSERT_TRUE(reply.accepted) << reply.text;
    (void)fastest(10.0);
    run_for(0.5);
  }
  ASSERT_NE(event("jog.force"), nullptr);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
  const double here_mm = position_mm();
  if (virtual_rig->core().status().control.force_N > 0.5F) expect_refused(jog(4.9, false), "takes it back");
  ASSERT_TRUE(jog(here_mm - 0.1, false).accepted);
  (void)fastest(5.0);
  EXPECT_NEAR(position_mm(), here_mm - 0.1, 0.02);
}

TEST_F(SetupTest, ATripEndsSetup) {
  enter();
  ASSERT_TRUE(jog(4.0, false).accepted);
  run_for(1.0);
  virtual_rig->rig().interlock().guard_closed = false;
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  run_for(0.5);
  const double stopped_mm = position_mm();
  EXPECT_LT(stopped_mm, 1.5);
  run_for(2.0);
  EXPECT_NEAR(position_mm(), stopped_mm, 0.005);
  virtual_rig->rig().interlock().guard_closed = true;
  run_for(0.5);
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  EXPECT_TRUE(reach(RunState::kReady, 5.0));  // no limit is passed: not to setup
}

/// Between runs the pressure guard trips nothing; what it doubted then is no cause in setup.
TEST_F(SetupTest, ADoubtOfTheGuardFromBeforeTripsNothing) {
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  run_for(1.0);
  virtual_rig->rig().pressure().faults.drift_psi_s = 1.0;  // above vented air a reading that rises is doubted
  run_for(0.4);
  virtual_rig->rig().pressure().faults.drift_psi_s = 0.0;
  run_for(3.0);
  enter();
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup) << virtual_rig->core().status().fault;
}

TEST_F(SetupTest, WithTheGuardOpenHalfTheSpeedWhereTheRigAllowsIt) {
  config.core.operating.jog_with_guard_open = config.core.supervisor.guard_open_in_setup = true;
  rebuild();
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  virtual_rig->rig().interlock().guard_closed = false;
  ASSERT_TRUE(reach(RunState::kIdle, 0.1));
  expect_refused(ask(Request::Verb::kSetup), "its safety chain is open");  // its own chain has the guard in it
  virtual_rig->rig().interlock().guard_stops_frame = false;
  run_for(0.5);
  const auto reply = ask(Request::Verb::kSetup);
  ASSERT_TRUE(reply.accepted) << reply.text;
  run_for(0.5);
  expect_refused(jog(1.0, false, 0.8), "the guard is open");
  ASSERT_TRUE(jog(1.0, false).accepted);
  EXPECT_LT(fastest(5.0), 0.55);
  EXPECT_NEAR(position_mm(), 1.0, 0.02);
  // Opened in a fast jog: it ends.
  virtual_rig->rig().interlock().guard_closed = true;
  run_for(0.5);
  ASSERT_TRUE(jog(4.0, false).accepted);
  run_for(0.5);
  virtual_rig->rig().interlock().guard_closed = false;
  ASSERT_TRUE(run_until(0.2, [&] {
    drain();
    return event("jog.guard") != nullptr;
  }));
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
  // An emergency stop is no guard.
  virtual_rig->rig().interlock().estop_closed = false;
  EXPECT_TRUE(reach(RunState::kFaulted, 0.1));
}

TEST_F(SetupTest, SetupEndsWhenNothingIsDone) {
  config.core.operating.setup_max_s = 10.0;
  rebuild();
  enter();
  run_for(8.0);
  ASSERT_TRUE(jog(1.0, false).accepted);
  run_for(9.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  EXPECT_NE(event("setup.expired"), nullptr);
}

TEST_F(SetupTest, OffALimitOnlyAwayFromIt) {
  drive_beyond();
  enter();
  const double beyond_mm = position_mm();
  expect_refused(jog(0.5, true), "only a motion back");
  expect_refused(jog(beyond_mm + 0.001, false), "only a motion back");
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
  ASSERT_TRUE(jog(-0.02, true).accepted);  // still outside, and the right way
  run_for(2.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kSetup);
  ASSERT_TRUE(jog(4.0, false).accepted);
  (void)fastest(5.0);
  EXPECT_NEAR(position_mm(), 4.0, 0.02);
  run_for(0.5);
  // Inside, the limit is what it was.
  expect_refused(jog(5.2, false), "outside the travel limits");
  ASSERT_TRUE(ask(Request::Verb::kLeaveSetup).accepted);
  EXPECT_TRUE(reach(RunState::kReady, 5.0));
}

TEST_F(SetupTest, AtALimitTheCrossheadStandsAndCanLeaveIt) {
  config.core.operating.jog_time_max_s = 60.0;
  config.core.operating.jog_speed_max_mm_s = 5.0;
  config.core.operating.jog_force_max_N = 100.0;
  rebuild();
  for (const double limit_mm : {config.limits.travel_max_mm, config.limits.travel_min_mm}) {
    enter();
    expect_refused(jog(limit_mm, false, 5.0), "too close to a travel limit");
    ASSERT_TRUE(jog(limit_mm, false, 1.0).accepted);
    (void)fastest(15.0);
    run_for(10.0);
    ASSERT_EQ(virtual_rig->core().state(), RunState::kSetup) << virtual_rig->core().status().fault;
    EXPECT_NEAR(position_mm(), limit_mm, 0.01);
    // Out and in again: each begins with a fresh look at where it stands.
    ASSERT_TRUE(ask(Request::Verb::kLeaveSetup).accepted);
    enter();
    run_for(5.0);
    expect_refused(jog(1.01 * limit_mm, false, 1.0), "");
    const auto reply = jog(limit_mm > 0 ? -1.0 : 1.0, true, 1.0);
    ASSERT_TRUE(reply.accepted) << reply.text;
    (void)fastest(5.0);
    EXPECT_LT(std::abs(position_mm()), std::abs(limit_mm) - 0.9);
    run_for(0.5);
    ASSERT_TRUE(ask(Request::Verb::kLeaveSetup).accepted);
  }
}

TEST_F(SetupTest, ARunToALimitIsCarriedOutAndCanBeLeft) {
  start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 5, velocity_mm_s = 2 },
  { do = "hold", duration_s = 5 },)");
  ASSERT_TRUE(reach(RunState::kStopping, 40.0)) << virtual_rig->core().status().fault;
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kDone);
  ASSERT_TRUE(reach(RunState::kReady, 10.0));
  enter();
  ASSERT_TRUE(jog(-1.0, true).accepted);
  (void)fastest(5.0);
  EXPECT_NEAR(position_mm(), 4.0, 0.02);
}

TEST_F(SetupTest, AResetBeyondALimitLeadsToSetup) {
  drive_beyond();
  enter();
  virtual_rig->rig().interlock().estop_closed = false;
  ASSERT_TRUE(reach(RunState::kFaulted, 0.1));
  virtual_rig->rig().interlock().estop_closed = true;
  run_for(1.0);
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_TRUE(reach(RunState::kSetup, 5.0));
  run_for(0.5);
  expect_refused(jog(0.5, true), "only a motion back");
  ASSERT_TRUE(jog(-1.0, true).accepted);
  (void)fastest(5.0);
  EXPECT_LT(position_mm(), config.limits.travel_max_mm);
}

}  // namespace
}  // namespace isorig::daemon::test
