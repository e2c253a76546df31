#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

namespace isorig::sim {

/// std::system_error of errno.
[[noreturn]] void throw_errno(const std::string& what);

/// A file descriptor that is closed with its owner.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(other.release()) {}
  Fd& operator=(Fd&& other) noexcept {
    if (this != &other) {
      reset();
      fd_ = other.release();
    }
    return *this;
  }
  ~Fd() { reset(); }
  void reset() noexcept;
  [[nodiscard]] int release() noexcept { return std::exchange(fd_, -1); }
  [[nodiscard]] int get() const noexcept { return fd_; }
  explicit operator bool() const noexcept { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

/// Wakes the emulator's thread out of poll() for good.
class StopEvent {
 public:
  StopEvent();
  void raise() noexcept;
  [[nodiscard]] int fd() const noexcept { return fd_.get(); }  ///< readable once raised

 private:
  Fd fd_;
};

struct Listener {
  Fd fd;  ///< non-blocking
  std::uint16_t port = 0;
};
/// Listens on an IPv4 address; port 0: a free one. Throws std::runtime_error.
[[nodiscard]] Listener listen_on(const std::string& address, std::uint16_t port);

/// A serial line: the emulator's side, and the device file that a driver opens.
struct PseudoTerminal {
  Fd master;  ///< non-blocking
  Fd slave;   ///< without it the master hangs up between clients, and reports so once it was open
  std::string path;
};
/// `raw`: what arrives before a client sets its own mode is not echoed to it. Throws std::runtime_error.
[[nodiscard]] PseudoTerminal open_pseudo_terminal(bool raw);
/// `link` names the device file from now on, in one step: whoever tries at this moment finds the old or the new one.
/// Throws std::runtime_error.
void link_to(const std::string& path, const std::string& link);

/// The line of a device that has one client: a TCP port, or a pseudo-terminal behind a link. A TCP client that comes
/// takes the place of the one before, whose connection may hang for ever.
class ClientLine {
 public:
  /// TCP. Throws std::runtime_error.
  ClientLine(const std::string& address, std::uint16_t port);
  /// A pseudo-terminal. Throws std::runtime_error.
  explicit ClientLine(std::string pty_link);
  ~ClientLine();  ///< removes the link
  ClientLine(const ClientLine&) = delete;
  ClientLine& operator=(const ClientLine&) = delete;

  /// For poll(); negative, which poll() skips, where there is none.
  [[nodiscard]] int listener() const noexcept { return listener_.get(); }
  [[nodiscard]] int fd() const noexcept { return line_.get(); }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }     ///< 0 of a pseudo-terminal
  [[nodiscard]] const std::string& tty() const noexcept { return tty_; }  ///< empty of TCP
  /// Takes the client that waits, or closes it at once when `refused`. True when a new one is there.
  bool accept(bool refused);
  /// Hangs up; a pseudo-terminal stays.
  void drop() noexcept;
  /// One write, of all or part, as the system takes it; -1 when there is nobody.
  [[nodiscard]] std::ptrdiff_t send(const void* bytes, std::size_t size) const noexcept;

 private:
  Fd listener_, line_;
  Fd slave_;  // PseudoTerminal::slave
  std::uint16_t port_ = 0;
  std::string tty_, pty_link_;
};

}  // namespace isorig::sim
