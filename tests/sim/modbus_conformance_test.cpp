// The emulated gateway against the specifications, request by request over a raw socket and a raw pseudo-terminal:
// MODBUS Application Protocol V1.1b3, Messaging on TCP/IP V1.0b, over serial line V1.02. After each the connection
// still works.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <thread>
#include <utility>

#include "fake_wire.hpp"

namespace isorig::sim {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Of isorig-gateway.toml.
constexpr std::uint8_t kUnit = 1;

/// Independent of the driver's and of the emulator's.
Bytes with_crc(Bytes bytes) {
  unsigned crc = 0xFFFF;
  for (const auto b : bytes) {
    crc ^= b;
    for (int i = 0; i < 8; ++i) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
  }
  bytes.push_back(static_cast<std::uint8_t>(crc));
  bytes.push_back(static_cast<std::uint8_t>(crc >> 8U));
  return bytes;
}

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Bytes words(std::size_t count) {
  return Bytes(2 * count);
}
Bytes request(std::uint8_t function, std::uint16_t address, std::uint16_t count) {
  const auto high = [](std::uint16_t w) { return static_cast<std::uint8_t>(w >> 8U); };
  const auto low = [](std::uint16_t w) { return static_cast<std::uint8_t>(w & 0xFFU); };
  return {function, high(address), low(address), high(count), low(count)};
}

enum class Ends { kAnswer, kException, kSilence, kClosed };

struct Case {
  const char* name;
  Bytes pdu;
  Ends ends = Ends::kAnswer;
  std::uint8_t exception = 0;
  Bytes answer{};  // its beginning, after the function
  // What differs from a right frame.
  std::uint8_t unit = kUnit;
  std::uint16_t protocol = 0;
  int length_off = 0;
  bool wrong_crc = false;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

class Raw {
 public:
  explicit Raw(int fd) : fd_(fd) {}
  ~Raw() { ::close(fd_); }
  Raw(const Raw&) = delete;
  Raw& operator=(const Raw&) = delete;

  void send(const Bytes& bytes) {
    ASSERT_EQ(::write(fd_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  /// What comes until `enough`, or for `timeout_ms`.
  template <typename Enough>
  Bytes receive(const Enough& enough, int timeout_ms) {
    while (!enough(got_)) {
      pollfd wait{fd_, POLLIN, 0};
      if (::poll(&wait, 1, timeout_ms) <= 0) break;
      std::array<std::uint8_t, 512> part{};
      const auto size = ::read(fd_, part.data(), part.size());
      if (size <= 0) {
        closed = true;
        break;
      }
      got_.insert(got_.end(), part.begin(), part.begin() + size);
    }
    return std::exchange(got_, {});
  }
  bool closed = false;

 private:
  int fd_;
  Bytes got_;
};

constexpr int kPatience_ms = 20'000, kSilence_ms = 60;

int connected_to(std::uint16_t port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
  return fd;
}

int opened(const std::string& tty) {
  const int fd = ::open(tty.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  termios raw{};
  EXPECT_EQ(::tcgetattr(fd, &raw), 0);
  ::cfmakeraw(&raw);
  EXPECT_EQ(::tcsetattr(fd, TCSANOW, &raw), 0);
  return fd;
}

/// What both lines have in common: the PDU.
std::vector<Case> application_cases() {
  std::vector<Case> cases{
      {"ReadHolding1", request(3, 0, 1), Ends::kAnswer, 0, {2}},
      {"ReadInput125", request(4, 256, 125), Ends::kAnswer, 0, {250}},
      {"WriteSingle", request(6, 6, 1), Ends::kAnswer, 0, {0, 6, 0, 1}},
      {"WriteMultiple", request(16, 0, 5) + Bytes{10} + words(5), Ends::kAnswer, 0, {0, 0, 0, 5}},
      {"ReadHolding0", request(3, 0, 0), Ends::kException, 3},
      {"ReadHolding126", request(3, 0, 126), Ends::kException, 3},
      {"ReadHolding65535", request(3, 0, 65535), Ends::kException, 3},
      {"ReadHoldingBeyondTheLastAddress", request(3, 65535, 2), Ends::kException, 2},
      {"ReadHoldingUnmapped", request(3, 60000, 1), Ends::kException, 2},
      {"ReadInput126", request(4, 0, 126), Ends::kException, 3},
      {"ReadInput0", request(4, 0, 0), Ends::kException, 3},
      {"ReadInputUnmapped", request(4, 60000, 1), Ends::kException, 2},
      {"ReadHoldingTooShort", {3, 0, 0, 0}, Ends::kException, 3},
      {"ReadHoldingTooLong", request(3, 0, 1) + Bytes{0}, Ends::kException, 3},
      {"WriteSingleUnmapped", request(6, 60000, 1), Ends::kException, 2},
      {"WriteSingleTooShort", {6, 0, 0, 0}, Ends::kException, 3},
      {"WriteSingleTooLong", request(6, 0, 1) + Bytes{0, 0}, Ends::kException, 3},
      {"WriteMultiple0", request(16, 100, 0) + Bytes{0}, Ends::kException, 3},
      {"WriteMultipleByteCount", request(16, 100, 2) + Bytes{3} + words(2), Ends::kException, 3},
      {"WriteMultipleTooLong", request(16, 100, 1) + Bytes{2} + words(2), Ends::kException, 3},
      {"WriteMultipleWithoutData", request(16, 100, 1), Ends::kException, 3},
      {"WriteMultipleUnmapped", request(16, 60000, 2) + Bytes{4} + words(2), Ends::kException, 2},
      {"WriteMultipleBeyondTheLastAddress", request(16, 65535, 2) + Bytes{4} + words(2), Ends::kException, 2},
      {"FunctionAlone", {3}, Ends::kException, 3},
  };
  // Public, user-defined, reserved, and what would be an exception: none of them is served here.
  static const std::array<std::pair<std::uint8_t, const char*>, 23> kOthers{
      {{0, "Function0"},     {1, "Function1"},     {2, "Function2"},     {5, "Function5"},     {7, "Function7"},
       {8, "Function8"},     {11, "Function11"},   {12, "Function12"},   {15, "Function15"},   {17, "Function17"},
       {20, "Function20"},   {21, "Function21"},   {22, "Function22"},   {23, "Function23"},   {24, "Function24"},
       {43, "Function43"},   {65, "Function65"},   {100, "Function100"}, {110, "Function110"}, {127, "Function127"},
       {131, "Function131"}, {144, "Function144"}, {255, "Function255"}}};
  for (const auto& [function, name] : kOthers) {
    Bytes pdu = request(function, 0, 1);
    if (function == 15) pdu = pdu + Bytes{1, 0};
    if (function == 43) pdu = {43, 14, 1, 0};
    if (function == 24) pdu = {24, 0, 0};
    cases.push_back({name, pdu, Ends::kException, 1});
  }
  return cases;
}

std::vector<Case> tcp_cases() {
  auto cases = application_cases();
  cases.insert(cases.end(), {{"WriteMultiple124", request(16, 0, 124) + Bytes{248} + words(124), Ends::kException, 3},
                             {"LengthOfAnotherPdu", request(3, 0, 1) + Bytes(30), Ends::kException, 3},
                             {"ProtocolOfAnother", request(3, 0, 1), Ends::kSilence, 0, {}, kUnit, 1},
                             {"ProtocolFFFF", request(3, 0, 1), Ends::kSilence, 0, {}, kUnit, 0xFFFF},
                             {"LengthZero", {}, Ends::kClosed, 0, {}, kUnit, 0, -1},
                             {"LengthOne", {}, Ends::kClosed},
                             {"LengthHuge", request(3, 0, 1), Ends::kClosed, 0, {}, kUnit, 0, 60000},
                             {"UnitOfAnother", request(3, 0, 1), Ends::kException, 11, {}, 9},
                             {"Unit0IsWhoeverIsThere", request(3, 0, 1), Ends::kAnswer, 0, {2}, 0},
                             {"Unit255IsWhoeverIsThere", request(3, 0, 1), Ends::kAnswer, 0, {2}, 255}});
  return cases;
}

std::vector<Case> rtu_cases() {
  auto cases = application_cases();
  cases.insert(cases.end(), {{"WrongCrc", request(3, 0, 1), Ends::kSilence, 0, {}, kUnit, 0, 0, true},
                             {"UnitOfAnother", request(3, 0, 1), Ends::kSilence, 0, {}, 9},
                             {"UnknownFunctionOfAnother", {65, 1, 2, 3}, Ends::kSilence, 0, {}, 9},
                             {"AnswerOfAnother", {3, 4, 0, 1, 0, 2}, Ends::kSilence, 0, {}, 9},
                             {"BroadcastRead", request(3, 0, 1), Ends::kSilence, 0, {}, 0},
                             {"WriteMultiple124", request(16, 0, 124) + Bytes{248} + words(124), Ends::kSilence}});
  return cases;
}

void expect_ends(const Case& c, const Bytes& pdu) {
  ASSERT_GE(pdu.size(), 2U);
  const auto function = c.pdu[0];
  if (c.ends == Ends::kException) {
    EXPECT_EQ(pdu.size(), 2U);
    EXPECT_EQ(pdu[0], function | 0x80U);
    EXPECT_EQ(pdu[1], c.exception);
  } else {
    EXPECT_EQ(pdu[0], function);
    EXPECT_TRUE(std::equal(c.answer.begin(), c.answer.end(), pdu.begin() + 1));
  }
}

class ModbusTcpConformance : public testing::TestWithParam<Case> {
 protected:
  FakeWire rig{Line::kTcp};
  static Bytes frame(std::uint16_t transaction, const Case& c) {
    const auto length = static_cast<std::size_t>(static_cast<int>(c.pdu.size()) + 1 + c.length_off);
    Bytes out{static_cast<std::uint8_t>(transaction >> 8U),
              static_cast<std::uint8_t>(transaction),
              static_cast<std::uint8_t>(c.protocol >> 8U),
              static_cast<std::uint8_t>(c.protocol),
              static_cast<std::uint8_t>(length >> 8U),
              static_cast<std::uint8_t>(length),
              c.unit};
    return out + c.pdu;
  }
  static bool whole(const Bytes& got) { return got.size() >= 6 && got.size() >= 6U + (got[4] << 8U) + got[5]; }
};

TEST_P(ModbusTcpConformance, AnswersAsItShould) {
  const auto& c = GetParam();
  Raw raw(connected_to(rig.server->port()));
  raw.send(frame(0x1234, c));
  const auto got = raw.receive(whole, c.ends == Ends::kSilence ? kSilence_ms : kPatience_ms);
  if (c.ends == Ends::kSilence) {
    EXPECT_THAT(got, testing::IsEmpty());
  } else if (c.ends == Ends::kClosed) {
    EXPECT_THAT(got, testing::IsEmpty());
    EXPECT_TRUE(raw.closed);
    return;
  } else {
    ASSERT_TRUE(whole(got)) << (raw.closed ? "closed" : "silent");
    EXPECT_THAT(Bytes(got.begin(), got.begin() + 4), testing::ElementsAre(0x12, 0x34, 0, 0));
    EXPECT_EQ(got.size(), 6U + (got[4] << 8U) + got[5]);
    EXPECT_EQ(got[6], c.unit);
    ASSERT_NO_FATAL_FAILURE(expect_ends(c, Bytes(got.begin() + 7, got.end())));
  }
  // And the next request is answered as if nothing had been.
  const Case next{"next", request(3, 0, 2), Ends::kAnswer, 0, {4}};
  raw.send(frame(0x4321, next));
  const auto after = raw.receive(whole, kPatience_ms);
  ASSERT_TRUE(whole(after)) << (raw.closed ? "closed" : "out of step");
  EXPECT_THAT(Bytes(after.begin(), after.begin() + 2), testing::ElementsAre(0x43, 0x21));
  expect_ends(next, Bytes(after.begin() + 7, after.end()));
}

INSTANTIATE_TEST_SUITE_P(Every, ModbusTcpConformance, testing::ValuesIn(tcp_cases()),
                         [](const auto& each) { return std::string(each.param.name); });

TEST_F(ModbusTcpConformance, RequestsInPiecesAndInOneAreAnsweredInOrder) {
  const Case one{"one", request(3, 0, 1), Ends::kAnswer, 0, {2}};
  Raw raw(connected_to(rig.server->port()));
  for (const auto byte : frame(1, one)) {
    raw.send({byte});
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(whole(raw.receive(whole, kPatience_ms)));
  raw.send(frame(2, one) + frame(3, one) + frame(4, one));
  const auto three = raw.receive([](const Bytes& got) { return got.size() >= 33; }, kPatience_ms);
  ASSERT_EQ(three.size(), 33U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(three[11 * i + 1], i + 2);
}

class ModbusRtuConformance : public testing::TestWithParam<Case> {
 protected:
  FakeWire rig{Line::kRtu};
  static Bytes frame(const Case& c) {
    auto out = with_crc(Bytes{c.unit} + c.pdu);
    if (c.wrong_crc) out.back() ^= 1U;
    return out;
  }
};

TEST_P(ModbusRtuConformance, AnswersAsItShould) {
  const auto& c = GetParam();
  Raw raw(opened(rig.server->tty()));
  const auto whole = [&](const Bytes& got) {
    return got.size() >= 5 && with_crc(Bytes(got.begin(), got.end() - 2)) == got;
  };
  raw.send(frame(c));
  const auto got = raw.receive(whole, c.ends == Ends::kSilence ? kSilence_ms : kPatience_ms);
  if (c.ends == Ends::kSilence) {
    EXPECT_THAT(got, testing::IsEmpty());
  } else {
    ASSERT_TRUE(whole(got));
    EXPECT_EQ(got[0], c.unit);
    ASSERT_NO_FATAL_FAILURE(expect_ends(c, Bytes(got.begin() + 1, got.end() - 2)));
  }
  const Case next{"next", request(3, 0, 2), Ends::kAnswer, 0, {4}};
  raw.send(frame(next));
  const auto after = raw.receive(whole, kPatience_ms);
  ASSERT_TRUE(whole(after)) << "the request after it is lost";
  expect_ends(next, Bytes(after.begin() + 1, after.end() - 2));
}

INSTANTIATE_TEST_SUITE_P(Every, ModbusRtuConformance, testing::ValuesIn(rtu_cases()),
                         [](const auto& each) { return std::string(each.param.name); });

}  // namespace
}  // namespace isorig::sim
