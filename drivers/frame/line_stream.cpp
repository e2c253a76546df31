#include "drivers/frame/line_stream.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "drivers/error.hpp"
#include "drivers/tcp_connect.hpp"

namespace isorig::frame {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr std::size_t kLongestLine = 256;
constexpr int kWriteTimeout_ms = 100;

speed_t speed_of(int baud) {
  constexpr std::array<std::pair<int, speed_t>, 12> kSpeeds{{{1200, B1200},
                                                             {2400, B2400},
                                                             {4800, B4800},
                                                             {9600, B9600},
                                                             {19200, B19200},
                                                             {38400, B38400},
                                                             {57600, B57600},
                                                             {115200, B115200},
                                                             {230400, B230400},
                                                             {460800, B460800},
                                                             {500000, B500000},
                                                             {921600, B921600}}};
  for (const auto& [number, speed] : kSpeeds) {
    if (number == baud) return speed;
  }
  return B0;
}

bool wait_for(int fd, short events, std::int64_t timeout_ns) {
  pollfd waiting{fd, events, 0};
  const std::int64_t wait_ns = std::max<std::int64_t>(timeout_ns, 0);
  const timespec timeout{static_cast<time_t>(wait_ns / 1'000'000'000), static_cast<long>(wait_ns % 1'000'000'000)};
  return ::ppoll(&waiting, 1, &timeout, nullptr) > 0;
}

}  // namespace

void LineStream::fail_disconnected(const std::string& what) {
  close();
  throw DeviceError(Fault::kDisconnected, options_.name + ": " + what);
}

void LineStream::open() {
  close();
  if (options_.tcp) {
    fd_ = drivers::connect_tcp(options_.host, options_.port, options_.connect_timeout_ms, options_.name);
  } else {
    open_tty();
  }
  received_.clear();
}

void LineStream::open_tty() {
  fd_ = ::open(options_.tty.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) {
    const int error = errno;
    if (error == EACCES || error == EPERM) {
      throw DeviceError(Fault::kRefused, options_.name + ": no permission; serial devices belong to the group `dialout`");
    }
    fail_disconnected(std::string("cannot open (") + std::strerror(error) + "); is the adapter plugged in?");
  }
  termios tio{};
  const speed_t speed = speed_of(options_.baud);
  bool good = tcgetattr(fd_, &tio) == 0 && speed != B0;
  if (good) {
    cfmakeraw(&tio);
    tio.c_cflag |= CLOCAL | CREAD;
    tio.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | PARENB | PARODD | CSTOPB);
    if (options_.parity != 'N') tio.c_cflag |= PARENB;
    if (options_.parity == 'O') tio.c_cflag |= PARODD;
    if (options_.stop_bits == 2) tio.c_cflag |= CSTOPB;
    tio.c_cc[VMIN] = 1;  // an empty line then reads EAGAIN, and 0 means hung up
    tio.c_cc[VTIME] = 0;
    good = cfsetspeed(&tio, speed) == 0 && tcsetattr(fd_, TCSANOW, &tio) == 0;
  }
  if (!good) fail_disconnected("cannot be set to " + std::to_string(options_.baud) + " baud; is it a serial device?");
  if (ioctl(fd_, TIOCEXCL) != 0 || flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    fail_disconnected("another program has it open; `fuser -v " + options_.tty + "` names it");
  }
  tcflush(fd_, TCIOFLUSH);
}

void LineStream::close() noexcept {
  if (fd_ < 0) return;
  if (!options_.tcp) {
    // A stop that was just written still goes out: only the input is thrown away. What a dead adapter does not take
    // is flushed, since close() would wait for it.
    tcflush(fd_, TCIFLUSH);
    int pending = 0;
    for (int tries = 0; tries < 20 && ioctl(fd_, TIOCOUTQ, &pending) == 0 && pending > 0; ++tries) ::usleep(5'000);
    if (pending > 0) tcflush(fd_, TCOFLUSH);
    (void)ioctl(fd_, TIOCNXCL);  // a pty keeps it as long as its other side is open
    (void)flock(fd_, LOCK_UN);
  }
  ::close(fd_);
  fd_ = -1;
}

void LineStream::write_line(std::string_view line) {
  if (fd_ < 0) fail_disconnected("not connected");
  std::string bytes(line);
  bytes += "\r\n";
  std::string_view left = bytes;
  while (!left.empty()) {
    const ssize_t size = options_.tcp ? ::send(fd_, left.data(), left.size(), MSG_NOSIGNAL) : ::write(fd_, left.data(), left.size());
    if (size > 0) {
      left.remove_prefix(static_cast<std::size_t>(size));
      continue;
    }
    if (size < 0 && errno != EAGAIN && errno != EINTR) fail_disconnected(std::string("connection lost (") + std::strerror(errno) + ")");
    if (!wait_for(fd_, POLLOUT, std::int64_t{kWriteTimeout_ms} * 1'000'000)) {
      // Half a line may have gone: whatever is sent next would be glued to it.
      fail_disconnected("takes no more data");
    }
  }
}

void LineStream::fill(std::int64_t until_ns) {
  if (fd_ < 0) fail_disconnected("not connected");
  if (!wait_for(fd_, POLLIN, until_ns - clock_.now_ns())) return;
  std::array<char, 512> bytes{};
  const ssize_t size = ::read(fd_, bytes.data(), bytes.size());
  received_ns_ = clock_.now_ns();
  if (size > 0) {
    received_.append(bytes.data(), static_cast<std::size_t>(size));
  } else if (size == 0) {
    fail_disconnected("connection closed by the other side");
  } else if (errno != EAGAIN && errno != EINTR) {
    fail_disconnected(std::string("connection lost (") + std::strerror(errno) + ")");
  }
}

std::optional<LineStream::Line> LineStream::read_line(std::int64_t until_ns) {
  bool looked = false;
  for (;;) {
    if (const auto end = received_.find('\n'); end != std::string::npos) {
      Line line{received_.substr(0, end), received_ns_};
      received_.erase(0, end + 1);
      if (!line.text.empty() && line.text.back() == '\r') line.text.pop_back();
      return line;
    }
    if (received_.size() > kLongestLine) {
      received_.clear();
      throw DeviceError(Fault::kProtocol, options_.name + ": what comes in has no lines; check baud, parity and what is connected");
    }
    if (looked && clock_.now_ns() >= until_ns) return std::nullopt;
    fill(until_ns);
    looked = true;
  }
}

bool LineStream::discard_input() {
  bool any = !received_.empty();
  received_.clear();
  for (;;) {
    fill(0);
    if (received_.empty()) return any;
    any = true;
    received_.clear();
  }
}

}  // namespace isorig::frame
