// The real driver against the emulator, over real sockets and pseudo-terminals: what goes through, unharmed.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "fake_wire.hpp"
#include "tree.hpp"

namespace isorig::sim {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using frame::Motion;
using testing::HasSubstr;

struct Way {
  Line line;
  const char* map;
};

void PrintTo(const Way& way, std::ostream* out) {
  PrintTo(way.line, out);
  *out << ", " << way.map;
}

class ModbusWire : public testing::TestWithParam<Way> {
 protected:
  FakeWire rig{GetParam().line, GetParam().map};

  /// Each value is its own and each sequence follows the one before.
  void expect_run(const std::vector<frame::Sample>& samples, std::uint32_t first, std::size_t count) {
    ASSERT_EQ(samples.size(), count);
    for (std::size_t i = 0; i < count; ++i) {
      const auto sequence = first + static_cast<std::uint32_t>(i);
      ASSERT_EQ(samples[i].sequence, sequence);
      ASSERT_EQ(samples[i].position_mm, FakeFrame::position_mm(sequence)) << sequence;
      ASSERT_EQ(samples[i].force_N, FakeFrame::force_N(sequence)) << sequence;
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Maps, ModbusWire,
                         testing::Values(Way{Line::kTcp, "isorig-gateway.toml"}, Way{Line::kTcp, "int32-scaled.toml"},
                                         Way{Line::kRtu, "isorig-gateway.toml"}, Way{Line::kRtu, "int32-scaled.toml"}),
                         [](const auto& way) {
                           return std::string(way.param.line == Line::kTcp ? "Tcp" : "Rtu") +
                                  (way.param.map[0] == 'i' && way.param.map[1] == 's' ? "Gateway" : "Int32");
                         });

TEST_P(ModbusWire, IdentityIsRead) {
  const auto identity = rig.driver->connect();
  EXPECT_EQ(identity.serial, "F-0042");
  EXPECT_EQ(identity.sample_rate_hz, rig.config.map.sample_rate_Hz);
  if (rig.config.map.model) {
    EXPECT_EQ(identity.maker, "isorig");
    EXPECT_EQ(identity.model, "fake frame");
    EXPECT_EQ(identity.firmware, "1.0");
  }
}

TEST_P(ModbusWire, EverySampleComesOnceAndUnchanged) {
  rig.driver->connect();
  std::uint32_t next = 1;
  for (const std::uint32_t burst : {0U, 1U, 2U, 10U, 19U, 20U, 21U, 45U, 333U, 7U}) {
    rig.fake.advance(burst);
    expect_run(rig.drain(), next, burst);
    next += burst;
  }
  EXPECT_EQ(rig.lost, 0U);
}

TEST_P(ModbusWire, WhatDoesNotFitStaysForTheNextCall) {
  rig.driver->connect();
  rig.fake.advance(100);
  expect_run(rig.drain(7), 1, 100);
  EXPECT_EQ(rig.lost, 0U);
}

TEST_P(ModbusWire, SamplesAreDatedByTheFramesClock) {
  // Half way through, the 32 bits of the frame's clock wrap.
  const double tick_us = rig.config.map.at(modbus::Quantity::kDeviceTime_us)->format.scale;
  const auto turn_us = static_cast<std::int64_t>(0x1p32 * tick_us);
  rig.fake.set_next(1, turn_us - static_cast<std::int64_t>(1250 * 1e6 / rig.config.map.sample_rate_Hz));
  rig.driver->connect();
  const auto period_us = static_cast<std::int64_t>(1e6 / rig.config.map.sample_rate_Hz);
  for (int i = 0; i < 10; ++i) {
    rig.fake.advance(250);
    const auto before = rig.fake.device_us();
    const auto samples = rig.drain();
    ASSERT_EQ(samples.size(), 250U);
    EXPECT_EQ(samples.back().device_us, before);
    EXPECT_EQ(samples.front().device_us, before - 249 * period_us);
  }
  EXPECT_GT(rig.fake.device_us(), turn_us);
}

TEST_P(ModbusWire, ExchangeEnclosesTheFramesTime) {
  rig.driver->connect();
  rig.fake.advance(5);
  std::vector<frame::Sample> out(100);
  const auto poll = rig.driver->poll(out);
  ASSERT_TRUE(poll.has_exchange);
  EXPECT_LE(poll.exchange.host_send_ns, poll.exchange.host_recv_ns);
  EXPECT_EQ(poll.exchange.device_rx_us, static_cast<double>(rig.fake.device_us()));
  EXPECT_EQ(poll.exchange.device_tx_us, poll.exchange.device_rx_us);
}

TEST_P(ModbusWire, CounterWrapsAt32Bit) {
  rig.fake.set_next(0xFFFFFFFFU - 249, 5'000'000);
  rig.fake.advance(1);  // the newest sample at connect is 2^32 - 250
  rig.driver->connect();
  rig.fake.advance(500);
  expect_run(rig.drain(64), 0xFFFFFFFFU - 248, 500);
  EXPECT_EQ(rig.fake.last_sequence(), 250U);
  EXPECT_EQ(rig.lost, 0U);
}

TEST_P(ModbusWire, RingOverrunIsCountedExactly) {
  rig.driver->connect();
  const std::uint32_t usable = rig.config.map.samples.slots - 1;
  rig.fake.advance(usable + 123);
  const auto samples = rig.drain();
  EXPECT_EQ(rig.lost, 123U);
  expect_run(samples, 124, usable);
}

/// A gateway that was held up for longer than its frame remembers: the counter goes on over slots nobody has written.
/// Maps whose slots hold a stamp: without it nothing in a slot tells which turn of the ring it is of.
class ModbusWireWithStamps : public ModbusWire {};
INSTANTIATE_TEST_SUITE_P(Maps, ModbusWireWithStamps,
                         testing::Values(Way{Line::kTcp, "isorig-gateway.toml"},
                                         Way{Line::kRtu, "isorig-gateway.toml"}),
                         [](const auto& way) { return way.param.line == Line::kTcp ? "Tcp" : "Rtu"; });

TEST_P(ModbusWireWithStamps, SlotsOfAnotherTurnOfTheRingAreLostAndNotServedAgain) {
  ASSERT_TRUE(rig.config.map.samples.time_us);
  rig.fake.advance(1);
  rig.driver->connect();
  const std::uint32_t slots = rig.config.map.samples.slots;
  std::uint32_t next = 2;
  std::uint64_t lost = 0;
  for (const std::uint32_t before : {10U, slots / 2, slots / 2, 300U, 7U}) {  // the first turn of the ring, and later
    rig.fake.skip(94);
    rig.fake.advance(before);
    lost += 94;
    expect_run(rig.drain(), next + 94, before);
    EXPECT_EQ(rig.lost, lost);
    next += 94 + before;
  }
  EXPECT_EQ(rig.driver->statistics().misplaced_samples, lost);
}

TEST_P(ModbusWire, AClockThatIsSetBackLosesNoSample) {
  rig.driver->connect();
  rig.fake.advance(100);
  expect_run(rig.drain(), 1, 100);
  rig.fake.set_next(101, -3'000'000);
  rig.fake.advance(50);
  expect_run(rig.drain(), 101, 50);
  rig.fake.advance(50);
  expect_run(rig.drain(), 151, 50);
  EXPECT_EQ(rig.lost, 0U);
}

TEST_P(ModbusWire, NothingTornIsPassedOnWhenTheFrameOvertakes) {
  rig.driver->connect();
  const std::uint32_t slots = rig.config.map.samples.slots;
  rig.fake.advance(slots - 10);
  rig.fake.advance_on_poll(3);  // per request and while idle: the ring turns while it is read
  std::vector<frame::Sample> all, part(4096);
  for (int i = 0; i < 5; ++i) {
    const auto poll = rig.driver->poll(part);
    rig.lost += poll.lost;
    all.insert(all.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(poll.samples));
  }
  rig.fake.advance_on_poll(0);
  const auto rest = rig.drain();
  all.insert(all.end(), rest.begin(), rest.end());
  EXPECT_GT(rig.lost, 0U) << "the ring was not overtaken: the test shows nothing";
  EXPECT_EQ(all.size() + rig.lost, rig.fake.last_sequence());
  std::uint32_t previous = 0;
  for (const auto& sample : all) {
    ASSERT_GT(sample.sequence, previous);
    ASSERT_EQ(sample.position_mm, FakeFrame::position_mm(sample.sequence)) << sample.sequence;
    ASSERT_EQ(sample.force_N, FakeFrame::force_N(sample.sequence)) << sample.sequence;
    previous = sample.sequence;
  }
}

TEST_P(ModbusWire, SegmentIsStartedReadBackAndStopped) {
  rig.driver->connect();
  rig.driver->start_segment({7, 12.34567F, 0.05F});
  const auto started = rig.fake.started();
  ASSERT_EQ(started.size(), 1U);
  EXPECT_EQ(started[0].id, 7);
  EXPECT_NEAR(started[0].target_mm, 12.34567F, 1e-5);
  EXPECT_NEAR(started[0].velocity_mm_s, 0.05F, 1e-6);

  rig.drain();
  EXPECT_EQ(rig.last.state.motion, Motion::kMoving);
  EXPECT_EQ(rig.last.state.segment_id, 7);
  EXPECT_NEAR(rig.last.state.target_mm, 12.34567F, 1e-5);

  rig.driver->stop();
  rig.driver->stop();
  EXPECT_EQ(rig.fake.stops(), 2);
  rig.drain();
  EXPECT_EQ(rig.last.state.motion, Motion::kStopped);
}

TEST_P(ModbusWire, NegativeTargetsKeepTheirSign) {
  rig.driver->connect();
  rig.driver->start_segment({8, -4.0F, 10.0F});
  EXPECT_EQ(rig.fake.started().at(0).target_mm, -4.0F);
}

TEST_P(ModbusWire, HeartbeatReachesTheFrameAndComesBack) {
  rig.driver->connect();
  rig.driver->heartbeat(0xBEEF);
  rig.fake.set_fault_bits(frame::kHeartbeatLost | frame::kTravelLimit);
  rig.drain();
  EXPECT_EQ(rig.fake.state().heartbeat_echo, 0xBEEF);
  EXPECT_EQ(rig.last.state.heartbeat_echo, 0xBEEF);
  EXPECT_EQ(rig.last.state.fault_bits, frame::kHeartbeatLost | frame::kTravelLimit);
}

TEST(ModbusWireMaps, NarrowCounterIsExtended) {
  std::ifstream in(test::source_path("/config/frames/isorig-gateway.toml"));
  std::ostringstream file;
  file << in.rdbuf();
  auto text = file.str();
  const std::string counter = "sample_counter = { address = 64, type = \"uint32\" }";
  text.replace(text.find(counter), counter.size(), "sample_counter = { address = 64, type = \"uint16\" }");
  text.replace(text.find("unit_id = 1"), 11, "unit_id = 1\nbridge_gap_registers = 1");
  FakeWire rig(Line::kTcp, modbus::read_register_map(base::TomlDocument::parse_text(text, "narrow.toml")));
  rig.fake.set_next(65400, 1'000'000);
  rig.fake.advance(1);
  rig.driver->connect();
  rig.fake.advance(300);
  const auto samples = rig.drain();
  ASSERT_EQ(samples.size(), 300U);
  EXPECT_EQ(samples.front().sequence, 65401U);
  EXPECT_EQ(samples.back().sequence, 65700U) << "16 bits wrapped at 65536";
  EXPECT_EQ(samples.back().position_mm, FakeFrame::position_mm(65700));
}

TEST(ModbusWireLimits, SetPointThatDoesNotFitItsRegisterIsRefused) {
  FakeWire rig(Line::kTcp, "int32-scaled.toml");
  rig.driver->connect();
  try {
    rig.driver->start_segment({1, 30000.0F, 1.0F});  // 3e9 counts of 10 nm
    FAIL() << "accepted";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kRefused);
    EXPECT_THAT(error.what(), HasSubstr("does not fit"));
  }
  EXPECT_TRUE(rig.fake.started().empty());
}

TEST(ModbusWireLimits, ADescriptorAbove1024IsLikeAnyOther) {
  FakeWire rig(Line::kTcp);
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &limit), 0);
  if (limit.rlim_cur < 1100) {
    limit.rlim_cur = 1100;
    ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &limit), 0);
  }
  std::vector<int> taken;
  do {
    taken.push_back(open("/dev/null", O_RDONLY | O_CLOEXEC));
    ASSERT_GE(taken.back(), 0);
  } while (taken.back() < 1030);
  // select(), which libmodbus waits with, would write outside of its set.
  EXPECT_EQ(rig.driver->connect().serial, "F-0042");
  for (const int fd : taken) close(fd);
}

}  // namespace
}  // namespace isorig::sim
