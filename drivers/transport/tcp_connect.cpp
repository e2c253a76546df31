#include "drivers/transport/tcp_connect.hpp"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <string_view>

#include "drivers/api/error.hpp"

namespace isorig::drivers {
namespace {

/// The socket, or -1 and errno.
int connect_within(const addrinfo& to, int timeout_ms) {
  const int fd = ::socket(to.ai_family, to.ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK, to.ai_protocol);
  if (fd < 0) return -1;
  int error = ::connect(fd, to.ai_addr, to.ai_addrlen) == 0 ? 0 : errno;
  if (error == EINPROGRESS) {
    pollfd wait{fd, POLLOUT, 0};
    socklen_t size = sizeof error;
    error = ETIMEDOUT;
    if (::poll(&wait, 1, timeout_ms) == 1) ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
  }
  if (error == 0) {
    const int on = 1;
    ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return fd;
  }
  ::close(fd);
  errno = error;
  return -1;
}

std::string text_of(const addrinfo& to) {
  char host[NI_MAXHOST] = "?";
  (void)::getnameinfo(to.ai_addr, to.ai_addrlen, host, sizeof host, nullptr, 0, NI_NUMERICHOST);
  return host;
}

/// A service's networks are filtered by systemd: the kernel drops what goes elsewhere, which looks like a device that
/// is off.
std::string_view advice(int error) {
  switch (error) {
    case ECONNREFUSED:
      return "; somebody is there, but nobody listens: check `port`, and that the device's server is on";
    case EAFNOSUPPORT:
      return "; this process has no such kind of network: RestrictAddressFamilies= (docs/service.md)";
    default:
      return "; check that it is on, its cable, `host` and `port`, and the service's IPAddressAllow= (docs/service.md)";
  }
}

}  // namespace

int connect_tcp(const std::string& host, std::uint16_t port, int timeout_ms, const std::string& name) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* first = nullptr;
  if (const int rc = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &first); rc != 0) {
    throw DeviceError(Fault::kDisconnected, name + ": no such host (" + ::gai_strerror(rc) +
                                                "); check `host` in the rig's file, or give its address: a service may "
                                                "not reach a name server outside its networks");
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> found(first, &::freeaddrinfo);
  std::string failures;
  int error = 0;
  for (const auto* to = first; to != nullptr; to = to->ai_next) {
    if (const int fd = connect_within(*to, timeout_ms); fd >= 0) return fd;
    error = errno;
    failures += (failures.empty() ? "" : ", ") + text_of(*to) + ": " + std::strerror(error);
  }
  throw DeviceError(Fault::kDisconnected, name + ": cannot connect (" + failures + ")" + std::string(advice(error)));
}

}  // namespace isorig::drivers
