#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "messages/teensy/cobs.hpp"
#include "messages/teensy/crc32c.hpp"
#include "messages/teensy/decoder.hpp"
#include "messages/teensy/wire.hpp"
#include "tree.hpp"

namespace isorig::messages::teensy {
namespace {

using Bytes = std::vector<std::uint8_t>;

// --- CRC ---------------------------------------------------------------------------------------------------

std::uint32_t crc_of(const Bytes& bytes) {
  return crc32c(bytes.data(), bytes.size());
}

TEST(Crc32c, CheckValue) {
  const std::string digits = "123456789";
  EXPECT_EQ(crc_of(Bytes(digits.begin(), digits.end())), 0xE3069283U);
  EXPECT_EQ(crc_of({}), 0U);
}

TEST(Crc32c, VectorsOfRfc3720AppendixB4) {
  Bytes up(32), down(32);
  for (std::uint8_t i = 0; i < 32; ++i) {
    up[i] = i;
    down[i] = static_cast<std::uint8_t>(31 - i);
  }
  EXPECT_EQ(crc_of(Bytes(32, 0x00)), 0x8A9136AAU);
  EXPECT_EQ(crc_of(Bytes(32, 0xFF)), 0x62A8AB43U);
  EXPECT_EQ(crc_of(up), 0x46DD794EU);
  EXPECT_EQ(crc_of(down), 0x113FDB5CU);
}

// --- COBS --------------------------------------------------------------------------------------------------

Bytes encoded(const Bytes& data) {
  Bytes out(cobs_max_encoded(data.size()));
  out.resize(cobs_encode(data.data(), data.size(), out.data()));
  return out;
}

Bytes count_up(int first, int last) {
  Bytes bytes;
  for (int i = first; i <= last; ++i) bytes.push_back(static_cast<std::uint8_t>(i));
  return bytes;
}

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

void expect_decodes(const Bytes& from, const Bytes& to) {
  Bytes out(from.size() + 1);
  const std::size_t size = cobs_decode(from.data(), from.size(), out.data());
  ASSERT_NE(size, kCobsInvalid);
  out.resize(size);
  EXPECT_EQ(out, to);
}

struct CobsVector {
  const char* name;
  Bytes data;
  Bytes frame;
};

void PrintTo(const CobsVector& vector, std::ostream* out) {
  *out << vector.name;
}

class Cobs : public testing::TestWithParam<CobsVector> {};

TEST_P(Cobs, Vector) {
  EXPECT_EQ(encoded(GetParam().data), GetParam().frame);
  expect_decodes(GetParam().frame, GetParam().data);
}

INSTANTIATE_TEST_SUITE_P(
    CheshireBaker, Cobs,
    testing::Values(CobsVector{"one_zero", {0x00}, {0x01, 0x01}},
                    CobsVector{"two_zeros", {0x00, 0x00}, {0x01, 0x01, 0x01}},
                    CobsVector{"zero_between", {0x00, 0x11, 0x00}, {0x01, 0x02, 0x11, 0x01}},
                    CobsVector{"inner_zero", {0x11, 0x22, 0x00, 0x33}, {0x03, 0x11, 0x22, 0x02, 0x33}},
                    CobsVector{"no_zero", {0x11, 0x22, 0x33, 0x44}, {0x05, 0x11, 0x22, 0x33, 0x44}},
                    CobsVector{"trailing_zeros", {0x11, 0x00, 0x00, 0x00}, {0x02, 0x11, 0x01, 0x01, 0x01}},
                    // The start of an IP header, the example of the paper.
                    CobsVector{"paper_ip_header",
                               {0x45, 0x00, 0x00, 0x2C, 0x4C, 0x79, 0x00, 0x00, 0x40, 0x06, 0x4F, 0x37},
                               {0x02, 0x45, 0x01, 0x04, 0x2C, 0x4C, 0x79, 0x01, 0x05, 0x40, 0x06, 0x4F, 0x37}},
                    CobsVector{"253", count_up(1, 253), Bytes{0xFE} + count_up(1, 253)},
                    CobsVector{"254", count_up(1, 254), Bytes{0xFF} + count_up(1, 254)},
                    CobsVector{"zero_254", count_up(0, 254), Bytes{0x01, 0xFF} + count_up(1, 254)},
                    CobsVector{"255", count_up(1, 255), Bytes{0xFF} + count_up(1, 254) + Bytes{0x02, 0xFF}},
                    CobsVector{"254_zero", count_up(1, 254) + Bytes{0},
                               Bytes{0xFF} + count_up(1, 254) + Bytes{0x01, 0x01}},
                    CobsVector{"253_zero", count_up(2, 254) + Bytes{0}, Bytes{0xFE} + count_up(2, 254) + Bytes{0x01}}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(CobsCodec, TheFormWithASpareCodeByteDecodesToo) {
  expect_decodes(Bytes{0xFF} + count_up(1, 254) + Bytes{0x01}, count_up(1, 254));
}

TEST(CobsCodec, DamageIsInvalid) {
  for (const Bytes& bad : {Bytes{0x00}, Bytes{0x03, 0x11}, Bytes{0x02}, Bytes{0x03, 0x11, 0x00}}) {
    Bytes out(8);
    EXPECT_EQ(cobs_decode(bad.data(), bad.size(), out.data()), kCobsInvalid);
  }
}

TEST(CobsCodec, RoundTripInPlaceOfEveryLength) {
  std::mt19937 random(20'240'501);
  for (std::size_t size = 0; size <= 1024; ++size) {
    Bytes data(size);
    for (auto& byte : data) byte = random() % 4 == 0 ? 0 : static_cast<std::uint8_t>(random());
    Bytes frame = encoded(data);
    ASSERT_LE(frame.size(), cobs_max_encoded(size));
    ASSERT_THAT(frame, testing::Each(testing::Ne(0)));
    frame.resize(cobs_decode(frame.data(), frame.size(), frame.data()));
    ASSERT_EQ(frame, data) << size;
  }
}

// --- messages ----------------------------------------------------------------------------------------------

Bytes bytes_of(const Frame& frame) {
  return {frame.bytes, frame.bytes + frame.size};
}

/// Feeds `stream` in chunks of `chunk` and returns (version, type, body) of each packet.
std::vector<Bytes> packets_in(Decoder& decoder, const Bytes& stream, std::size_t chunk) {
  std::vector<Bytes> packets;
  for (std::size_t at = 0; at < stream.size(); at += chunk) {
    decoder.feed(stream.data() + at, std::min(chunk, stream.size() - at), [&](const Packet& packet) {
      packets.push_back(Bytes{packet.version, packet.type} + Bytes(packet.body, packet.body + packet.size));
    });
  }
  return packets;
}

template <class Message>
Message round_trip(const Message& message, std::size_t body_size) {
  const Frame frame = encode(message);
  EXPECT_EQ(frame.size, kHeaderSize + body_size + kCrcSize + 2);
  Decoder decoder;
  Message out{};
  int count = 0;
  decoder.feed(frame.bytes, frame.size, [&](const Packet& packet) {
    ++count;
    EXPECT_EQ(packet.version, kProtocolVersion);
    EXPECT_EQ(packet.size, body_size);
    EXPECT_TRUE(parse(packet, out));
    Packet shorter = packet;
    --shorter.size;
    Message ignored{};
    EXPECT_FALSE(parse(shorter, ignored));
    Packet other_type = packet;
    other_type.type = 0x7F;
    EXPECT_FALSE(parse(other_type, ignored));
  });
  EXPECT_EQ(count, 1);
  return out;
}

TEST(TeensyMessages, RoundTrips) {
  EXPECT_EQ(round_trip(IdentityRequest{0xDEADBEEF}, 4).session, 0xDEADBEEF);
  EXPECT_EQ(round_trip(TimeSyncRequest{0x01020304}, 4).cookie, 0x01020304U);
  EXPECT_EQ(round_trip(Heartbeat{0xFFFFFFFF}, 4).counter, 0xFFFFFFFFU);

  const auto command = round_trip(ValveCommand{7, 1000, 0, 100}, 10);
  EXPECT_EQ(command.sequence, 7U);
  EXPECT_EQ(command.fill_permille, 1000);
  EXPECT_EQ(command.vent_permille, 0);
  EXPECT_EQ(command.validity_ms, 100);

  const auto reply = round_trip(TimeSyncReply{9, 0x123456789ABCDEF0, 0x123456789ABCDEF1}, 20);
  EXPECT_EQ(reply.cookie, 9U);
  EXPECT_EQ(reply.device_rx_us, 0x123456789ABCDEF0U);
  EXPECT_EQ(reply.device_tx_us, 0x123456789ABCDEF1U);

  const auto status =
      round_trip(Status{1ULL << 40U, 2, 3, 4, 5, 6, 7, 8, kStatusSelfVented, VentCause::kFillTime, 9}, 34);
  EXPECT_EQ(status.device_us, 1ULL << 40U);
  EXPECT_EQ(status.dropped, 2U);
  EXPECT_EQ(status.rejected, 3U);
  EXPECT_EQ(status.corrupt, 4U);
  EXPECT_EQ(status.command_sequence, 5U);
  EXPECT_EQ(status.self_vents, 6);
  EXPECT_EQ(status.fill_permille, 7);
  EXPECT_EQ(status.vent_permille, 8);
  EXPECT_EQ(status.flags, kStatusSelfVented);
  EXPECT_EQ(status.cause, VentCause::kFillTime);
  EXPECT_EQ(status.fill_used_ms, 9);
  Status unknown;
  unknown.cause = static_cast<VentCause>(kVentCauses);
  Decoder decoder;
  const Frame frame = encode(unknown);
  decoder.feed(frame.bytes, frame.size, [](const Packet& packet) {
    Status out;
    EXPECT_FALSE(parse(packet, out));
  });

  const Limits limits{12'124, 70, 6500};
  EXPECT_EQ(round_trip(limits, 8), limits);
  const auto confirmed = round_trip(LimitsReply{limits, 1}, 9);
  EXPECT_EQ(confirmed.limits, limits);
  EXPECT_EQ(confirmed.accepted, 1);

  const auto edge = round_trip(SyncEdge{1ULL << 33U, 12, 1}, 13);
  EXPECT_EQ(edge.device_us, 1ULL << 33U);
  EXPECT_EQ(edge.count, 12U);
  EXPECT_EQ(edge.level, 1);
}

TEST(TeensyMessages, IdentityKeepsTexts) {
  Identity identity;
  identity.session = 1;
  identity.sample_rate_mhz = 2'000'000;
  identity.watchdog_ms = 200;
  identity.device_us = 3;
  identity.next_sequence = 4;
  std::strcpy(identity.model, "isorig-teensy36");
  std::memset(identity.serial, 'x', kTextSize);  // not terminated: one character is lost, nothing else
  const Identity out = round_trip(identity, 22 + 3 * kTextSize);
  EXPECT_EQ(out.sample_rate_mhz, 2'000'000U);
  EXPECT_EQ(out.watchdog_ms, 200);
  EXPECT_EQ(out.next_sequence, 4U);
  EXPECT_STREQ(out.model, "isorig-teensy36");
  EXPECT_EQ(std::string(out.serial), std::string(kTextSize - 1, 'x'));
  EXPECT_STREQ(out.firmware, "");
}

TEST(TeensyMessages, EveryBatchSizeFits) {
  for (std::uint8_t count = 1; count <= kMaxSamples; ++count) {
    Samples samples;
    samples.count = count;
    for (std::uint8_t i = 0; i < count; ++i) samples.items[i] = {0xFFFFFFF0U + i, 0xFF00FF00U * i, 0x00FF00FFU + i};
    const Samples out = round_trip(samples, 1U + count * kSampleSize);
    ASSERT_EQ(out.count, count);
    for (std::uint8_t i = 0; i < count; ++i) {
      EXPECT_EQ(out.items[i].sequence, samples.items[i].sequence);
      EXPECT_EQ(out.items[i].device_us, samples.items[i].device_us);
      EXPECT_EQ(out.items[i].raw_word, samples.items[i].raw_word);
    }
  }
}

bool parses_samples(const Bytes& body) {
  Samples out;
  return parse(Packet{kProtocolVersion, static_cast<std::uint8_t>(Type::kSamples), body.data(), body.size()}, out);
}

TEST(TeensyMessages, RefusesWhatIsNotSpecified) {
  EXPECT_FALSE(parses_samples({}));
  EXPECT_FALSE(parses_samples({0}));
  EXPECT_FALSE(parses_samples(Bytes{2} + Bytes(kSampleSize, 0)));
  EXPECT_FALSE(parses_samples(Bytes{1} + Bytes(kSampleSize + 1, 0)));
  EXPECT_FALSE(parses_samples(Bytes{21} + Bytes(21 * kSampleSize, 0)));
  EXPECT_TRUE(parses_samples(Bytes{1} + Bytes(kSampleSize, 0)));

  const Bytes body(4, 0);
  Heartbeat heartbeat;
  EXPECT_FALSE(
      parse(Packet{kProtocolVersion - 1, static_cast<std::uint8_t>(Type::kHeartbeat), body.data(), 4}, heartbeat));
  IdentityRequest request;  // any version, so that the answer can name the one spoken here
  EXPECT_TRUE(
      parse(Packet{kProtocolVersion + 1, static_cast<std::uint8_t>(Type::kIdentityRequest), body.data(), 4}, request));
}

TEST(TeensyMessages, ExampleFrameOfTheDocumentation) {
  const Bytes frame = bytes_of(encode(ValveCommand{42, 250, 0, 100}));
  EXPECT_EQ(frame, (Bytes{0x04, 0x02, 0x03, 0x2A, 0x01, 0x01, 0x02, 0xFA, 0x01, 0x01, 0x02, 0x64, 0x05, 0x7B, 0xF5,
                          0x88, 0x1C, 0x00}));
  std::ostringstream hex;
  for (const int byte : frame) hex << ' ' << std::hex << std::uppercase << std::setw(2) << std::setfill('0') << byte;
  std::ifstream file(test::source_path("/docs/wire-teensy.md"));
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  EXPECT_NE(text.find("frame   " + hex.str() + "\n"), std::string::npos) << hex.str();
}

TEST(TeensyMessages, ExtendsOverTheWrapInBothDirections) {
  constexpr std::int64_t kWrap = std::int64_t{1} << 32;
  EXPECT_EQ(extend_us(5, kWrap - 10), kWrap + 5);
  EXPECT_EQ(extend_us(0xFFFFFFF0U, kWrap + 10), kWrap - 16);
  EXPECT_EQ(extend_us(0, 0), 0);
  EXPECT_EQ(extend_us(7, 5 * kWrap + 2'000'000'000), 5 * kWrap + 7);
}

// --- decoder -----------------------------------------------------------------------------------------------

Bytes example_stream(std::vector<Bytes>& expected) {
  Bytes stream;
  for (std::uint32_t i = 0; i < 6; ++i) {
    Samples samples;
    samples.count = static_cast<std::uint8_t>(1 + 3 * i);
    for (std::uint32_t k = 0; k < samples.count; ++k) samples.items[k] = {i * 100 + k, k * 1000, 0x19990000U + k};
    const Frame frame = encode(samples);
    stream = stream + bytes_of(frame);
    Decoder decoder;
    expected.push_back(packets_in(decoder, bytes_of(frame), 1).at(0));
  }
  return stream;
}

TEST(TeensyDecoder, EveryChunkSizeGivesTheSamePackets) {
  std::vector<Bytes> expected;
  const Bytes stream = example_stream(expected);
  for (std::size_t chunk = 1; chunk <= stream.size(); ++chunk) {
    Decoder decoder;
    ASSERT_EQ(packets_in(decoder, stream, chunk), expected) << chunk;
    ASSERT_EQ(decoder.counters().errors(), 0U);
  }
}

TEST(TeensyDecoder, EverySplitInTwoGivesTheSamePackets) {
  std::vector<Bytes> expected;
  const Bytes stream = example_stream(expected);
  for (std::size_t split = 0; split <= stream.size(); ++split) {
    Decoder decoder;
    auto packets = packets_in(decoder, Bytes(stream.begin(), stream.begin() + static_cast<long>(split)), 1000);
    for (auto& packet : packets_in(decoder, Bytes(stream.begin() + static_cast<long>(split), stream.end()), 1000))
      packets.push_back(std::move(packet));
    ASSERT_EQ(packets, expected) << split;
  }
}

TEST(TeensyDecoder, EverySingleBitErrorCostsAtMostTheFramesItTouches) {
  std::vector<Bytes> expected;
  const Bytes stream = example_stream(expected);
  for (std::size_t bit = 0; bit < stream.size() * 8; ++bit) {
    Bytes damaged = stream;
    damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ (1U << (bit % 8)));
    Decoder decoder;
    const auto packets = packets_in(decoder, damaged + Bytes{0}, 64);
    // A changed delimiter joins two frames; anything else damages one.
    const std::size_t lost = stream[bit / 8] == 0 ? 2 : 1;
    ASSERT_GE(packets.size() + lost, expected.size()) << bit;
    ASSERT_LT(packets.size(), expected.size()) << bit;
    for (const Bytes& packet : packets) ASSERT_THAT(expected, testing::Contains(packet)) << bit;
  }
}

TEST(TeensyDecoder, RandomGarbageYieldsNothingAndTheNextFrameIsFound) {
  std::mt19937 random(1);
  std::vector<Bytes> expected;
  const Bytes stream = example_stream(expected);
  Decoder decoder;
  std::uint64_t fed = 0;
  for (int round = 0; round < 2000; ++round) {
    Bytes garbage(random() % 700);
    for (auto& byte : garbage) byte = static_cast<std::uint8_t>(random());
    garbage.push_back(0);
    fed += garbage.size();
    ASSERT_TRUE(packets_in(decoder, garbage, 1 + random() % 100).empty());
    ASSERT_EQ(packets_in(decoder, stream, 1 + random() % 100), expected);
  }
  EXPECT_GT(fed, 500'000U);
  EXPECT_GT(decoder.counters().malformed, 100U);
  EXPECT_GT(decoder.counters().oversize, 10U);
  EXPECT_EQ(decoder.counters().packets, 2000U * 6U);
}

TEST(TeensyDecoder, CountsEachKindOfDamage) {
  Decoder decoder;
  const Bytes good = bytes_of(encode(Heartbeat{1}));
  EXPECT_EQ(packets_in(decoder, good, 7).size(), 1U);

  Bytes bad_crc = good;
  bad_crc[bad_crc.size() - 2] ^= 0x40;
  packets_in(decoder, bad_crc, 100);
  EXPECT_EQ(decoder.counters().bad_crc, 1U);

  packets_in(decoder, {0x05, 0x11, 0x00}, 100);        // truncated
  packets_in(decoder, {0x03, 0x11, 0x22, 0x00}, 100);  // shorter than version, type and CRC
  EXPECT_EQ(decoder.counters().malformed, 2U);

  packets_in(decoder, Bytes(100'000, 0x55), 1000);
  EXPECT_EQ(decoder.counters().oversize, 0U);  // counted once, at its end
  packets_in(decoder, {0x00, 0x00, 0x00}, 1);
  EXPECT_EQ(decoder.counters().oversize, 1U);
  EXPECT_EQ(decoder.counters().errors(), 4U);

  EXPECT_EQ(packets_in(decoder, good, 1).size(), 1U);
  EXPECT_EQ(decoder.counters().packets, 2U);
}

TEST(TeensyDecoder, TheTailOfAFrameAtTheStartIsNoError) {
  const Bytes good = bytes_of(encode(Heartbeat{1}));
  Decoder decoder;
  EXPECT_TRUE(packets_in(decoder, Bytes(good.begin() + 3, good.end()), 100).empty());
  EXPECT_EQ(decoder.counters().errors(), 0U);
  packets_in(decoder, Bytes(good.begin() + 3, good.end()), 100);
  EXPECT_EQ(decoder.counters().errors(), 1U);
  packets_in(decoder, {0x07, 0x07}, 100);
  decoder.resynchronise();
  EXPECT_EQ(packets_in(decoder, good, 100).size(), 1U);
  EXPECT_EQ(decoder.counters().errors(), 1U);
}

TEST(TeensyDecoder, LongestFrameFits) {
  const Bytes body(kMaxBody, 0x11);
  const Frame frame = make_frame(1, 0x7E, body.data(), body.size());
  EXPECT_EQ(frame.size, kMaxFrame);
  Decoder decoder;
  EXPECT_EQ(packets_in(decoder, bytes_of(frame), 64).size(), 1U);
  EXPECT_EQ(make_frame(1, 0x7E, body.data(), kMaxBody + 1).size, 0U);
}

}  // namespace
}  // namespace isorig::messages::teensy
