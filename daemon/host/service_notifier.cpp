#include "daemon/host/service_notifier.hpp"

#include <unistd.h>

#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace isorig::daemon {
namespace {

template <typename Number>
std::optional<Number> number_in(const char* text) {
  if (text == nullptr) return std::nullopt;
  Number value{};
  const char* end = text + std::strlen(text);
  const auto [rest, error] = std::from_chars(text, end, value);
  if (error != std::errc() || rest != end || value < 0) return std::nullopt;
  return value;
}

/// A line break would begin another assignment.
std::string one_line(std::string_view text) {
  std::string line(text);
  for (char& c : line) {
    if (c == '\n' || c == '\r') c = ' ';
  }
  return line;
}

}  // namespace

ServiceNotifier ServiceNotifier::from_environment() {
  const char* named = std::getenv("NOTIFY_SOCKET");
  const std::string socket = named == nullptr ? "" : named;
  // The watchdog may be meant for another process: a wrapper that started this one.
  const auto pid = number_in<long>(std::getenv("WATCHDOG_PID"));
  const auto limit_us = number_in<std::int64_t>(std::getenv("WATCHDOG_USEC"));
  const bool for_us = limit_us && (!pid || *pid == static_cast<long>(::getpid()));
  for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_PID", "WATCHDOG_USEC"}) ::unsetenv(name);
  return ServiceNotifier(socket, for_us ? *limit_us * 1000 : 0);
}

ServiceNotifier::ServiceNotifier(std::string_view socket, std::int64_t watchdog_ns) {
  if (socket.empty()) return;
  if ((socket.front() != '/' && socket.front() != '@') || socket.size() < 2 ||
      socket.size() >= sizeof address_.sun_path) {
    throw std::runtime_error("NOTIFY_SOCKET=" + std::string(socket) +
                             " is neither a path nor an abstract name (@...) of a Unix socket; unset it, or start "
                             "isorigd by a service manager");
  }
  address_.sun_family = AF_UNIX;
  std::memcpy(address_.sun_path, socket.data(), socket.size());
  // A path counts with its final zero; an abstract name begins with one and counts without.
  const bool abstract = socket.front() == '@';
  if (abstract) address_.sun_path[0] = '\0';
  address_length_ = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket.size() + (abstract ? 0U : 1U));
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd_ < 0)
    throw std::runtime_error(std::string("no socket to notify the service manager: ") + std::strerror(errno));
  watchdog_ns_ = watchdog_ns;
}

ServiceNotifier::~ServiceNotifier() {
  if (fd_ >= 0) ::close(fd_);
}

ServiceNotifier::ServiceNotifier(ServiceNotifier&& other) noexcept
    : address_(other.address_),
      address_length_(other.address_length_),
      fd_(std::exchange(other.fd_, -1)),
      watchdog_ns_(other.watchdog_ns_),
      last_status_(std::move(other.last_status_)) {}

bool ServiceNotifier::send(std::string_view assignments) noexcept {
  if (fd_ < 0) return false;
  return ::sendto(fd_, assignments.data(), assignments.size(), MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&address_),
                  address_length_) == static_cast<ssize_t>(assignments.size());
}

void ServiceNotifier::ready(std::string_view status) {
  last_status_ = one_line(status);
  send("READY=1\nSTATUS=" + last_status_);
}

void ServiceNotifier::status(std::string_view text) {
  if (auto line = one_line(text); line != last_status_) {
    last_status_ = std::move(line);
    send("STATUS=" + last_status_);
  }
}

void ServiceNotifier::stopping(std::string_view status) {
  last_status_ = one_line(status);
  send("STOPPING=1\nSTATUS=" + last_status_);
}

bool WatchdogFeeder::turn() noexcept {
  const std::uint32_t beat = loop_beat_.load(std::memory_order_acquire);
  if (last_beat_ && *last_beat_ == beat) return false;
  const bool first = !last_beat_;
  last_beat_ = beat;
  // The first look proves nothing yet: only a beat that changed does.
  if (first) return false;
  // Sent again at the next turn if the manager's queue was full: the limit is four turns long.
  return notifier_.send("WATCHDOG=1");
}

}  // namespace isorig::daemon
