// The real driver against the emulator's faults. Each test says what the I/O thread sees, and that what comes
// afterwards is right again.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <thread>

#include "fake_wire.hpp"

namespace isorig::sim {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using testing::HasSubstr;

class ModbusFaults : public testing::TestWithParam<Line> {
 protected:
  explicit ModbusFaults(int timeout_ms = FakeWire::kPatience_ms) : rig(GetParam(), "isorig-gateway.toml", timeout_ms) {}
  FakeWire rig;
  std::vector<frame::Sample> buffer = std::vector<frame::Sample>(4096);

  void SetUp() override {
    rig.driver->connect();
    rig.fake.advance(10);
    ASSERT_EQ(rig.drain().size(), 10U);
  }
  void expect_fault(Fault fault) {
    try {
      rig.driver->poll(buffer);
      FAIL() << "no error";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.fault(), fault) << error.what();
      EXPECT_THAT(error.what(), HasSubstr(rig.config.where()));
    }
  }
  /// Nothing missing, nothing twice, up to what the frame has taken.
  void expect_all_up_to_now(std::uint32_t first) {
    const auto samples = rig.drain();
    ASSERT_EQ(samples.size(), rig.fake.last_sequence() - first + 1);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      ASSERT_EQ(samples[i].sequence, first + i);
      ASSERT_EQ(samples[i].position_mm, FakeFrame::position_mm(samples[i].sequence));
    }
    EXPECT_EQ(rig.lost, 0U);
  }
};

INSTANTIATE_TEST_SUITE_P(Lines, ModbusFaults, testing::Values(Line::kTcp, Line::kRtu),
                         [](const auto& way) { return way.param == Line::kTcp ? "Tcp" : "Rtu"; });

/// Where answers do come too late, and not only those that a test holds back.
class ModbusTimeOuts : public ModbusFaults {
 protected:
  static constexpr int kTimeout_ms = 300;
  ModbusTimeOuts() : ModbusFaults(kTimeout_ms) {}

  /// As the daemon does: until the line works again, with a new connection where the old one is gone.
  template <typename Call>
  auto patiently(const Call& call) {
    for (int attempt = 0;; ++attempt) {
      try {
        if (attempt > 0 && !connected_) rig.driver->connect();
        connected_ = true;
        return call();
      } catch (const DeviceError& error) {
        if (error.fault() == Fault::kRefused || error.fault() == Fault::kIdentity || attempt == 30) throw;
        connected_ = connected_ && error.fault() != Fault::kDisconnected;
      }
    }
  }
  /// Until the driver has met what `hinder` does to the next answer. A machine that stands still may let a late answer
  /// through in time, and may make any answer late.
  void meets(Fault fault, const std::function<void()>& hinder, const std::function<void()>& call) {
    for (int attempt = 0; attempt < 30; ++attempt) {
      hinder();
      try {
        call();
      } catch (const DeviceError& error) {
        if (error.fault() == fault) return;
        ASSERT_EQ(error.fault(), Fault::kTimeout) << error.what();
      }
    }
    FAIL() << "not met";
  }
  /// The next so many after the first ten, each once.
  void expect_these(const frame::Poll& poll, std::size_t count) {
    ASSERT_EQ(poll.samples, count);
    EXPECT_EQ(poll.lost, 0U);
    for (std::size_t i = 0; i < count; ++i) {
      ASSERT_EQ(buffer[i].sequence, 11 + i);
      ASSERT_EQ(buffer[i].position_mm, FakeFrame::position_mm(buffer[i].sequence));
    }
  }

 private:
  bool connected_ = true;
};

INSTANTIATE_TEST_SUITE_P(Lines, ModbusTimeOuts, testing::Values(Line::kTcp, Line::kRtu),
                         [](const auto& way) { return way.param == Line::kTcp ? "Tcp" : "Rtu"; });

TEST_P(ModbusTimeOuts, ALateReplyIsNeverTheNextAnswer) {
  // The late answer to the header's read says 10 samples and an old time. Taken as the next, equal request's
  // answer it would hide the new samples and date the exchange back. All delays from "just late" to "during
  // the second request after".
  std::uint32_t seen = 10;
  for (const int late_ms : {kTimeout_ms + 50, 2 * kTimeout_ms - 50, 2 * kTimeout_ms + 50, 5 * kTimeout_ms / 2}) {
    meets(
        Fault::kTimeout, [&] { rig.faults.late_ms = late_ms; },
        [&] { EXPECT_EQ(rig.driver->poll(buffer).samples, 0U); });
    rig.fake.advance(5);
    const double device_us = static_cast<double>(rig.fake.device_us());
    // The probe itself may meet a gateway that still sits on its answer.
    const auto poll = patiently([&] { return rig.driver->poll(buffer); });
    ASSERT_EQ(poll.samples, 5U) << "late by " << late_ms << " ms";
    EXPECT_EQ(buffer[0].sequence, ++seen);
    ASSERT_TRUE(poll.has_exchange);
    EXPECT_EQ(poll.exchange.device_tx_us, device_us);
    seen += 4;
  }
  EXPECT_GE(rig.driver->statistics().resyncs, 4U);
}

TEST_P(ModbusTimeOuts, ALateWriteReplyIsNotTheHeartbeats) {
  meets(
      Fault::kTimeout, [&] { rig.faults.late_ms = kTimeout_ms + 50; }, [&] { rig.driver->heartbeat(1); });
  patiently([&] { rig.driver->heartbeat(2); });
  rig.fake.advance(1);
  const auto poll = patiently([&] { return rig.driver->poll(buffer); });
  ASSERT_EQ(poll.samples, 1U);
  EXPECT_EQ(buffer[0].sequence, 11U);
  EXPECT_EQ(poll.state.heartbeat_echo, 2);
}

TEST_P(ModbusTimeOuts, ADroppedReplyIsATimeOut) {
  rig.faults.drop = 1;
  expect_fault(Fault::kTimeout);
  rig.fake.advance(20);
  expect_these(patiently([&] { return rig.driver->poll(buffer); }), 20);
}

TEST_P(ModbusTimeOuts, ADamagedReplyIsNotBelieved) {
  rig.fake.advance(3);
  meets(
      Fault::kProtocol, [&] { rig.faults.corrupt = 1; }, [&] { (void)rig.driver->poll(buffer); });
  rig.fake.advance(20);
  expect_these(patiently([&] { return rig.driver->poll(buffer); }), 23);
}

TEST_P(ModbusTimeOuts, AStopWithoutAnswerIsGivenAgainWithinOneTimeOut) {
  FakeWire slow(GetParam(), "isorig-gateway.toml", 800);
  slow.driver->connect();
  slow.faults.drop = 1;
  const auto before = std::chrono::steady_clock::now();
  if (GetParam() == Line::kTcp) {
    EXPECT_NO_THROW(slow.driver->stop());
    EXPECT_EQ(slow.fake.stops(), 2) << "the first arrived, only its answer was lost; a stop may be given twice";
  } else {
    // On a shared line the second would run into the first one's answer.
    EXPECT_THROW(slow.driver->stop(), DeviceError);
    EXPECT_EQ(slow.fake.stops(), 1);
    EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::milliseconds(1600));
    EXPECT_NO_THROW(slow.driver->stop());
    EXPECT_EQ(slow.fake.stops(), 2);
  }
}

TEST_P(ModbusTimeOuts, AStopDoesNotWaitForALineInDoubt) {
  meets(
      Fault::kTimeout, [&] { rig.faults.late_ms = 2 * kTimeout_ms; }, [&] { (void)rig.driver->poll(buffer); });
  // The late answer is still to come; getting in step first would be a time-out and a probe.
  const auto before = std::chrono::steady_clock::now();
  patiently([&] { rig.driver->stop(); });
  const auto took = std::chrono::steady_clock::now() - before;
  EXPECT_GE(rig.fake.stops(), 1);
  EXPECT_LT(took, std::chrono::milliseconds(20 * kTimeout_ms));  // a machine that stands still
  std::printf("  a stop took %ld ms\n",
              static_cast<long>(std::chrono::duration_cast<std::chrono::milliseconds>(took).count()));
  rig.fake.advance(3);
  expect_these(patiently([&] { return rig.driver->poll(buffer); }), 3);
}

TEST_P(ModbusTimeOuts, AStartWithoutAnswerIsStoppedAndReported) {
  rig.faults.drop = -1;
  EXPECT_THROW(rig.driver->start_segment({3, 1.0F, 1.0F}), DeviceError);
  EXPECT_TRUE(rig.fake.started().empty()) << "set-points unconfirmed: nothing may start";
}

TEST_P(ModbusFaults, DelaysBelowTheTimeOutOnlyCostTime) {
  rig.faults.delay_ms = 20;
  rig.fake.advance(30);
  expect_all_up_to_now(11);
}

TEST_P(ModbusFaults, AFrozenFrameGivesNoSamplesAndNoTime) {
  rig.faults.freeze = true;
  rig.fake.advance(50);
  for (int i = 0; i < 3; ++i) {
    const auto poll = rig.driver->poll(buffer);
    EXPECT_EQ(poll.samples, 0U);
    EXPECT_FALSE(poll.has_exchange) << "a clock that stands still must not be mapped";
  }
  rig.driver->heartbeat(99);
  EXPECT_NE(rig.fake.state().heartbeat_echo, 99) << "the frame behind does not hear it, so its watchdog runs";
  rig.faults.freeze = false;
  expect_all_up_to_now(11);
  EXPECT_NE(rig.last.state.heartbeat_echo, 99);
}

TEST_P(ModbusFaults, ARefusedStartLeavesTheFrameAlone) {
  rig.faults.refuse = true;
  try {
    rig.driver->start_segment({3, 1.0F, 1.0F});
    FAIL() << "accepted";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kRefused) << error.what();
  }
  EXPECT_TRUE(rig.fake.started().empty());
  EXPECT_EQ(rig.fake.stops(), 0);
  rig.faults.refuse = false;
  rig.driver->start_segment({4, 1.0F, 1.0F});
  EXPECT_EQ(rig.fake.started().at(0).id, 4);
}

TEST_P(ModbusFaults, TheFramesOwnRefusalComesThrough) {
  rig.fake.refuse_segments(true);
  try {
    rig.driver->start_segment({3, 1.0F, 1.0F});
    FAIL() << "accepted";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kRefused) << error.what();
  }
  EXPECT_EQ(rig.fake.stops(), 0);
}

TEST_P(ModbusFaults, AClampedTargetIsFoundAndStopped) {
  rig.fake.clamp_target_mm(5.0F);
  try {
    rig.driver->start_segment({3, 8.0F, 1.0F});
    FAIL() << "accepted";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kRefused);
    EXPECT_THAT(error.what(), HasSubstr("to 5 mm"));
  }
  EXPECT_EQ(rig.fake.stops(), 1);
}

/// The loop makes the safe state of it (frame.number); an error here would only make the stream stale.
TEST_P(ModbusFaults, ASampleThatIsNoNumberIsHandedOn) {
  rig.fake.make_next_sample_invalid();
  rig.fake.advance(1);
  const auto poll = rig.driver->poll(buffer);
  ASSERT_EQ(poll.samples, 1U);
  EXPECT_FALSE(std::isfinite(buffer[0].force_N) && std::isfinite(buffer[0].position_mm));
}

TEST_P(ModbusFaults, AnotherFrameIsNotAccepted) {
  rig.driver->disconnect();
  rig.faults.wrong_identity = true;
  try {
    rig.driver->connect();
    FAIL() << "accepted";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kIdentity) << error.what();
  }
  rig.faults.wrong_identity = false;
  rig.config.expected_serial = "F-0043";
  frame::ModbusFrame other(rig.config, rig.fake.clock());
  try {
    other.connect();
    FAIL() << "accepted";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kIdentity);
    EXPECT_THAT(error.what(), HasSubstr("F-0042"));
  }
}

TEST_P(ModbusFaults, ARestartedFrameIsNotTakenForTheOldOne) {
  rig.fake.set_next(1, 0);
  rig.fake.advance(3);
  // Counter 13 -> 3 is no progress; only a new connection may begin a new count.
  expect_fault(Fault::kDisconnected);
  EXPECT_EQ(rig.driver->connect().reference_epoch, 2U) << "it may count positions from another zero";
  rig.fake.advance(4);
  const auto samples = rig.drain();
  ASSERT_EQ(samples.size(), 4U);
  EXPECT_EQ(samples[0].sequence, 4U);
  EXPECT_EQ(samples[3].device_us, 7000);
}

TEST(ModbusReconnect, ALostConnectionLosesNoSample) {
  FakeWire rig(Line::kTcp);
  const auto reference = rig.driver->connect().reference_epoch;
  EXPECT_EQ(reference, 1U);
  rig.fake.advance(10);
  ASSERT_EQ(rig.drain().size(), 10U);
  std::vector<frame::Sample> buffer(4096);

  rig.faults.disconnect = true;
  const auto fails_with = [&](auto&& call) {
    try {
      call();
    } catch (const DeviceError& error) {
      return error.fault() == Fault::kDisconnected;
    }
    return false;
  };
  EXPECT_TRUE(fails_with([&] { rig.driver->poll(buffer); }));
  EXPECT_TRUE(fails_with([&] { rig.driver->poll(buffer); })) << "without connect() nothing comes back by itself";
  EXPECT_TRUE(fails_with([&] { rig.driver->connect(); }));
  rig.fake.advance(700);

  rig.faults.disconnect = false;
  EXPECT_EQ(rig.driver->connect().reference_epoch, reference) << "the frame never stopped counting";
  const auto samples = rig.drain();
  ASSERT_EQ(samples.size(), 700U) << "the ring held them all meanwhile";
  EXPECT_EQ(samples.front().sequence, 11U);
  EXPECT_EQ(rig.lost, 0U);
}

/// A break in which nobody saw the frame: clock and counter afterwards, and whether it may be called the same one.
class ModbusBreak : public ::testing::Test {
 protected:
  ModbusBreak() {
    before_ = rig_.driver->connect().reference_epoch;
    rig_.fake.advance(10);  // counter 10, clock 10 ms
    EXPECT_EQ(rig_.drain().size(), 10U);
    rig_.driver->disconnect();
  }
  bool is_the_same(double break_s, std::uint32_t counter, double device_s) {
    auto& clock = rig_.fake.clock();
    clock.sleep_until_ns(clock.now_ns() + static_cast<std::int64_t>(1e9 * break_s));
    rig_.fake.set_next(counter, static_cast<std::int64_t>(1e6 * device_s));
    rig_.fake.advance(1);
    return rig_.driver->connect().reference_epoch == before_;
  }
  FakeWire rig_{Line::kTcp};
  std::uint32_t before_ = 0;
};

TEST_F(ModbusBreak, AFrameWhoseClockIsSomewhatFastIsTheSame) {
  EXPECT_TRUE(is_the_same(3600.0, 3'601'000, 3601.0));
}

TEST_F(ModbusBreak, ACounterThatIsTooSlowIsARestart) {
  EXPECT_FALSE(is_the_same(60.0, 2000, 60.0)) << "the clock agrees; of 60000 samples 2000 were counted";
}

TEST_F(ModbusBreak, ACounterThatIsTooFastIsARestart) {
  EXPECT_FALSE(is_the_same(60.0, 90'000, 60.0));
}

/// 100 h: 84 turns of the clock less 779 s, which 0.1 % of the time, 360 s, is a good part of.
TEST_F(ModbusBreak, AfterSoLongThatTheClockSaysNothingItIsARestart) {
  const double turn_s = 0x1p32 * 1e-6;
  const double device_s = std::fmod(360'000.0, turn_s) + 200.0;
  EXPECT_FALSE(is_the_same(360'000.0, 360'000'000, device_s));
}

TEST(ModbusReconnect, ASecondClientWaitsUntilTheFirstIsSilent) {
  FakeWire rig(Line::kTcp);
  rig.driver->connect();
  std::vector<frame::Sample> buffer(16);
  rig.driver->poll(buffer);
  rig.config.response_timeout_ms = 300;
  frame::ModbusFrame second(rig.config, rig.fake.clock());
  EXPECT_THROW(second.connect(), DeviceError);
  const auto before = std::chrono::steady_clock::now();
  EXPECT_NO_THROW(rig.driver->poll(buffer)) << "the first must not notice";

  const auto heard = std::chrono::steady_clock::now();
  const auto is_taken = [&] {
    try {
      return second.connect().serial == "F-0042";
    } catch (const DeviceError&) {
      return false;
    }
  };
  while (!is_taken()) {
    ASSERT_LT(std::chrono::steady_clock::now() - heard, std::chrono::seconds(30));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_GE(std::chrono::steady_clock::now() - before, std::chrono::milliseconds(FakeWire::kSilence_ms));
  EXPECT_THROW(rig.driver->poll(buffer), DeviceError);
  EXPECT_NO_THROW(second.poll(buffer));
}

TEST(ModbusReconnect, ATtyThatIsNotThereSaysSo) {
  FakeWire rig(Line::kRtu);
  rig.config.tty = "/dev/does-not-exist";
  frame::ModbusFrame driver(rig.config, rig.fake.clock());
  try {
    driver.connect();
    FAIL() << "connected";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kDisconnected);
    EXPECT_THAT(error.what(), HasSubstr("dialout"));
  }
}

}  // namespace
}  // namespace isorig::sim
