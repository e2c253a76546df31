#include "daemon/core/supervisor.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace isorig::daemon::test {
namespace {

constexpr std::int64_t kMs = 1'000'000;

/// A supervisor that sees a rig which is well, a millisecond at a time.
class SupervisorTest : public ::testing::Test {
 protected:
  SupervisorTest() {
    config.limits.travel_min_mm = -5.0;
    config.limits.travel_max_mm = 5.0;
    config.limits.force_min_N = -10.0;
    config.limits.force_max_N = 100.0;
    config.limits.force_rate_max_N_s = 400.0;
    config.limits.pressure_max_psi = 24.0;
    config.regulator_age_max_s = 0.25;
    rebuild();
  }
  void rebuild() {
    supervisor = std::make_unique<Supervisor>(config);
    report = {};
    report.stands = report.stop_confirmed = true;
    force_N = 1.0;
    position_mm = 0.0;
    pressure_psi = 5.0;
    quiet = false;
  }

  /// What was found in the last of `ms` milliseconds.
  TripList run(int ms) {
    TripList found;
    for (int i = 0; i < ms; ++i) {
      now_ns += kMs;
      supervisor->set_state(state, run_open);
      ++count;
      FrameRecord s;
      s.mono_ns = now_ns;
      s.position_mm = position_mm;
      s.raw_position_mm = static_cast<float>(position_mm);
      s.force_N = force_N + (quiet ? 0.0 : 0.01 * std::sin(0.7 * count));
      s.raw_force_N = static_cast<float>(s.force_N);
      if (!no_frame) supervisor->on_frame_sample(s);
      report.mono_ns = now_ns;
      report.position_mm = static_cast<float>(position_mm);
      if (!no_frame) supervisor->on_frame_report(report);
      if (!no_pressure) supervisor->on_pressure_sample(now_ns, pressure_psi, true);
      if (!no_regulator) supervisor->on_regulator(now_ns, regulator_psi, pressure_psi, regulator_faulty);
      chain.mono_ns = now_ns;
      if (!no_chain) supervisor->on_interlock(chain);
      if (extra) extra();
      found = supervisor->check(now_ns);
    }
    return found;
  }
  static Severity severity(const TripList& found, const std::string& code) {
    for (const auto& trip : found) {
      if (code == trip.code) return trip.severity;
    }
    return Severity::kInfo;
  }
  void segment(float target_mm, float velocity_mm_s) {
    ++number;
    const frame::Segment s{static_cast<std::uint16_t>(number), target_mm, velocity_mm_s};
    supervisor->on_segment(s, number, position_mm, now_ns);
    report.taken_segment = number;
    report.state.segment_id = s.id;
    report.state.target_mm = target_mm;
    report.state.velocity_mm_s = velocity_mm_s;
    report.state.motion = frame::Motion::kMoving;
  }

  SupervisorConfig config;
  std::unique_ptr<Supervisor> supervisor;
  RunState state = RunState::kRunning;
  bool run_open = true;
  FrameReport report;
  interlock::State chain{.estop_closed = true, .guard_closed = true};
  std::function<void()> extra;
  double force_N = 1.0, position_mm = 0.0, pressure_psi = 5.0, regulator_psi = 5.0;
  bool no_frame = false, no_pressure = false, no_regulator = false, no_chain = false, regulator_faulty = false,
       quiet = false;
  std::int64_t now_ns = 1'000'000'000;
  std::uint32_t number = 0;
  int count = 0;
};

/// A loop that is away for longer than any stream may be silent. What a stream was silent for before and is behind it
/// counts, to the millisecond; the time in which nobody listened does not, nor does it start the count anew.
TEST_F(SupervisorTest, TimeInWhichTheLoopWasAwayIsNoSilence) {
  const auto be_away = [&](int ms) {
    now_ns += ms * kMs;
    supervisor->set_state(state, run_open);
    supervisor->on_tick_lateness(now_ns, ms * kMs);
    return supervisor->check(now_ns);
  };
  const struct {
    const char* code;
    bool* silent;
    int limit_ms;
  } streams[] = {{"stale.frame", &no_frame, 250},
                 {"stale.pressure", &no_pressure, 250},
                 {"stale.regulator", &no_regulator, 250},
                 {"stale.interlock", &no_chain, 500}};
  for (const auto& [code, silent, limit_ms] : streams) {
    for (const int before_ms : {0, 1, 100, 200}) {
      for (const auto& absences : {std::vector{400}, {3000}, {400, 400}, {260, 600, 300}}) {
        rebuild();
        run(100);
        *silent = true;
        run(before_ms);
        int attended_ms = before_ms;
        for (const int ms : absences) {
          const auto found = be_away(ms);
          EXPECT_EQ(severity(found, "loop.late"), Severity::kProgramStop);
          EXPECT_EQ(severity(found, code), Severity::kInfo) << code << " in an absence of " << ms << " ms";
          EXPECT_EQ(severity(run(1), code), Severity::kInfo);
          ++attended_ms;
        }
        EXPECT_EQ(severity(run(limit_ms - attended_ms), code), Severity::kInfo) << code << ", " << before_ms;
        EXPECT_EQ(severity(run(1), code), Severity::kSafeState) << code << ", " << before_ms;
        EXPECT_EQ(severity(run(1), "loop.late"), Severity::kInfo);
        *silent = false;
        EXPECT_EQ(severity(run(1), code), Severity::kInfo);
      }
    }
  }
}

/// The device's threads lived on: the newest sample is of the middle of the absence.
TEST_F(SupervisorTest, ASampleOfTheTimeInWhichTheLoopWasAwayIsAsOldAsTheLoopLooked) {
  run(100);
  FrameRecord s;
  s.mono_ns = now_ns + 100 * kMs;
  s.force_N = force_N + 0.005;
  no_frame = true;
  now_ns += 400 * kMs;
  supervisor->on_tick_lateness(now_ns, 400 * kMs);
  supervisor->on_frame_sample(s);
  EXPECT_NEAR(supervisor->frame_age_s(now_ns), 0.3, 1e-9) << "what is shown is its age";
  const char* why = "";
  EXPECT_FALSE(supervisor->healthy(now_ns, &why)) << "and so is what starts a run";
  EXPECT_EQ(severity(run(250), "stale.frame"), Severity::kInfo);
  EXPECT_EQ(severity(run(1), "stale.frame"), Severity::kSafeState);
}

/// Likewise a stop: nobody could have seen the crosshead stand.
TEST_F(SupervisorTest, AStopIsWaitedForWhileTheLoopIsThere) {
  run(100);
  segment(1.0F, 1.0F);
  run(100);
  supervisor->on_stop(now_ns, 1);
  report.stop_confirmed = report.stands = false;
  run(200);
  now_ns += 400 * kMs;
  supervisor->on_tick_lateness(now_ns, 400 * kMs);
  EXPECT_EQ(severity(run(99), "frame.stop"), Severity::kInfo);
  EXPECT_EQ(severity(run(2), "frame.stop"), Severity::kSafeState);
}

TEST_F(SupervisorTest, ARigThatIsWellHasNothingWrong) {
  for (const auto s : {RunState::kIdle, RunState::kReady, RunState::kRunning, RunState::kPaused, RunState::kStopping,
                       RunState::kFaulted}) {
    state = s;
    for (int i = 0; i < 3000; ++i) {
      const auto found = run(1);
      ASSERT_EQ(found.begin(), found.end()) << found.begin()->code << " while " << to_text(s);
    }
  }
}

/// What has fallen behind a gap in the samples may have fallen slowly.
TEST_F(SupervisorTest, AForceThatFellWhileNobodyLookedIsNoBrokenSpecimen) {
  for (const int gap_ms : {0, 150, 2000}) {  // a line of 150 ms a sample is slow, and seen
    rebuild();
    state = RunState::kPaused;
    run_open = true;
    force_N = 20.0;
    run(1500);
    no_frame = true;
    run(gap_ms);
    no_frame = false;
    force_N = 0.5;
    auto worst = Severity::kInfo;
    for (int i = 0; i < 25; ++i) worst = std::max(worst, severity(run(1), "specimen.broken"));
    EXPECT_EQ(worst, gap_ms < 1000 ? Severity::kSafeState : Severity::kInfo) << gap_ms << " ms";
  }
}

/// Each cause by itself, in every phase: the severity is that of its rule, and no other cause comes up.
TEST_F(SupervisorTest, EveryCauseHasTheSeverityOfItsRuleInEveryPhase) {
  struct Case {
    const char* code;
    std::function<void()> make;
    int within_ms;
  };
  const std::vector<Case> cases{
      {"limit.travel", [&] { position_mm = 5.1; }, 1},
      {"limit.force", [&] { force_N = 101.0; }, 1},
      {"limit.force_rate", [&] { force_N = 40.0; }, 25},
      {"limit.pressure", [&] { pressure_psi = regulator_psi = 24.5; }, 1},
      {"force.frozen", [&] { quiet = true; }, 1300},
      {"specimen.broken", [&] { force_N = 0.5; }, 25},
      {"frame.fault", [&] { report.state.motion = frame::Motion::kFault; }, 1},
      {"frame.heartbeat", [&] { report.state.fault_bits = frame::kHeartbeatLost; }, 1},
      {"frame.number", [&] { force_N = std::numeric_limits<double>::quiet_NaN(); }, 1},
      {"frame.stop",
       [&] {
         supervisor->on_stop(now_ns, 1);
         report.stop_confirmed = report.stands = false;
         report.state.motion = frame::Motion::kMoving;
       },
       350},
      {"interlock.frame", [&] { report.state.fault_bits = frame::kInterlockOpen; }, 1},
      {"interlock.lost", [&] { chain.lost = true; }, 1},
      {"interlock.estop", [&] { chain.estop_closed = false; }, 1},
      {"interlock.guard", [&] { chain.guard_closed = false; }, 1},
      {"stale.frame", [&] { no_frame = true; }, 300},
      {"stale.pressure", [&] { no_pressure = true; }, 300},
      {"stale.regulator", [&] { no_regulator = true; }, 300},
      {"stale.interlock", [&] { no_chain = true; }, 600},
      {"regulator.fault", [&] { regulator_faulty = true; }, 1},
      {"regulator.disagrees", [&] { regulator_psi = 7.0; }, 1100},
      {"pressure.frozen", [&] { extra = [&] { supervisor->on_pressure_stuck(); }; }, 1},
      {"pressure.watchdog",
       [&] { extra = [&] { supervisor->on_device_vented(true, pressure::VentCause::kHeartbeat); }; }, 1},
      {"loop.late", [&] { extra = [&] { supervisor->on_tick_lateness(now_ns, 300 * kMs); }; }, 1},
  };
  const std::pair<Phase, std::pair<RunState, bool>> phases[] = {
      {Phase::kMoving, {RunState::kRunning, true}},  {Phase::kHolding, {RunState::kRunning, true}},
      {Phase::kHolding, {RunState::kPaused, true}},  {Phase::kHolding, {RunState::kFaulted, true}},
      {Phase::kAfter, {RunState::kStopping, false}}, {Phase::kAfter, {RunState::kFaulted, false}},
      {Phase::kBetween, {RunState::kIdle, false}},   {Phase::kBetween, {RunState::kReady, false}}};
  for (const auto& c : cases) {
    for (const auto& [phase, rig] : phases) {
      const std::string what =
          std::string(c.code) + ", " + to_text(rig.first) + (phase == Phase::kMoving ? ", moving" : "");
      rebuild();
      no_frame = no_pressure = no_regulator = no_chain = regulator_faulty = false;
      chain = {.estop_closed = true, .guard_closed = true};
      regulator_psi = 5.0;
      extra = nullptr;
      if (std::string(c.code) == "specimen.broken") force_N = 20.0;
      if (std::string(c.code) == "limit.travel") position_mm = 4.95;
      if (std::string(c.code) == "limit.force") force_N = 99.0;
      state = rig.first;
      run_open = rig.second;
      run(1500);  // the cell's noise is known
      if (phase == Phase::kMoving) {
        segment(static_cast<float>(position_mm) + 0.2F, 0.001F);
        run(2);
      }
      c.make();
      auto worst = Severity::kInfo;
      for (int i = 0; i < c.within_ms; ++i) {
        const auto found = run(1);
        worst = std::max(worst, severity(found, c.code));
      }
      EXPECT_EQ(worst, severity_of(c.code, phase)) << what;
    }
  }
}

/// The next chord of a wave is commanded while the line is down and taken when it is back: the crosshead has been
/// stopped all the same, and would go on from there.
TEST_F(SupervisorTest, AConnectionStartedAfreshIsFoundWhicheverSegmentItTakes) {
  segment(0.0F, 1.0F);
  ASSERT_EQ(severity(run(5), "frame.stopped"), Severity::kInfo);
  const std::uint32_t taken = report.taken_segment;
  segment(0.0F, 2.0F);
  report.taken_segment = taken;  // waits in the queue
  ASSERT_EQ(severity(run(5), "frame.stopped"), Severity::kInfo);
  report.reconnects = 1;
  report.taken_segment = number;
  EXPECT_EQ(severity(run(1), "frame.stopped"), Severity::kProgramStop);
}

TEST_F(SupervisorTest, ASegmentThatHasArrivedLosesNothingByANewConnection) {
  segment(0.0F, 1.0F);
  (void)run(5);
  report.state.motion = frame::Motion::kReached;
  (void)run(5);
  report.reconnects = 1;
  report.taken_segment = 0;
  EXPECT_EQ(severity(run(100), "frame.stopped"), Severity::kInfo);
}

/// The table once more, by hand: moving, holding, after, between; P program stop, S safe state, W warning.
TEST_F(SupervisorTest, EveryRuleIsTheOneThatTheStatesDocumentNames) {
  const std::map<std::string, std::string> expected{{"limit.travel", "PPP-"},
                                                    {"limit.force", "PSSS"},
                                                    {"limit.force_rate", "PP--"},
                                                    {"limit.pressure", "SSSS"},
                                                    {"force.frozen", "PPP-"},
                                                    {"specimen.broken", "SS--"},
                                                    {"frame.lags", "WW--"},
                                                    {"frame.following", "PP--"},
                                                    {"frame.stopped", "PP--"},
                                                    {"frame.segment", "PP--"},
                                                    {"frame.stop", "SSS-"},
                                                    {"frame.fault", "SSS-"},
                                                    {"frame.heartbeat", "SSS-"},
                                                    {"frame.number", "SSS-"},
                                                    {"frame.reference", "SS--"},
                                                    {"interlock.frame", "SSS-"},
                                                    {"interlock.lost", "SSS-"},
                                                    {"interlock.estop", "SSS-"},
                                                    {"interlock.guard", "SSS-"},
                                                    {"stale.frame", "SSS-"},
                                                    {"stale.pressure", "SSS-"},
                                                    {"stale.regulator", "SSS-"},
                                                    {"stale.interlock", "SSS-"},
                                                    {"regulator.fault", "SSS-"},
                                                    {"regulator.disagrees", "SSS-"},
                                                    {"pressure.unreachable", "SS--"},
                                                    {"pressure.frozen", "SSS-"},
                                                    {"pressure.watchdog", "SSS-"},
                                                    {"vent.stuck", "SSSS"},
                                                    {"held.expired", "SS--"},
                                                    {"loop.late", "PPP-"},
                                                    {"recorder", "PP--"},
                                                    {"protocol", "SS--"},
                                                    {"recorder.overflow", "PP--"},
                                                    {"recorder.stalled", "PP--"},
                                                    {"pressure.no_response", "SSS-"},
                                                    {"pressure.no_vent", "SSS-"},
                                                    {"pressure.falls", "SSS-"},
                                                    {"pressure.rises", "SSS-"},
                                                    {"pressure.hold", "SSS-"},
                                                    {"pressure.fill_time", "SSS-"},
                                                    {"teensy.pressure", "SSS-"},
                                                    {"teensy.fill_time", "SSS-"},
                                                    {"teensy.sensor", "SSS-"},
                                                    {"teensy.stuck", "SSS-"}};
  const auto letter = [](Severity s) { return "-WPS"[static_cast<int>(s)]; };
  std::set<std::string> codes;
  EXPECT_EQ(trip_rules().size(), expected.size());
  for (const auto& rule : trip_rules()) {
    ASSERT_TRUE(expected.contains(rule.code)) << rule.code;
    EXPECT_EQ((std::string{letter(rule.moving), letter(rule.holding), letter(rule.after), letter(rule.between)}),
              expected.at(rule.code))
        << rule.code;
  }
  for (const auto& rule : trip_rules()) {
    EXPECT_TRUE(codes.insert(rule.code).second) << rule.code << " stands twice";
    EXPECT_LE(std::string(rule.code).size(), sizeof(EventRecord::code) - 1);
    EXPECT_GE(rule.holding, rule.between) << rule.code << ": no run is no reason for more";
  }
  EXPECT_EQ(severity_of("no.such", Phase::kBetween), Severity::kSafeState) << "what nobody thought of is the worst";
}

TEST_F(SupervisorTest, BeyondALimitOnlyTheWayBackIsFreeAfterAReset) {
  run(100);
  position_mm = 5.1;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop);
  EXPECT_TRUE(supervisor->binding(5.2));
  EXPECT_FALSE(supervisor->binding(4.0));
  supervisor->rearm(now_ns);
  EXPECT_EQ(severity(run(100), "limit.travel"), Severity::kInfo) << "known";
  EXPECT_TRUE(supervisor->binding(5.2));
  EXPECT_FALSE(supervisor->binding(4.0));
  position_mm = 5.4;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop) << "further out";
  position_mm = 4.9;
  run(1);
  EXPECT_FALSE(supervisor->binding(4.95));
  position_mm = 5.1;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop) << "armed again";
}

TEST_F(SupervisorTest, StandingAtALimitIsNotBeyondIt) {
  for (const double at_mm : {5.0, -5.0}) {
    for (int i = 0; i < 200; ++i) {
      position_mm = at_mm + (i % 2 == 0 ? 0.0002 : -0.0002);
      ASSERT_EQ(severity(run(1), "limit.travel"), Severity::kInfo) << at_mm;
      if (i % 50 == 0) supervisor->rearm(now_ns);
    }
  }
  position_mm = 5.03;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop);
}

TEST_F(SupervisorTest, AResetByASampleThatIsJustInsideDoesNotArmALimitThatIsPassed) {
  run(100);
  position_mm = 5.03;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop);
  position_mm = 4.999;
  run(1);
  supervisor->rearm(now_ns);
  position_mm = 5.03;
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kInfo) << "it stands where it stood";
  }
  EXPECT_TRUE(supervisor->binding(5.1));
  position_mm = 4.97;
  run(1);
  EXPECT_FALSE(supervisor->binding(4.99)) << "inside the limits nothing keeps it from moving";
  position_mm = 5.25;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop) << "further out";
  position_mm = 4.9;
  run(1);
  supervisor->rearm(now_ns);
  position_mm = 5.03;
  EXPECT_EQ(severity(run(1), "limit.travel"), Severity::kProgramStop) << "armed again";
}

TEST_F(SupervisorTest, AForceLimitNearZeroIsLeftWhenTheSpecimenIsSlack) {
  config.limits.force_min_N = -0.5;
  rebuild();
  run(100);
  force_N = -0.6;
  EXPECT_NE(severity(run(1), "limit.force"), Severity::kInfo);
  EXPECT_TRUE(supervisor->binding(-1.0));
  force_N = 0.0;
  run(1);
  EXPECT_FALSE(supervisor->binding(-1.0));
}

/// The limits are -10 and 100 N: clear of one is 1.375 N inside, a quarter of 5 % of the range.
TEST_F(SupervisorTest, AForceThatIsOnlyJustInsideSaysSoInNewtons) {
  run(100);
  force_N = 100.5;
  run(1);
  supervisor->rearm(now_ns);
  auto kept = supervisor->binding(1.0);
  ASSERT_TRUE(kept);
  EXPECT_STREQ(kept->code, "limit.force");
  EXPECT_STREQ(kept->why, "the force is beyond a limit: only a motion that takes it back is let through");
  EXPECT_NEAR(kept->value, 100.5, 0.02);
  EXPECT_EQ(kept->threshold, 100.0);
  force_N = 98.7;
  run(1);
  kept = supervisor->binding(1.0);
  ASSERT_TRUE(kept);
  EXPECT_THAT(kept->why, ::testing::HasSubstr("was beyond a limit and is only just inside"));
  EXPECT_NEAR(kept->value, 98.7, 0.02);
  EXPECT_FALSE(supervisor->binding(-1.0)) << "the way back";
  force_N = 98.5;
  run(1);
  EXPECT_FALSE(supervisor->binding(1.0));
}

TEST_F(SupervisorTest, AForceThatGoesOnRisingAfterAProgramStopIsTheSafeState) {
  run(100);
  segment(1.0F, 0.1F);
  run(2);
  force_N = 100.5;
  EXPECT_EQ(severity(run(1), "limit.force"), Severity::kProgramStop);
  state = RunState::kFaulted;
  supervisor->on_stop(now_ns, 1);
  report.state.motion = frame::Motion::kStopped;
  report.stop_request = 1;
  for (int i = 0; i < 50; ++i) {
    force_N = 100.0 + 0.02 * (i % 3 - 1);  // noise about the limit
    EXPECT_EQ(severity(run(1), "limit.force"), Severity::kInfo);
  }
  force_N = 107.0;  // 5 % of the range above
  EXPECT_EQ(severity(run(1), "limit.force"), Severity::kSafeState);
}

TEST_F(SupervisorTest, ASlowRampThatIsNotFollowedIsNoticedByItsSpeed) {
  run(10);
  segment(1.0F, 0.01F);
  int warned_ms = -1, stopped_ms = -1;
  for (int i = 0; i < 60'000 && stopped_ms < 0; ++i) {
    const auto found = run(1);
    if (severity(found, "frame.lags") == Severity::kWarning && warned_ms < 0) warned_ms = i;
    if (severity(found, "frame.following") == Severity::kProgramStop) stopped_ms = i;
  }
  EXPECT_NEAR(warned_ms, 10'000, 500);
  EXPECT_NEAR(stopped_ms, 20'000, 500);
}

TEST_F(SupervisorTest, AQuietLoadCellAtRestIsNotCalledDead) {
  quiet = true;
  force_N = 2.0;
  for (int i = 0; i < 100; ++i) {
    run(100);
    force_N += 0.001;  // a digit now and then
    ASSERT_EQ(severity(run(1), "force.frozen"), Severity::kInfo);
  }
  EXPECT_EQ(severity(run(900), "force.frozen"), Severity::kInfo);
}

TEST_F(SupervisorTest, ASegmentCountsOnlyOnceTheFrameHasTakenIt) {
  run(10);
  report.state.segment_id = 1;
  report.state.motion = frame::Motion::kStopped;  // from an earlier life
  report.state.target_mm = 3.0F;
  ++number;
  supervisor->on_segment({1, 1.0F, 0.5F}, number, 0.0, now_ns);
  const auto found = run(100);
  EXPECT_EQ(found.begin(), found.end()) << found.begin()->code;
  report.refused_segment = number;
  EXPECT_EQ(severity(run(1), "frame.segment"), Severity::kProgramStop) << "at once";
}

/// A contact that opened and was closed for longer than closing_ms before anybody looked.
TEST_F(SupervisorTest, AnOpeningThatIsOverIsFoundOnce) {
  chain.estop_opened_ns = chain.guard_opened_ns = now_ns - kMs;  // before the first reading: no news
  auto found = run(10);
  EXPECT_EQ(found.begin(), found.end());
  chain.estop_opened_ns = now_ns;
  found = run(1);
  EXPECT_EQ(severity(found, "interlock.estop"), Severity::kSafeState);
  EXPECT_EQ(severity(found, "interlock.guard"), Severity::kInfo);
  found = run(1);
  EXPECT_EQ(found.begin(), found.end());
  chain.guard_opened_ns = now_ns;
  found = run(1);
  EXPECT_EQ(severity(found, "interlock.guard"), Severity::kSafeState);
  EXPECT_EQ(severity(found, "interlock.estop"), Severity::kInfo);
}

TEST_F(SupervisorTest, OneTickCanHaveSeveralCauses) {
  run(10);
  chain.estop_closed = false;
  pressure_psi = 25.0;
  const auto found = run(1);
  EXPECT_EQ(severity(found, "interlock.estop"), Severity::kSafeState);
  EXPECT_EQ(severity(found, "limit.pressure"), Severity::kSafeState);
}

}  // namespace
}  // namespace isorig::daemon::test
