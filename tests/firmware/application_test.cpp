#include "firmware/application.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "fake_hardware.hpp"

namespace isorig::firmware {
namespace {

using namespace messages::teensy;

class Firmware : public testing::Test {
 protected:
  Firmware() { application.start(); }

  void run_ms(int ms, bool with_heartbeat = true) {
    for (int i = 0; i < ms; ++i) {
      if (with_heartbeat && i % 10 == 0) hardware.say(Heartbeat{});
      const std::uint64_t end = hardware.cycles + 1'000 * kCyclesPerUs;
      while (hardware.cycles < end) application.step();
    }
  }
  void open_session() {
    hardware.say(IdentityRequest{.session = 7});
    hardware.say(Limits{.pressure_max_raw = 14'000, .fill_allowance_permille = 100, .fill_max_ms = 2'000});
    hardware.say(Heartbeat{});
    run_ms(2);
  }
  void command(std::uint16_t fill, std::uint16_t vent, std::uint16_t validity_ms = 10'000) {
    hardware.say(
        ValveCommand{.sequence = ++sequence, .fill_permille = fill, .vent_permille = vent, .validity_ms = validity_ms});
    run_ms(1);
  }
  [[nodiscard]] bool is_unpowered() const { return hardware.fill_permille == 0 && hardware.vent_closing_permille == 0; }

  static constexpr std::uint32_t kCyclesPerUs = FakeHardware::kCyclesPerUs;
  FakeHardware hardware;
  Application application{{.cycles_per_us = kCyclesPerUs, .serial = "1234560", .firmware = "test"}, hardware};
  std::uint32_t sequence = 0;
};

TEST_F(Firmware, StartsWithBothCoilsUnpowered) {
  EXPECT_TRUE(is_unpowered());
}

TEST_F(Firmware, IntroducesItself) {
  open_session();
  const auto identities = hardware.take<Identity>();
  ASSERT_EQ(identities.size(), 1U);
  EXPECT_EQ(identities[0].session, 7U);
  EXPECT_STREQ(identities[0].serial, "1234560");
  EXPECT_STREQ(identities[0].model, "isorig-teensy36");
  EXPECT_EQ(identities[0].watchdog_ms, 200);
}

TEST_F(Firmware, StreamsEveryConversion) {
  open_session();
  hardware.take_samples();
  run_ms(1'000);
  const auto samples = hardware.take_samples();
  EXPECT_NEAR(static_cast<double>(samples.size()), 1e6 / 460.0, 4.0);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    ASSERT_EQ(samples[i].sequence, samples[i - 1].sequence + 1);
    ASSERT_GT(samples[i].device_us, samples[i - 1].device_us);
  }
  EXPECT_EQ(application.status().dropped, 0U);
  EXPECT_EQ(hardware.bus_violations, 0);
}

TEST_F(Firmware, AnswersTimeSyncWithinAFewPasses) {
  open_session();
  for (std::uint32_t i = 0; i < 200; ++i) {
    run_ms(1);
    hardware.cycles += 37 * i;  // any phase against the sensor's polls
    const std::uint64_t sent_us = hardware.now_ns() / 1000;
    hardware.say(TimeSyncRequest{.cookie = i});
    run_ms(1, false);
    const auto replies = hardware.take<TimeSyncReply>();
    ASSERT_EQ(replies.size(), 1U);
    EXPECT_EQ(replies[0].cookie, i);
    // No transfer of the sensor is waited for: a word alone takes 22 us.
    EXPECT_LE(replies[0].device_rx_us - sent_us, 8U);
    EXPECT_LE(replies[0].device_tx_us - replies[0].device_rx_us, 1U);
  }
}

TEST_F(Firmware, FillsAndHoldsAndVents) {
  open_session();
  command(1000, 0);
  EXPECT_EQ(hardware.fill_permille, 1000);
  EXPECT_EQ(hardware.vent_closing_permille, 1000);
  run_ms(300);
  EXPECT_NEAR(hardware.sensor.pressure_raw(), SimulatedElvh::kSupplyRaw, 100);
  command(0, 0);
  EXPECT_EQ(hardware.fill_permille, 0);
  EXPECT_EQ(hardware.vent_closing_permille, 1000) << "held: the vent valve needs current to stay closed";
  command(0, 250);
  EXPECT_EQ(hardware.vent_closing_permille, 750);
  command(0, 1000);
  EXPECT_TRUE(is_unpowered());
}

TEST_F(Firmware, VentsWhenHeartbeatsStop) {
  open_session();
  command(1000, 0);
  run_ms(100);
  const std::uint64_t last_us = hardware.now_ns() / 1000;
  run_ms(185, false);  // the last heartbeat came in the 91st of the 100 ms
  EXPECT_FALSE(is_unpowered());
  run_ms(20, false);
  EXPECT_TRUE(is_unpowered());
  EXPECT_LE(hardware.driven_us - last_us, 200'000U + 1'000U);
  EXPECT_EQ(application.status().self_vents, 1);
  run_ms(300, false);
  EXPECT_NEAR(hardware.sensor.pressure_raw(), SimulatedElvh::kRestRaw, 100);
  command(1000, 0);
  EXPECT_TRUE(is_unpowered()) << "latched";
}

TEST_F(Firmware, DropsAndCountsWhenTheHostStallsAndNeverWaits) {
  open_session();
  hardware.take_samples();
  const std::uint64_t passes = hardware.feeds;
  run_ms(100);
  const std::uint64_t free_passes = hardware.feeds - passes;
  const auto before = hardware.take_samples();
  hardware.is_stalled = true;
  hardware.room = 1'024;
  run_ms(100);
  EXPECT_NEAR(static_cast<double>(hardware.feeds - passes - free_passes), static_cast<double>(free_passes),
              0.02 * static_cast<double>(free_passes))
      << "the loop is as fast as with a host that reads";
  hardware.is_stalled = false;
  const std::uint32_t dropped = application.status().dropped;
  EXPECT_GT(dropped, 100U);
  run_ms(10);
  const auto after = hardware.take_samples();
  std::uint32_t gaps = after[0].sequence - before.back().sequence - 1;
  for (std::size_t i = 1; i < after.size(); ++i) gaps += after[i].sequence - after[i - 1].sequence - 1;
  EXPECT_EQ(gaps, dropped);
}

TEST_F(Firmware, WithoutAHostNothingIsSentAndNothingCountsAsDropped) {
  hardware.is_open = false;
  run_ms(1'000, false);
  EXPECT_TRUE(hardware.sent.empty());
  EXPECT_EQ(application.status().dropped, 0U);
  hardware.is_open = true;
  run_ms(2);
  EXPECT_GE(hardware.discards, 1) << "nothing left over from another host";
  open_session();
  EXPECT_GT(hardware.take<Identity>().at(0).next_sequence, 2'000U);
}

TEST_F(Firmware, RaisesTheSyncLineAtWholeSecondsAndSaysWhen) {
  open_session();
  run_ms(5'200);
  const auto edges = hardware.take<SyncEdge>();
  // start() itself puts the line low.
  ASSERT_EQ(hardware.sync_edges.size(), edges.size() + 1);
  ASSERT_EQ(edges.size(), 9U);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const FakeHardware::Edge& truth = hardware.sync_edges[i + 1];
    EXPECT_EQ(edges[i].count, i + 1);
    EXPECT_EQ(edges[i].level != 0, truth.is_high);
    EXPECT_EQ(edges[i].level, i % 2 == 0 ? 1 : 0);
    const double edge_us = static_cast<double>(truth.cycles) / kCyclesPerUs;
    EXPECT_GE(static_cast<double>(edges[i].device_us) + 1.0, edge_us);
    EXPECT_LE(static_cast<double>(edges[i].device_us) - edge_us, 1.0) << "stamped when the pin changed";
    const double due_us = 1'000'000.0 + 500'000.0 * static_cast<double>(i);
    EXPECT_NEAR(edge_us, due_us, 20.0);
  }
}

// The 32-bit counter wraps each 23.86 s at 180 MHz; nothing on the wire may show it.
TEST_F(Firmware, TimeGoesOnAcrossWrapsOfTheCycleCounter) {
  open_session();
  hardware.take_samples();
  hardware.pass_cycles = 450;
  std::uint32_t last_us = 0;
  std::uint64_t passed_us = hardware.now_ns() / 1000;
  for (int second = 0; second < 60; ++second) {
    run_ms(1'000);
    for (const Sample& sample : hardware.take_samples()) {
      if (last_us != 0) {
        ASSERT_GT(sample.device_us, last_us);
        ASSERT_LT(sample.device_us - last_us, 1'000U);
      }
      last_us = sample.device_us;
    }
  }
  passed_us = hardware.now_ns() / 1000;
  EXPECT_GT(hardware.cycles, std::uint64_t{2} << 32U);
  EXPECT_NEAR(static_cast<double>(last_us), static_cast<double>(passed_us), 3'000.0);
}

TEST_F(Firmware, AStallOfTheLoopItselfShowsAsAGap) {
  open_session();
  run_ms(50);
  const auto before = hardware.take_samples();
  hardware.cycles += 50'000 * kCyclesPerUs;
  run_ms(5);
  const auto after = hardware.take_samples();
  const auto lost = after.back().sequence - before.back().sequence - after.size();
  EXPECT_NEAR(static_cast<double>(lost), 50'000.0 / 460.0, 4.0);
  EXPECT_EQ(application.status().dropped, 0U) << "they were never read, so never dropped";
  EXPECT_GE(application.longest_pass_cycles(), 50'000U * kCyclesPerUs);
}

TEST_F(Firmware, FeedsTheWatchdogInEveryPass) {
  const std::uint64_t before = hardware.feeds;
  for (int i = 0; i < 100; ++i) application.step();
  EXPECT_EQ(hardware.feeds - before, 100U);
}

TEST_F(Firmware, TheLedTellsStatesApart) {
  const auto changes_in_a_second = [this](bool with_heartbeat) {
    hardware.led_changes = 0;
    run_ms(1'000, with_heartbeat);
    return hardware.led_changes;
  };
  open_session();
  EXPECT_EQ(changes_in_a_second(true), 1);
  hardware.sensor.set_fault(SimulatedElvh::Fault::kAbsent);
  run_ms(5);
  EXPECT_NEAR(changes_in_a_second(true), 2, 1);
  command(1000, 0);
  run_ms(300, false);
  EXPECT_NEAR(changes_in_a_second(false), 10, 1);
}

// Without the host, and against it: commands and heartbeats go on.

class FirmwareGuard : public Firmware {
 protected:
  FirmwareGuard() { hardware.sensor.set_noise(true); }
  void fill_ms(int ms, std::uint16_t fill_permille = 1000) {
    for (int i = 0; i < ms; i += 10) {
      hardware.say(
          ValveCommand{.sequence = ++sequence, .fill_permille = fill_permille, .vent_permille = 0, .validity_ms = 100});
      run_ms(10);
    }
  }
  void expect_vented(VentCause cause) {
    EXPECT_TRUE(is_unpowered());
    EXPECT_EQ(application.status().cause, cause);
    EXPECT_EQ(application.status().flags & kStatusSelfVented, kStatusSelfVented);
    fill_ms(200);
    EXPECT_TRUE(is_unpowered()) << "latched";
    run_ms(300);
    EXPECT_NEAR(hardware.sensor.pressure_raw(), SimulatedElvh::kRestRaw, 100);
  }
};

TEST_F(FirmwareGuard, VentsAboveTheGreatestPressure) {
  hardware.say(IdentityRequest{.session = 7});
  hardware.say(Limits{.pressure_max_raw = 8'000, .fill_allowance_permille = 100, .fill_max_ms = 2'000});
  hardware.say(Heartbeat{});
  std::uint16_t highest = 0;
  for (int i = 0; i < 30; ++i) {
    fill_ms(10);
    highest = std::max(highest, hardware.sensor.pressure_raw());
  }
  // At 33 counts a conversion: four of them, and the one that was under way.
  EXPECT_LE(highest, 8'000 + 6 * 40);
  expect_vented(VentCause::kPressureHigh);
}

TEST_F(FirmwareGuard, VentsAFillThatDoesNotEnd) {
  open_session();
  fill_ms(2'200);
  EXPECT_FALSE(is_unpowered());
  fill_ms(50);
  expect_vented(VentCause::kFillTime);
}

TEST_F(FirmwareGuard, VentsWhenTheSensorDiesWhileItFills) {
  for (const auto fault : {SimulatedElvh::Fault::kAbsent, SimulatedElvh::Fault::kShorted, SimulatedElvh::Fault::kSilent,
                           SimulatedElvh::Fault::kStuckCurrent, SimulatedElvh::Fault::kDiagnostic}) {
    SCOPED_TRACE(static_cast<int>(fault));
    open_session();
    command(0, 1000);
    fill_ms(50, 300);
    EXPECT_FALSE(is_unpowered());
    hardware.sensor.set_fault(fault);
    fill_ms(90, 300);
    const bool is_early = is_unpowered();
    fill_ms(30, 300);
    EXPECT_FALSE(is_early);
    hardware.sensor.set_fault(SimulatedElvh::Fault::kNone);
    expect_vented(VentCause::kSensorSilent);
    command(0, 1000);
  }
}

TEST_F(FirmwareGuard, VentsWhenTheCountStandsWhileItFills) {
  open_session();
  fill_ms(50, 300);
  hardware.sensor.set_fault(SimulatedElvh::Fault::kStuckCount);
  fill_ms(300, 300);
  EXPECT_FALSE(is_unpowered());
  fill_ms(50, 300);
  hardware.sensor.set_fault(SimulatedElvh::Fault::kNone);
  expect_vented(VentCause::kSensorStuck);
}

}  // namespace
}  // namespace isorig::firmware
