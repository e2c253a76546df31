#include "protocol/cursor.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>

#include "plant.hpp"
#include "protocol/compile.hpp"
#include "tree.hpp"

namespace isorig::protocol {
namespace {

using test::Plant;
constexpr std::int64_t kTick_ns = 1'000'000;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

Plan plan_of(const std::string& steps, const std::string& head = "") {
  const std::string text = "format = \"isorig-protocol/1\"\nname = \"test\"\n" + head + "steps = [\n" + steps + "]\n";
  return compile(base::TomlDocument::parse_text(text, "test.toml"));
}

constexpr const char* kPressurize =
    "{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.5, timeout_s = 10 },\n";

std::string shipped(const std::string& name) {
  return isorig::test::source_path() + "/config/protocols/" + name + ".toml";
}

/// Everything that happened, by tick.
struct Trace {
  std::vector<std::uint32_t> began, ended;
  std::vector<std::int64_t> began_ns;
  std::vector<bool> session_ended;
  std::int64_t full_ns = 0;
};

/// Runs until the cursor is done, or `until` says so.
template <typename Until>
Trace run(Cursor& cursor, Plant& plant, Until until, std::int64_t tick_ns = kTick_ns) {
  Trace trace;
  const std::int64_t give_up_ns = plant.now_ns + 48 * 3600 * kSecond_ns;
  while (plant.now_ns < give_up_ns) {
    const Action& action = cursor.advance(plant.now_ns, plant.see());
    if (action.step_began) {
      trace.began.push_back(action.step);
      trace.began_ns.push_back(plant.now_ns);
    }
    if (action.step_ended) trace.ended.push_back(action.ended_step);
    if (action.step_ended && action.session_ended) trace.session_ended.push_back(true);
    if (action.keep == Keep::kFull) trace.full_ns += tick_ns;
    if (action.state == CursorState::kFinished || action.state == CursorState::kFailed) return trace;
    const bool stop = until(action);
    plant.step(action);  // also the last action is carried out
    if (stop) return trace;
  }
  ADD_FAILURE() << "never ends";
  return trace;
}
Trace run(Cursor& cursor, Plant& plant, std::int64_t tick_ns = kTick_ns) {
  return run(
      cursor, plant, [](const Action&) { return false; }, tick_ns);
}

std::vector<std::uint32_t> all_steps(const Plan& plan, std::uint32_t from = 0) {
  std::vector<std::uint32_t> out;
  for (auto i = from; i < plan.steps.size(); ++i) out.push_back(i);
  return out;
}

TEST(Cursor, WalksAWholeProtocolInOrderAndOnTime) {
  const Plan plan = compile_file(shipped("vma-short"));
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  const auto begin_ns = plant.now_ns;
  cursor.start(plant.now_ns);
  const Trace trace = run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  EXPECT_EQ(trace.began, all_steps(plan));
  EXPECT_EQ(trace.ended, all_steps(plan));
  EXPECT_EQ(trace.session_ended.size(), plan.sessions.size());
  EXPECT_NEAR(plant.travel_mm, plan.travel_mm, 1e-6);
  EXPECT_NEAR(plant.position_mm, 0.0, 1e-9);
  const double took_s = static_cast<double>(plant.now_ns - begin_ns) * 1e-9;
  EXPECT_LT(took_s, plan.worst_s + 1.0);
  for (std::size_t i = 0; i < plan.steps.size(); ++i) {
    // Every step whose length is known lasts that long, give or take the ticks in which it is seen to be
    // over.
    const Step& step = plan.steps[i];
    if (step.kind == StepKind::kSettle || step.kind == StepKind::kPressurize || i + 1 == plan.steps.size()) continue;
    const double lasted_s = static_cast<double>(trace.began_ns[i + 1] - trace.began_ns[i]) * 1e-9;
    const double ticks = step.kind == StepKind::kWave ? 2.0 * (2.0 * step.cycles + 1.0) : 2.0;
    EXPECT_NEAR(lasted_s, step.nominal_s, ticks * 0.001 + 1e-9) << describe(step);
  }
}

TEST(Cursor, RunsOneSessionOfThePapersProtocol) {
  const Plan plan = compile_file(shipped("vma-isovelocity"));
  constexpr std::int64_t kSlowTick_ns = 10'000'000;
  Cursor cursor(plan);
  Plant plant(kSlowTick_ns);
  cursor.start(plant.now_ns);
  const auto begin_ns = plant.now_ns;
  const Trace trace = run(
      cursor, plant, [](const Action& action) { return action.session_ended; }, kSlowTick_ns);
  EXPECT_EQ(trace.ended.back(), plan.sessions[0].last_step);
  const double took_s = static_cast<double>(plant.now_ns - begin_ns) * 1e-9;
  // 3202.3 s of motion and holds, 10 s to pressurize, and settles as short as this plant allows (window + 5
  // s).
  EXPECT_GT(took_s, 3202.3 + 10.0 + 2 * 25.0);
  EXPECT_LT(took_s, 3202.3 + 12.0 + 2 * 60.0);
  // Full rate: 10 ramps with 5 s after each; what is before them comes out of the recorder's memory.
  EXPECT_NEAR(static_cast<double>(trace.full_ns) * 1e-9, 10 * 5.0 + 2.28, 0.6);
}

TEST(Cursor, IsDeterministic) {
  const Plan plan = compile_file(shipped("vma-smoke"));
  std::vector<std::int64_t> first;
  for (int turn = 0; turn < 2; ++turn) {
    Cursor cursor(plan);
    Plant plant(kTick_ns);
    cursor.start(plant.now_ns);
    const auto began_ns = run(cursor, plant).began_ns;
    if (turn == 0) first = began_ns;
    EXPECT_EQ(began_ns, first);
  }
}

TEST(Cursor, KeepsFullRateFromARampToSomeTimeAfter) {
  const Plan plan = plan_of(std::string(kPressurize) +
                                "{ do = \"hold\", duration_s = 10 },\n"
                                "{ do = \"ramp\", to_mm = 1, velocity_mm_s = 1 },\n"
                                "{ do = \"hold\", duration_s = 10 },\n",
                            "recording.before_s = 3\nrecording.after_s = 4\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  std::vector<std::pair<double, Keep>> changes;
  std::int64_t hold_ns = 0;
  Keep keep = Keep::kAveraged;
  run(cursor, plant, [&](const Action& action) {
    if (action.step_began && action.step == 1) hold_ns = plant.now_ns;
    if (action.keep != keep) {
      keep = action.keep;
      changes.emplace_back(static_cast<double>(plant.now_ns - hold_ns) * 1e-9, keep);
    }
    return false;
  });
  ASSERT_EQ(changes.size(), 2U);
  EXPECT_NEAR(changes[0].first, 10.0, 0.0015);
  EXPECT_EQ(changes[0].second, Keep::kFull);
  EXPECT_NEAR(changes[1].first, 10.0 + 1.0 + 4.0, 0.004);
  EXPECT_EQ(changes[1].second, Keep::kAveraged);
}

TEST(Cursor, ApproachesTheFirstPositionBeforeItPressurizes) {
  const Plan plan = plan_of(kPressurize, "approach_velocity_mm_s = 0.5\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  plant.position_mm = 3.0;
  cursor.start(plant.now_ns, 0, 41);
  const auto begin_ns = plant.now_ns;
  const Trace approach = run(cursor, plant, [&](const Action& action) {
    // The way of 3 mm at 0.5 mm/s comes before the plan's own time; known to 5 % of what has passed of it.
    const double passed_s = static_cast<double>(plant.now_ns - begin_ns) * 1e-9;
    if (action.approaching) {
      EXPECT_NEAR(cursor.progress(plant.now_ns).remaining_s, plan.nominal_s + 6.0 - passed_s, 0.01 + 0.05 * passed_s);
    }
    return action.step_began;
  });
  EXPECT_NEAR(static_cast<double>(plant.now_ns - begin_ns) * 1e-9, 6.0, 0.01);
  EXPECT_NEAR(cursor.progress(plant.now_ns).remaining_s, plan.nominal_s, 0.01);
  EXPECT_LE(plant.pressure_psi, 0.005);  // one tick of the pressurize that begins now
  ASSERT_EQ(plant.sent.size(), 1U);
  EXPECT_EQ(plant.sent[0].id, 41);
  EXPECT_EQ(plant.sent[0].target_mm, 0.0);
  EXPECT_EQ(plant.sent[0].velocity_mm_s, 0.5);
  EXPECT_FALSE(cursor.action().approaching);
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
}

TEST(Cursor, StartsAtALaterSession) {
  const Plan plan = compile_file(shipped("vma-short"));
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  plant.position_mm = -1.3;  // where the power cut left it
  cursor.start(plant.now_ns, 1);
  const Trace trace = run(cursor, plant);
  EXPECT_EQ(trace.began, all_steps(plan, plan.sessions[1].first_step));
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  Cursor past_the_end(plan);
  past_the_end.start(plant.now_ns, 2);
  EXPECT_EQ(past_the_end.advance(plant.now_ns, plant.see()).state, CursorState::kFinished);
}

TEST(Cursor, PauseFreezesAHold) {
  const Plan plan = plan_of(std::string(kPressurize) + "{ do = \"hold\", duration_s = 10 },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  run(cursor, plant, [](const Action& action) { return action.step_began && action.step == 1; });
  const auto hold_ns = plant.now_ns;
  run(cursor, plant, [&](const Action&) { return plant.now_ns >= hold_ns + 4 * kSecond_ns; });
  cursor.pause(plant.now_ns);
  const double left_s = cursor.progress(plant.now_ns).remaining_s;
  EXPECT_NEAR(left_s, 6.0, 0.003);
  for (int i = 0; i < 100'000; ++i) plant.step(cursor.advance(plant.now_ns, plant.see()));
  EXPECT_EQ(cursor.action().state, CursorState::kPaused);
  EXPECT_EQ(cursor.action().setpoint_psi, 5.0);  // program stop: frame holds, pressure holds
  EXPECT_EQ(cursor.progress(plant.now_ns).remaining_s, left_s);
  cursor.resume(plant.now_ns);
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  EXPECT_NEAR(static_cast<double>(plant.now_ns - hold_ns) * 1e-9, 110.0, 0.003);
}

TEST(Cursor, ResumeCommandsAnInterruptedRampAgain) {
  const Plan plan = plan_of(std::string(kPressurize) + "{ do = \"ramp\", to_mm = 2, velocity_mm_s = 0.1 },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  run(cursor, plant, [&](const Action&) { return plant.position_mm >= 1.0; });
  cursor.pause(plant.now_ns);
  plant.frame_stopped = true;
  for (int i = 0; i < 60'000; ++i) plant.step(cursor.advance(plant.now_ns, plant.see()));
  EXPECT_NEAR(plant.position_mm, 1.0, 1e-3);
  ASSERT_EQ(plant.sent.size(), 1U);
  cursor.resume(plant.now_ns);
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  ASSERT_EQ(plant.sent.size(), 2U);
  EXPECT_EQ(plant.sent[1].target_mm, 2.0);
  EXPECT_EQ(plant.sent[1].velocity_mm_s, 0.1);
  EXPECT_NE(plant.sent[1].id, plant.sent[0].id);
  EXPECT_NEAR(plant.position_mm, 2.0, 1e-9);
}

/// Sealed valves do not make up for a leak.
class Leaked : public ::testing::Test {
 protected:
  void leak_in(const std::string& step, double psi) {
    plan_ = plan_of(std::string(kPressurize) + step);
    cursor_.emplace(plan_);
    cursor_->start(plant_.now_ns);
    run(*cursor_, plant_, [&](const Action& action) { return action.step == 1; });
    run(*cursor_, plant_,
        [&, begin_ns = plant_.now_ns](const Action&) { return plant_.now_ns >= begin_ns + kSecond_ns; });
    cursor_->pause(plant_.now_ns);
    plant_.frame_stopped = true;
    plant_.supply_empty = true;
    for (int i = 0; i < 60'000; ++i) plant_.step(cursor_->advance(plant_.now_ns, plant_.see()));
    plant_.pressure_psi -= psi;
    plant_.supply_empty = false;
    cursor_->resume(plant_.now_ns);
  }
  Plan plan_;
  std::optional<Cursor> cursor_;
  Plant plant_{kTick_ns};
};

TEST_F(Leaked, ARampWaitsForItsPressure) {
  leak_in("{ do = \"ramp\", to_mm = 2, velocity_mm_s = 0.1 },\n", 2.0);
  const double stopped_mm = plant_.position_mm;
  const auto resumed_ns = plant_.now_ns;
  run(*cursor_, plant_, [](const Action& action) { return action.start_segment; });
  // 2 psi at 5 psi/s, less the last 0.1 psi, which are within the tolerance, and settled for 0.5 s.
  EXPECT_NEAR(static_cast<double>(plant_.now_ns - resumed_ns) * 1e-9, 1.9 / 5.0 + 0.5, 0.005);
  EXPECT_NEAR(plant_.position_mm, stopped_mm, 1e-3);
  EXPECT_EQ(plant_.pressure_psi, 5.0);
  run(*cursor_, plant_);
  EXPECT_EQ(cursor_->action().state, CursorState::kFinished);
}

TEST_F(Leaked, AHoldHasItsWholeTimeAtPressure) {
  leak_in("{ do = \"hold\", duration_s = 10 },\n", 2.0);
  EXPECT_TRUE(cursor_->action().regaining);
  const auto resumed_ns = plant_.now_ns;
  // Paused once more before the pressure is back: nothing of the hold has passed.
  run(*cursor_, plant_, [&](const Action&) { return plant_.now_ns >= resumed_ns + kSecond_ns / 5; });
  cursor_->pause(plant_.now_ns);
  for (int i = 0; i < 5'000; ++i) plant_.step(cursor_->advance(plant_.now_ns, plant_.see()));
  EXPECT_NEAR(cursor_->progress(plant_.now_ns).step_elapsed_s, 1.0, 0.003);
  cursor_->resume(plant_.now_ns);
  const auto again_ns = plant_.now_ns;
  run(*cursor_, plant_);
  EXPECT_EQ(cursor_->action().state, CursorState::kFinished);
  EXPECT_NEAR(static_cast<double>(plant_.now_ns - again_ns) * 1e-9, 9.0, 0.01);
}

TEST_F(Leaked, APressureThatDoesNotComeBackIsATimeOut) {
  leak_in("{ do = \"hold\", duration_s = 10 },\n", 2.0);
  plant_.supply_empty = true;
  const auto resumed_ns = plant_.now_ns;
  run(*cursor_, plant_);
  EXPECT_EQ(cursor_->action().state, CursorState::kFailed);
  EXPECT_EQ(cursor_->action().failure, Failure::kPressurizeTimeout);
  EXPECT_NEAR(static_cast<double>(plant_.now_ns - resumed_ns) * 1e-9, 10.0, 0.005);
}

TEST(Cursor, LeavesTheCrossheadWhereItIs) {
  const Plan plan = plan_of(std::string(kPressurize) + "{ do = \"hold\", duration_s = 1 },\n", "approach = false\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  plant.position_mm = 3.0;
  cursor.start(plant.now_ns);
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  EXPECT_TRUE(plant.sent.empty());
  EXPECT_EQ(plant.position_mm, 3.0);
}

TEST(Cursor, ResumeGoesOnWithAWave) {
  const Plan plan = plan_of(std::string(kPressurize) +
                            "{ do = \"wave\", shape = \"sine\", amplitude_mm = 2, frequency_hz = 0.1, cycles = 2 },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  run(cursor, plant, [&](const Action& action) { return action.step == 1 && plant.position_mm <= -0.5; });
  const auto before = plant.sent.back();
  cursor.pause(plant.now_ns);
  plant.frame_stopped = true;
  for (int i = 0; i < 30'000; ++i) plant.step(cursor.advance(plant.now_ns, plant.see()));
  cursor.resume(plant.now_ns);
  const auto& again = cursor.advance(plant.now_ns, plant.see());
  EXPECT_TRUE(again.start_segment);
  EXPECT_EQ(again.segment.target_mm, before.target_mm);
  EXPECT_EQ(again.segment.velocity_mm_s, before.velocity_mm_s);
  plant.step(again);
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  EXPECT_NEAR(plant.travel_mm, 4 * 2.0 * 2, 1e-6);
}

TEST(Cursor, ResumeGivesAWaveTheTimeForItsWayBack) {
  const Plan plan =
      plan_of(std::string(kPressurize) +
              "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 2, velocity_mm_s = 0.02, cycles = 1 },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  run(cursor, plant, [&](const Action& action) { return action.step == 1 && plant.position_mm >= 1.99; });
  // A frame that ran on beyond its target, found when the stroke's time is nearly over: 100 s, 5 s and a twentieth.
  plant.frame_stuck = true;
  for (int i = 0; i < 9'000; ++i) plant.step(cursor.advance(plant.now_ns, plant.see()));
  ASSERT_EQ(cursor.action().state, CursorState::kRunning);
  cursor.pause(plant.now_ns);
  plant.frame_stuck = false;
  plant.frame_stopped = true;
  plant.position_mm = 2.3;
  for (int i = 0; i < 1'000; ++i) plant.step(cursor.advance(plant.now_ns, plant.see()));
  cursor.resume(plant.now_ns);
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
}

TEST(Cursor, IgnoresTheEndOfAnOlderSegment) {
  const Plan plan = plan_of(std::string(kPressurize) + "{ do = \"ramp\", to_mm = 2, velocity_mm_s = 1 },\n");
  Cursor cursor(plan);
  cursor.start(0, 0, 0xffff);
  Observation seen;
  seen.pressure_psi = 5.0;
  std::int64_t now_ns = 0;
  while (!cursor.advance(now_ns += kTick_ns, seen).start_segment) ASSERT_LT(now_ns, 2 * kSecond_ns);
  EXPECT_EQ(cursor.action().segment.id, 0xffff);
  seen.segment_reached = true;
  seen.segment_id = 0xfffe;
  EXPECT_EQ(cursor.advance(now_ns += kTick_ns, seen).state, CursorState::kRunning);
  seen.segment_id = 0xffff;
  EXPECT_EQ(cursor.advance(now_ns += kTick_ns, seen).state, CursorState::kFinished);
}

TEST(Cursor, SegmentNumbersSkipZero) {
  const Plan plan =
      plan_of(std::string(kPressurize) +
              "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 1, velocity_mm_s = 10, cycles = 2 },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns, 0, 0xfffe);
  run(cursor, plant);
  std::vector<std::uint16_t> ids;
  for (const auto& segment : plant.sent) ids.push_back(segment.id);
  EXPECT_THAT(ids, testing::ElementsAre(0xfffe, 0xffff, 1, 2, 3));
}

TEST(Cursor, FailsWhenThePressureIsNotReached) {
  const Plan plan = plan_of(kPressurize);
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  plant.supply_empty = true;
  cursor.start(plant.now_ns);
  const auto begin_ns = plant.now_ns;
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFailed);
  EXPECT_EQ(cursor.action().failure, Failure::kPressurizeTimeout);
  EXPECT_EQ(cursor.action().failure_value, 0.0);
  EXPECT_EQ(cursor.action().failure_threshold, 5.0);
  EXPECT_EQ(plant.now_ns - begin_ns, 10 * kSecond_ns);
  EXPECT_EQ(cursor.advance(plant.now_ns + kTick_ns, plant.see()).state, CursorState::kFailed);
}

TEST(Cursor, SettledPressureMeansAllTheTime) {
  const Plan plan = plan_of(kPressurize);
  Cursor cursor(plan);
  cursor.start(0);
  Observation seen;
  std::int64_t now_ns = 0;
  // 0.4 s within, one tick outside, again and again: never 0.5 s.
  for (int i = 0; i < 9000; ++i) {
    seen.pressure_psi = i % 400 == 0 ? 5.11 : 5.09;
    ASSERT_EQ(cursor.advance(now_ns += kTick_ns, seen).state, CursorState::kRunning);
  }
  seen.pressure_psi = 5.09;
  for (int i = 0; i < 501; ++i) cursor.advance(now_ns += kTick_ns, seen);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
}

constexpr const char* kRestlessSettle =
    "{ do = \"settle\", force_slope_N_s = 0.01, window_s = 2, settled_for_s = 1, timeout_s = 20, on_timeout "
    "= ";

/// A force that rises by 0.5 N/s for ever.
const Action& run_restless(Cursor& cursor, std::int64_t& now_ns) {
  Observation seen;
  seen.pressure_psi = 5.0;
  seen.new_force = true;
  cursor.start(now_ns);
  while (true) {
    now_ns += kTick_ns;
    seen.force_N = 0.5e-9 * static_cast<double>(now_ns);
    const Action& action = cursor.advance(now_ns, seen);
    if (action.state != CursorState::kRunning || now_ns > 100 * kSecond_ns) return action;
  }
}

TEST(Cursor, SettleThatTimesOutGoesOnAndSaysSo) {
  const Plan plan = plan_of(std::string(kPressurize) + kRestlessSettle + "\"continue\" },\n");
  Cursor cursor(plan);
  std::int64_t now_ns = 0;
  const Action& action = run_restless(cursor, now_ns);
  EXPECT_EQ(action.state, CursorState::kFinished);
  EXPECT_TRUE(action.step_ended);
  EXPECT_TRUE(action.settle_timed_out);
  EXPECT_NEAR(action.end_value, 0.5, 1e-6);
}

TEST(Cursor, SettleThatTimesOutStopsWhenTold) {
  const Plan plan = plan_of(std::string(kPressurize) + kRestlessSettle + "\"stop\" },\n");
  Cursor cursor(plan);
  std::int64_t now_ns = 0;
  const Action& action = run_restless(cursor, now_ns);
  EXPECT_EQ(action.state, CursorState::kFailed);
  EXPECT_EQ(action.failure, Failure::kSettleTimeout);
  EXPECT_NEAR(action.failure_value, 0.5, 1e-6);
  EXPECT_EQ(action.failure_threshold, 0.01);
}

TEST(Cursor, SettleWaitsForTheForceToRelax) {
  const Plan plan = plan_of(std::string(kPressurize) + "{ do = \"ramp\", to_mm = 2, velocity_mm_s = 10 },\n" +
                            kRestlessSettle + "\"stop\" },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  run(cursor, plant, [](const Action& action) { return action.step_began && action.step == 2; });
  const auto begin_ns = plant.now_ns;
  run(cursor, plant);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  // 6 N relax with 2 s: 3 e^(-t/2) N/s is 0.01 at 11.4 s; seen by the middle of a 2 s window; then 1 s of
  // patience.
  EXPECT_NEAR(static_cast<double>(plant.now_ns - begin_ns) * 1e-9, 2 * std::log(3 / 0.01) + 1.0 + 1.0, 0.3);
  EXPECT_LT(cursor.action().end_value, 0.01);
}

TEST(Cursor, FailsWhenTheFrameDoesNotArrive) {
  const Plan plan = plan_of(std::string(kPressurize) + "{ do = \"ramp\", to_mm = 2, velocity_mm_s = 0.1 },\n");
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  plant.frame_stuck = true;
  cursor.start(plant.now_ns);
  run(cursor, plant, [](const Action& action) { return action.start_segment; });
  const auto begin_ns = plant.now_ns;
  run(cursor, plant);
  EXPECT_EQ(cursor.action().failure, Failure::kMotionTimeout);
  EXPECT_EQ(cursor.action().failure_threshold, 2.0);
  EXPECT_NEAR(static_cast<double>(plant.now_ns - begin_ns) * 1e-9, 20.0 * 1.05 + 5.0, 0.002);
}

TEST(Cursor, SineStaysWithinItsStatedDeviation) {
  const Plan plan = plan_of(std::string(kPressurize) +
                            "{ do = \"wave\", shape = \"sine\", amplitude_mm = 2, frequency_hz = 0.1, cycles = 3 },\n");
  const Step& wave = plan.steps[1];
  EXPECT_LE(wave.deviation_mm, 0.02);
  EXPECT_EQ(wave.segments_per_quarter, 6U);  // pi / (4 acos(0.99)) = 5.55
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  run(cursor, plant, [](const Action& action) { return action.step_began && action.step == 1; });
  const auto begin_ns = plant.now_ns;
  double worst_mm = 0.0, highest_mm = 0.0, lowest_mm = 0.0;
  run(cursor, plant, [&](const Action&) {
    const double t_s = static_cast<double>(plant.now_ns - begin_ns) * 1e-9;
    const double sine_mm = 2.0 * std::sin(2 * std::numbers::pi * 0.1 * t_s);
    worst_mm = std::max(worst_mm, std::abs(plant.position_mm - sine_mm));
    highest_mm = std::max(highest_mm, plant.position_mm);
    lowest_mm = std::min(lowest_mm, plant.position_mm);
    return false;
  });
  // A stroke is over one tick after the frame is there: up to 2 ms late per stroke at 1.26 mm/s.
  EXPECT_LT(worst_mm, wave.deviation_mm + 7 * 0.002 * 1.26);
  EXPECT_GT(worst_mm, 0.5 * wave.deviation_mm);
  EXPECT_EQ(highest_mm, 2.0);
  EXPECT_EQ(lowest_mm, -2.0);
  EXPECT_EQ(plant.position_mm, 0.0);
}

TEST(Cursor, ProgressNeverGoesBackAndEndsAtOne) {
  const Plan plan = compile_file(shipped("vma-smoke"));
  Cursor cursor(plan);
  Plant plant(kTick_ns);
  cursor.start(plant.now_ns);
  double fraction = 0.0, remaining_s = plan.nominal_s;
  run(cursor, plant, [&](const Action&) {
    const Progress progress = cursor.progress(plant.now_ns);
    EXPECT_GE(progress.fraction, fraction - 1e-12);
    EXPECT_LE(progress.remaining_s, remaining_s + 1e-9);
    fraction = progress.fraction;
    remaining_s = progress.remaining_s;
    return testing::Test::HasFailure();
  });
  EXPECT_GT(fraction, 0.99);
  EXPECT_EQ(cursor.progress(plant.now_ns).fraction, 1.0);
  EXPECT_EQ(cursor.progress(plant.now_ns).remaining_s, 0.0);
}

}  // namespace
}  // namespace isorig::protocol
