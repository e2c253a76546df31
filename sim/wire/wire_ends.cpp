#include "sim/wire/wire_ends.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <system_error>

namespace isorig::sim {

void throw_errno(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

void Fd::reset() noexcept {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

StopEvent::StopEvent() : fd_(::eventfd(0, EFD_CLOEXEC)) {
  if (!fd_) throw_errno("no descriptor");
}

void StopEvent::raise() noexcept {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = ::write(fd_.get(), &one, sizeof one);
}

Listener listen_on(const std::string& address, std::uint16_t port) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  if (::inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) {
    throw std::runtime_error("`" + address + "` is no IPv4 address");
  }
  Listener out;
  out.fd = Fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int on = 1;
  ::setsockopt(out.fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  socklen_t size = sizeof to;
  auto* generic = reinterpret_cast<sockaddr*>(&to);
  if (::bind(out.fd.get(), generic, size) != 0 || ::listen(out.fd.get(), 4) != 0 ||
      ::getsockname(out.fd.get(), generic, &size) != 0) {
    throw_errno("cannot listen on " + address + ":" + std::to_string(port));
  }
  out.port = ntohs(to.sin_port);
  return out;
}

PseudoTerminal open_pseudo_terminal(bool raw) {
  PseudoTerminal out;
  out.master = Fd(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  std::array<char, 128> name{};
  if (!out.master || ::grantpt(out.master.get()) != 0 || ::unlockpt(out.master.get()) != 0 ||
      ::ptsname_r(out.master.get(), name.data(), name.size()) != 0) {
    throw_errno("no pseudo-terminal");
  }
  out.path = name.data();
  out.slave = Fd(::open(out.path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (!out.slave) throw_errno(out.path);
  if (raw) {
    termios mode{};
    if (::tcgetattr(out.slave.get(), &mode) != 0) throw_errno(out.path);
    ::cfmakeraw(&mode);
    ::tcsetattr(out.slave.get(), TCSANOW, &mode);
  }
  return out;
}

void link_to(const std::string& path, const std::string& link) {
  const std::string fresh = link + ".new";
  ::unlink(fresh.c_str());
  if (::symlink(path.c_str(), fresh.c_str()) != 0 || std::rename(fresh.c_str(), link.c_str()) != 0) {
    throw_errno("cannot link " + link);
  }
}

ClientLine::ClientLine(const std::string& address, std::uint16_t port) {
  auto listener = listen_on(address, port);
  listener_ = std::move(listener.fd);
  port_ = listener.port;
}

ClientLine::ClientLine(std::string pty_link) : pty_link_(std::move(pty_link)) {
  auto pty = open_pseudo_terminal(true);
  link_to(pty.path, pty_link_);
  line_ = std::move(pty.master);
  slave_ = std::move(pty.slave);
  tty_ = pty.path;
}

ClientLine::~ClientLine() {
  if (!pty_link_.empty()) ::unlink(pty_link_.c_str());
}

bool ClientLine::accept(bool refused) {
  Fd client(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (!client || refused) return false;
  const int on = 1;
  ::setsockopt(client.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  line_ = std::move(client);
  return true;
}

void ClientLine::drop() noexcept {
  if (listener_) line_.reset();
}

std::ptrdiff_t ClientLine::send(const void* bytes, std::size_t size) const noexcept {
  return listener_ ? ::send(line_.get(), bytes, size, MSG_NOSIGNAL) : ::write(line_.get(), bytes, size);
}

}  // namespace isorig::sim
