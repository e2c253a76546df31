#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "rig_fixture.hpp"

/// What fails between air and reading, and how far the true pressure gets before the rig is safe. The force limit is
/// out of the way, so that the pressure side has to notice by itself.
namespace isorig::daemon::test {
namespace {

constexpr double kLimitPsi = 24.0;      // of config/rigs/sim.toml
constexpr double kMarginPsi = 1.5;      // the true pressure never exceeds the limit by more
constexpr double kOpenPsi = 4.0;        // what a fill valve that does not close keeps up against vent and dump valve
constexpr double kVentedWithinS = 2.5;  // from the trip to 1 psi, through vent and dump valve

class PressureFaultsTest : public RigFixture {
 protected:
  void SetUp() override {
    config.core.supervisor.limits.force_max_N = 1e6;
    config.core.supervisor.limits.force_min_N = -1e6;
    config.core.supervisor.limits.force_rate_max_N_s = 1e9;
    RigFixture::SetUp();
  }

  struct Seen {
    double trip_s = -1.0, max_psi = 0.0, vented_s = -1.0;
    std::string fault;
  };
  /// From the fault on.
  Seen watch(double seconds, double rest_psi = 1.0) {
    Seen seen;
    const std::int64_t start_ns = virtual_rig->now_ns();
    std::int64_t trip_ns = 0;
    virtual_rig->before_core = [&](VirtualRig& r) {
      const double psi = r.rig().truth().pressure_psi;
      seen.max_psi = std::max(seen.max_psi, psi);
      if (trip_ns == 0 && r.core().state() == RunState::kFaulted) trip_ns = r.now_ns();
      if (trip_ns != 0 && seen.vented_s < 0.0 && psi < rest_psi)
        seen.vented_s = static_cast<double>(r.now_ns() - trip_ns) * 1e-9;
    };
    run_for(seconds);
    virtual_rig->before_core = nullptr;
    if (trip_ns != 0) seen.trip_s = static_cast<double>(trip_ns - start_ns) * 1e-9;
    const std::string fault = virtual_rig->core().status().fault;
    seen.fault = fault.substr(0, fault.find(':'));
    return seen;
  }
  /// Fills to 20 psi at 8 psi/s; returns when the chamber truly holds `psi`.
  void fill_past(double psi) {
    start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },
  { do = "hold", duration_s = 1000 },)");
    ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->rig().truth().pressure_psi > psi; }));
  }
  void hold_at_23() {
    start(R"(  { do = "pressurize", pressure_psi = 23, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },
  { do = "hold", duration_s = 1000 },)");
    ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.step == 1; }));
    run_for(3.0);
  }
  void lower() {
    start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 4, settled_for_s = 0.5, timeout_s = 60 },
  { do = "hold", duration_s = 1000 },)");
    ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.step == 1; }));
  }
};

TEST_F(PressureFaultsTest, EachIsFoundBeforeTheTruePressurePassesItsLimit) {
  struct Row {
    const char* what;
    std::function<void()> prepare;
    std::function<void(sim::Rig&)> fail;
    double within_s;
    std::vector<std::string> codes;
    double rest_psi = 1.0;
  };
  using R = sim::Rig;
  const auto filling = [this] { fill_past(10.0); };
  const auto holding = [this] { hold_at_23(); };
  const auto lowering = [this] { lower(); };
  const auto starting = [this] { fill_past(-1.0); };
  const std::vector<Row> rows = {
      {"filling: tube off the sensor",
       filling,
       [](R& r) { r.pressure().faults.tube_off = true; },
       0.1,
       {"pressure.falls", "pressure.no_response"}},
      {"filling: tube blocked",
       filling,
       [](R& r) { r.pressure().faults.tube_blocked = true; },
       0.5,
       {"pressure.no_response"}},
      {"filling: count stuck",
       filling,
       [](R& r) { r.pressure().faults.stuck_value = true; },
       0.5,
       {"pressure.no_response", "pressure.frozen", "teensy.stuck"}},
      {"filling: tube kinked, 2 s",
       filling,
       [](R& r) { r.pressure().faults.tube_lag_ms = 2000; },
       0.5,
       {"pressure.no_response"}},
      {"filling: 20 % too little at once",
       filling,
       [](R& r) { r.pressure().faults.low_permille = 200; },
       0.1,
       {"pressure.falls", "pressure.no_response"}},
      {"filling: burst hose, 150 mL/s/bar",
       filling,
       [](R& r) { r.pneumatics().burst_mL_s_bar = 150.0; },
       0.5,
       {"pressure.no_response", "pressure.falls"}},
      {"filling: supply gone",
       filling,
       [](R& r) { r.pneumatics().supply_empty = true; },
       3.0,
       {"pressure.no_response"}},
      {"filling: fill valve stuck open",
       filling,
       [](R& r) { r.pneumatics().fill_stuck_open = true; },
       2.0,
       {"pressure.rises", "pressure.no_vent", "limit.pressure"},
       kOpenPsi},
      {"start: valve commands lost",
       starting,
       [](R& r) { r.pressure().faults.ignores_commands = true; },
       1.0,
       {"pressure.no_response", "pressure.falls"}},
      {"start: no air", starting, [](R& r) { r.pneumatics().supply_empty = true; }, 3.0, {"pressure.no_response"}},
      {"hold: tube off the sensor",
       holding,
       [](R& r) { r.pressure().faults.tube_off = true; },
       0.1,
       {"pressure.falls", "pressure.no_response"}},
      // At the very set-point nothing flows, and nothing happens.
      {"hold: tube blocked", holding, [](R& r) { r.pressure().faults.tube_blocked = true; }, 0.0, {}},
      {"hold: blocked 0.02 psi low",
       holding,
       [](R& r) {
         r.pressure().faults.low_permille = 1;
         r.pressure().faults.tube_blocked = true;
       },
       4.0,
       {"pressure.hold", "pressure.no_response"}},
      {"hold: blocked 0.05 psi low",
       holding,
       [](R& r) {
         r.pressure().faults.low_permille = 2;
         r.pressure().faults.tube_blocked = true;
       },
       2.0,
       {"pressure.hold", "pressure.no_response"}},
      {"hold: count stuck",
       holding,
       [](R& r) { r.pressure().faults.stuck_value = true; },
       6.0,
       {"pressure.frozen", "pressure.hold", "pressure.no_response", "teensy.stuck"}},
      {"hold: 20 % too little at once",
       holding,
       [](R& r) { r.pressure().faults.low_permille = 200; },
       0.1,
       {"pressure.falls", "pressure.no_response"}},
      {"hold: burst hose, 150 mL/s/bar",
       holding,
       [](R& r) { r.pneumatics().burst_mL_s_bar = 150.0; },
       0.5,
       {"pressure.no_response", "pressure.falls"}},
      {"hold: fill valve stuck open",
       holding,
       [](R& r) { r.pneumatics().fill_stuck_open = true; },
       0.5,
       {"pressure.rises", "pressure.no_vent", "limit.pressure"},
       kOpenPsi},
      {"hold: supply turned up to 90 psi", holding, [](R& r) { r.pneumatics().supply_psi_now = 90.0; }, 0.0, {}},
      {"lowering: vent valve stuck shut",
       lowering,
       [](R& r) { r.pneumatics().vent_stuck_shut = true; },
       2.0,
       {"pressure.no_vent"}},
      {"lowering: valve commands lost",
       lowering,
       [](R& r) { r.pressure().faults.ignores_commands = true; },
       2.0,
       {"pressure.no_vent", "pressure.rises", "pressure.falls"}},
      {"lowering: tube blocked",
       lowering,
       [](R& r) { r.pressure().faults.tube_blocked = true; },
       2.0,
       {"pressure.no_vent"}},
  };
  std::printf("%-36s %-22s %8s %9s %9s\n", "fault", "found as", "after s", "max psi", "vented s");
  for (const auto& row : rows) {
    SCOPED_TRACE(row.what);
    rebuild();
    row.prepare();
    if (HasFatalFailure()) return;
    row.fail(virtual_rig->rig());
    const Seen seen = watch(60.0, row.rest_psi);
    std::printf("%-36s %-22s %8.2f %9.2f %9.2f\n", row.what, seen.fault.c_str(), seen.trip_s, seen.max_psi,
                seen.vented_s);
    EXPECT_LT(seen.max_psi, kLimitPsi + kMarginPsi);
    if (row.codes.empty()) {
      EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning) << seen.fault;
      continue;
    }
    EXPECT_NE(std::find(row.codes.begin(), row.codes.end(), seen.fault), row.codes.end()) << seen.fault;
    EXPECT_GT(seen.trip_s, 0.0);
    EXPECT_LT(seen.trip_s, row.within_s);
    EXPECT_GE(seen.vented_s, 0.0);
    EXPECT_LT(seen.vented_s, kVentedWithinS);
    EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kFailed);
  }
}

/// The crosshead moves, the tube is shut off at one moment or another of the stroke: the reading then stands a little
/// above or below the set-point, or at it, and nothing but the loop's own doing tells.
TEST_F(PressureFaultsTest, ATubeBlockedInMotionIsFoundOrDoesNothing) {
  // The hold's allowance, 0.6 psi; what 4 mm of stroke may explain, 1 psi; what flows meanwhile as a leak's share.
  constexpr double kAbovePsi = 3.0;
  std::printf("%-10s %-10s %-22s %8s %9s\n", "hold psi", "speed", "found as", "after s", "max psi");
  for (const double pressure_psi : {10.0, 23.0}) {
    for (const double speed_mm_s : {0.0, 0.2, 2.0, 5.0, 10.0}) {
      double worst_psi = 0.0, latest_s = 0.0;
      int found = 0;
      std::string codes;
      for (int moment = 0; moment < 12; ++moment) {
        SCOPED_TRACE(std::to_string(pressure_psi) + " psi, " + std::to_string(speed_mm_s) + " mm/s, moment " +
                     std::to_string(moment));
        rebuild();
        const std::string target = std::to_string(pressure_psi), speed = std::to_string(speed_mm_s);
        start("  { do = \"pressurize\", pressure_psi = " + target +
              ", rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },\n" +
              (speed_mm_s > 0.0 ? "  { do = \"wave\", shape = \"triangle\", amplitude_mm = 2, velocity_mm_s = " +
                                      speed + ", cycles = 1000 },"
                                : std::string("  { do = \"hold\", duration_s = 1000 },")));
        ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.step == 1; }));
        run_for(1.5 + (speed_mm_s > 0.0 ? 8.0 / speed_mm_s : 1.0) * moment / 12.0);
        ASSERT_EQ(virtual_rig->core().state(), RunState::kRunning) << virtual_rig->core().status().fault;
        virtual_rig->rig().pressure().faults.tube_blocked = true;
        const Seen seen = watch(40.0);
        EXPECT_LT(seen.max_psi, std::min(pressure_psi + kAbovePsi, kLimitPsi + kMarginPsi))
            << seen.fault << " after " << seen.trip_s << " s";
        worst_psi = std::max(worst_psi, seen.max_psi);
        latest_s = std::max(latest_s, seen.trip_s);
        if (seen.trip_s >= 0.0) ++found;
        if (codes.find(seen.fault) == std::string::npos) codes += " " + seen.fault;
      }
      std::printf("%8.1f %6.1f mm/s  %2d of 12 %-34s %6.2f s at the latest, at most %6.2f psi\n", pressure_psi,
                  speed_mm_s, found, codes.c_str(), latest_s, worst_psi);
    }
  }
}

TEST_F(PressureFaultsTest, ASensorThatHasAlwaysReadTooLittleIsNotSeen) {
  // docs/states.md says so: what is left is the force limit, the time of the fill valve, a relief valve.
  virtual_rig->rig().pressure().faults.low_permille = 200;
  start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },
  { do = "hold", duration_s = 1000 },)");
  const Seen seen = watch(20.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning) << seen.fault;
  EXPECT_NEAR(seen.max_psi, 25.0, 0.3);
}

/// A sound rig is never doubted: the shipped one, others whose volume is not what the gains say, leaks, speed, noise.
TEST_F(PressureFaultsTest, ASoundRigIsNotDoubted) {
  struct Row {
    const char* what;
    std::function<void(RigConfig&)> change;
  };
  const std::vector<Row> rows = {
      {"as shipped", [](RigConfig&) {}},
      {"a chamber 2.5 times as large", [](RigConfig& c) { c.sim->pneumatics.manifold_volume_mL *= 2.5; }},
      {"a chamber 0.4 times as large", [](RigConfig& c) { c.sim->pneumatics.manifold_volume_mL *= 0.4; }},
      {"ten times the leak", [](RigConfig& c) { c.sim->pneumatics.leak_mL_s_bar *= 10.0; }},
      {"slow valves",
       [](RigConfig& c) {
         c.sim->pneumatics.valve_time_ms = 15.0;
         c.sim->pneumatics.valve_delay_ms = 15.0;
         c.core.pressure_loop.proportional_per_s = 12.0;
       }},
      {"a dead band of 12 %",
       [](RigConfig& c) {
         c.sim->pneumatics.duty_dead_permille = 120.0;
         c.core.pressure_loop.minimum_duty = 0.12;
       }},
      {"a quiet sensor", [](RigConfig& c) { c.sim->pressure.noise_counts = 0.2; }},
      {"a noisy sensor", [](RigConfig& c) { c.sim->pressure.noise_counts = 5.0; }},
      {"feed-forward", [](RigConfig& c) { c.core.pressure_loop.feedforward_psi_per_mm = 0.06; }},
  };
  for (const auto& row : rows) {
    SCOPED_TRACE(row.what);
    config = load_rig(source("config/rigs/sim.toml"));
    config.core.supervisor.limits.force_max_N = 1e6;
    config.core.supervisor.limits.force_min_N = -1e6;
    config.core.supervisor.limits.force_rate_max_N_s = 1e9;
    config.core.pressure_loop.unreachable_after_s = 30.0;  // a large chamber takes its time
    row.change(config);
    rebuild();
    start(
        R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 20, tolerance_psi = 0.3, settled_for_s = 0.5, timeout_s = 30 },
  { do = "hold", duration_s = 20 },
  { do = "ramp", to_mm = 2, velocity_mm_s = 10 },
  { do = "ramp", to_mm = -2, velocity_mm_s = 10 },
  { do = "hold", duration_s = 5 },
  { do = "wave", shape = "triangle", amplitude_mm = 2, velocity_mm_s = 10, cycles = 30 },
  { do = "wave", shape = "sine", amplitude_mm = 2, velocity_mm_s = 5, cycles = 10 },
  { do = "pressurize", pressure_psi = 2, rate_psi_s = 20, tolerance_psi = 0.3, settled_for_s = 0.5, timeout_s = 30 },
  { do = "pressurize", pressure_psi = 12, rate_psi_s = 0.5, tolerance_psi = 0.3, settled_for_s = 0.5, timeout_s = 60 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 10 },
  { do = "pressurize", pressure_psi = 18, rate_psi_s = 20, tolerance_psi = 0.3, settled_for_s = 0.5, timeout_s = 60 },
  { do = "pressurize", pressure_psi = 4, rate_psi_s = 20, tolerance_psi = 0.3, settled_for_s = 0.5, timeout_s = 60 },)");
    EXPECT_TRUE(run_until(200.0, [&] {
      return virtual_rig->core().outcome() != Outcome::kNone || virtual_rig->core().state() == RunState::kFaulted;
    }));
    EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kDone) << virtual_rig->core().status().fault;
    EXPECT_TRUE(reach(RunState::kReady, 30.0))
        << virtual_rig->core().status().fault << virtual_rig->core().status().not_ready;
  }
}

TEST_F(PressureFaultsTest, AProgramStopShutsBothValvesAndResumeTakesTheSetPointUpAgain) {
  hold_at_23();
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);  // a tick that came 0.4 s late
  ASSERT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  run_for(0.1);
  virtual_rig->rig().pneumatics().leak_factor = 20.0;
  for (int i = 0; i < 100; ++i) {
    run_for(0.1);
    ASSERT_EQ(control.fill_permille, 0);
    ASSERT_EQ(control.vent_permille, 0);
  }
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 22.8) << "sealed, it leaks";
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kPaused);
  run_for(1.0);
  EXPECT_EQ(control.fill_permille, 0);
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  run_for(5.0);
  EXPECT_NEAR(virtual_rig->rig().truth().pressure_psi, 23.0, 0.1);
}

/// What the events say of a resumed step that waits for its pressure: that it waits, and that it goes on only if it
/// does.
class RegainTest : public PressureFaultsTest {
 protected:
  void resume_after_a_leak(const char* timeout_s) {
    start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = )" +
          std::string(timeout_s) + R"( },
  { do = "hold", duration_s = 20 },)");
    ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().status().control.step == 1; }));
    virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);  // a tick that came 0.4 s late
    virtual_rig->rig().pneumatics().leak_factor = 20.0;
    run_for(10.0);
    virtual_rig->rig().pneumatics().leak_factor = 1.0;
    ASSERT_LT(virtual_rig->rig().truth().pressure_psi, 19.5);
    ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
    events.clear();
  }
  [[nodiscard]] std::vector<std::string> told() const {
    std::vector<std::string> out;
    for (const auto& e : events)
      if (std::string_view(e.code) == "resume.pressure") out.emplace_back(e.text);
    return out;
  }
};

TEST_F(RegainTest, ItWaitsAndThenGoesOn) {
  resume_after_a_leak("20");
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  ASSERT_TRUE(run_until(40.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  run_for(0.1);
  EXPECT_THAT(told(), ::testing::ElementsAre(::testing::HasSubstr("waits for it"), "the step goes on"));
}

TEST_F(RegainTest, ItDoesNotGoOnWhenThePressureDoesNotComeBack) {
  resume_after_a_leak("6");
  virtual_rig->rig().pneumatics().fill_stuck_shut = true;
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  ASSERT_TRUE(reach(RunState::kFaulted, 20.0));
  run_for(0.1);
  EXPECT_THAT(told(), ::testing::ElementsAre(::testing::HasSubstr("waits for it")));
}

TEST_F(RegainTest, TheNextRunHasNotWaited) {
  resume_after_a_leak("20");
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  run_for(0.05);
  ASSERT_TRUE(ask(Request::Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 20.0));
  EXPECT_EQ(told().size(), 1U);
  events.clear();
  start(R"(  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },)");
  ASSERT_TRUE(run_until(20.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  run_for(0.1);
  EXPECT_THAT(told(), ::testing::IsEmpty());
}

TEST_F(PressureFaultsTest, ASealedPressureIsWatched) {
  hold_at_23();
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
  run_for(0.5);
  ASSERT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  virtual_rig->rig().pneumatics().fill_stuck_open = true;
  const Seen seen = watch(5.0);
  EXPECT_LT(seen.max_psi, kLimitPsi + kMarginPsi);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 2.0)
      << "vented, though the fill valve is open: the dump valve is larger";
}

TEST_F(PressureFaultsTest, AStepsTimeOutVents) {
  start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },
  { do = "settle", force_slope_N_s = 1e-9, window_s = 2, settled_for_s = 2, expected_s = 5, timeout_s = 8, on_timeout = "stop" },)");
  ASSERT_TRUE(reach(RunState::kFaulted, 30.0));
  run_for(5.0);
  EXPECT_NE(event("protocol"), nullptr);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 0.5);
  EXPECT_EQ(control.fill_permille, 0);
}

TEST_F(PressureFaultsTest, TheForceLimitAtRestVents) {
  config.core.supervisor.limits.force_max_N = 40.0;
  rebuild();
  start(R"(  { do = "pressurize", pressure_psi = 20, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 60 },)");
  ASSERT_TRUE(reach(RunState::kFaulted, 10.0));
  EXPECT_NE(std::string(virtual_rig->core().status().fault).find("limit.force"), std::string::npos);
  run_for(3.0);
  EXPECT_LT(virtual_rig->rig().truth().pressure_psi, 1.0) << "nothing moved: it was the pressure";
}

TEST_F(PressureFaultsTest, TheDeviceVentsWhatTheDaemonDoesNotSee) {
  // The daemon believes in 60 psi; the device does not.
  config.core.supervisor.limits.pressure_max_psi = 60.0;
  config.services.fill_limits.pressure_max_psi = 15.0;
  rebuild();
  fill_past(12.0);
  const Seen seen = watch(5.0);
  EXPECT_EQ(seen.fault, "teensy.pressure");
  EXPECT_LT(seen.max_psi, 15.5);
  EXPECT_GE(seen.vented_s, 0.0);
  // Its latch needs nothing but the reset, and names no other cause afterwards.
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 10.0)) << virtual_rig->core().status().fault;
  config.services.fill_limits = {.pressure_max_psi = 25.0, .fill_allowance_permille = 75, .fill_max_ms = 500};
  rebuild();
  fill_past(1.0);
  EXPECT_EQ(watch(5.0).fault, "teensy.fill_time");
}

TEST_F(PressureFaultsTest, ADeviceThatVentedDuringAStallSaysSo) {
  config.sim->frame.heartbeat_timeout_s = 5.0;  // which would speak first
  rebuild();
  hold_at_23();
  virtual_rig->hang_core = true;  // the whole process: neither beats nor commands
  run_for(1.0);
  virtual_rig->hang_core = false;
  virtual_rig->core().tick(virtual_rig->now_ns(), 1'000'000'000, 0);
  run_for(0.5);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  EXPECT_NE(event("pressure.watchdog"), nullptr) << virtual_rig->core().status().fault;
  EXPECT_EQ(virtual_rig->core().outcome(), Outcome::kFailed) << "nothing is held any more";
  run_for(3.0);
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 10.0)) << virtual_rig->core().status().fault;
  start(kHold);
  run_for(5.0);
  EXPECT_EQ(virtual_rig->core().state(), RunState::kRunning) << virtual_rig->core().status().fault;
}

}  // namespace
}  // namespace isorig::daemon::test
