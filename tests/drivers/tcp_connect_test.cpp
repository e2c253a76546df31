#include "drivers/transport/tcp_connect.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/api/error.hpp"

namespace isorig::drivers {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// A port of this machine's loopback; nobody listens there until listen().
class Port {
 public:
  Port() {
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address_;
    if (::bind(fd_, reinterpret_cast<sockaddr*>(&address_), size) != 0 ||
        ::getsockname(fd_, reinterpret_cast<sockaddr*>(&address_), &size) != 0) {
      throw std::runtime_error("no port");
    }
  }
  ~Port() { ::close(fd_); }
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;
  void listen() { ASSERT_EQ(::listen(fd_, 1), 0); }
  [[nodiscard]] std::uint16_t number() const { return ntohs(address_.sin_port); }

 private:
  int fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address_{};
};

TEST(TcpConnect, TakesTheAddressThatAnswers) {
  Port port;
  port.listen();
  // A name has several addresses, and ::1 may come first: nobody listens there.
  for (const char* host : {"127.0.0.1", "localhost"}) {
    const int fd = connect_tcp(host, port.number(), 5000, "frame");
    EXPECT_GE(fd, 0) << host;
    ::close(fd);
  }
}

TEST(TcpConnect, SaysWhichAddressFailedAndWhatToLookAt) {
  const Port port;
  EXPECT_THAT(
      [&] { (void)connect_tcp("127.0.0.1", port.number(), 5000, "frame at tcp"); },
      ThrowsMessage<DeviceError>(AllOf(HasSubstr("frame at tcp: cannot connect (127.0.0.1: Connection refused)"),
                                       HasSubstr("nobody listens"))));
  EXPECT_THAT([&] { (void)connect_tcp("no-such-host.invalid", 1, 5000, "frame"); },
              ThrowsMessage<DeviceError>(AllOf(HasSubstr("no such host"), HasSubstr("check `host`"))));
}

}  // namespace
}  // namespace isorig::drivers
