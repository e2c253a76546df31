// The client against gateways that lie: an answer that is not the request's is never taken, and the next call works
// again.
#include "drivers/modbus/modbus_link.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <functional>
#include <mutex>
#include <thread>

#include "drivers/api/error.hpp"

namespace isorig::modbus {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using ::testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint8_t kUnit = 7;

/// A gateway whose answers a test writes. Every connection is served until the client closes it.
class Gateway {
 public:
  using Answer = std::function<std::vector<Bytes>(const Bytes& request)>;
  Gateway() {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || ::listen(listener_, 4) != 0 ||
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
      throw std::runtime_error("no port");
    }
    port = ntohs(address.sin_port);
    thread_ = std::thread([this] { run(); });
  }
  ~Gateway() {
    const std::uint64_t one = 1;
    (void)!::write(stop_, &one, sizeof one);
    thread_.join();
    ::close(listener_);
    ::close(stop_);
  }
  Gateway(const Gateway&) = delete;
  Gateway& operator=(const Gateway&) = delete;

  void answer_by(Answer answer) {
    const std::lock_guard lock(mutex_);
    answer_ = std::move(answer);
  }
  /// As it should be: registers that read 0x0102, echoes of writes.
  static Bytes right(const Bytes& request) {
    Bytes answer;
    for (std::size_t i = 0; i < 8; ++i) answer.push_back(request[i]);
    if (request[7] == 3) {
      const std::size_t bytes = 2U * request[11];
      answer.push_back(static_cast<std::uint8_t>(bytes));
      for (std::size_t i = 0; i < bytes; ++i) answer.push_back(i % 2 == 0 ? 1 : 2);
    } else {
      for (std::size_t i = 8; i < 12; ++i) answer.push_back(request[i]);
    }
    answer[5] = static_cast<std::uint8_t>(answer.size() - 6);
    return answer;
  }
  std::uint16_t port = 0;

 private:
  void run() {
    int client = -1;
    Bytes received;
    for (;;) {
      std::array<pollfd, 3> wait{{{stop_, POLLIN, 0}, {listener_, POLLIN, 0}, {client, POLLIN, 0}}};
      ::poll(wait.data(), wait.size(), -1);
      if (wait[0].revents != 0) break;
      if (wait[1].revents != 0) {
        if (client >= 0) ::close(client);
        client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
        received.clear();
        continue;
      }
      std::array<std::uint8_t, 512> bytes{};
      const auto size = ::recv(client, bytes.data(), bytes.size(), 0);
      if (size <= 0) {
        ::close(client);
        client = -1;
        continue;
      }
      received.insert(received.end(), bytes.begin(), bytes.begin() + size);
      while (received.size() >= 6 && received.size() >= 6U + received[5]) {
        const auto end = received.begin() + 6 + received[5];
        const Bytes request(received.begin(), end);
        received.erase(received.begin(), end);
        std::vector<Bytes> answers;
        {
          const std::lock_guard lock(mutex_);
          answers = answer_(request);
        }
        for (const auto& answer : answers) (void)!::send(client, answer.data(), answer.size(), MSG_NOSIGNAL);
      }
    }
    if (client >= 0) ::close(client);
  }

  int listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  int stop_ = ::eventfd(0, EFD_CLOEXEC);
  std::mutex mutex_;
  Answer answer_ = [](const Bytes& request) { return std::vector<Bytes>{right(request)}; };
  std::thread thread_;
};

struct Lie {
  const char* name;
  std::function<std::vector<Bytes>(const Bytes& request, const Bytes& right)> tell;
  Fault fault = Fault::kProtocol;
  const char* says = "";
};
void PrintTo(const Lie& lie, std::ostream* out) {
  *out << lie.name;
}

std::vector<Bytes> changed(Bytes answer, std::size_t at, std::uint8_t to) {
  answer[at] = to;
  return {std::move(answer)};
}
std::vector<Bytes> cut_to(Bytes answer, std::size_t pdu, bool with_length = true) {
  answer.resize(7 + pdu);
  if (with_length) answer[5] = static_cast<std::uint8_t>(pdu + 1);
  return {std::move(answer)};
}

class ModbusLies : public ::testing::TestWithParam<Lie> {
 protected:
  Gateway gateway_;
  ModbusConfig config_ = [this] {
    ModbusConfig c;
    c.port = gateway_.port;
    c.map.unit_id = kUnit;
    c.response_timeout_ms = GetParam().fault == Fault::kTimeout ? 300 : 10'000;
    return c;
  }();
  ModbusLink link_{config_, ReadBlock{0, 10, 3, {}}, "frame"};
};

TEST_P(ModbusLies, AreNotTakenForAnAnswer) {
  const auto& lie = GetParam();
  link_.open();
  gateway_.answer_by([&](const Bytes& request) { return lie.tell(request, Gateway::right(request)); });
  std::array<std::uint16_t, 2> words{};
  try {
    link_.read(3, 100, words);
    ADD_FAILURE() << "taken: " << words[0];
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), lie.fault) << error.what();
    EXPECT_THAT(error.what(), HasSubstr(lie.says));
    EXPECT_THAT(error.what(), HasSubstr("reading registers 100-101"));
  }
  gateway_.answer_by([](const Bytes& request) { return std::vector<Bytes>{Gateway::right(request)}; });
  std::array<std::uint16_t, 3> others{};
  link_.read(3, 100, others);
  EXPECT_THAT(others, ::testing::Each(0x0102));
}

INSTANTIATE_TEST_SUITE_P(
    Every, ModbusLies,
    ::testing::Values(
        Lie{"UnitOfAnother", [](const Bytes&, const Bytes& r) { return changed(r, 6, 9); }, Fault::kProtocol,
            "unit 9 instead of 7"},
        Lie{"UnitZero", [](const Bytes&, const Bytes& r) { return changed(r, 6, 0); }, Fault::kProtocol,
            "unit 0 instead of 7"},
        Lie{"ProtocolOfAnother", [](const Bytes&, const Bytes& r) { return changed(r, 3, 1); }, Fault::kProtocol,
            "protocol 1"},
        Lie{"LengthTooShort", [](const Bytes&, const Bytes& r) { return changed(r, 5, 5); }, Fault::kProtocol,
            "length of 4"},
        Lie{"LengthTooLong",
            [](const Bytes&, const Bytes& r) {
              return std::vector<Bytes>{changed(r, 5, 9).front(), {0, 0}};
            },
            Fault::kProtocol, "length of 8"},
        Lie{"LengthThatNeverComes", [](const Bytes&, const Bytes& r) { return changed(r, 5, 60); }, Fault::kTimeout,
            "half an answer"},
        Lie{"LengthZero", [](const Bytes&, const Bytes& r) { return changed(r, 5, 0); }, Fault::kProtocol, "length 0"},
        Lie{"LengthHuge", [](const Bytes&, const Bytes& r) { return changed(r, 4, 4); }, Fault::kProtocol, "no Modbus"},
        Lie{"TransactionOfAnother", [](const Bytes&, const Bytes& r) { return changed(r, 0, 0x55); }, Fault::kProtocol,
            "transaction"},
        Lie{"FunctionOfAnother", [](const Bytes&, const Bytes& r) { return changed(r, 7, 4); }, Fault::kProtocol,
            "function 4 instead of 3"},
        Lie{"ByteCountTooSmall", [](const Bytes&, const Bytes& r) { return changed(r, 8, 2); }, Fault::kProtocol,
            "2 bytes of registers instead of 4"},
        Lie{"RegistersMissing", [](const Bytes&, const Bytes& r) { return cut_to(r, 4); }, Fault::kProtocol,
            "length of 4"},
        Lie{"FunctionAlone", [](const Bytes&, const Bytes& r) { return cut_to(r, 1); }, Fault::kProtocol, "no Modbus"},
        Lie{"ExceptionWithoutCode", [](const Bytes&, const Bytes& r) { return cut_to(changed(r, 7, 0x83).front(), 3); },
            Fault::kProtocol, "exception of 3"},
        Lie{"ExceptionOfAnotherFunction",
            [](const Bytes&, const Bytes& r) { return cut_to(changed(r, 7, 0x84).front(), 2); }, Fault::kProtocol,
            "function 132"},
        Lie{"Silence", [](const Bytes&, const Bytes&) { return std::vector<Bytes>{}; }, Fault::kTimeout,
            "no answer within"},
        Lie{"HalfAnAnswer", [](const Bytes&, const Bytes& r) { return cut_to(r, 3, false); }, Fault::kTimeout,
            "half an answer"},
        Lie{"Refusal",
            [](const Bytes&, const Bytes& r) { return cut_to(changed(changed(r, 7, 0x83).front(), 8, 2).front(), 2); },
            Fault::kRefused, "exception 2, illegal data address"},
        Lie{"TargetMissing",
            [](const Bytes&, const Bytes& r) { return cut_to(changed(changed(r, 7, 0x83).front(), 8, 11).front(), 2); },
            Fault::kTimeout, "cannot reach the frame"},
        Lie{"NoModbusAtAll",
            [](const Bytes&,
               const Bytes&) { return std::vector<Bytes>{Bytes{'S', 'S', 'H', '-', '2', '.', '0', '\r', '\n'}}; },
            Fault::kProtocol, "no Modbus"}),
    [](const auto& each) { return std::string(each.param.name); });

class ModbusAnswers : public ::testing::Test {
 protected:
  Gateway gateway_;
  ModbusConfig config_ = [this] {
    ModbusConfig c;
    c.port = gateway_.port;
    c.map.unit_id = kUnit;
    c.response_timeout_ms = 400;
    return c;
  }();
  ModbusLink link_{config_, ReadBlock{0, 10, 3, {}}, "frame"};
};

TEST_F(ModbusAnswers, TheEchoOfAnotherWriteIsNone) {
  link_.open();
  const std::array<std::uint16_t, 2> words{1, 2};
  link_.write(16, 50, words);
  link_.write(6, 50, std::span(words).first(1));
  for (const std::size_t at : {9U, 11U}) {  // the address, then count or value
    gateway_.answer_by([&](const Bytes& r) { return changed(Gateway::right(r), at, 99); });
    EXPECT_THROW(link_.write(16, 50, words), DeviceError) << at;
    EXPECT_THROW(link_.write(6, 50, std::span(words).first(1)), DeviceError) << at;
  }
}

TEST_F(ModbusAnswers, ALateOneIsThrownAwayWithoutANewConnection) {
  link_.open();
  Bytes held;
  int requests = 0;
  gateway_.answer_by([&](const Bytes& request) {
    auto right = Gateway::right(request);
    if (++requests == 1) {
      held = std::move(right);
      return std::vector<Bytes>{};
    }
    return std::vector<Bytes>{std::exchange(held, {}), right};
  });
  std::array<std::uint16_t, 2> words{};
  EXPECT_THROW(link_.read(3, 100, words), DeviceError);
  link_.read(3, 100, words);
  EXPECT_EQ(words[0], 0x0102);
  EXPECT_EQ(link_.resyncs(), 1U);
}

}  // namespace
}  // namespace isorig::modbus
