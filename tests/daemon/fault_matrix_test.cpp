#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>

#include "base/text_file.hpp"
#include "daemon/core/trips.hpp"
#include "fault_matrix_expect.hpp"
#include "fault_matrix_judge.hpp"
#include "tree.hpp"

/// Every fault in every kind of step: docs/faults.md, cell by cell, against the plant's truth.
namespace isorig::daemon::test {
namespace {

using Kind = Expected::Kind;

constexpr double kHeldShare = 0.85;

/// What the state is without a fault, after the watch.
RunState undisturbed(const Fault& fault, At at) {
  const bool paused = fault.then == Request::Verb::kPause;
  switch (at) {
    case At::kReady:
    case At::kStopping:
      return RunState::kReady;
    case At::kArmed:
      return paused ? RunState::kReady : RunState::kArmed;
    case At::kCountdown:
      return paused ? RunState::kReady : RunState::kCountdown;
    case At::kSetup:
    case At::kJog:
      return RunState::kSetup;
    case At::kPaused:
    case At::kSealed:
      return RunState::kPaused;
    case At::kHeld:
      return RunState::kFaulted;
    default:
      return paused ? RunState::kPaused : RunState::kRunning;
  }
}

class FaultMatrix : public ::testing::TestWithParam<std::size_t> {
 protected:
  [[nodiscard]] static const Fault& fault() { return faults()[GetParam()]; }

  void play(At at) {
    const auto& e = expected(fault(), at);
    ++counts[e.kind];
    if (e.kind == Kind::kImpossible) return;
    const auto b = bounds(fault(), e);
    MatrixRig rig(at);
    const bool before_motion = fault().of_segment && (at == At::kJog || at == At::kApproach);
    ASSERT_TRUE(rig.bring(before_motion)) << rig.trouble();
    rig.strike(b.rest_psi);
    fault().set(rig, true);
    if (before_motion) {
      ASSERT_TRUE(rig.set_off()) << rig.trouble();
    }
    if (fault().then) {
      rig.run_for(0.02);
      rig.ask(*fault().then);
    }
    if (fault().lasts_s > 0.0) {
      rig.watch(fault().lasts_s);
      fault().set(rig, false);
    }
    rig.watch(b.watch_s);
    const Seen seen = rig.seen();
    judge(at, e, b, rig, seen);
    fault().set(rig, false);
    rig.late_ns = 0;
    ASSERT_TRUE(rig.come_back()) << rig.trouble();
    EXPECT_TRUE(rig.recording_is_intact(e.kind == Kind::kTrips ? seen.cause : std::string(), losses(fault())))
        << rig.trouble();
    EXPECT_TRUE(rig.start_again()) << rig.trouble();
  }

  void judge(At at, const Expected& e, const Bounds& b, MatrixRig& rig, const Seen& seen) {
    std::string all;
    for (const auto& code : seen.faults) all += code + " ";
    switch (e.kind) {
      case Kind::kTrips:
        EXPECT_NE(std::find(e.codes.begin(), e.codes.end(), seen.cause), e.codes.end()) << "found as: " << all;
        EXPECT_LE(seen.trip_s, e.within_s);
        EXPECT_EQ(seen.state, RunState::kFaulted);
        EXPECT_LE(seen.stood_s, b.by_itself ? kStandsByItself_s : seen.trip_s + kStands_s);
        judge_severity(at, b, rig, seen);
        worst_trip_s = std::max(worst_trip_s, seen.trip_s);
        worst_stand_s = std::max(worst_stand_s, seen.stood_s);
        break;
      case Kind::kNotReady:
        EXPECT_EQ(seen.state, RunState::kIdle);
        EXPECT_NE(seen.not_ready.find(e.codes.front()), std::string::npos) << seen.not_ready;
        EXPECT_EQ(all, "");
        break;
      case Kind::kStandsDown:
        EXPECT_TRUE(seen.state == RunState::kReady || seen.state == RunState::kIdle) << to_text(seen.state);
        EXPECT_EQ(all, "");
        break;
      case Kind::kRides:
      case Kind::kUnseen:
        EXPECT_EQ(seen.state, undisturbed(fault(), at));
        EXPECT_EQ(all, "");
        break;
      case Kind::kImpossible:
        break;
    }
    judge_limits(at, rig, seen, b.by_itself ? kStandsByItself_s : kStands_s);
  }

  /// The safe state vents, a program stop holds: which of them docs/states.md has for the codes.
  void judge_severity(At at, const Bounds& b, MatrixRig& rig, const Seen& seen) {
    const auto& where = situation(at);
    const Phase phase = at == At::kStopping                                    ? Phase::kAfter
                        : !where.has_run && at != At::kSetup && at != At::kJog ? Phase::kBetween
                        : seen.moved_at_trip                                   ? Phase::kMoving
                                                                               : Phase::kHolding;
    bool safe = !where.has_run || at == At::kCountdown || at == At::kStopping;  // there is nothing to hold
    for (const auto& code : seen.faults) safe = safe || severity_of(code, phase) == Severity::kSafeState;
    EXPECT_EQ(rig.core().status().vented_fault, safe) << seen.cause;
    if (safe) {
      EXPECT_LE(seen.vented_s, seen.trip_s + b.vents_s);
      worst_vent_s = std::max(worst_vent_s, seen.vented_s);
    } else if (where.has_pressure) {
      EXPECT_GE(rig.plant().truth().pressure_psi, kHeldShare * seen.tripped_psi);
    }
  }

  std::map<Kind, int> counts;
  double worst_trip_s = 0.0, worst_stand_s = 0.0, worst_vent_s = 0.0;
};

TEST_P(FaultMatrix, EveryCellEndsAsThePageSays) {
  for (unsigned i = 0; i < kSituations; ++i) {
    SCOPED_TRACE(std::string(fault().words) + ", in " + situation(static_cast<At>(i)).name);
    play(static_cast<At>(i));
  }
  std::printf("%-22s", fault().name);
  for (const auto& [kind, count] : counts) std::printf(" %d %s,", count, to_text(kind));
  std::printf(" at the latest found after %.2f s, stood after %.2f s, vented after %.2f s\n", worst_trip_s,
              worst_stand_s, worst_vent_s);
}

INSTANTIATE_TEST_SUITE_P(All, FaultMatrix, ::testing::Range(std::size_t{0}, faults().size()),
                         [](const auto& row) { return std::string(faults()[row.param].name); });

TEST(FaultMatrixPage, IsUpToDate) {
  EXPECT_EQ(base::read_text_file(isorig::test::source_path() + "/docs/faults.md"), faults_page())
      << "build/bin/fault_matrix_page > docs/faults.md";
}

}  // namespace
}  // namespace isorig::daemon::test
