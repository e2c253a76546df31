#include <gtest/gtest.h>

#include <string>

#include "fault_matrix_expect.hpp"
#include "fault_matrix_judge.hpp"

/// The end of isorigd in every kind of step: docs/faults.md, against the plant's truth.
namespace isorig::daemon::test {
namespace {

constexpr double kVents_s = 2.5;
constexpr double kVentsAlone_s = 6.0;  // through the vent valve

class FaultMatrixEnds : public ::testing::TestWithParam<unsigned> {
 protected:
  [[nodiscard]] static At at() { return static_cast<At>(GetParam()); }
  /// A run is open, and nobody has ended it.
  [[nodiscard]] static bool can_go_on() { return situation(at()).has_run && at() != At::kStopping; }

  static void judge(const MatrixRig& rig, double stands_s, double vents_s) {
    const Seen seen = rig.seen();
    EXPECT_LE(seen.stood_s, stands_s);
    EXPECT_LE(seen.vented_s, vents_s);
    judge_limits(at(), rig, seen, stands_s);
  }

  /// docs/states.md: idle until the zero is confirmed, then ready. Nothing is latched.
  static void come_up(MatrixRig& rig) {
    rig.start_daemon();
    rig.watch(8.0);
    const Seen seen = rig.seen();
    EXPECT_EQ(seen.state, RunState::kIdle);
    EXPECT_NE(seen.not_ready.find("zero is not confirmed"), std::string::npos) << seen.not_ready;
    EXPECT_EQ(seen.cause, "");
  }

  static void kill_and_come_up(double gone_s, double stands_s, bool dump_stuck = false) {
    MatrixRig rig(at());
    ASSERT_TRUE(rig.bring()) << rig.trouble();
    rig.strike();
    const double kill_s = rig.now_s();
    rig.plant().pneumatics().dump_stuck_shut = dump_stuck;
    rig.kill();
    rig.watch(gone_s);
    rig.plant().pneumatics().dump_stuck_shut = false;
    if (situation(at()).has_run) {
      EXPECT_TRUE(rig.is_left_interrupted(kill_s)) << rig.trouble();
    }
    ASSERT_NO_FATAL_FAILURE(come_up(rig));
    judge(rig, stands_s, dump_stuck ? kVentsAlone_s : kVents_s);
    ASSERT_TRUE(rig.come_back()) << rig.trouble();
    if (can_go_on()) {
      EXPECT_TRUE(rig.go_on()) << rig.trouble();
    }
    EXPECT_TRUE(rig.start_again()) << rig.trouble();
  }
};

// As long as systemd waits, and longer than both watchdogs.
TEST_P(FaultMatrixEnds, AKilledDaemonIsReplacedByTheDevicesAndAnotherGoesOn) {
  kill_and_come_up(3.0, kStandsByItself_s);
}

// What the Teensy's watchdog does by itself.
TEST_P(FaultMatrixEnds, AKilledDaemonsPressureGoesThroughTheVentValveAlone) {
  kill_and_come_up(7.0, kStandsByItself_s, true);
}

// Sooner than either watchdog has noticed: its first poll stops the frame.
TEST_P(FaultMatrixEnds, AnotherDaemonAtOnceStopsAndVentsWhatItFinds) {
  kill_and_come_up(0.1, 0.1 + 0.01 + kStands_s);
}

TEST_P(FaultMatrixEnds, ATerminatedDaemonLeavesTheRigAtRestAndTheRecordingEnded) {
  MatrixRig rig(at());
  ASSERT_TRUE(rig.bring()) << rig.trouble();
  rig.strike();
  ASSERT_TRUE(rig.terminate()) << rig.trouble();
  rig.watch(3.0);
  ASSERT_NO_FATAL_FAILURE(come_up(rig));
  judge(rig, kStands_s, kVents_s);
  ASSERT_TRUE(rig.come_back()) << rig.trouble();
  EXPECT_TRUE(rig.start_again()) << rig.trouble();
}

INSTANTIATE_TEST_SUITE_P(All, FaultMatrixEnds, ::testing::Range(0U, kSituations), [](const auto& cell) {
  std::string name = situation(static_cast<At>(cell.param)).name;
  std::erase(name, ' ');
  return name;
});

}  // namespace
}  // namespace isorig::daemon::test
