#include "witness.hpp"

#include <gtest/gtest.h>

#include "../daemon/rig_fixture.hpp"

/// What judges a soak has to be able to find something.
namespace isorig::soak {
namespace {

/// The rig in a hold at 10 psi, watched by what watches a soak.
class WitnessTest : public daemon::test::RigFixture {
 protected:
  void hold() {
    start(
        "{ do = \"pressurize\", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },\n"
        "{ do = \"hold\", duration_s = 100 }");
    watch(5.0);
    EXPECT_TRUE(witness.take_breaches().empty());
    witness.strike(*virtual_rig);
  }
  void watch(double seconds) {
    for (int i = 0; i < static_cast<int>(seconds * 1000.0); ++i) {
      tick();
      witness.look(*virtual_rig);
    }
  }
  Witness witness{config};
};

TEST_F(WitnessTest, SeesACrossheadThatIsMovedThoughTheDaemonStopsIt) {
  hold();
  auto& panel = virtual_rig->rig().frame();
  panel.start_segment({900, 3.0F, 2.0F});  // at its panel
  panel.faults.runaway = true;
  watch(2.0);
  const auto breaches = witness.take_breaches();
  ASSERT_FALSE(breaches.empty());
  EXPECT_NE(breaches.front().find("off its path"), std::string::npos) << breaches.front();
}

TEST_F(WitnessTest, LetsAProgramStopHoldWhatWasBeingLowered) {
  start(
      "{ do = \"pressurize\", pressure_psi = 15, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },\n"
      "{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },\n"
      "{ do = \"hold\", duration_s = 100 }");
  const auto psi = [&] { return virtual_rig->rig().truth().pressure_psi; };
  for (int i = 0; i < 20'000 && virtual_rig->core().status().control.step == 0; ++i) watch(0.001);
  for (int i = 0; i < 20'000 && psi() > 12.0; ++i) watch(0.001);
  ASSERT_EQ(virtual_rig->core().state(), daemon::RunState::kRunning);
  witness.strike(*virtual_rig);
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);  // a loop that came late
  // The set-point is 5 psi: 3 psi above it is the bound, 20 s later at the latest.
  watch(40.0);
  ASSERT_EQ(virtual_rig->core().state(), daemon::RunState::kFaulted);
  ASSERT_FALSE(virtual_rig->core().status().vented_fault);
  ASSERT_GT(psi(), 8.5);
  EXPECT_TRUE(witness.take_breaches().empty());
  // And no more than that.
  virtual_rig->rig().pressure().faults.tube_blocked = true;
  virtual_rig->rig().pneumatics().fill_stuck_open = true;
  watch(5.0);
  EXPECT_FALSE(witness.take_breaches().empty());
}

TEST_F(WitnessTest, SeesAPressureThatNoSensorShows) {
  hold();
  virtual_rig->rig().pressure().faults.tube_blocked = true;
  virtual_rig->rig().pressure().faults.ignores_commands = true;
  virtual_rig->rig().pneumatics().fill_stuck_open = true;
  virtual_rig->rig().pneumatics().vent_stuck_shut = true;
  virtual_rig->rig().pneumatics().dump_stuck_shut = true;
  watch(5.0);
  const auto breaches = witness.take_breaches();
  ASSERT_FALSE(breaches.empty());
  EXPECT_NE(breaches.front().find("pressure over its set-point"), std::string::npos) << breaches.front();
}

}  // namespace
}  // namespace isorig::soak
