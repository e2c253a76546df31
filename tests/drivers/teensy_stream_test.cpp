#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <deque>
#include <fstream>
#include <functional>
#include <memory>
#include <vector>

#include "drivers/api/error.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "error_of.hpp"

namespace isorig::pressure {
namespace {

namespace wire = messages::teensy;
using drivers::DeviceError;
using drivers::Fault;
using test::error_of;
using testing::HasSubstr;

/// A device of bytes: a script answers what the driver writes; reading costs virtual time when nothing is
/// there.
class ScriptedStream final : public ByteStream {
 public:
  explicit ScriptedStream(clock::VirtualClock& clock) : clock_(clock) {}
  void open() override { is_open_ = true; }
  void close() noexcept override { is_open_ = false; }
  [[nodiscard]] bool is_open() const noexcept override { return is_open_; }
  std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) override {
    if (incoming.empty()) {
      clock_.sleep_until_ns(clock_.now_ns() + timeout_ns);
      return 0;
    }
    const std::size_t size = std::min(out.size(), incoming.size());
    std::copy_n(incoming.begin(), size, out.begin());
    incoming.erase(incoming.begin(), incoming.begin() + static_cast<long>(size));
    return size;
  }
  void write_all(std::span<const std::uint8_t> bytes) override {
    if (write_error) throw DeviceError(*write_error, "scripted");
    written.insert(written.end(), bytes.begin(), bytes.end());
    decoder_.feed(bytes.data(), bytes.size(), [this](const wire::Packet& packet) {
      if (on_packet) on_packet(packet);
    });
  }
  [[nodiscard]] std::string name() const override { return "scripted"; }

  void push(const wire::Frame& frame) { incoming.insert(incoming.end(), frame.bytes, frame.bytes + frame.size); }

  std::deque<std::uint8_t> incoming;
  std::vector<std::uint8_t> written;
  std::optional<Fault> write_error;
  std::function<void(const wire::Packet&)> on_packet;

 private:
  clock::VirtualClock& clock_;
  wire::Decoder decoder_;
  bool is_open_ = false;
};

wire::Identity an_identity(std::uint32_t session) {
  wire::Identity identity;
  identity.session = session;
  identity.sample_rate_mhz = 1'000'000;
  identity.watchdog_ms = 200;
  identity.device_us = 10'000'000;
  identity.next_sequence = 100;
  std::strcpy(identity.model, "isorig-teensy36");
  std::strcpy(identity.serial, "1234560");
  std::strcpy(identity.firmware, "0.1");
  return identity;
}

wire::Frame a_sample(std::uint32_t sequence, std::uint32_t device_us) {
  wire::Samples samples;
  samples.count = 1;
  samples.items[0] = {sequence, device_us, 0x19990000U + sequence};
  return encode(samples);
}

class TeensyOnScript : public testing::Test {
 protected:
  TeensyOnScript() {
    auto owned = std::make_unique<ScriptedStream>(clock);
    stream = owned.get();
    stream->on_packet = [this](const wire::Packet& packet) { answer_identity(packet); };
    device = std::make_unique<Teensy>(Teensy::Options{.serial = "1234560"}, std::move(owned), clock);
  }
  void answer_identity(const wire::Packet& packet) {
    if (wire::IdentityRequest request; parse(packet, request)) stream->push(encode(an_identity(request.session)));
  }
  Poll poll() { return device->poll(samples, exchanges, 0); }

  clock::VirtualClock clock{5'000'000'000};
  ScriptedStream* stream = nullptr;
  std::unique_ptr<Teensy> device;
  std::array<Sample, 64> samples{};
  std::array<clock::Exchange, 64> exchanges{};
};

TEST_F(TeensyOnScript, ConnectReportsTheIdentity) {
  const Identity identity = device->connect();
  EXPECT_EQ(identity.model, "isorig-teensy36");
  EXPECT_EQ(identity.serial, "1234560");
  EXPECT_EQ(identity.firmware, "0.1");
  EXPECT_EQ(identity.protocol_version, wire::kProtocolVersion);
  EXPECT_DOUBLE_EQ(identity.sample_rate_hz, 1000.0);
  EXPECT_EQ(device->watchdog_ms(), 200);
  EXPECT_EQ(stream->written.front(), 0) << "ends what the device may have half received";
}

TEST_F(TeensyOnScript, AsksAgainWhenTheFirstRequestWasLost) {
  int requests = 0;
  stream->on_packet = [&](const wire::Packet& packet) {
    if (++requests == 3) answer_identity(packet);
  };
  const std::int64_t start_ns = clock.now_ns();
  device->connect();
  EXPECT_EQ(clock.now_ns() - start_ns, 400'000'000);
}

TEST_F(TeensyOnScript, SilenceIsATimeOut) {
  stream->on_packet = nullptr;
  const DeviceError error = error_of([&] { device->connect(); });
  EXPECT_EQ(error.fault(), Fault::kTimeout);
  EXPECT_THAT(error.what(), HasSubstr("nobody answers"));
  EXPECT_FALSE(stream->is_open());
}

TEST_F(TeensyOnScript, WhatComesAndIsNoAnswerIsSaid) {
  stream->on_packet = nullptr;
  stream->incoming.assign(100'000, 'U');  // another sketch that prints, or another baud rate
  const DeviceError error = error_of([&] { device->connect(); });
  EXPECT_EQ(error.fault(), Fault::kTimeout);
  EXPECT_THAT(error.what(), HasSubstr("100000 bytes came and no frame of the isorig firmware among them"));
}

TEST_F(TeensyOnScript, ConnectsOnlyToADeviceThatKeepsTheLimits) {
  const FillLimits wanted{.pressure_max_psi = 24.0, .fill_allowance_permille = 75, .fill_max_ms = 6500};
  device->set_limits(wanted);
  int asked = 0;
  wire::LimitsReply answer;
  const auto with = [&](int answers_from, std::function<void(wire::LimitsReply&)> change) {
    stream->on_packet = [&, answers_from, change](const wire::Packet& packet) {
      answer_identity(packet);
      wire::Limits limits;
      if (!parse(packet, limits) || ++asked < answers_from) return;
      answer = {limits, 1};
      change(answer);
      stream->push(encode(answer));
    };
  };
  with(2, [](wire::LimitsReply&) {});  // the first was lost
  device->connect();
  EXPECT_EQ(asked, 2);
  EXPECT_EQ(answer.limits.pressure_max_raw, 12'124);  // 24 psi, rounded down
  EXPECT_EQ(answer.limits.fill_allowance_permille, 75);
  EXPECT_EQ(answer.limits.fill_max_ms, 6500U);

  with(0, [](wire::LimitsReply& reply) { reply.limits.pressure_max_raw += 1; });
  EXPECT_EQ(error_of([&] { device->connect(); }).fault(), Fault::kIdentity);
  with(0, [](wire::LimitsReply& reply) { reply.accepted = 0; });
  const DeviceError refused = error_of([&] { device->connect(); });
  EXPECT_EQ(refused.fault(), Fault::kIdentity);
  EXPECT_THAT(refused.what(), HasSubstr("other limits"));
  EXPECT_FALSE(stream->is_open());

  stream->on_packet = [this](const wire::Packet& packet) { answer_identity(packet); };
  const DeviceError silent = error_of([&] { device->connect(); });
  EXPECT_EQ(silent.fault(), Fault::kTimeout);
  EXPECT_THAT(silent.what(), HasSubstr("limits"));
}

TEST_F(TeensyOnScript, AnAnswerToAnEarlierSessionIsNotTaken) {
  stream->on_packet = [&](const wire::Packet& packet) {
    wire::IdentityRequest request;
    ASSERT_TRUE(parse(packet, request));
    stream->push(encode(an_identity(request.session - 1)));
  };
  const DeviceError error = error_of([&] { device->connect(); });
  EXPECT_EQ(error.fault(), Fault::kTimeout);
  EXPECT_THAT(error.what(), HasSubstr("does not answer who it is"));
}

TEST_F(TeensyOnScript, RefusesAnotherSerialNumberModelOrVersion) {
  struct Case {
    std::function<void(wire::Identity&)> change;
    std::uint8_t version;
    const char* text;
  };
  for (const Case& test : {Case{[](auto& identity) { std::strcpy(identity.serial, "7654320"); }, wire::kProtocolVersion,
                                "serial number '7654320'"},
                           Case{[](auto& identity) { std::strcpy(identity.model, "coffee-machine"); },
                                wire::kProtocolVersion, "'coffee-machine'"},
                           Case{[](auto&) {}, 1, "speaks protocol version 1"},  // which caps nothing by itself
                           Case{[](auto&) {}, 3, "speaks protocol version 3"}}) {
    stream->incoming.clear();
    stream->on_packet = [&](const wire::Packet& packet) {
      wire::IdentityRequest request;
      ASSERT_TRUE(parse(packet, request));
      wire::Identity identity = an_identity(request.session);
      test.change(identity);
      const wire::Frame frame = encode(identity);
      wire::Decoder decoder;
      decoder.feed(frame.bytes, frame.size, [&](const wire::Packet& sent) {
        stream->push(wire::make_frame(test.version, sent.type, sent.body, sent.size));
      });
    };
    const DeviceError error = error_of([&] { device->connect(); });
    EXPECT_EQ(error.fault(), Fault::kIdentity);
    EXPECT_THAT(error.what(), HasSubstr(test.text));
    EXPECT_FALSE(stream->is_open());
  }
}

TEST_F(TeensyOnScript, CountsGapsAndDropsRepeats) {
  device->connect();
  for (const std::uint32_t sequence : {100U, 101U, 101U, 105U, 104U, 106U}) {
    stream->push(a_sample(sequence, 10'000'000 + sequence * 1000));
  }
  const Poll result = poll();
  ASSERT_EQ(result.samples, 4U);
  EXPECT_EQ(samples[2].sequence, 105U);
  EXPECT_EQ(samples[3].sequence, 106U);
  EXPECT_EQ(samples[3].raw_word, 0x19990000U + 106U);
  EXPECT_EQ(result.lost, 3U);
  EXPECT_EQ(device->counters().duplicates, 2U);
  EXPECT_EQ(poll().lost, 0U);
}

TEST_F(TeensyOnScript, SequenceWraps) {
  stream->on_packet = [&](const wire::Packet& packet) {
    wire::IdentityRequest request;
    ASSERT_TRUE(parse(packet, request));
    wire::Identity identity = an_identity(request.session);
    identity.next_sequence = 0xFFFFFFFE;
    stream->push(encode(identity));
  };
  device->connect();
  for (const std::uint32_t sequence : {0xFFFFFFFEU, 0xFFFFFFFFU, 0U, 1U}) stream->push(a_sample(sequence, 10'000'000));
  const Poll result = poll();
  EXPECT_EQ(result.samples, 4U);
  EXPECT_EQ(result.lost, 0U);
}

TEST_F(TeensyOnScript, WhatDoesNotFitComesWithTheNextPolls) {
  device->connect();
  for (std::uint32_t i = 0; i < 50; ++i) stream->push(a_sample(100 + i, 10'000'000 + i));
  std::uint32_t next = 100;
  for (int i = 0; i < 10; ++i) {
    const Poll result = device->poll(std::span(samples).first(7), {}, 0);
    for (std::size_t k = 0; k < result.samples; ++k) EXPECT_EQ(samples[k].sequence, next++);
  }
  EXPECT_EQ(next, 150U);
}

TEST_F(TeensyOnScript, LateRepliesGoToTheirOwnRequests) {
  device->connect();
  std::vector<std::uint32_t> cookies;
  stream->on_packet = [&](const wire::Packet& packet) {
    if (wire::TimeSyncRequest request; parse(packet, request)) cookies.push_back(request.cookie);
  };
  const std::int64_t first_ns = clock.now_ns();
  device->request_time_sync();
  clock.sleep_until_ns(first_ns + 10'000'000);
  device->request_time_sync();
  clock.sleep_until_ns(first_ns + 12'000'000);
  ASSERT_EQ(cookies.size(), 2U);
  EXPECT_NE(cookies[0], cookies[1]);
  stream->push(encode(wire::TimeSyncReply{cookies[0], 10'000'100, 10'000'120}));
  stream->push(encode(wire::TimeSyncReply{cookies[1], 10'011'000, 10'011'000}));
  stream->push(encode(wire::TimeSyncReply{cookies[1], 10'011'000, 10'011'000}));  // answered already
  stream->push(encode(wire::TimeSyncReply{cookies[1] + 1, 10'011'000, 10'011'000}));
  const Poll result = poll();
  ASSERT_EQ(result.exchanges, 2U);
  EXPECT_EQ(exchanges[0].host_send_ns, first_ns);
  EXPECT_EQ(exchanges[0].host_recv_ns, first_ns + 12'000'000);
  EXPECT_DOUBLE_EQ(exchanges[0].device_rx_us, 10'000'100.0);
  EXPECT_DOUBLE_EQ(exchanges[0].device_tx_us, 10'000'120.0);
  EXPECT_EQ(exchanges[1].host_send_ns, first_ns + 10'000'000);
  EXPECT_EQ(device->counters().unmatched_replies, 2U);

  device->request_time_sync();
  clock.sleep_until_ns(clock.now_ns() + 1'000'000'001);
  stream->push(encode(wire::TimeSyncReply{cookies[2], 10'020'000, 10'020'000}));
  EXPECT_EQ(poll().exchanges, 0U) << "older than any useful exchange";
}

TEST_F(TeensyOnScript, RepliesOfAnEarlierConnectionAreNotTaken) {
  std::uint32_t cookie = 0;
  stream->on_packet = [&](const wire::Packet& packet) {
    answer_identity(packet);
    if (wire::TimeSyncRequest request; parse(packet, request)) cookie = request.cookie;
  };
  device->connect();
  device->request_time_sync();
  clock.sleep_until_ns(clock.now_ns() + 1'000'000);
  device->connect();
  device->request_time_sync();
  stream->push(encode(wire::TimeSyncReply{cookie - 1, 10'020'000, 10'020'000}));
  EXPECT_EQ(poll().exchanges, 0U);
}

TEST_F(TeensyOnScript, AReconnectCountsWhatWasMissed) {
  device->connect();
  stream->push(a_sample(100, 10'000'000));
  EXPECT_EQ(poll().samples, 1U);
  stream->on_packet = [&](const wire::Packet& packet) {
    wire::IdentityRequest request;
    ASSERT_TRUE(parse(packet, request));
    wire::Identity identity = an_identity(request.session);
    identity.device_us = 12'000'000;
    identity.next_sequence = 2100;
    stream->push(encode(identity));
  };
  device->connect();
  EXPECT_EQ(poll().lost, 1999U);

  stream->on_packet = [&](const wire::Packet& packet) {  // and this one was switched off in between
    wire::IdentityRequest request;
    ASSERT_TRUE(parse(packet, request));
    wire::Identity identity = an_identity(request.session);
    identity.device_us = 300'000;
    identity.next_sequence = 3;
    stream->push(encode(identity));
  };
  device->connect();
  stream->push(a_sample(3, 301'000));
  const Poll result = poll();
  EXPECT_EQ(result.lost, 0U);
  ASSERT_EQ(result.samples, 1U);
  EXPECT_EQ(samples[0].device_us, 301'000);
}

TEST_F(TeensyOnScript, ADeviceThatStartsAnewIsNoticed) {
  device->connect();
  wire::Status status;
  status.device_us = 20'000'000;
  stream->push(encode(status));
  poll();
  status.device_us = 100;
  stream->push(encode(status));
  EXPECT_EQ(error_of([&] { poll(); }).fault(), Fault::kDisconnected);

  device->connect();
  stream->push(a_sample(100'000, 11'000'000));
  poll();
  stream->push(a_sample(0, 11'000'000));
  EXPECT_EQ(error_of([&] { poll(); }).fault(), Fault::kDisconnected);
}

TEST_F(TeensyOnScript, ReportsAVentThatIsOverAlreadyOnce) {
  device->connect();
  wire::Status status;
  status.device_us = 10'000'000;
  status.self_vents = 4;  // before our time
  stream->push(encode(status));
  EXPECT_FALSE(poll().state.vented_by_itself);
  status.self_vents = 5;
  status.cause = wire::VentCause::kFillTime;
  stream->push(encode(status));
  const State vented = poll().state;
  EXPECT_TRUE(vented.vented_by_itself);
  EXPECT_EQ(vented.cause, VentCause::kFillTime);
  EXPECT_FALSE(poll().state.vented_by_itself);
  status.flags = wire::kStatusSelfVented;
  stream->push(encode(status));
  EXPECT_TRUE(poll().state.vented_by_itself);
  EXPECT_TRUE(poll().state.vented_by_itself);
}

TEST_F(TeensyOnScript, CountsCorruptAndForeignFrames) {
  device->connect();
  wire::Frame broken = a_sample(100, 0);
  broken.bytes[5] ^= 0x10;
  stream->push(broken);
  const std::uint8_t body[4] = {};
  stream->push(wire::make_frame(9, 0x44, body, 4));
  stream->push(encode(wire::Heartbeat{}));  // our own, echoed
  EXPECT_EQ(poll().corrupt, 3U);
  EXPECT_EQ(poll().corrupt, 0U);
  EXPECT_EQ(device->counters().unexpected, 2U);
}

TEST_F(TeensyOnScript, RefusesSenselessDuties) {
  device->connect();
  stream->written.clear();
  EXPECT_EQ(error_of([&] { device->command({.fill_permille = 1001}); }).fault(), Fault::kRefused);
  EXPECT_EQ(error_of([&] { device->command({.fill_permille = 1, .vent_permille = 1}); }).fault(), Fault::kRefused);
  EXPECT_TRUE(stream->written.empty());
}

TEST_F(TeensyOnScript, AFrameCutShortByATimeOutDoesNotSpoilTheNext) {
  device->connect();
  stream->write_error = Fault::kTimeout;
  EXPECT_EQ(error_of([&] { device->heartbeat(); }).fault(), Fault::kTimeout);
  stream->write_error.reset();
  stream->written.clear();
  device->heartbeat();
  EXPECT_EQ(stream->written.front(), 0);
  stream->written.clear();
  device->heartbeat();
  EXPECT_NE(stream->written.front(), 0);
}

TEST_F(TeensyOnScript, HandsOverSyncEdgesAndCountsLostOnes) {
  device->connect();
  EXPECT_FALSE(device->take_sync_edge());
  stream->push(encode(wire::SyncEdge{1ULL << 40U, 7, 1}));
  stream->push(encode(wire::SyncEdge{(1ULL << 40U) + 500, 9, 0}));
  poll();
  EXPECT_EQ(device->take_sync_edge()->device_us, std::int64_t{1} << 40U);
  EXPECT_EQ(device->take_sync_edge()->rising, false);
  EXPECT_FALSE(device->take_sync_edge());
  EXPECT_EQ(device->counters().sync_edges_lost, 1U);
}

TEST_F(TeensyOnScript, NeitherARestartNorARepeatedEdgeCountsAsLostEdges) {
  device->connect();
  stream->push(encode(wire::SyncEdge{10'000'000, 7, 1}));
  stream->push(encode(wire::SyncEdge{10'000'500, 8, 0}));
  stream->push(encode(wire::SyncEdge{10'000'000, 7, 1}));  // once more
  poll();
  EXPECT_TRUE(device->take_sync_edge());
  EXPECT_TRUE(device->take_sync_edge());
  EXPECT_FALSE(device->take_sync_edge());
  EXPECT_EQ(device->counters().sync_edges_lost, 0U);

  stream->on_packet = [&](const wire::Packet& packet) {  // switched off and on: it counts anew
    wire::IdentityRequest request;
    ASSERT_TRUE(parse(packet, request));
    wire::Identity identity = an_identity(request.session);
    identity.device_us = 300'000;
    identity.next_sequence = 3;
    stream->push(encode(identity));
  };
  device->connect();
  stream->push(encode(wire::SyncEdge{400'000, 1, 1}));
  stream->push(encode(wire::SyncEdge{400'500, 3, 0}));
  poll();
  EXPECT_EQ(device->take_sync_edge()->device_us, 400'000);
  EXPECT_TRUE(device->take_sync_edge());
  EXPECT_EQ(device->counters().sync_edges_lost, 1U);
}

TEST_F(TeensyOnScript, PollNeedsAConnection) {
  EXPECT_EQ(error_of([&] { poll(); }).fault(), Fault::kDisconnected);
}

TEST(TtyStream, SaysWhyItCannotOpen) {
  TtyStream missing({.path = testing::TempDir() + "no_such_tty"});
  const DeviceError gone = error_of([&] { missing.open(); });
  EXPECT_EQ(gone.fault(), Fault::kDisconnected);
  EXPECT_THAT(gone.what(), HasSubstr("plugged in"));

  const std::string path = testing::TempDir() + "isorig_not_a_tty";
  std::ofstream(path) << "text";
  TtyStream file({.path = path});
  const DeviceError wrong = error_of([&] { file.open(); });
  EXPECT_EQ(wrong.fault(), Fault::kIdentity);
  EXPECT_FALSE(file.is_open());
  std::remove(path.c_str());
}

}  // namespace
}  // namespace isorig::pressure
