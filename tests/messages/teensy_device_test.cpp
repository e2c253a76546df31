#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <variant>
#include <vector>

#include "messages/teensy/device.hpp"

namespace isorig::messages::teensy {
namespace {

using Message = std::variant<Identity, TimeSyncReply, Status, Samples, SyncEdge, LimitsReply>;

class FakeBoard final : public Board {
 public:
  uint64_t now_us() noexcept override { return time_us += step_us; }
  bool send(const uint8_t* bytes, size_t size) noexcept override {
    if (is_stalled) return false;
    decoder_.feed(bytes, size, [this](const Packet& packet) {
      Identity identity;
      TimeSyncReply reply;
      Status status;
      Samples samples;
      SyncEdge edge;
      LimitsReply limits;
      if (parse(packet, identity)) sent.emplace_back(identity);
      if (parse(packet, reply)) sent.emplace_back(reply);
      if (parse(packet, status)) sent.emplace_back(status);
      if (parse(packet, samples)) sent.emplace_back(samples);
      if (parse(packet, edge)) sent.emplace_back(edge);
      if (parse(packet, limits)) sent.emplace_back(limits);
    });
    return true;
  }
  void set_valves(uint16_t fill, uint16_t vent) noexcept override {
    fill_permille = fill;
    vent_permille = vent;
  }

  template <class T>
  std::vector<T> take() {
    std::vector<T> out;
    for (const Message& message : sent)
      if (const T* value = std::get_if<T>(&message)) out.push_back(*value);
    std::erase_if(sent, [](const Message& message) { return std::holds_alternative<T>(message); });
    return out;
  }

  uint64_t time_us = 1'000'000;
  uint64_t step_us = 0;
  bool is_stalled = false;
  uint16_t fill_permille = 9999;
  uint16_t vent_permille = 9999;
  std::vector<Message> sent;

 private:
  Decoder decoder_;
};

class TeensyDevice : public testing::Test {
 protected:
  TeensyDevice() { core.start(); }

  void open_session() {
    say(IdentityRequest{});
    say(kLimits);
    say(Heartbeat{});
  }
  /// A conversion; by default of a live sensor, whose count moves.
  void convert() {
    core.add_sample(board.time_us, pack_elvh({ElvhStatus::kCurrent, ++raw_ % 2 == 0 ? raw : raw_moved(), 700}));
  }
  [[nodiscard]] uint16_t raw_moved() const { return static_cast<uint16_t>(raw + 1); }
  template <class T>
  void say(const T& message) {
    const Frame frame = encode(message);
    core.receive(frame.bytes, frame.size);
  }
  void run_ms(int ms, bool with_heartbeat) {
    for (int i = 0; i < ms; ++i) {
      board.time_us += 1000;
      if (with_heartbeat) say(Heartbeat{});
      if (has_sensor) convert();
      core.tick();
    }
  }
  void expect_valves(int fill, int vent) {
    EXPECT_EQ(board.fill_permille, fill);
    EXPECT_EQ(board.vent_permille, vent);
    EXPECT_EQ(core.status().fill_permille, fill);
    EXPECT_EQ(core.status().vent_permille, vent);
  }

  /// 24 psi; 0.1 of the duty for ever; 2 s.
  static constexpr Limits kLimits{12'124, 100, 2000};
  uint16_t raw = 2000;
  bool has_sensor = true;
  FakeBoard board;
  DeviceCore core{{.serial = "1234560", .firmware = "test"}, board};

 private:
  unsigned raw_ = 0;
};

TEST_F(TeensyDevice, StartsVented) {
  expect_valves(0, 1000);
}

TEST_F(TeensyDevice, AnswersIdentityThenStatus) {
  core.add_sample(1, 0);
  say(IdentityRequest{77});
  core.tick();
  ASSERT_EQ(board.sent.size(), 3U);
  const auto identity = std::get<Identity>(board.sent[1]);
  EXPECT_EQ(identity.session, 77U);
  EXPECT_EQ(identity.next_sequence, 1U);
  EXPECT_EQ(identity.device_us, 1'000'000U);
  EXPECT_EQ(identity.watchdog_ms, 200);
  EXPECT_EQ(std::string(identity.serial), "1234560");
  EXPECT_EQ(std::string(identity.model), "isorig-teensy36");
  EXPECT_TRUE(std::holds_alternative<Status>(board.sent[2]));
}

TEST_F(TeensyDevice, TimeSyncEchoesTheCookieWithBothStamps) {
  board.step_us = 3;
  say(TimeSyncRequest{0xABCD});
  const auto replies = board.take<TimeSyncReply>();
  ASSERT_EQ(replies.size(), 1U);
  EXPECT_EQ(replies[0].cookie, 0xABCDU);
  EXPECT_EQ(replies[0].device_tx_us - replies[0].device_rx_us, 3U);
}

TEST_F(TeensyDevice, CommandsNeedASession) {
  say(ValveCommand{1, 500, 0, 100});
  expect_valves(0, 1000);
  EXPECT_EQ(core.status().rejected, 1U);
  open_session();
  say(ValveCommand{1, 500, 0, 100});
  expect_valves(500, 0);
}

TEST_F(TeensyDevice, ValvesObeyOnlyWhileHeartbeatsArrive) {
  say(IdentityRequest{});
  say(kLimits);
  say(ValveCommand{1, 500, 0, 100});
  say(ValveCommand{2, 0, 999, 100});
  say(ValveCommand{3, 0, 0, 100});
  expect_valves(0, 1000);
  EXPECT_EQ(core.status().rejected, 3U);
  say(ValveCommand{4, 0, 1000, 100});
  EXPECT_EQ(core.status().rejected, 3U);
  say(Heartbeat{});
  board.time_us += 200'000;
  say(ValveCommand{5, 500, 0, 100});
  expect_valves(500, 0);
  board.time_us += 1;  // and before the next tick
  say(ValveCommand{6, 600, 0, 100});
  expect_valves(500, 0);
}

TEST_F(TeensyDevice, WithoutAHeartbeatYetTheWatchdogWaits) {
  say(IdentityRequest{});
  run_ms(1000, false);
  EXPECT_FALSE(core.has_vented_itself());
  EXPECT_EQ(core.status().self_vents, 0);
}

TEST_F(TeensyDevice, AHostThatVentsAndGoesAwayLeavesNothingToReport) {
  open_session();
  say(ValveCommand{1, 500, 0, 100});
  run_ms(50, true);
  say(ValveCommand{2, 0, 1000, 100});
  run_ms(1000, false);
  EXPECT_FALSE(core.has_vented_itself());
  EXPECT_EQ(core.status().self_vents, 0);
  say(ValveCommand{3, 500, 0, 100});
  expect_valves(0, 1000);
  open_session();
  say(ValveCommand{1, 500, 0, 100});
  expect_valves(500, 0);
}

TEST_F(TeensyDevice, RefusesCommandsOutOfRange) {
  open_session();
  say(ValveCommand{1, 10, 0, 100});
  uint32_t sequence = 2;
  for (const ValveCommand& bad :
       {ValveCommand{0, 1001, 0, 100}, ValveCommand{0, 0, 1001, 100}, ValveCommand{0, 1, 1, 100},
        ValveCommand{0, 1, 0, 0}, ValveCommand{0, 1, 0, 10'001}}) {
    ValveCommand command = bad;
    command.sequence = sequence++;
    say(command);
    expect_valves(10, 0);
  }
  EXPECT_EQ(core.status().rejected, 5U);
  EXPECT_EQ(core.status().command_sequence, 1U);
}

TEST_F(TeensyDevice, IgnoresOldCommandsAlsoOverTheWrap) {
  open_session();
  say(ValveCommand{0xFFFFFFFF, 100, 0, 100});
  say(ValveCommand{0, 200, 0, 100});
  expect_valves(200, 0);
  say(ValveCommand{0xFFFFFFFF, 300, 0, 100});
  say(ValveCommand{0, 400, 0, 100});
  expect_valves(200, 0);
  say(IdentityRequest{});  // a restarted host counts anew
  say(kLimits);
  say(ValveCommand{0xFFFFFF00, 50, 0, 100});
  expect_valves(50, 0);
}

TEST_F(TeensyDevice, CommandExpiresToClosedValvesAndSaysSo) {
  open_session();
  say(ValveCommand{1, 500, 0, 50});
  run_ms(50, true);
  expect_valves(500, 0);
  board.take<Status>();
  run_ms(1, true);
  expect_valves(0, 0);
  const auto statuses = board.take<Status>();
  ASSERT_EQ(statuses.size(), 1U);
  EXPECT_EQ(statuses[0].flags, kStatusCommandExpired | kStatusHasLimits);
  say(ValveCommand{2, 0, 300, 50});
  core.tick();
  expect_valves(0, 300);
  EXPECT_EQ(board.take<Status>().at(0).flags, kStatusHasLimits);
}

TEST_F(TeensyDevice, AFullVentNeedsNoRenewal) {
  open_session();
  say(ValveCommand{1, 500, 0, 50});
  say(ValveCommand{2, 0, 1000, 50});
  run_ms(1000, true);
  expect_valves(0, 1000);
}

TEST_F(TeensyDevice, VentsByItselfWhenHeartbeatsStop) {
  open_session();
  say(ValveCommand{1, 500, 0, 10'000});
  run_ms(1000, true);
  run_ms(200, false);
  expect_valves(500, 0);
  board.take<Status>();
  run_ms(1, false);
  expect_valves(0, 1000);
  const auto statuses = board.take<Status>();
  ASSERT_EQ(statuses.size(), 1U);
  EXPECT_EQ(statuses[0].flags, kStatusSelfVented | kStatusHasLimits);
  EXPECT_EQ(statuses[0].self_vents, 1);
  EXPECT_EQ(statuses[0].cause, VentCause::kHeartbeat);
}

TEST_F(TeensyDevice, OnlyAgreeingWithTheVentReleasesTheLatch) {
  open_session();
  say(ValveCommand{0, 500, 0, 100});
  run_ms(300, false);
  ASSERT_TRUE(core.has_vented_itself());
  say(ValveCommand{1, 0, 1000, 100});  // agrees, but no heartbeat came since
  ASSERT_TRUE(core.has_vented_itself());
  run_ms(10, true);
  say(ValveCommand{2, 500, 0, 100});  // a host that never noticed
  expect_valves(0, 1000);
  say(IdentityRequest{});
  say(kLimits);
  say(ValveCommand{3, 500, 0, 100});  // nor does reconnecting release it
  expect_valves(0, 1000);
  EXPECT_EQ(core.status().rejected, 3U);
  say(ValveCommand{4, 0, 1000, 100});
  EXPECT_FALSE(core.has_vented_itself());
  say(ValveCommand{5, 500, 0, 100});
  expect_valves(500, 0);
  EXPECT_EQ(core.status().self_vents, 1);
}

// What it does without its host, and against it.

class TeensyLimits : public TeensyDevice {
 protected:
  /// As a host that is wrong: commands and heartbeats go on whatever happens.
  void fill_ms(int ms, uint16_t fill_permille = 1000) {
    for (int i = 0; i < ms; ++i) {
      if (i % 10 == 0) say(ValveCommand{++sequence, fill_permille, 0, 100});
      run_ms(1, true);
    }
  }
  void expect_vented(VentCause cause) {
    expect_valves(0, 1000);
    EXPECT_TRUE(core.has_vented_itself());
    EXPECT_EQ(core.status().cause, cause);
    fill_ms(100);
    expect_valves(0, 1000);  // latched, whatever the host still says
    say(ValveCommand{++sequence, 0, 1000, 100});
    EXPECT_FALSE(core.has_vented_itself());
    EXPECT_EQ(core.status().cause, cause) << "and can still be asked why";
  }
  uint32_t sequence = 0;
};

TEST_F(TeensyLimits, NothingIsFilledBeforeTheyAreSetInThisSession) {
  say(IdentityRequest{});
  say(Heartbeat{});
  say(ValveCommand{1, 100, 0, 100});
  expect_valves(0, 1000);
  say(ValveCommand{2, 0, 0, 100});  // to hold needs none
  expect_valves(0, 0);
  say(kLimits);
  say(ValveCommand{3, 100, 0, 100});
  expect_valves(100, 0);
  say(IdentityRequest{1});
  say(ValveCommand{1, 200, 0, 100});
  EXPECT_EQ(core.status().rejected, 2U);
  EXPECT_EQ(core.status().flags & kStatusHasLimits, 0);
}

TEST_F(TeensyLimits, AreEchoedAndRefusedWhereTheyAreNone) {
  say(kLimits);  // without a session
  open_session();
  for (const Limits& bad :
       {Limits{14'747, 100, 2000}, Limits{1638, 100, 2000}, Limits{12'124, 501, 2000}, Limits{12'124, 100, 60'001}}) {
    say(bad);
  }
  const auto replies = board.take<LimitsReply>();
  ASSERT_EQ(replies.size(), 6U);
  EXPECT_EQ(replies[0].accepted, 0);
  EXPECT_EQ(replies[1].accepted, 1);
  for (std::size_t i = 1; i < replies.size(); ++i) {
    EXPECT_EQ(replies[i].accepted, i == 1 ? 1 : 0);
    EXPECT_EQ(replies[i].limits, kLimits) << "what is in force";
  }
}

TEST_F(TeensyLimits, AReadingAboveTheGreatestPressureVentsInAnyState) {
  for (const uint16_t fill : {uint16_t{500}, uint16_t{0}}) {  // filling, and sealed
    open_session();
    raw = 12'122;
    fill_ms(50, fill);
    expect_valves(fill, 0);
    raw = 12'200;
    run_ms(3, true);
    expect_valves(fill, 0);  // one wild conversion is none
    run_ms(1, true);
    expect_vented(VentCause::kPressureHigh);
  }
}

TEST_F(TeensyLimits, AFillThatIsLongerThanAnyFillingVents) {
  open_session();
  // 2 s above a tenth: 2 / 0.9 s at full duty.
  fill_ms(2210);
  expect_valves(1000, 0);
  fill_ms(20);
  expect_vented(VentCause::kFillTime);
}

TEST_F(TeensyLimits, SmallDutiesMayFlowForEverAndVentingGivesBack) {
  open_session();
  fill_ms(60'000, 100);
  expect_valves(100, 0);
  for (int cycle = 0; cycle < 20; ++cycle) {  // 1.8 s in, 1.8 s out
    fill_ms(1800);
    say(ValveCommand{++sequence, 0, 900, 10'000});
    run_ms(1850, true);
  }
  EXPECT_FALSE(core.has_vented_itself());
  EXPECT_LT(core.status().fill_used_ms, 100);
}

TEST_F(TeensyLimits, WithoutACapTheValveMayStayOpen) {
  say(IdentityRequest{});
  say(Limits{12'124, 0, 0});
  fill_ms(60'000);
  expect_valves(1000, 0);
  raw = 12'200;
  run_ms(10, true);
  expect_vented(VentCause::kPressureHigh);
}

TEST_F(TeensyLimits, ASensorThatSaysNothingWhileFillingVents) {
  const uint32_t invalid[] = {0U,
                              0xFFFFFFFFU,
                              pack_elvh({ElvhStatus::kStale, 5000, 700}),
                              pack_elvh({ElvhStatus::kFault, 5000, 700}),
                              pack_elvh({ElvhStatus::kReserved, 5000, 700}),
                              pack_elvh({ElvhStatus::kCurrent, 15'900, 700}),
                              pack_elvh({ElvhStatus::kCurrent, 900, 700})};
  for (const uint32_t word : invalid) {
    open_session();
    raw = 5000;
    fill_ms(50, 200);
    has_sensor = false;
    const bool is_high = unpack_elvh(word).status == ElvhStatus::kCurrent && unpack_elvh(word).pressure_raw == 15'900;
    for (int i = 0; i < 99 && !is_high; ++i) {
      core.add_sample(board.time_us, word);
      fill_ms(1, 200);
    }
    if (!is_high) expect_valves(200, 0);
    for (int i = 0; i < 5; ++i) {
      core.add_sample(board.time_us, word);
      fill_ms(1, 200);
    }
    has_sensor = true;
    expect_vented(is_high ? VentCause::kPressureHigh : VentCause::kSensorSilent);
  }
  open_session();
  has_sensor = false;  // not even a word
  fill_ms(120, 200);
  expect_vented(VentCause::kSensorSilent);
}

TEST_F(TeensyLimits, ACountThatStandsWhileTheValveIsOpenVents) {
  open_session();
  fill_ms(50, 500);
  const auto stuck_ms = [&](int ms, uint16_t fill) {
    has_sensor = false;
    for (int i = 0; i < ms; ++i) {
      core.add_sample(board.time_us, pack_elvh({ElvhStatus::kCurrent, 2000, 700}));
      fill_ms(1, fill);
    }
    has_sensor = true;
  };
  stuck_ms(190, 500);  // 0.1 s of full duty are 0.2 s of half
  expect_valves(500, 0);
  stuck_ms(20, 500);
  expect_vented(VentCause::kSensorStuck);
  // At rest a count may stand for long.
  open_session();
  stuck_ms(5000, 0);
  EXPECT_FALSE(core.has_vented_itself());
}

/// Open 90 ms, shut 10 ms, shorter than what is allowed without a reading.
TEST_F(TeensyLimits, PulsesGiveASensorThatIsSilentOrStuckNoMoreTime) {
  const auto pulse_ms = [&](bool stuck) {
    has_sensor = false;
    int ms = 0;
    for (; ms < 2000 && !core.has_vented_itself(); ++ms) {
      if (stuck) core.add_sample(board.time_us, pack_elvh({ElvhStatus::kCurrent, 2000, 700}));
      const bool is_open = ms % 100 < 90;
      if (ms % 10 == 0) say(ValveCommand{++sequence, static_cast<uint16_t>(is_open ? 1000 : 0), 0, 100});
      run_ms(1, true);
    }
    has_sensor = true;
    return ms;
  };
  say(IdentityRequest{});
  say(Heartbeat{});
  say(Limits{12'124, 0, 0});  // without a cap
  run_ms(10, true);
  EXPECT_LE(pulse_ms(false), 110);
  expect_vented(VentCause::kSensorSilent);
  say(IdentityRequest{});
  say(kLimits);
  run_ms(10, true);
  EXPECT_LE(pulse_ms(true), 125);
  expect_vented(VentCause::kSensorStuck);
}

/// As without air in the supply: the count is that of rest, before and after.
TEST_F(TeensyLimits, ASecondOfFullVentBeginsAnewOnTheSameCount) {
  open_session();
  const auto hold_count_ms = [&](int ms, uint16_t fill, uint16_t vent) {
    has_sensor = false;
    for (int i = 0; i < ms; ++i) {
      core.add_sample(board.time_us, pack_elvh({ElvhStatus::kCurrent, 1638, 700}));
      if (i % 10 == 0) say(ValveCommand{++sequence, fill, vent, 100});
      run_ms(1, true);
    }
    has_sensor = true;
  };
  hold_count_ms(120, 1000, 0);
  EXPECT_EQ(core.status().self_vents, 1);
  hold_count_ms(1010, 0, 1000);
  hold_count_ms(90, 1000, 0);
  EXPECT_FALSE(core.has_vented_itself());
  hold_count_ms(500, 0, 1000);
  hold_count_ms(20, 1000, 0);
  EXPECT_EQ(core.status().self_vents, 2) << "half a second does not";
}

/// Rare short refills near a set-point, by a host that goes by the reading: neither a quiet nor a noisy sensor is
/// taken for a stuck one. Rates in counts/s: 0.6 and 20 psi/s.
TEST(FillGuard, ShortRefillsOfAHealthySensorAreLeftAlone) {
  constexpr uint64_t kConversion_us = 461;
  constexpr double kTarget = 9000.0;
  std::mt19937 random(1);
  for (const double full : {262.0, 8740.0}) {
    for (const double leak_of_full : {0.0003, 0.013, 0.11}) {
      for (const double noise : {0.0, 1.5}) {
        FillGuard guard;
        ASSERT_TRUE(guard.set_limits({12'124, 150, 60'000}));
        std::normal_distribution<double> counts(0.0, 1.0);
        double pressure = kTarget;
        uint16_t fill = 0;
        uint64_t shut_us = 0;
        int refills = 0;
        VentCause cause = VentCause::kNone;
        uint64_t now_us = 1'000'000;
        for (; now_us < 601'000'000 && cause == VentCause::kNone; now_us += kConversion_us) {
          const double passed_s = 1e-6 * static_cast<double>(kConversion_us);
          pressure += passed_s * full * (1e-3 * fill - leak_of_full);
          const double read = std::round(pressure + noise * counts(random));
          cause = guard.sample(pack_elvh({ElvhStatus::kCurrent, static_cast<uint16_t>(read), 700}), now_us);
          if (cause == VentCause::kNone) cause = guard.tick(now_us);
          if (fill == 0 && read < kTarget) {  // 3 ms, and looks again
            fill = 1000;
            ++refills;
            shut_us = now_us + 3000;
            guard.apply(fill, 0, now_us);
          } else if (fill > 0 && now_us >= shut_us) {
            fill = 0;
            guard.apply(fill, 0, now_us);
          }
        }
        EXPECT_EQ(cause, VentCause::kNone) << full << " counts/s, leak " << leak_of_full << ", noise " << noise
                                           << ", after " << 1e-6 * static_cast<double>(now_us) << " s";
        EXPECT_GT(refills, 10);
      }
    }
  }
}

TEST_F(TeensyLimits, AVentedDeviceHasNothingToReport) {
  open_session();
  say(ValveCommand{1, 0, 1000, 100});
  raw = 14'000;
  run_ms(1000, true);
  EXPECT_FALSE(core.has_vented_itself());
  EXPECT_EQ(core.status().self_vents, 0);
}

TEST_F(TeensyDevice, SamplesKeepSequenceAndLowTimeBits) {
  core.add_sample((1ULL << 32U) - 1, 0x11);
  core.skip_samples(3);
  core.add_sample((1ULL << 32U) + 999, 0x22);
  const auto samples = board.take<Samples>();
  ASSERT_EQ(samples.size(), 2U);
  EXPECT_EQ(samples[0].items[0].device_us, 0xFFFFFFFFU);
  EXPECT_EQ(samples[1].items[0].device_us, 999U);
  EXPECT_EQ(samples[1].items[0].sequence, 4U);
}

TEST_F(TeensyDevice, CountsWhatAStalledHostLoses) {
  board.is_stalled = true;
  for (int i = 0; i < 10; ++i) core.add_sample(board.time_us, 0);
  board.is_stalled = false;
  core.add_sample(board.time_us, 0);
  EXPECT_EQ(core.status().dropped, 10U);
  EXPECT_EQ(board.take<Samples>().at(0).items[0].sequence, 10U);
}

TEST_F(TeensyDevice, WithoutAHostNothingIsSentAndNothingCountsAsDropped) {
  core.set_link_up(false);
  has_sensor = false;
  for (int i = 0; i < 10; ++i) core.add_sample(board.time_us, 0);
  run_ms(500, false);
  EXPECT_TRUE(board.sent.empty());
  EXPECT_EQ(core.status().dropped, 0U);
  core.set_link_up(true);
  core.add_sample(board.time_us, 0);
  EXPECT_EQ(board.take<Samples>().at(0).items[0].sequence, 10U);
}

TEST_F(TeensyDevice, StatusIsPeriodic) {
  run_ms(1000, false);
  EXPECT_EQ(board.take<Status>().size(), 10U);
}

TEST_F(TeensyDevice, AStatusThatFoundNoRoomIsSentLater) {
  open_session();
  say(ValveCommand{1, 500, 0, 1000});
  run_ms(100, true);
  board.take<Status>();
  board.is_stalled = true;
  run_ms(300, false);
  ASSERT_TRUE(core.has_vented_itself());
  board.is_stalled = false;
  run_ms(1, false);
  const auto statuses = board.take<Status>();
  ASSERT_EQ(statuses.size(), 1U);
  EXPECT_EQ(statuses[0].flags, kStatusSelfVented | kStatusHasLimits);
}

TEST_F(TeensyDevice, CountsDamageAndEchoedFrames) {
  core.receive(reinterpret_cast<const uint8_t*>("\0garbage"), 9);
  say(Status{});  // its own kind, come back from a tty in cooked mode
  EXPECT_EQ(core.status().corrupt, 2U);
}

TEST(TeensyDeviceBatch, SendsWhenFullOrOld) {
  FakeBoard board;
  DeviceCore core({.batch_samples = 4, .batch_age_us = 1500}, board);
  core.start();
  for (int i = 0; i < 5; ++i) core.add_sample(board.time_us, 0);
  auto samples = board.take<Samples>();
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(samples[0].count, 4);
  board.time_us += 1499;
  core.tick();
  EXPECT_TRUE(board.take<Samples>().empty());
  board.time_us += 1;
  core.tick();
  samples = board.take<Samples>();
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(samples[0].count, 1);
}

}  // namespace
}  // namespace isorig::messages::teensy
