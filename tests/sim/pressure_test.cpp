#include "sim/pressure/pressure.hpp"

#include <gtest/gtest.h>

#include <utility>

#include "driver.hpp"
#include "messages/elvh.hpp"

namespace isorig::sim {
namespace {

using testing::Driver;
using testing::shipped;

double psi(const pressure::Sample& s) {
  return messages::elvh_pressure_psi(messages::unpack_elvh(s.raw_word).pressure_raw);
}

TEST(SimPressure, SendsElvhWordsWithAboutOneCountOfNoise) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(60.0);
  const auto& s = d.pressure_samples;
  ASSERT_NEAR(static_cast<double>(s.size()), 60'000.0, 3.0);
  double sum = 0.0;
  double squares = 0.0;
  for (std::size_t i = 0; i < s.size(); ++i) {
    ASSERT_EQ(s[i].sequence, s[0].sequence + i);
    const auto word = messages::unpack_elvh(s[i].raw_word);
    ASSERT_EQ(word.status, messages::ElvhStatus::kCurrent);
    ASSERT_NEAR(messages::elvh_temperature_c(word.temperature_raw), 23.0, 0.7);
    sum += word.pressure_raw;
    squares += static_cast<double>(word.pressure_raw) * word.pressure_raw;
  }
  const auto n = static_cast<double>(s.size());
  const double mean = sum / n;
  EXPECT_NEAR(mean, messages::kElvhOffsetCounts, 0.03);
  EXPECT_NEAR(std::sqrt(squares / n - mean * mean), std::sqrt(1.0 + 1.0 / 12.0), 0.02);
}

TEST(SimPressure, ReadsThePressureOfTheChamber) {
  Rig rig(shipped());
  Driver d(rig);
  d.target_psi = 20.0;
  d.run(8.0);
  EXPECT_NEAR(rig.truth().pressure_psi, 20.0, 0.1);
  double mean_psi = 0.0;
  for (std::size_t i = d.pressure_samples.size() - 1000; i < d.pressure_samples.size(); ++i) {
    mean_psi += psi(d.pressure_samples[i]) / 1000.0;
  }
  EXPECT_NEAR(mean_psi, rig.truth().pressure_psi, 0.05);
}

TEST(SimPressure, CommandsActAfterTheirDelay) {
  const SimConfig config = shipped();
  Rig rig(config);
  Driver d(rig);
  d.run(1.0);
  rig.pressure().command({1000, 0, 0.0F});
  const double delay_ms = config.pressure.command_delay_ms + config.pneumatics.valve_delay_ms;
  d.run(1e-3 * std::floor(delay_ms));
  EXPECT_EQ(rig.truth().pressure_psi, 0.0);
  d.run(0.004);
  EXPECT_GT(rig.truth().pressure_psi, 0.001);
  d.run(0.01);
  EXPECT_EQ(d.pressure_state.fill_permille, 1000);
  EXPECT_EQ(d.pressure_state.vent_permille, 0);
}

TEST(SimPressure, DutiesBelowTheDeadBandKeepAValveShut) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(1.0);
  rig.pressure().command({20, 0, 0.0F});
  d.run(1.0);
  EXPECT_NEAR(rig.truth().pressure_psi, 0.0, 1e-9);
  rig.pressure().command({22, 0, 0.0F});
  d.run(1.0);
  EXPECT_GT(rig.truth().pressure_psi, 0.01);
  EXPECT_THROW(rig.pressure().command({1001, 0, 0.0F}), drivers::DeviceError);
}

TEST(SimPressure, VentsByItselfWhenHeartbeatsStop) {
  Rig rig(shipped());
  Driver d(rig);
  d.target_psi = 15.0;
  d.run(5.0);
  EXPECT_GT(rig.truth().pressure_psi, 14.5);
  d.beating = false;
  d.run(6.0);  // commands still come: they do not feed the watchdog
  EXPECT_TRUE(d.pressure_state.vented_by_itself);
  EXPECT_EQ(d.pressure_state.vent_permille, 1000);
  EXPECT_LT(rig.truth().pressure_psi, 1.0);
  d.beating = true;
  d.run(5.0);
  EXPECT_TRUE(d.pressure_state.vented_by_itself) << "a host that never noticed does not get its pressure back";
  EXPECT_EQ(d.pressure_state.cause, pressure::VentCause::kHeartbeat);
  const double target_psi = std::exchange(d.target_psi, -1.0);
  rig.pressure().command({0, 1000, 0.0F});
  d.run(0.1);
  d.target_psi = target_psi;
  d.run(5.0);
  EXPECT_FALSE(d.pressure_state.vented_by_itself);
  EXPECT_GT(rig.truth().pressure_psi, 14.5);
}

/// Heartbeats go on: it is the command that ends. Looked at every 10 ms, as the watchdog is.
TEST(SimPressure, ClosesBothValvesWhenNobodyRenewsACommand) {
  const auto fill_after = [](double time_s, bool has_limits, bool stands_still) {
    Rig rig(shipped());
    if (has_limits)
      rig.pressure().set_limits({.pressure_max_psi = 20.0, .fill_allowance_permille = 50, .fill_max_ms = 5'000});
    Driver d(rig);
    d.run(1.0);
    rig.pressure().command({300, 0, 0.0F});
    d.run(0.05);
    rig.pressure().faults.ignores_commands = stands_still;
    d.run(time_s - 0.05);
    return d.pressure_state.fill_permille;
  };
  EXPECT_EQ(fill_after(0.1, true, false), 300);
  EXPECT_EQ(fill_after(0.12, true, false), 0);
  EXPECT_EQ(fill_after(0.4, false, false), 300) << "an emulated Teensy before it does this";
  EXPECT_EQ(fill_after(0.4, true, true), 300) << "valves that take no command take no closing either";
}

TEST(SimPressure, AFullVentNeedsNoRenewal) {
  Rig rig(shipped());
  rig.pressure().set_limits({.pressure_max_psi = 20.0, .fill_allowance_permille = 50, .fill_max_ms = 5'000});
  Driver d(rig);
  d.run(1.0);
  rig.pressure().command({0, 1000, 0.0F});
  d.run(2.0);
  EXPECT_EQ(d.pressure_state.vent_permille, 1000);
  rig.pressure().command({0, 400, 0.0F});
  d.run(0.2);
  EXPECT_EQ(d.pressure_state.vent_permille, 0) << "half a vent is a command like others";
}

TEST(SimPressure, GuardsItsFillingAsTheFirmwareDoes) {
  Rig rig(shipped());
  rig.pressure().set_limits({.pressure_max_psi = 12.0, .fill_allowance_permille = 50, .fill_max_ms = 5'000});
  EXPECT_THROW(rig.pressure().set_limits({.pressure_max_psi = 40.0, .fill_allowance_permille = 600}),
               drivers::DeviceError);
  Driver d(rig);
  d.target_psi = 15.0;
  d.run(8.0);
  EXPECT_TRUE(d.pressure_state.vented_by_itself);
  EXPECT_EQ(d.pressure_state.cause, pressure::VentCause::kPressureHigh);
  EXPECT_LT(rig.truth().pressure_psi, 1.0);
}

TEST(SimPressure, AnOpenEmergencyStopDumpsWhateverTheDaemonAsks) {
  Rig rig(shipped());
  Driver d(rig);
  d.target_psi = 20.0;
  d.run(5.0);
  rig.interlock().estop_closed = false;
  EXPECT_FALSE(rig.interlock().read().estop_closed);
  d.target_psi = -1.0;
  rig.pressure().command({0, 0, 0.0F});
  d.run(2.0);
  EXPECT_LT(rig.truth().pressure_psi, 1.0);
}

TEST(SimPressure, DropsTheNewestWhenTheHostStallsAndCounts) {
  const SimConfig config = shipped();
  Rig rig(config);
  Driver d(rig);
  d.run(0.5);
  d.polling = false;
  d.run(1.0);
  d.polling = true;
  d.run(0.5);
  EXPECT_NEAR(d.pressure_lost, 1000.0 - config.pressure.ring_samples, 3.0);
  EXPECT_EQ(d.pressure_state.dropped, d.pressure_lost);
}

TEST(SimPressure, TimeSyncRepliesBracketTheTruth) {
  SimConfig config = shipped();
  Rig rig(config);
  Driver d(rig);
  d.syncing = true;
  d.run(60.0);
  ASSERT_GT(d.pressure_exchanges.size(), 590U);
  DeviceClock clock(config.pressure.clock, Random(config.seed, static_cast<std::uint64_t>(Stream::kSensorClock)), 0);
  int spikes = 0;
  for (const auto& e : d.pressure_exchanges) {
    clock.advance_to(e.host_send_ns);
    EXPECT_LE(static_cast<double>(e.host_send_ns) + 0.249e6, clock.host_since(0, e.device_rx_us));
    EXPECT_LE(clock.host_since(0, e.device_tx_us) + 0.249e6, static_cast<double>(e.host_recv_ns));
    EXPECT_NEAR(e.device_tx_us - e.device_rx_us, 20.0, 1.01);
    spikes += e.host_recv_ns - e.host_send_ns > 5'000'000;
  }
  EXPECT_GT(spikes, 2);
  EXPECT_LT(spikes, 40);
}

TEST(SimPressure, FaultSwitchesShowTheirFault) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(0.2);
  const auto last = [&] {
    d.run(0.1);
    return d.pressure_samples.back().raw_word;
  };
  rig.pressure().faults = {.sensor_fault = true};
  EXPECT_EQ(messages::unpack_elvh(last()).status, messages::ElvhStatus::kFault);
  rig.pressure().faults = {.sensor_stale = true};
  EXPECT_EQ(messages::unpack_elvh(last()).status, messages::ElvhStatus::kStale);
  rig.pressure().faults = {.bus_low = true};
  EXPECT_EQ(last(), 0U);
  rig.pressure().faults = {.bus_high = true};
  EXPECT_EQ(last(), 0xFFFFFFFFU);
  rig.pressure().faults = {.stuck_value = true};
  EXPECT_EQ(last(), last());
  rig.pressure().faults = {.frozen_samples = true};
  d.run(0.1);  // what is still under way
  const std::size_t count = d.pressure_samples.size();
  d.run(0.1);
  EXPECT_EQ(d.pressure_samples.size(), count);
  rig.pressure().faults = {.disconnected = true};
  EXPECT_THROW(rig.pressure().heartbeat(), drivers::DeviceError);
}

TEST(SimPressure, WhatHappensToTheTubeShowsInTheReadingAndNotInTheTruth) {
  Rig rig(shipped());
  Driver d(rig);
  d.target_psi = 10.0;
  d.run(5.0);
  const auto mean_psi = [&](double seconds) {
    const std::size_t from = d.pressure_samples.size();
    d.run(seconds);
    double sum = 0.0;
    for (std::size_t i = from; i < d.pressure_samples.size(); ++i) sum += psi(d.pressure_samples[i]);
    return sum / static_cast<double>(d.pressure_samples.size() - from);
  };
  auto& faults = rig.pressure().faults;
  faults = {.tube_off = true};
  EXPECT_NEAR(mean_psi(0.5), 0.0, 0.05);  // one or two conversions were under way
  faults = {.low_permille = 200};
  EXPECT_NEAR(mean_psi(0.5), 8.0, 0.1);
  faults = {};
  d.run(0.1);
  faults = {.tube_blocked = true};
  d.target_psi = 15.0;
  EXPECT_NEAR(mean_psi(3.0), 10.0, 0.1);
  EXPECT_NEAR(rig.truth().pressure_psi, 15.0, 0.1);
  EXPECT_NE(d.pressure_samples.back().raw_word, d.pressure_samples[d.pressure_samples.size() - 5].raw_word) << "noise";
  faults = {.tube_lag_ms = 1000};
  d.run(1.0);
  EXPECT_NEAR(mean_psi(0.01), 15.0 - 5.0 * std::exp(-1.0), 0.15);
}

TEST(SimPressure, ValvesHosesAndSupplyFail) {
  Rig rig(shipped());
  Driver d(rig);
  d.target_psi = 10.0;
  d.run(5.0);
  rig.pneumatics().fill_stuck_open = true;
  d.target_psi = 5.0;
  d.run(10.0);
  EXPECT_GT(rig.truth().pressure_psi, 12.0) << "fill and vent of the same size: the supply wins";
  rig.pneumatics().supply_psi_now = 20.0;
  d.run(20.0);
  EXPECT_LT(rig.truth().pressure_psi, 12.0);
  rig.pneumatics().fill_stuck_open = false;
  rig.pneumatics().supply_psi_now = 0.0;
  d.target_psi = 10.0;
  d.run(5.0);
  rig.pneumatics().vent_stuck_shut = true;
  d.target_psi = 5.0;
  d.run(5.0);
  EXPECT_GT(rig.truth().pressure_psi, 9.5);
  rig.pneumatics().burst_mL_s_bar = 150.0;
  d.run(2.0);
  EXPECT_LT(rig.truth().pressure_psi, 5.5);
  rig.pneumatics().burst_mL_s_bar = 0.0;
  d.target_psi = 10.0;
  d.run(5.0);
  rig.pneumatics().dump_stuck_shut = true;
  rig.interlock().hold_pressure(false);
  d.target_psi = -1.0;
  rig.pressure().command({0, 1000, 0.0F});
  d.run(2.0);
  EXPECT_GT(rig.truth().pressure_psi, 9.5) << "neither valve opens";
}

}  // namespace
}  // namespace isorig::sim
