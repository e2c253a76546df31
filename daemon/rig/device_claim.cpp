#include "daemon/rig/device_claim.hpp"

#include <pwd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "base/printable.hpp"

namespace isorig::daemon {
namespace {

/// For a program that has taken the name and does not listen yet.
constexpr std::chrono::milliseconds kListenPatience{500}, kListenPoll{5};

struct Address {
  sockaddr_un name{};
  socklen_t length = 0;
};

Address address_of(const std::string& device) {
  Address a;
  a.name.sun_family = AF_UNIX;
  // A leading zero byte makes it abstract. Of a path that is too long its end tells more.
  std::string name = "isorig " + device;
  if (name.size() > sizeof a.name.sun_path - 1) name.erase(0, name.size() - (sizeof a.name.sun_path - 1));
  std::memcpy(a.name.sun_path + 1, name.data(), name.size());
  a.length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  return a;
}

std::string name_of_user(uid_t uid) {
  passwd entry{};
  passwd* found = nullptr;
  char buffer[1024];
  const bool known = ::getpwuid_r(uid, &entry, buffer, sizeof buffer, &found) == 0 && found != nullptr;
  return known ? entry.pw_name : "uid " + std::to_string(uid);
}

bool connected(int fd, const Address& address) {
  const auto deadline = std::chrono::steady_clock::now() + kListenPatience;
  while (::connect(fd, reinterpret_cast<const sockaddr*>(&address.name), address.length) != 0) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(kListenPoll);
  }
  return true;
}

/// Who listens there, as the kernel has it: nobody can give somebody else's name. Empty: it does not say.
std::string holder_of(const Address& address) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return {};
  std::string who;
  ucred peer{};
  socklen_t length = sizeof peer;
  if (connected(fd, address) && ::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &length) == 0) {
    std::string program;
    std::getline(std::ifstream("/proc/" + std::to_string(peer.pid) + "/comm"), program);
    who = "process " + std::to_string(peer.pid) + (program.empty() ? "" : " (" + base::printable(program) + ")") +
          " of user " + name_of_user(peer.uid);
    if (peer.uid != 0 && peer.uid != ::geteuid())
      who += ", who is neither you nor root: ask whether it is a daemon at all";
  }
  ::close(fd);
  return who;
}

}  // namespace

DeviceClaim::DeviceClaim(const std::string& device) {
  const auto address = address_of(device);
  // A stream that listens, for the kernel tells whoever connects to it which process and user that is.
  fd_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd_ >= 0 && ::bind(fd_, reinterpret_cast<const sockaddr*>(&address.name), address.length) == 0 &&
      ::listen(fd_, 8) == 0)
    return;
  const int why = errno;
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  if (why == EADDRINUSE) {
    const auto holder = holder_of(address);
    throw std::runtime_error("another isorigd on this machine drives the " + device +
                             (holder.empty() ? "" : ": " + holder) +
                             "; stop it first (pgrep -a isorigd), a rig has one daemon");
  }
  throw std::runtime_error("the " + device + " cannot be claimed: " + std::strerror(why));
}

DeviceClaim::~DeviceClaim() {
  if (fd_ >= 0) ::close(fd_);
}

DeviceClaim::DeviceClaim(DeviceClaim&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

}  // namespace isorig::daemon
