#include "daemon/device_claim.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace isorig::daemon {

DeviceClaim::DeviceClaim(const std::string& device) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  // A leading zero byte makes it abstract. Of a path that is too long its end tells more.
  std::string name = "isorig " + device;
  if (name.size() > sizeof address.sun_path - 1) name.erase(0, name.size() - (sizeof address.sun_path - 1));
  std::memcpy(address.sun_path + 1, name.data(), name.size());
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd_ >= 0 && ::bind(fd_, reinterpret_cast<const sockaddr*>(&address), length) == 0) return;
  const int why = errno;
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  if (why == EADDRINUSE) {
    throw std::runtime_error("another isorigd on this machine drives the " + device +
                             "; stop it first (pgrep -a isorigd), a rig has one daemon");
  }
  throw std::runtime_error("the " + device + " cannot be claimed: " + std::strerror(why));
}

DeviceClaim::~DeviceClaim() {
  if (fd_ >= 0) ::close(fd_);
}

DeviceClaim::DeviceClaim(DeviceClaim&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

}  // namespace isorig::daemon
